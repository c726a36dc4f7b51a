"""Conditions of recordings, compared with their matches in the reference.

With y the measured rows, f the model and theta the nuisance parameters, the model's error d is
common to both: y_new = f_new(theta, effects) + d and y_ref = f_ref(theta) + d. So the difference

    y_new - y_ref = f_new(theta, effects) - f_ref(theta)

has no part of it. f_ref is linear around the fit of the reference, so that no simulation of the
reference is needed: what is subtracted is its residual, and the derivatives of that residual.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.config import USUAL_ERROR
from rfca_rig.diagnosis.data import Observations
from rfca_rig.diagnosis.inference.map_fit import without_scatter
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.problem import RecordingPair
from rfca_rig.diagnosis.reference.fit import ReferenceFit
from rfca_rig.diagnosis.reference.matching import Match, find_matches
from rfca_rig.diagnosis.simulator import (
    ConditionData,
    Dataset,
    ScatterDirection,
    Simulator,
    make_dataset,
)
from rfca_rig.errors import SimulationFailed

Floats = NDArray[np.float64]

# Least discrepancy of matched conditions, as a share of the usual one: repeats of one day differ by
# less than recordings of two days. With 0.3, 20 % more weight on a servo is stated as a family
# only, at a probability of 0.71 for the effect.
LEAST_SHARE = 0.1
# Distance of two motions, see `Match`, over which the model's error changes by as much as itself.
# Assumed; motions of the benchmark that match differ by 0.02 at most, so that it adds little there.
ERROR_LENGTH = 0.5


@dataclass(frozen=True)
class ReferenceParts:
    """Which parts of the reference are used. All of them, unless their worth is measured."""

    joint_prior: bool = True
    covariance: bool = True
    matching: bool = True


@dataclass(frozen=True)
class ReferencedCondition:
    """A condition with m rows, and what the reference says of it.

    Parameters
    ----------
    condition
        The condition as it was recorded.
    observed
        Its rows, with the mean residual of the matches subtracted and its error added.
    slope
        (m, n) by how much the predicted rows of the reference change with each nuisance parameter,
        per unit of its value; 0 without a match.
    directions
        (m,) each, by name: what may vary by one standard deviation. One name in several conditions
        is one quantity.
    matches
        The matches.
    """

    condition: ConditionData
    observed: Observations
    slope: Floats
    directions: Mapping[str, Floats]
    matches: tuple[Match, ...]

    @property
    def repeats(self) -> Floats:
        """The repeats as they were recorded: only their differences count."""
        return self.condition.repeats

    def rows(self) -> Observations:
        """The rows that are compared."""
        return self.observed


@dataclass(frozen=True)
class ReferenceSimulator(Simulator):
    """Predicts compared conditions: the model's rows less the change of those of the reference.

    Parameters
    ----------
    inner
        The simulator of the conditions as recorded.
    fit
        The reference.
    values
        (n,) values of the nuisance parameters in the fit of the reference.
    """

    inner: Simulator
    fit: ReferenceFit
    values: Floats = field(repr=False)

    def simulate(self, at: Any, condition: ReferencedCondition) -> Floats:
        """The predicted rows (m,). Raises SimulationFailed and BadInput as the inner simulator."""
        predicted = self.inner.simulate(at, condition.condition)
        return np.asarray(predicted - self._change_reference(at, condition))

    def simulate_each(self, at: Any, conditions: Sequence[ReferencedCondition]) -> Iterator[Floats]:
        """As `simulate`, one condition after the other."""
        recorded = [part.condition for part in conditions]
        of_inner = self.inner.simulate_each(at, recorded)
        for predicted, part in zip(of_inner, conditions, strict=True):
            yield np.asarray(predicted - self._change_reference(at, part))

    @property
    def varies_many(self) -> bool:
        """As the inner simulator."""
        return self.inner.varies_many

    def simulate_changes(
        self, at: Any, rows: Floats, inputs: Sequence[Any], condition: ReferencedCondition
    ) -> list[Floats | None]:
        """The change of the predicted rows (m,) from `at` to each input, as in `Simulator`."""
        of_reference = self._change_reference(at, condition)
        recorded = condition.condition
        of_inner = self.inner.simulate_changes(at, rows + of_reference, inputs, recorded)
        changes: list[Floats | None] = []
        for varied, change in zip(inputs, of_inner, strict=True):
            if change is None:
                changes.append(None)
            else:
                changes.append(change + of_reference - self._change_reference(varied, condition))
        return changes

    def _change_reference(self, at: Any, condition: ReferencedCondition) -> Floats:
        """The change (m,) of the reference's rows from its fit to the values that it shares with
        the recordings. What has changed since then is no part of it.
        """
        shared = at.unchanged or at
        values = [parameter.read(shared) for parameter in self.fit.space.parameters]
        return np.asarray(condition.slope @ (np.array(values) - self.values))

    def coarsen(self, conditions: Sequence[ReferencedCondition], count: int) -> list[int]:
        """As the inner simulator."""
        return self.inner.coarsen([part.condition for part in conditions], count)

    def scatter(
        self, at: Any, conditions: Sequence[ReferencedCondition]
    ) -> tuple[ScatterDirection, ...]:
        """As the inner simulator."""
        return self.inner.scatter(at, [part.condition for part in conditions])

    def known_scatter(self, conditions: Sequence[ReferencedCondition]) -> Floats:
        """What varies between recordings, and the error of the reference, (m, k)."""
        names = list(dict.fromkeys(name for part in conditions for name in part.directions))
        columns = [np.empty((sum(len(part.slope) for part in conditions), 0))]
        for name in names:
            column = [part.directions.get(name, np.zeros(len(part.slope))) for part in conditions]
            columns.append(np.concatenate(column)[:, None])
        return np.column_stack(columns)


def compare_pair(
    pair: RecordingPair, coordinates: Parameterization, fit: ReferenceFit, parts: ReferenceParts
) -> Dataset:
    """The conditions of the recordings, compared with the reference where it was fitted.

    Raises SimulationFailed where the model cannot be computed there.
    """
    optimizer = without_scatter(pair.new)
    start = optimizer.at(coordinates, np.zeros(coordinates.size))
    if start is None:
        raise SimulationFailed("the model cannot be computed with the values of the reference")
    jacobian = coordinates.space.per_deviation(start.jacobian)
    return compare_with_reference(pair, jacobian, fit, parts)


def compare_with_reference(
    pair: RecordingPair, jacobian: Floats, fit: ReferenceFit, parts: ReferenceParts
) -> Dataset:
    """The conditions of the new recordings, m rows, compared with the reference.

    Parameters
    ----------
    pair
        The recordings.
    jacobian
        (m, n) derivatives of their predictions with respect to the nuisance parameters, per unit of
        the prior's `std`.
    fit
        The reference.
    parts
        What is used of it.
    """
    compared = []
    value_slopes = fit.value_slopes()
    for number, part in enumerate(pair.new.parts):
        of_part = np.flatnonzero(pair.new.rows.condition == number)
        observed = part.rows()
        matches: tuple[Match, ...] = ()
        if parts.matching:
            matches = find_matches(observed, fit.dataset.rows, pair.name_commands)
        slope = np.zeros((len(of_part), len(fit.mean)))
        if matches:
            slope = np.mean([fit.jacobian[match.rows] for match in matches], axis=0)
        of_new = jacobian[of_part]
        steep = _find_steep(observed, (of_new, slope), fit)
        # Where the model jumps, a row says nothing, and a derivative would say anything.
        of_new[steep] = 0.0
        slope[steep] = 0.0
        noise = np.where(steep, np.hypot(observed.noise, observed.scale), observed.noise)
        observed = replace(observed, noise=noise)
        directions: dict[str, Floats] = {}
        if parts.covariance and fit.repeats is not None:
            name = "recordings"
            if not pair.is_one_recording:
                name = f"recording {pair.new.rows.recording[of_part[0]]}"
            directions |= _name_columns(name, of_new * fit.repeats.std)
        if matches:
            directions |= _list_directions(slope, fit, matches, parts)
            observed = _subtract_matches(observed, fit, matches, parts)
        else:
            share = fit.transfer_error / USUAL_ERROR if parts.covariance else 1.0
            observed = _scale_error(observed, share)
        # A value at its bound does not move with its coordinate.
        moves = np.broadcast_to(~fit.free & (value_slopes != 0.0), slope.shape)
        shared = np.divide(slope, value_slopes, out=np.zeros_like(slope), where=moves)
        compared.append(ReferencedCondition(part, observed, shared, directions, matches))
    simulator = ReferenceSimulator(pair.new.simulator, fit, fit.read_values())
    return make_dataset(compared, simulator)


def _find_steep(
    observed: Observations, derivatives: Sequence[Floats], fit: ReferenceFit
) -> NDArray[np.bool_]:
    """Rows (m,) that change by more than the whole signal within what the reference leaves open, in
    any of these derivatives (m, n): a leg wedges there, or slips.
    """
    std = np.sqrt(np.diag(fit.covariance))
    if fit.repeats is not None:
        std = np.maximum(std, fit.repeats.std)
    steep = np.zeros(len(observed.measured), dtype=bool)
    for derivative in derivatives:
        steep |= (np.abs(derivative) * std).max(axis=1) > observed.scale
    return steep


def _list_directions(
    slope: Floats, fit: ReferenceFit, matches: tuple[Match, ...], parts: ReferenceParts
) -> dict[str, Floats]:
    """In what the mean of the matches may be off, (m,) each by name.

    Parameters
    ----------
    slope
        (m, n) derivatives of their mean, per unit of the prior's `std`.
    fit, matches, parts
        The reference, the matches, and what is used of them.
    """
    count = len(matches)
    # The zeros of the reference's day are known as well as its fit knows them.
    of_day = slope * np.where(fit.free, np.sqrt(np.diag(fit.covariance)), 0.0)
    directions = _name_columns("reference", of_day)
    for match in matches:
        name = f"scatter within {match.recording}"
        directions |= _name_columns(name, fit.scatter[match.rows] / count)
    if parts.covariance and fit.repeats is not None:
        recordings = "+".join(str(match.recording) for match in matches)
        of_mean = slope * fit.repeats.std / np.sqrt(count)
        directions |= _name_columns(f"mean of {recordings}", of_mean)
    return directions


def _subtract_matches(
    observed: Observations, fit: ReferenceFit, matches: tuple[Match, ...], parts: ReferenceParts
) -> Observations:
    """The rows less the mean residual of the matches, with its noise and its error added."""
    residual = np.mean([fit.residuals[match.rows] for match in matches], axis=0)
    noise = np.sqrt(
        np.mean([fit.dataset.rows.noise[match.rows] ** 2 for match in matches], axis=0)
        / len(matches)
    )
    share = 1.0
    if parts.covariance and fit.repeats is not None:
        share = _measure_share(fit, fit.repeats.error, matches)
    return replace(
        _scale_error(observed, share),
        measured=observed.measured - residual,
        noise=np.hypot(observed.noise, noise),
    )


def _measure_share(fit: ReferenceFit, repeat_error: float, matches: Sequence[Match]) -> float:
    """Size of the discrepancy of a matched condition, over the usual one.

    It has the error of a single recording and of the mean of its matches, and the change of the
    model's error with the motion. It is never larger than that of a condition without a match.
    """
    distance = float(np.mean([match.distance for match in matches]))
    of_motion = distance / ERROR_LENGTH * fit.error
    of_repeats = repeat_error * np.sqrt(1.0 + 1.0 / len(matches))
    share = float(np.hypot(of_repeats, of_motion)) / USUAL_ERROR
    return min(max(share, LEAST_SHARE), max(fit.error / USUAL_ERROR, 1.0))


def _scale_error(rows: Observations, share: float) -> Observations:
    """The rows with a discrepancy of `share` times its size."""
    return replace(rows, scale=share * rows.scale, transient_scale=share * rows.transient_scale)


def _name_columns(name: str, columns: Floats) -> dict[str, Floats]:
    """Columns (m, n) by name, those that are not zero."""
    return {f"{name}, {index}": column for index, column in enumerate(columns.T) if np.any(column)}
