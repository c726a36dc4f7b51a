"""The command line. Entry point: `main.run`.

`commands` has the commands, in a package per panel of the help. Run commands share, in order: `run_config` (the options), `preflight` (the
plan checked and printed), `run_experiment` (armed, run, recorded), `finalize_run` (the recording closed).
"""
