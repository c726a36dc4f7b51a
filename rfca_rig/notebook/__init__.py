"""The program as a library, for scripts and notebooks. Entry point: `import rfca_rig as rr`, which
lists the names.

Nothing here prints or ends the process; what cannot be done raises an error of `rfca_rig.errors`.
The order of work:

1. `rig`: a rig file, and what its model predicts of a stroke.
2. `experiments`: a plan, and a run on the twin.
3. `recordings`: recordings as xarray datasets and pandas tables.
4. `analyses`: report, fit and diagnosis of recordings.

`display` holds what all results share: tables, pictures, progress bars.
"""
