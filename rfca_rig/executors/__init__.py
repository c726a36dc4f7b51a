"""Who carries out many simulations: this process, processes of this machine, a cluster. Entry point: `mapping.map_unordered`.

`base` defines an executor; `local`, `cluster` (Dask) and `slurm` are the kinds. `environment` makes sure that workers compute the same.
"""
