"""What differs between recordings of one command: the covariance of held-out residuals.

The residual of a recording, held out and predicted by the mean of its repeats, has two parts:

- scatter of the nuisance parameters, as of a supply voltage: all rows of the recording move
  together
- a smooth error like the discrepancy, with a share of its size

Both are estimated by maximum likelihood: the share on a grid, the scatter by expectation
maximisation at each point of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data import Observations
from rfca_rig.diagnosis.likelihood.covariance import DiscrepancyWhitening, make_basis
from rfca_rig.diagnosis.reference.matching import Match

Floats = NDArray[np.float64]

# Grid of the size of the smooth error, as a share of the signals; each is about 1.5 times the one
# before it.
REPEAT_ERRORS = (
    0.0005,
    0.0007,
    0.001,
    0.0015,
    0.002,
    0.003,
    0.005,
    0.0075,
    0.01,
    0.015,
    0.02,
    0.03,
    0.045,
    0.07,
)
EM_ROUNDS = 60
# Scatter, in prior standard deviations, of a parameter that the recordings hardly show, and how
# many recordings this counts as. Without it such a parameter keeps the value that the estimate
# begins with. With 0.1 instead of 0.03, servos of the benchmark no longer show friction that grew
# by 50 to 70 % (pairs 3 and 6 of seed 1): scatter of three repeats could be as large.
USUAL_SCATTER = 0.03
USUAL_COUNT = 1.0


@dataclass(frozen=True)
class RepeatError:
    """How recordings of one command differ.

    Parameters
    ----------
    std
        (n,) standard deviations of the nuisance parameters from recording to recording, in units of
        the prior's `std`.
    error
        Size of the smooth error of a single recording, as a share of the signals.
    spare
        Recordings beyond the first of each command, on which both rest.
    """

    std: Floats
    error: float
    spare: int


def estimate_repeat_error(
    rows: Observations, residuals: Floats, jacobian: Floats, groups: Sequence[Sequence[Match]]
) -> RepeatError | None:
    """The differences between the recordings of each group; None where no command was repeated.

    Parameters
    ----------
    rows
        The reference.
    residuals
        (m,) measured less predicted.
    jacobian
        (m, n) derivatives of the predictions with respect to the nuisance parameters, in units of
        the prior's `std`.
    groups
        As `matching.find_repeats` gives them.
    """
    if not groups:
        return None
    spare = sum(len(group) - 1 for group in groups)
    best = None
    for error in REPEAT_ERRORS:
        std, log_likelihood = _estimate_at(error, rows, residuals, jacobian, groups)
        if best is None or log_likelihood > best[0]:
            best = (log_likelihood, std, error)
    assert best is not None
    # A variance from few repeats may be far too small by chance; its mean over the posterior with
    # a flat prior of the log deviation is larger by this factor (Gelman et al., Bayesian Data
    # Analysis, section 3.2).
    widening = float(np.sqrt((spare + 2.0) / spare))
    return RepeatError(best[1] * widening, best[2] * widening, spare)


def _estimate_at(
    error: float,
    rows: Observations,
    residuals: Floats,
    jacobian: Floats,
    groups: Sequence[Sequence[Match]],
) -> tuple[Floats, float]:
    """Scatter (n,) with a smooth error of this size, and the log likelihood there."""
    deviations = []
    log_det = 0.0
    for group in groups:
        basis = make_basis(rows.take(group[0].rows), np.empty((len(group[0].rows), 0)))
        whitening = DiscrepancyWhitening(basis, error)
        of_group = np.array([residuals[match.rows] for match in group])
        slope = whitening(np.mean([jacobian[match.rows] for match in group], axis=0))
        # The mean uses one degree of freedom; the factor restores the variance of one recording.
        factor = np.sqrt(len(group) / (len(group) - 1.0))
        for deviation in factor * (of_group - of_group.mean(axis=0)):
            # Each of R deviations carries the information of (R - 1) / R recordings.
            share = (len(group) - 1.0) / len(group)
            deviations.append((slope, slope.T @ whitening(deviation), whitening(deviation), share))
            log_det += share * whitening.log_det
    std = np.ones(jacobian.shape[1])
    for _ in range(EM_ROUNDS):
        squares = np.zeros(len(std))
        total = 0.0
        for slope, match, _, share in deviations:
            covariance = np.linalg.inv(std[:, None] * (slope.T @ slope) * std + np.eye(len(std)))
            mean = std * (covariance @ (std * match))
            squares += share * (mean**2 + std**2 * np.diag(covariance))
            total += share
        usual = USUAL_COUNT * USUAL_SCATTER**2
        std = np.sqrt((squares + usual) / (total + USUAL_COUNT))
    log_likelihood = -0.5 * log_det
    for slope, match, white, share in deviations:
        precision = std[:, None] * (slope.T @ slope) * std + np.eye(len(std))
        taken = (std * match) @ np.linalg.solve(precision, std * match)
        determinant = float(np.linalg.slogdet(precision)[1])
        log_likelihood -= 0.5 * share * float(white @ white - taken + determinant)
    return std, log_likelihood
