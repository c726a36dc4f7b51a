"""The search over hypotheses. Entry point: `model_selection.search_models`.

`parameterization` and the nuisances define the unknowns; `map_fit` finds the best point of one hypothesis; `screening` probes every
effect; `hypotheses` weighs what was found.
"""
