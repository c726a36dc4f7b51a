"""The diagnosis of driven chains without ground. Entry points: `diagnose.diagnose_pendulum` and
`windows.fit_pendulum`.

`windows` holds the conditions and predicts them; `diagnose` lists the effects that may be missing
and proposes the next experiment.
"""
