"""Measured and simulated strokes compared: residuals of fz, their phases and their valleys."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.matched_simulation import MatchedSimulation, Shaft, simulate_matching
from rfca_rig.analysis.phases import PHASES, StrokePhases, Undetermined, phases_of_simulation
from rfca_rig.analysis.repeats import Condition
from rfca_rig.analysis.valley import Valley, valley_and_phases
from rfca_rig.model.parameters import RigModel
from rfca_rig.recording.model import Stroke

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ComparedRepeat:
    """One measured stroke with its residual, measured minus simulated fz, on the measured time base; arrays (m,).

    The residual is NaN where the simulation has ended. All arrays are empty where fz was not recorded. Phases are the measured stroke's.
    """

    repeat: int
    t_s: Floats
    fz_N: Floats
    residual_N: Floats
    valley: Valley | Undetermined
    phases: StrokePhases


@dataclass(frozen=True)
class ComparedCondition:
    """All repeats of a condition with the matched simulation: one stroke, or one for each repeat."""

    condition: Condition
    repeats: tuple[ComparedRepeat, ...]
    simulated: tuple[MatchedSimulation, ...]

    @property
    def contact_is_measured(self) -> bool:
        """Whether at least one repeat has a measurable contact with the ground."""
        return any(np.isfinite(r.phases.touchdown_s) for r in self.repeats)

    def mean_phases(self) -> StrokePhases:
        """Mean of each border over the repeats that reached it; of the simulated strokes where no repeat has a measurable contact."""
        measured = [r.phases for r in self.repeats]
        return _mean_phases(measured if self.contact_is_measured else [_phases_of(model) for model in self.simulated])

    def rms_N(self) -> dict[str, float]:
        """Root mean square of the residual over all repeats, by phase; phases without samples are omitted."""
        residual = np.concatenate([r.residual_N for r in self.repeats])
        phase = np.concatenate([r.phases.number(r.t_s) for r in self.repeats])
        # The residual is NaN after the end of the simulation.
        known = np.isfinite(residual)
        return {
            name: float(np.sqrt(np.mean(residual[known & (phase == number)] ** 2)))
            for number, name in enumerate(PHASES)
            if (known & (phase == number)).any()
        }


def compare_condition(rig: RigModel, condition: Condition, shaft: Shaft = "average") -> ComparedCondition:
    """Simulate the condition and compare every repeat with it.

    Parameters
    ----------
    rig
        The nominal model.
    condition
        Measured strokes of one height and one commanded speed.
    shaft
        Motion of the simulated shaft, as in `matched_simulation.simulate_matching`.

    Raises
    ------
    SimulationFailed
        Where the model cannot be computed.
    """
    simulated = simulate_matching(rig, condition, shaft)
    # One simulated stroke serves all repeats, unless each repeat has its own.
    of_each = simulated if len(simulated) == len(condition.strokes) else simulated * len(condition.strokes)
    repeats = tuple(_compare_stroke(stroke, model) for stroke, model in zip(condition.strokes, of_each, strict=True))
    return ComparedCondition(condition, repeats, simulated)


def _compare_stroke(stroke: Stroke, model: MatchedSimulation) -> ComparedRepeat:
    trace = stroke.channel("fz_N")
    if trace is None:
        nothing = np.empty(0)
        return ComparedRepeat(stroke.repeat, nothing, nothing, nothing, Undetermined("fz was not recorded"), StrokePhases())
    t_s, fz_N = trace
    valley, phases = valley_and_phases(t_s, fz_N)
    return ComparedRepeat(stroke.repeat, t_s, fz_N, fz_N - _interpolate_fz(model, t_s), valley, phases)


def _phases_of(model: MatchedSimulation) -> StrokePhases:
    return phases_of_simulation(model.stroke, model.valley.time_s if isinstance(model.valley, Valley) else np.inf)


def _mean_phases(each: Sequence[StrokePhases]) -> StrokePhases:
    return StrokePhases(
        touchdown_s=_mean_of_finite([phases.touchdown_s for phases in each]),
        valley_s=_mean_of_finite([phases.valley_s for phases in each]),
        lift_off_s=_mean_of_finite([phases.lift_off_s for phases in each]),
    )


def _mean_of_finite(times_s: Sequence[float]) -> float:
    finite = [time_s for time_s in times_s if np.isfinite(time_s)]
    return float(np.mean(finite)) if finite else np.inf


def _interpolate_fz(model: MatchedSimulation, t_s: Floats) -> Floats:
    """Simulated fz at the measured times (m,). Before its grid the model is at rest; after it the force is unknown, NaN."""
    return np.interp(t_s, model.stroke.t_s, model.stroke.fz_N, right=np.nan)
