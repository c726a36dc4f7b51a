"""How probable the observations are under one hypothesis. Entry point: `marginal_likelihood.make_marginal_likelihood`.

`covariance` (noise, discrepancy, repeat scatter) -> `laplace` (linear model, posterior) -> `marginal_likelihood` (discrepancy scale
integrated out); `repeat_scatter` estimates what differs from repeat to repeat, `cross_validation` leaves conditions out.
"""
