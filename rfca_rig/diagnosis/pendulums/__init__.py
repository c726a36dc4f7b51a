"""Pendulums as simulators of the diagnosis. Entry point: `windows.pendulum_dataset`.

`windows` holds their conditions and predicts them; `nuisances` the parameters with priors.
"""
