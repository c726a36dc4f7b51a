"""Log evidence of the observations under one hypothesis. Entry point:
`marginal_likelihood.make_marginal_likelihood`.

`covariance` (noise, discrepancy, scatter estimated from the repeats) -> `marginal_likelihood`
(linear model, posterior, discrepancy scale integrated out, held-out conditions).
"""
