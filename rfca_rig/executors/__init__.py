"""Parallel execution of many simulations: in this process, in local processes, or on a cluster.

Entry points: `mapping.map_unordered` for long work that may go to other machines,
`parallel.map_in_processes` and `map_in_threads` within one command.

`mapping.TaskExecutor` is the interface; `mapping` (local processes), `cluster` (Dask) and `slurm`
implement it. `environment` checks that all workers compute the same, `termination` that none
outlives the command.
"""
