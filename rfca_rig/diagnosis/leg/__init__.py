"""The leg as a simulator of the diagnosis. Entry point: `simulator.make_leg_dataset`.

`strokes`, `stages` and `shaft_observations` hold one kind of condition each. `simulator` holds the
parameters with priors, predicts all conditions and infers the approach path of a static table.
"""
