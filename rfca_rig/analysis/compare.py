"""Measured and simulated strokes side by side, and what is left when one is taken from the other."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.counterpart import Counterpart, Shaft, counterparts
from rfca_rig.analysis.phases import PHASES, Refused, StrokePhases
from rfca_rig.analysis.repeats import Condition
from rfca_rig.analysis.valley import Valley, valley_and_phases
from rfca_rig.model.parameters import RigModel
from rfca_rig.recording.form import Stroke

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ComparedRepeat:
    """One measured stroke with its residual, measured minus simulated fz, on the measured time base; arrays (m,).

    The residual is NaN where the simulation did not reach. All are empty where fz was not recorded. Phases are the measured stroke's.
    """

    repeat: int
    t_s: Floats
    fz_N: Floats
    residual_N: Floats
    valley: Valley | Refused
    phases: StrokePhases


@dataclass(frozen=True)
class ComparedCondition:
    """All repeats of a condition with the model's counterpart: one stroke, or one for each repeat."""

    condition: Condition
    repeats: tuple[ComparedRepeat, ...]
    simulated: tuple[Counterpart, ...]

    def rms_N(self) -> dict[str, float]:
        """Root mean square of the residual over all repeats, by phase; phases without samples are left out."""
        residual = np.concatenate([r.residual_N for r in self.repeats])
        phase = np.concatenate([r.phases.number(r.t_s) for r in self.repeats])
        known = np.isfinite(residual)
        return {
            name: float(np.sqrt(np.mean(residual[known & (phase == number)] ** 2)))
            for number, name in enumerate(PHASES)
            if (known & (phase == number)).any()
        }


def compare_condition(rig: RigModel, condition: Condition, shaft: Shaft = "average") -> ComparedCondition:
    """Simulates the condition and sets every repeat against it. Raises SimulationFailed."""
    simulated = counterparts(rig, condition, shaft)
    of_each = simulated if len(simulated) == len(condition.strokes) else simulated * len(condition.strokes)
    repeats = tuple(_compare_stroke(stroke, model) for stroke, model in zip(condition.strokes, of_each, strict=True))
    return ComparedCondition(condition, repeats, simulated)


def _compare_stroke(stroke: Stroke, model: Counterpart) -> ComparedRepeat:
    trace = stroke.channel("fz_N")
    if trace is None:
        nothing = np.empty(0)
        return ComparedRepeat(stroke.repeat, nothing, nothing, nothing, Refused("fz was not recorded"), StrokePhases())
    t_s, fz_N = trace
    valley, phases = valley_and_phases(t_s, fz_N)
    return ComparedRepeat(stroke.repeat, t_s, fz_N, fz_N - _simulated_fz(model, t_s), valley, phases)


def _simulated_fz(model: Counterpart, t_s: Floats) -> Floats:
    """The model at the measured moments; before its grid it is at rest, after it unknown."""
    return np.interp(t_s, model.stroke.t_s, model.stroke.fz_N, right=np.nan)
