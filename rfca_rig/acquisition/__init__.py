"""Acquisition of a fast sensor in a separate process, so that no delay of this process can lose a
record.

Entry point: `acquired.AcquiredDatagrams`, which starts the process and reads what that writes into
a `ring` of shared memory.
"""
