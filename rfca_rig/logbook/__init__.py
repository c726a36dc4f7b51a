"""The logbook: every run below a folder, how it ended, and the result of its diagnosis."""
