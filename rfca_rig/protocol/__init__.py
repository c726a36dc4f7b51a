"""What is to be done, as data. Entry points: `written_plan.plan_of` and `check.check_plan`.

A protocol becomes a `plan` of stages; `check` holds the loads that a model predicts against the limits; `cycles` are stages of many turns.
"""
