"""Expected log evidence of an experiment between the open hypotheses.

If k is true, the log evidence that a new recording is expected to give it over l is

    1/2 (f_k - f_l)^T C_l^-1 (f_k - f_l),   C_l = (D + B B^T) / r + s^2 K + J_l P_l J_l^T

- f: the rows that each hypothesis predicts at its fitted point
- D: the noise of one repeat
- B: the scatter from repeat to repeat, and r the number of repeats
- s^2 K: a usual model error
- J_l P_l J_l^T: the change that the parameters of l may still make, given the recordings so far

References
----------
Box and Hill, Technometrics 9 (1967) 57.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from rfca_rig.diagnosis.config import USUAL_ERROR, WIDE_STEP
from rfca_rig.diagnosis.data.dataset import Dataset
from rfca_rig.diagnosis.experiment_design.open_hypotheses import OpenHypotheses
from rfca_rig.diagnosis.leg.simulator import select_strokes
from rfca_rig.diagnosis.likelihood.covariance import discrepancy_covariance
from rfca_rig.diagnosis.simulator import ConditionData

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ExpectedInformation:
    """One experiment as the n open hypotheses predict it.

    Parameters
    ----------
    hypotheses
        The open hypotheses.
    dataset
        The experiment as its only condition.
    predicted
        (n, m) the rows of each hypothesis.
    noise
        (m,) standard deviation of one repeat.
    model_error
        (m, m) covariance of a usual model error.
    """

    hypotheses: OpenHypotheses
    dataset: Dataset
    predicted: Floats
    noise: Floats
    model_error: Floats

    def bound(self, repeats: int) -> Floats:
        """Upper bound (n, n) of `expect`: no parameter may change, and repeats do not scatter."""
        return self._compare(np.diag(self.noise**2) / repeats, [np.zeros((len(self.noise), 0))] * len(self.predicted))

    def expect(self, repeats: Sequence[int]) -> list[Floats] | None:
        """Expected log evidence, (n, n) per number of repeats: of the row over the column if the row is true.

        None where a model has no answer.
        """
        jacobians = self._jacobians()
        if jacobians is None:
            return None
        scatter = self._scatter(jacobians[0])
        of_one = np.diag(self.noise**2) + scatter @ scatter.T
        roots = [np.linalg.cholesky(hypothesis.marginal.posterior.covariance) for hypothesis in self.hypotheses.open]
        moves = [jacobian @ root for jacobian, root in zip(jacobians, roots, strict=True)]
        return [self._compare(of_one / count, moves) for count in repeats]

    @property
    def load(self) -> float:
        """The largest value that would be recorded, in the unit of its signal."""
        return float(np.abs(self.predicted).max())

    def _compare(self, of_mean: Floats, moves: Sequence[Floats]) -> Floats:
        """`of_mean` (m, m) is the covariance of the mean over repeats, `moves` (m, p) a root of what each hypothesis may still change."""
        factor = cholesky(of_mean + self.model_error, lower=True)
        predicted, *white = (solve_triangular(factor, rows, lower=True) for rows in (self.predicted.T, *moves))
        # Woodbury: C_l is whitened without the parameters, and their part is subtracted as a (p, p) system.
        columns = []
        for k, own in enumerate(white):
            difference = predicted - predicted[:, [k]]
            along = own.T @ difference
            explained = along * np.linalg.solve(np.eye(len(along)) + own.T @ own, along)
            columns.append(0.5 * ((difference**2).sum(axis=0) - explained.sum(axis=0)))
        return np.column_stack(columns)

    def _jacobians(self) -> list[Floats] | None:
        """Jacobian (m, p) of each hypothesis. All share the columns of the nuisance parameters, since all fits lie near the first."""
        fits = [hypothesis.fitted for hypothesis in self.hypotheses.open]
        shared = fits[0].coordinates.nuisances
        places = [(0, i) for i in range(shared)] + [(k, i) for k, fit in enumerate(fits) for i in range(shared, fit.coordinates.size)]
        # Towards the middle of the prior, where the model has an answer.
        steps = [-WIDE_STEP if fits[k].x[i] > 0.0 else WIDE_STEP for k, i in places]
        points = [fits[k].x + step * (np.arange(len(fits[k].x)) == i) for (k, i), step in zip(places, steps, strict=True)]
        moved = self.dataset.predict_all([fits[k].coordinates.supposed(x) for (k, _), x in zip(places, points, strict=True)])
        columns = {}
        for (k, i), step, rows in zip(places, steps, moved, strict=True):
            if rows is None:
                return None
            columns[k, i] = (rows - self.predicted[k]) / step
        own = [[columns[0 if i < shared else k, i] for i in range(fit.coordinates.size)] for k, fit in enumerate(fits)]
        return [np.reshape(each, (-1, len(self.noise))).T for each in own]

    def _scatter(self, jacobian: Floats) -> Floats:
        """B (m, k), from the columns of the Jacobian of all nuisance parameters.

        A recorded start angle is simulated, so it does not scatter.
        """
        std = dict(self.hypotheses.found.scatter.std)
        if "start_angle" in std and all(flap.turn.start_rad is not None for flap in select_strokes(self.dataset.parts)):
            del std["start_angle"]
        space = self.hypotheses.open[0].fitted.coordinates.space
        share = np.array([std.get(name, 0.0) for name in space.names]) / space.prior_std
        return jacobian[:, : len(share)] * share


def predict_information(hypotheses: OpenHypotheses, condition: ConditionData) -> ExpectedInformation | None:
    """Predictions of all hypotheses for a condition that is not recorded yet; None where one of them has no answer."""
    rows = condition.rows()
    dataset = Dataset((condition,), rows, hypotheses.found.dataset.simulator)
    found = dataset.predict_all([h.fitted.coordinates.supposed(h.fitted.x) for h in hypotheses.open])
    if any(answer is None for answer in found):
        return None
    return ExpectedInformation(hypotheses, dataset, np.array(found), rows.noise, USUAL_ERROR**2 * discrepancy_covariance(rows))
