"""The leg as a simulator of the diagnosis. Entry point: `simulator.leg_dataset`.

`strokes`, `stages` and `shaft_observations` hold one kind of condition each; `nuisances` the parameters with priors; `simulator`
predicts all of them and infers how a static table was approached; `drive_tracking` says which drives the recorded shaft excludes.
"""
