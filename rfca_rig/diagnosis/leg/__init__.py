"""The leg as a problem of the diagnosis. Entry point: `problem.LegProblem`.

1. `prepared` makes conditions of recordings; `strokes`, `stages` and `shaft_observations` hold one
   kind of condition each. `simulator` holds the parameters with priors, predicts all conditions and
   infers the approach path of a static table.
2. `problem` searches the forces for what the leg, floor and sensor lack, and `drive_search` the
   motion of the shaft for what the drive lacks.
3. `left_out` predicts conditions that were left out, with the shaft as commanded.
4. `result` makes one answer of both searches (`findings`), and `model_files` writes the model.
"""
