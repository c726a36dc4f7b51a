"""The search over hypotheses. Entry point: `model_selection.search_models`.

`parameterization` and the nuisance parameters define the unknowns. `map_fit` finds the best point
of one hypothesis, `screening` probes every effect, and `hypotheses` weighs the results.
"""
