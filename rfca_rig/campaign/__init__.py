"""Recordings from other sources. Entry points: `opening.open_recordings` for the leg,
`experiment.read_experiment` for any mechanism.

`layout` describes the files; `reading` and `recorded_files` read tables, HDF5, MCAP and ROS 2 bags.
"""
