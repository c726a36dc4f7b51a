"""The command line. Entry point: `main.run`.

`commands` has the commands. Run commands share, in order: `run_config` (the options),
`run_experiment` (the plan checked and printed, then armed, run, recorded), `finalize_run` (the
recording closed).
"""
