"""By how much an experiment would tell rivals apart.

If k is true, the log evidence that a new recording is expected to give it over l is

    1/2 |C_l^(-1/2) (f_k - f_l)|^2,   C_l = D + s^2 K + B B^T / r + J_l P_l J_l^T,

with f the rows each rival predicts at its fitted point, D of the noise, s^2 K of a usual model error, B what differs from stroke to
stroke, and J_l P_l J_l^T what l may still move after the recordings there are (Box and Hill, Technometrics 9 (1967) 57).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cholesky, solve_triangular

from rfca_rig.diagnosis.config import USUAL_ERROR
from rfca_rig.diagnosis.data.dataset import Dataset
from rfca_rig.diagnosis.experiment_design.open_hypotheses import OpenHypotheses
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis
from rfca_rig.diagnosis.leg.simulator import flaps_of
from rfca_rig.diagnosis.likelihood.covariance import discrepancy
from rfca_rig.diagnosis.simulator import ConditionData

Floats = NDArray[np.float64]

STEP = 0.3  # of a prior deviation
START = "start_angle"


@dataclass(frozen=True)
class ExpectedInformation:
    """One experiment under all rivals: `predicted` (n, m), and without repeats `noise` (m,) and the model error's covariance (m, m)."""

    contest: OpenHypotheses
    evidence: Dataset
    predicted: Floats
    noise: Floats
    model_error: Floats

    def at_most(self, repeats: int) -> Floats:
        """An upper bound of `expected`: no rival may move, all strokes are alike."""
        return self._gained(repeats, [np.zeros((len(self.noise), 0))] * len(self.predicted))

    def expected(self, repeats: Sequence[int]) -> list[Floats] | None:
        """Expected log evidence (n, n) of row over column where row is true, for each number of repeats; None where a rival cannot move."""
        slopes = self._slopes()
        if slopes is None:
            return None
        scatter = self._scatter(slopes[0])
        moved = [_moved(h, jacobian) for h, jacobian in zip(self.contest.open, slopes, strict=True)]
        return [self._gained(r, [np.column_stack([scatter / np.sqrt(r), m]) for m in moved]) for r in repeats]

    def _gained(self, repeats: int, extra_directions: Sequence[Floats]) -> Floats:
        """`loose` (m, q) of each column's rival are directions in which its rows may vary by one standard deviation each."""
        factor = cholesky(np.diag(self.noise**2 / repeats) + self.model_error, lower=True)
        ends = np.cumsum([len(self.predicted), *(directions.shape[1] for directions in extra_directions)])
        white = solve_triangular(factor, np.column_stack([self.predicted.T, *extra_directions]), lower=True)
        predicted, *directions = np.split(white, ends[:-1], axis=1)
        return np.column_stack([_apart(predicted - predicted[:, [k]], d) for k, d in enumerate(directions)])

    @property
    def load(self) -> float:
        """The largest value that it would show."""
        return float(np.abs(self.predicted).max())

    def _slopes(self) -> list[Floats] | None:
        """Of each rival, (m, p); the nuisances of all move the rows as they do those of the likeliest, near which all fit."""
        first, nuisances = self.contest.open[0], self.contest.open[0].fitted.coordinates.nuisances
        jobs = [(first, i) for i in range(nuisances)]
        jobs += [(h, i) for h in self.contest.open for i in range(nuisances, h.fitted.coordinates.size)]
        found = self.evidence.predicted_all([_stepped(h, i) for h, i in jobs])
        if any(rows is None for rows in found):
            return None
        place = {id(h): row for h, row in zip(self.contest.open, self.predicted, strict=True)}
        columns = [(rows - place[id(h)]) / _step(h, i) for (h, i), rows in zip(jobs, found, strict=True) if rows is not None]
        shared, own, begin = columns[:nuisances], [], nuisances
        for h in self.contest.open:
            end = begin + h.fitted.coordinates.size - nuisances
            own.append(np.column_stack([*shared, *columns[begin:end]]))
            begin = end
        return own

    def _scatter(self, jacobian: Floats) -> Floats:
        """B of one stroke, (m, k), from the slopes of the nuisances that scatter too."""
        space = self.contest.open[0].fitted.coordinates.space
        std = {name: std for name, std in self.contest.found.scatter.std.items() if name != START or self._starts_anywhere}
        columns = [jacobian[:, i] * std[name] / space.prior_std[i] for i, name in enumerate(space.names) if std.get(name)]
        return np.column_stack(columns) if columns else np.zeros((len(jacobian), 0))

    @property
    def _starts_anywhere(self) -> bool:
        """Strokes whose start is recorded are simulated from there."""
        return any(flap.turn.start_rad is None for flap in flaps_of(self.evidence.parts))


def expected_information(contest: OpenHypotheses, part: ConditionData) -> ExpectedInformation | None:
    """The experiment whose rows these would be; None where a rival has no answer to it."""
    rows = part.rows()
    evidence = Dataset((part,), rows, contest.found.evidence.simulator)
    found = evidence.predicted_all([h.fitted.coordinates.supposed(h.fitted.x) for h in contest.open])
    answers = [rows for rows in found if rows is not None]
    if len(answers) < len(found):
        return None
    return ExpectedInformation(contest, evidence, np.array(answers), rows.noise, USUAL_ERROR**2 * discrepancy(rows))


def _apart(white: Floats, extra_directions: Floats) -> Floats:
    """Half the squares of whitened columns (m, n), what lies along loose directions (m, q) shrunk as far as those allow: (n,)."""
    along = extra_directions.T @ white
    shrunk = np.linalg.solve(np.eye(len(along)) + extra_directions.T @ extra_directions, along)
    return np.asarray(0.5 * ((white**2).sum(axis=0) - (along * shrunk).sum(axis=0)))


def _moved(hypothesis: Hypothesis, jacobian: Floats) -> Floats:
    """J times a root of P, (m, p)."""
    return np.asarray(jacobian @ np.linalg.cholesky(hypothesis.judgement.posterior.covariance))


def _step(hypothesis: Hypothesis, i: int) -> float:
    """Towards the middle of the prior, where the model has an answer."""
    return -STEP if hypothesis.fitted.x[i] > 0.0 else STEP


def _stepped(hypothesis: Hypothesis, i: int) -> Any:
    x = hypothesis.fitted.x.copy()
    x[i] += _step(hypothesis, i)
    return hypothesis.fitted.coordinates.supposed(x)
