"""Recordings exported to formats of other programs: CSV, MCAP, and a leg as an MJCF experiment.
One module for each format. The model of a leg as an FMU: `fmu`, with the modules `fmu_*`.
"""
