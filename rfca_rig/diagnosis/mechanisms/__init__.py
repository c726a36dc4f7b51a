"""The diagnosis of any mechanism of hinges and slides that MuJoCo simulates. Entry point:
`diagnose.diagnose_mechanism`.

`problem` cuts the recordings into windows, `windows` makes conditions of them and predicts them,
and `nuisances` holds the parameters with priors. The effects are those of
`rfca_rig.mechanism.effects`.

`check.check_experiment`, `fit.fit_mechanism` and `fit.compare_mechanism` are behind the commands
`check`, `fit` and `report`. `check` and `readings` find signs and units that are probably wrong.
"""
