"""Log evidence of the observations under one hypothesis. Entry point: `marginal_likelihood.make_marginal_likelihood`.

`covariance` (noise, discrepancy, repeat scatter) -> `marginal_likelihood` (linear model, posterior, discrepancy scale
integrated out). `repeat_scatter` estimates how much repeats differ, and `cross_validation` predicts held-out conditions.
"""
