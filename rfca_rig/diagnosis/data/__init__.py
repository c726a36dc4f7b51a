"""Recordings of any kind of rig as observations. Entry point: `dataset.make_dataset`.

`observations` holds the rows of conditions; `dataset` joins them with the simulator that predicts them.
"""
