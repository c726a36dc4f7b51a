"""Figures before and after: fit, held-out conditions, valleys, and curves to draw."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.counterpart import GRID_S, LONGER
from rfca_rig.analysis.fitting.parameters import Supposed
from rfca_rig.analysis.phases import Refused
from rfca_rig.analysis.valley import Valley, find_valley
from rfca_rig.diagnosis.data.observations import rms
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.leg.strokes import BOUNDED, FlapCondition
from rfca_rig.diagnosis.likelihood.covariance import AtError
from rfca_rig.diagnosis.likelihood.cross_validation import loo_residuals
from rfca_rig.diagnosis.result import BeforeAfter, Overlay
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.stroke import stroke_following

Floats = NDArray[np.float64]

DYNAMIC = "dynamic"


def before_and_after(found: ModelSelectionResult, accepted: Hypothesis, experiment: str = DYNAMIC) -> Mapping[str, BeforeAfter]:
    """Rms against the model as believed and as accepted, per signal, and what noise and scatter leave of it."""
    measured = found.evidence.rows.measured
    return _by_signal(found, "rms", measured - found.believed.predicted, measured - accepted.rows, experiment)


def held_out(found: ModelSelectionResult, accepted: Hypothesis) -> Mapping[str, BeforeAfter]:
    """The same on conditions that were left out in turn: all unknowns fitted to the others, without and with the effect."""
    linears = [hypothesis.fitted.linear(found.evidence.rows.measured) for hypothesis in (found.nothing, accepted)]
    return held_out_under(found, accepted, [found.judge.level(linear) for linear in linears], DYNAMIC)


def held_out_under(
    found: ModelSelectionResult, accepted: Hypothesis, whitenings: Sequence[AtError], experiment: str
) -> Mapping[str, BeforeAfter]:
    """The same with a covariance each for nothing missing and for what is accepted."""
    rows = found.evidence.rows
    conditions = sorted({int(c) for c in rows.condition[rows.experiment == experiment]})
    if len(conditions) < 2:
        return {}
    before, after = (
        loo_residuals(hypothesis.fitted.linear(rows.measured), whitening, rows.condition, conditions)
        for hypothesis, whitening in zip((found.nothing, accepted), whitenings, strict=True)
    )
    return _by_signal(found, "held_out_rms", before, after, experiment)


def _by_signal(found: ModelSelectionResult, name: str, before: Floats, after: Floats, experiment: str) -> dict[str, BeforeAfter]:
    """Rms of residuals before and after, and of the floor below both, of each signal of one experiment."""
    rows = found.evidence.rows
    floor = np.sqrt(rows.noise**2 + (found.scatter.columns**2).sum(axis=1))
    of_signal = {str(signal): (rows.signal == signal) & (rows.experiment == experiment) for signal in np.unique(rows.signal)}
    return {f"{name}_{s}": BeforeAfter(rms(before[h]), rms(after[h]), rms(floor[h])) for s, h in of_signal.items() if h.any()}


def valley_errors(flaps: Sequence[FlapCondition], believed: Supposed, after: Supposed, drive_found: bool) -> Mapping[str, BeforeAfter]:
    """Mean error of the valley in time and force, in percent, as in Table II; the believed shaft turns as commanded.

    With a drive that was found at fault the accepted model makes the shaft's motion itself, otherwise it follows the conditions' turn.
    """
    found = [
        (flap.valley, _valley(flap, believed, True), _valley(flap, after, drive_found))
        for flap in flaps
        if not isinstance(flap.valley, Refused)
    ]
    whole = [(m, b, a) for m, b, a in found if isinstance(m, Valley) and isinstance(b, Valley) and isinstance(a, Valley)]
    if not whole:
        return {}
    return {
        "valley_time_error_pct": BeforeAfter(
            _error([(b.time_s, m.time_s) for m, b, _ in whole]), _error([(a.time_s, m.time_s) for m, _, a in whole])
        ),
        "valley_force_error_pct": BeforeAfter(
            _error([(b.fz_N, m.fz_N) for m, b, _ in whole]), _error([(a.fz_N, m.fz_N) for m, _, a in whole])
        ),
    }


def _valley(flap: FlapCondition, supposed: Supposed, commanded: bool) -> Valley | Refused:
    t_s = GRID_S * np.arange(0, int(LONGER * flap.phases.valley_s / GRID_S), dtype=np.float64)
    turn = replace(flap.turn, recorded=None) if commanded else flap.turn
    if supposed.rig.effects and commanded:
        turn = replace(turn, start_rad=None)  # a drive at fault leaves its start by itself
    try:
        motion = turn.motion(supposed, float(t_s[-1]))
        known = t_s <= motion.breaks_s[-1]  # a recorded turn says nothing of the time after it
        stroke = stroke_following(supposed.rig, flap.height_m + supposed.height_offset_m, motion, t_s[known], BOUNDED)
    except SimulationFailed as error:
        return Refused(str(error))
    return find_valley(stroke.t_s, stroke.fz_N)


def _error(pairs: Sequence[tuple[float, float]]) -> float:
    return float(np.mean([100.0 * abs(simulated - measured) / abs(measured) for simulated, measured in pairs]))


def overlays(found: ModelSelectionResult, accepted: Hypothesis, experiment: str = DYNAMIC) -> tuple[Overlay, ...]:
    """Measured means with both models, condition by condition and signal by signal."""
    rows = found.evidence.rows
    after = accepted.rows
    return tuple(
        Overlay(label.condition, label.signal, rows.t_s[here], rows.measured[here], found.believed.predicted[here], after[here])
        for number, label in enumerate(rows.labels)
        if label.experiment == experiment and len(here := np.flatnonzero(rows.label == number))
    )
