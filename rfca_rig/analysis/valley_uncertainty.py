"""Valleys that a model predicts without a fit to strokes, and how far the uncertainty of its values
moves them.

The model's springs come from static stages, its other values from scales and calipers. Each has the
standard deviation that [known_to] states. Their effects on the valley are propagated to first
order, by central differences over one standard deviation. Errors of k0 and k2 count as independent.
Those of one static run are correlated negatively, so that their part of the interval is too wide.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import hypot, sqrt

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.compare import ComparedCondition, Table2Row, make_table2_row
from rfca_rig.analysis.fitting.parameters import ModelPoint, make_prior
from rfca_rig.analysis.fitting.residuals import list_motions, simulate_points
from rfca_rig.analysis.matched_simulation import (
    DURATION_FACTOR,
    Shaft,
    last_moment_s,
)
from rfca_rig.analysis.phases import Valley, find_valley
from rfca_rig.analysis.repeats import STDS_OF_95, Condition, Spread
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import SimulatedStroke

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class PredictedQuantity:
    """Time or force of a valley, predicted beside measured.

    Parameters
    ----------
    predicted
        The model's value, in s or N; None where it has no valley.
    std
        Standard deviation of `predicted` from the uncertainty of the model's values. None where
        a variation of one of them has no valley.
    measured
        Mean and spread of the repeats.
    """

    predicted: float | None
    std: float | None
    measured: Spread

    @property
    def half_95(self) -> float | None:
        """Half of the 95 % interval for the mean of the repeats: the uncertainty of the model's
        values, and the scatter of that mean.
        """
        if self.std is None:
            return None
        scatter = 0.0
        if self.measured.std is not None:
            scatter = self.measured.std / sqrt(self.measured.count)
        return STDS_OF_95 * hypot(self.std, scatter)

    @property
    def is_inside(self) -> bool | None:
        """Whether the measured mean lies in the interval; None where that is not known."""
        half = self.half_95
        if half is None or self.predicted is None or self.measured.mean is None:
            return None
        return abs(self.measured.mean - self.predicted) <= half


@dataclass(frozen=True)
class PredictedValley:
    """The valley of one condition.

    Parameters
    ----------
    row
        Measured and simulated valley, as in Table II.
    names
        Parameters whose uncertainty was propagated.
    effects
        (p, 2) change of time [s] and force [N] for one standard deviation of each parameter; NaN
        where it is unknown.
    """

    row: Table2Row
    names: tuple[str, ...]
    effects: Floats

    @cached_property
    def _stds(self) -> tuple[float | None, float | None]:
        variances = np.sum(self.effects**2, axis=0)
        return _root_or_none(variances[0]), _root_or_none(variances[1])

    @property
    def time(self) -> PredictedQuantity:
        """In s."""
        return PredictedQuantity(self.row.simulated_time_s, self._stds[0], self.row.time)

    @property
    def fz(self) -> PredictedQuantity:
        """In N."""
        return PredictedQuantity(self.row.simulated_fz_N, self._stds[1], self.row.fz)


def _root_or_none(variance: float) -> float | None:
    if np.isfinite(variance):
        return sqrt(variance)
    return None


def predict_valley(
    compared: ComparedCondition,
    rig: RigModel,
    known_to: Mapping[str, float],
    shaft: Shaft,
) -> PredictedValley:
    """The valley of a condition with the uncertainty that the model's values leave.

    Parameters
    ----------
    compared
        The condition, compared with `rig` along the same `shaft`.
    rig
        The model.
    known_to
        One standard deviation of its values, as in the section of that name.
    shaft
        Motion of the simulated shaft, as in `matched_simulation.simulate_matching`.

    Raises
    ------
    BadInput
        Where `known_to` lists nothing.
    """
    condition = compared.condition
    prior = make_prior((), ModelPoint(rig), known_to)
    end_s = _end_of_simulation_s(condition, shaft)
    turns, turn_of_stroke = list_motions(condition, shaft, rig.drive.ramp_s, end_s)
    weights = np.bincount(turn_of_stroke, minlength=len(turns)) / len(turn_of_stroke)
    points = []
    for step in np.eye(len(prior.std)):
        points.append(prior.at(step))
        points.append(prior.at(-step))
    by_point = simulate_points([turn.job for turn in turns], points)
    valleys = np.array([_mean_valley(strokes, weights) for strokes in by_point])
    effects = 0.5 * (valleys[0::2] - valleys[1::2])
    return PredictedValley(make_table2_row(compared, ""), prior.names, effects)


def _end_of_simulation_s(condition: Condition, shaft: Shaft) -> float:
    """Where every motion is known; beyond the recordings where it is no recorded one, as in
    `matched_simulation.simulate_matching`.
    """
    lasts_s = [last_moment_s(stroke) for stroke in condition.strokes]
    if shaft != "recorded":
        return DURATION_FACTOR * max(lasts_s)
    for stroke in condition.strokes:
        angle = stroke.channel("shaft_angle_rad")
        if angle is not None:
            lasts_s.append(float(angle[0][-1]))
    return min(lasts_s)


def _mean_valley(
    strokes: Sequence[SimulatedStroke | SimulationFailed], weights: Floats
) -> tuple[float, float]:
    """Mean time and force over the motions; NaN where one of them has no valley."""
    total = np.zeros(2)
    for stroke, weight in zip(strokes, weights, strict=True):
        if isinstance(stroke, SimulationFailed):
            return (np.nan, np.nan)
        valley = find_valley(stroke.t_s, stroke.fz_N)
        if not isinstance(valley, Valley):
            return (np.nan, np.nan)
        total += weight * np.array([valley.time_s, valley.fz_N])
    time_s, fz_N = total.tolist()
    return time_s, fz_N
