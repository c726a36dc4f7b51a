"""Recordings as observations. Entry point: `dataset.make_dataset`.

`strokes`, `stages`, `shaft_observations` and `pendulum_windows` hold one kind of condition each; `observations` stacks their rows;
`static_history` infers how a static table was approached; `drive_tracking` says which drives the recorded shaft excludes.
"""
