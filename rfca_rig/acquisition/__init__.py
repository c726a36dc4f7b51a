"""Acquisition of a fast sensor in a separate process, so that no delay of this process can lose a record."""
