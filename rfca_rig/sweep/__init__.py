"""Sweeps: any parameters of the model over grids or samples, with any outputs. Entry point:
`carrying_out.run_sweep`.

1. `sweep_file` reads what is asked for, with `quantities` and `outputs`, into a `plan`, which draws
   its points.
2. `plan.claim_folder` ties a folder to the plan; `carrying_out` sends ranges of `cases` to an
   executor, which evaluates `outputs` of them.
3. `result` is the whole as one table.
"""
