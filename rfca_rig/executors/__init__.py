"""Parallel execution of many simulations: in this process, in local processes, or on a cluster. Entry point: `mapping.map_unordered`.

`mapping.TaskExecutor` is the interface; `mapping` (local processes), `cluster` (Dask) and `slurm` implement it.
`environment` checks that all workers compute the same.
"""
