"""A plan of experiments, as data. Entry points: `written_plan.parse_plan` and `check.check_plan`.

A protocol becomes a `plan` of stages. `check` compares the loads that a model predicts with the
limits. `cycles` are stages of many turns.
"""
