"""Any mechanism of hinges and slides that MuJoCo simulates, as a problem of the diagnosis. Entry
point: `problem.MechanismProblem`.

1. `prepared` cuts the recordings into windows; `windows` makes conditions of them and predicts
   them, and `nuisances` holds the parameters with priors. The effects are those of
   `rfca_rig.mechanism.effects`.
2. `problem` searches them, in windows that become as long as the recordings allow, and
   `model_files` writes the model with what is stated.
3. `joint_law` measures a law that no effect describes; `fit` fits nominal values, and compares
   simulation and recordings for a report.

`check` and `readings` find signs and units that are probably wrong, for the command `check` too.
"""
