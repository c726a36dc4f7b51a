"""Measured and simulated strokes compared: residuals of fz, their phases and their valleys, and
Table II of the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.matched_simulation import MatchedSimulation, Shaft, simulate_matching
from rfca_rig.analysis.phases import (
    PHASES,
    StrokePhases,
    Undetermined,
    Valley,
    phases_of_simulation,
    valley_and_phases,
    valley_time_s,
)
from rfca_rig.analysis.repeats import Condition, Spread, compute_spread
from rfca_rig.model.parameters import RigModel
from rfca_rig.recording.model import Stroke

Floats = NDArray[np.float64]

# Time and force, from the paper's section IV.B.
PAPER_AVERAGE_ERROR_PCT = (3.2, 2.7)


@dataclass(frozen=True)
class ComparedRepeat:
    """One measured stroke with its residual, measured minus simulated fz, on the measured time
    base; arrays (m,).

    The residual is NaN where the simulation has ended. All arrays are empty where fz was not
    recorded. Phases are the measured stroke's.
    """

    repeat: int
    t_s: Floats
    fz_N: Floats
    residual_N: Floats
    valley: Valley | Undetermined
    phases: StrokePhases


@dataclass(frozen=True)
class ComparedCondition:
    """All repeats of a condition with the matched simulation: one stroke, or one for each
    repeat.
    """

    condition: Condition
    repeats: tuple[ComparedRepeat, ...]
    simulated: tuple[MatchedSimulation, ...]

    @property
    def contact_is_measured(self) -> bool:
        """Whether at least one repeat has a measurable contact with the ground."""
        return any(np.isfinite(r.phases.touchdown_s) for r in self.repeats)

    @property
    def end_s(self) -> float:
        """End of the longest recording of fz; of the simulation where none has fz."""
        return max(
            (float(r.t_s[-1]) for r in self.repeats if len(r.t_s)),
            default=float(self.simulated[0].stroke.t_s[-1]),
        )

    def mean_phases(self) -> StrokePhases:
        """Mean of each border over the repeats that reached it; of the simulated strokes where
        no repeat has a measurable contact.
        """
        if self.contact_is_measured:
            return _mean_phases([r.phases for r in self.repeats])
        return _mean_phases(
            [
                phases_of_simulation(model.stroke, valley_time_s(model.valley))
                for model in self.simulated
            ]
        )

    def rms_N(self) -> dict[str, float]:
        """Root mean square of the residual over all repeats, by phase; phases without samples
        are omitted.
        """
        residual = np.concatenate([r.residual_N for r in self.repeats])
        phase = np.concatenate([r.phases.number(r.t_s) for r in self.repeats])
        # The residual is NaN after the end of the simulation.
        known = np.isfinite(residual)
        return {
            name: float(np.sqrt(np.mean(residual[known & (phase == number)] ** 2)))
            for number, name in enumerate(PHASES)
            if (known & (phase == number)).any()
        }


def compare_condition(
    rig: RigModel, condition: Condition, shaft: Shaft = "average"
) -> ComparedCondition:
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
    if len(simulated) == len(condition.strokes):
        of_each = simulated
    else:
        of_each = simulated * len(condition.strokes)
    repeats = tuple(
        _compare_stroke(stroke, model)
        for stroke, model in zip(condition.strokes, of_each, strict=True)
    )
    return ComparedCondition(condition, repeats, simulated)


def _compare_stroke(stroke: Stroke, model: MatchedSimulation) -> ComparedRepeat:
    trace = stroke.channel("fz_N")
    if trace is None:
        nothing = np.empty(0)
        return ComparedRepeat(
            stroke.repeat,
            nothing,
            nothing,
            nothing,
            Undetermined("fz was not recorded"),
            StrokePhases(),
        )
    t_s, fz_N = trace
    valley, phases = valley_and_phases(t_s, fz_N)
    # Before its grid the model is at rest; after it the force is unknown, NaN.
    simulated_N = np.interp(t_s, model.stroke.t_s, model.stroke.fz_N, right=np.nan)
    return ComparedRepeat(stroke.repeat, t_s, fz_N, fz_N - simulated_N, valley, phases)


def _mean_phases(all_phases: Sequence[StrokePhases]) -> StrokePhases:
    return StrokePhases(
        touchdown_s=_mean_of_finite([phases.touchdown_s for phases in all_phases]),
        valley_s=_mean_of_finite([phases.valley_s for phases in all_phases]),
        lift_off_s=_mean_of_finite([phases.lift_off_s for phases in all_phases]),
    )


def _mean_of_finite(times_s: Sequence[float]) -> float:
    finite = [time_s for time_s in times_s if np.isfinite(time_s)]
    if finite:
        return float(np.mean(finite))
    return np.inf


@dataclass(frozen=True)
class Table2Row:
    """One condition. `time` and `fz` are mean and spread of the measured valleys, `simulated_*` the
    model's mean valley, None without one.

    `refused` lists the strokes without a valley and the reasons; `repeats` counts those with one.
    """

    source: str
    height_m: float
    speed_rad_s: float
    shaft_speed_rad_s: float
    time: Spread
    fz: Spread
    simulated_time_s: float | None
    simulated_fz_N: float | None
    refused: tuple[str, ...]

    @property
    def repeats(self) -> int:
        return self.time.count

    @property
    def signed_time_error_pct(self) -> float | None:
        """Simulated minus measured, in percent of the measured value's magnitude; negative where
        the model is early.
        """
        return _percent(self.simulated_time_s, self.time.mean)

    @property
    def signed_force_error_pct(self) -> float | None:
        """Simulated minus measured, in percent of the measured value's magnitude; negative where
        the model's force is larger.
        """
        return _percent(self.simulated_fz_N, self.fz.mean)

    @property
    def time_error_pct(self) -> float | None:
        """The error as the paper prints it, without sign."""
        return _magnitude(self.signed_time_error_pct)

    @property
    def force_error_pct(self) -> float | None:
        """The error as the paper prints it, without sign."""
        return _magnitude(self.signed_force_error_pct)


@dataclass(frozen=True)
class Table2:
    """Rows in the order of their recordings, heights and speeds."""

    rows: tuple[Table2Row, ...]

    @property
    def average_time_error_pct(self) -> float | None:
        """Mean over the rows with a time error; None without any."""
        return _mean([row.time_error_pct for row in self.rows])

    @property
    def average_force_error_pct(self) -> float | None:
        """Mean over the rows with a force error; None without any."""
        return _mean([row.force_error_pct for row in self.rows])


def make_table2_row(compared: ComparedCondition, source: str) -> Table2Row:
    """The row of one condition; `source` names the recording it came from."""
    measured = [r.valley for r in compared.repeats if isinstance(r.valley, Valley)]
    simulated = [s.valley for s in compared.simulated if isinstance(s.valley, Valley)]
    speeds = [s.shaft_speed_rad_s for s in compared.simulated]
    return Table2Row(
        source=source,
        height_m=compared.condition.height_m,
        speed_rad_s=compared.condition.speed_rad_s,
        # With recorded motions each repeat has its own simulated speed.
        shaft_speed_rad_s=sum(speeds) / len(speeds),
        time=compute_spread([v.time_s for v in measured]),
        fz=compute_spread([v.fz_N for v in measured]),
        simulated_time_s=compute_spread([v.time_s for v in simulated]).mean,
        simulated_fz_N=compute_spread([v.fz_N for v in simulated]).mean,
        refused=_refusals(compared),
    )


def _refusals(compared: ComparedCondition) -> tuple[str, ...]:
    measured = [
        f"repeat {r.repeat}: {r.valley.reason}"
        for r in compared.repeats
        if not isinstance(r.valley, Valley)
    ]
    simulated = [
        f"simulated: {s.valley.reason}"
        for s in compared.simulated
        if not isinstance(s.valley, Valley)
    ]
    return (*measured, *simulated)


def _percent(simulated: float | None, measured: float | None) -> float | None:
    if simulated is None or not measured:
        return None
    # The valley of fz is negative. The magnitude below keeps the sign of the difference.
    return 100.0 * (simulated - measured) / abs(measured)


def _magnitude(error: float | None) -> float | None:
    if error is None:
        return None
    return abs(error)


def _mean(errors: Sequence[float | None]) -> float | None:
    return compute_spread([error for error in errors if error is not None]).mean
