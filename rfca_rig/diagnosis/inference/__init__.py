"""The search over hypotheses. Entry point: `model_selection.search_models`.

`parameterization` and the nuisances define the unknowns; `map_fit` finds the best point of one hypothesis; `screening` probes every
effect; `continuation` (truncated conditions) and `nuisance_swap` provide further starts; `hypotheses` weighs what was found.
"""
