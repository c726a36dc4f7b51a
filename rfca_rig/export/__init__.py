"""Recordings exported to formats of other programs: CSV, MCAP, and a leg as an MJCF experiment.
One module for each format.
"""
