"""The diagnosis of driven chains without ground. Entry points: `diagnose.diagnose_pendulum` and `fit.fit_pendulum`.

`windows` holds the conditions and predicts them, `nuisances` the parameters with priors, `candidates` the effects that may be missing.
"""
