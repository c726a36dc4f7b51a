"""Recordings from other sources. Entry points: `opening.open_recordings` for the leg, `experiment.read_experiment` for any mechanism.

`layout` and `experiment_layout` describe the files; `reading` and `recorded_files` read tables, HDF5, MCAP and ROS 2 bags.
"""
