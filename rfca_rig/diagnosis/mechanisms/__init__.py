"""The diagnosis of any mechanism of hinges and slides that MuJoCo simulates. Entry point: `diagnose.diagnose_mechanism`.

`problem` cuts the recordings into windows, `windows` makes conditions of them and predicts them, `nuisances` holds the parameters with
priors. The effects are those of `rfca_rig.mechanism.effects`.
"""
