"""Table II of the paper: the valley of fz, measured and simulated, condition by condition."""

from collections.abc import Sequence
from dataclasses import dataclass

from rfca_rig.analysis.compare import ComparedCondition
from rfca_rig.analysis.repeats import Spread, compute_spread
from rfca_rig.analysis.valley import Valley

# Time and force, from the paper's section IV.B.
PAPER_AVERAGE_ERROR_PCT = (3.2, 2.7)


@dataclass(frozen=True)
class Table2Row:
    """One condition. `time` and `fz` are mean and spread of the measured valleys, `simulated_*` the model's mean valley, None without one.

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
        """Simulated minus measured, in percent of the measured value's magnitude; negative where the model is early."""
        return _percent(self.simulated_time_s, self.time.mean)

    @property
    def signed_force_error_pct(self) -> float | None:
        """Simulated minus measured, in percent of the measured value's magnitude; negative where the model's force is larger."""
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
    measured = [f"repeat {r.repeat}: {r.valley.reason}" for r in compared.repeats if not isinstance(r.valley, Valley)]
    simulated = [f"simulated: {s.valley.reason}" for s in compared.simulated if not isinstance(s.valley, Valley)]
    return (*measured, *simulated)


def _percent(simulated: float | None, measured: float | None) -> float | None:
    if simulated is None or not measured:
        return None
    # The valley of fz is negative. The magnitude below keeps the sign of the difference.
    return 100.0 * (simulated - measured) / abs(measured)


def _magnitude(error: float | None) -> float | None:
    return None if error is None else abs(error)


def _mean(errors: Sequence[float | None]) -> float | None:
    return compute_spread([error for error in errors if error is not None]).mean
