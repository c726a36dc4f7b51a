"""Table of a fatigue run's cycles: a row of numbers each, stored block by block like every other stage."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.recording.model import Floats, Recording
from rfca_rig.recording.rows import DEVICE_TIME, HOST_TIME, ColumnForm, Rows, StreamForm

CYCLES = "cycles"
NUMBER = "cycle"

CYCLE_FORM = StreamForm(
    CYCLES,
    (
        ColumnForm(NUMBER, "<u4", ""),
        ColumnForm("peak_force_N", "<f4", "N"),
        ColumnForm("peak_moment_Nm", "<f4", "N m"),
        ColumnForm("min_fz_N", "<f4", "N"),
        ColumnForm("mean_speed_rad_s", "<f4", "rad/s"),
        ColumnForm(HOST_TIME, "<f8", "s"),
        ColumnForm(DEVICE_TIME, "<f8", "s"),
    ),
)
_DTYPE = CYCLE_FORM.dtype


def cycle_row(number: int, values: tuple[float, float, float, float], host_s: float, device_s: float) -> Rows:
    """One cycle as a record array (1,); `values` are peak force, peak moment, least fz and mean speed."""
    return np.array([(number, *values, host_s, device_s)], _DTYPE)


@dataclass(frozen=True)
class CycleTable:
    """All cycles of a run in order; all (m,). `numbers` count from 1 over the whole run; cycles recorded as full strokes are not here."""

    numbers: NDArray[np.uint32]
    peak_force_N: Floats
    peak_moment_Nm: Floats
    min_fz_N: Floats
    mean_speed_rad_s: Floats


def cycle_table(recording: Recording) -> CycleTable:
    """The cycles of every block, complete or cut short; empty where the run has none."""
    streams = [stage.streams[CYCLES] for stage in recording.raw if CYCLES in stage.streams]

    def join_column(name: str) -> NDArray[np.float64]:
        return np.concatenate([np.zeros(0), *(stream.columns[name].values for stream in streams)])

    numbers = np.concatenate([np.zeros(0, np.uint32), *(stream.columns[NUMBER].raw for stream in streams)])
    return CycleTable(numbers, *(join_column(name) for name in ("peak_force_N", "peak_moment_Nm", "min_fz_N", "mean_speed_rad_s")))
