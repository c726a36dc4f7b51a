"""Conditions that were left out, at the commanded motion: what a user of the model would predict.

The diagnosis compares forces along the recorded turn of the shaft, because only that tells an
effect of the leg from one of the drive. A recorded turn already contains what a drive does wrong,
so that forces along it fit before any effect is added. Here nothing is taken from the condition
that is predicted: the shaft is commanded, a compliant drive is simulated with the leg on it, and
all values come from the other conditions.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.matched_simulation import DURATION_FACTOR, GRID_S
from rfca_rig.analysis.phases import Undetermined, Valley, find_valley
from rfca_rig.diagnosis.leg.findings import LegFindings, add_drive
from rfca_rig.diagnosis.leg.prepared import PreparedLeg
from rfca_rig.diagnosis.leg.strokes import DynamicCondition, ShaftTurn
from rfca_rig.diagnosis.likelihood.marginal_likelihood import loo_estimates
from rfca_rig.diagnosis.problem import DecidedSearch
from rfca_rig.diagnosis.result import ForceMinimum, LeftOutCondition, LeftOutValley, SignalOverlay
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.stroke import recall_stroke

Floats = NDArray[np.float64]


def predict_left_out(prepared: PreparedLeg, findings: LegFindings) -> tuple[LeftOutCondition, ...]:
    """Each condition by the nominal model, and by the accepted one with all its values from the
    other conditions.

    Conditions in which one of both models has no answer are omitted.
    """
    forces = findings.forces.search
    nominal = forces.nominal.coordinates.supposed(forces.nominal.x)
    predicted = []
    for flap, accepted in zip(
        prepared.flaps, _accept_without_each(prepared, findings), strict=True
    ):
        try:
            before = _Prediction.of(_command(flap, nominal), nominal)
            after = _Prediction.of(_command(flap, accepted), accepted)
        except (SimulationFailed, BadInput):
            continue
        predicted.append(_describe(flap, before, after))
    return tuple(predicted)


def _accept_without_each(prepared: PreparedLeg, findings: LegFindings) -> list[ModelPoint]:
    """For each condition of the strokes the accepted model, its values from all others."""
    points = _estimate_without_each(findings.forces, len(prepared.flaps))
    shaft = findings.shaft
    if shaft is None:
        return points
    of_drives = _estimate_without_each(shaft, len(prepared.shafts))
    by_label = {part.label: point for part, point in zip(prepared.shafts, of_drives, strict=True)}
    # Of a condition whose shaft was not recorded, nothing is left out.
    of_all = _suppose(shaft, shaft.decision.explanation.marginal.posterior.mean)
    # The centre of that search has the effects of the leg.
    known = len(shaft.search.nominal.coordinates.space.centre.rig.effects)
    accepted = []
    for flap, point in zip(prepared.flaps, points, strict=True):
        effects: tuple[PresentEffect, ...] = ()
        if shaft.decision.effects:
            effects = by_label.get(flap.label, of_all).rig.effects[known:]
        # The delay of the shaft's angle behind its command is no part of the model that is written:
        # it may be one of the reading alone.
        accepted.append(replace(point, rig=add_drive(point.rig, shaft, effects)))
    return accepted


def _estimate_without_each(finding: DecidedSearch, count: int) -> list[ModelPoint]:
    """The explanation of a search, for each of its first `count` conditions at the posterior mean
    given all others.
    """
    search = finding.search
    rows = search.dataset.rows
    linear = finding.decision.explanation.fitted.linear(rows.measured)
    whitening = search.likelihood.level(linear)
    means = loo_estimates(linear, whitening, rows.condition, range(count))
    return [_suppose(finding, x) for x in means]


def _suppose(finding: DecidedSearch, x: Floats) -> ModelPoint:
    """The explanation of a search at x (p,), its values raised to the lowest possible ones."""
    coordinates = finding.decision.explanation.fitted.coordinates
    count = coordinates.nuisances
    possible = np.concatenate([coordinates.space.clip(x[:count]), x[count:]])
    point: ModelPoint = coordinates.supposed(possible)
    return point


def _command(flap: DynamicCondition, point: ModelPoint) -> DynamicCondition:
    """The condition with its shaft as commanded: from where it stood before the motion, unless the
    drive of the model sags from its nominal start by itself.
    """
    is_compliant = any(catalogue()[effect.id].where == "drive" for effect in point.rig.effects)
    start_rad = flap.turn.start_rad
    if is_compliant and not point.rig.drive.holds_start:
        start_rad = None
    return replace(flap, turn=ShaftTurn(flap.turn.speed_rad_s, start_rad))


@dataclass(frozen=True)
class _Prediction:
    """Rows (k b,) of a condition, and its valley."""

    rows: Floats
    valley: Valley | Undetermined

    @classmethod
    def of(cls, commanded: DynamicCondition, point: ModelPoint) -> "_Prediction":
        """By a model. Raises SimulationFailed and BadInput."""
        # The rows may end before the force has come back from its valley.
        grid_s = np.arange(0.0, DURATION_FACTOR * commanded.phases.valley_s, GRID_S)
        longer = replace(commanded, t_s=np.union1d(commanded.t_s, grid_s))
        request = longer.request(point)
        # A step ends with the rows, which are then those of a stroke that ends there.
        motion = request.setup.motion
        landings_s = np.append(motion.landings_s, commanded.t_s[-1])
        setup = replace(request.setup, motion=replace(motion, landings_s=landings_s))
        stroke = recall_stroke(replace(request, setup=setup), only_sensed=True)
        course = stroke.at(grid_s)
        rows = commanded.read(point, stroke.at(commanded.t_s))
        return cls(rows, find_valley(course.t_s, course.fz_N))


def _describe(flap: DynamicCondition, before: _Prediction, after: _Prediction) -> LeftOutCondition:
    rows = flap.rows()
    # What noise and scatter between the repeats leave of their mean.
    count = len(flap.repeats)
    floor = rows.noise
    if count > 1:
        floor = np.std(flap.repeats, axis=0, ddof=1) / np.sqrt(count)
    overlays = []
    for number, signal in enumerate(flap.signals):
        of_signal = rows.label == number
        overlays.append(
            SignalOverlay(
                flap.label,
                signal,
                rows.t_s[of_signal],
                rows.measured[of_signal],
                before.rows[of_signal],
                after.rows[of_signal],
                phase=rows.phase[of_signal],
                floor=floor[of_signal],
            )
        )
    minima = [_as_minimum(valley) for valley in (flap.valley, before.valley, after.valley)]
    measured, of_before, of_after = minima
    valley = None
    if measured is not None and of_before is not None and of_after is not None:
        valley = LeftOutValley(measured, of_before, of_after)
    return LeftOutCondition(flap.label, tuple(overlays), valley)


def _as_minimum(valley: Valley | Undetermined) -> ForceMinimum | None:
    if isinstance(valley, Undetermined):
        return None
    return ForceMinimum(valley.time_s, valley.fz_N)
