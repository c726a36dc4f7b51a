"""One dynamic CSV: a stroke whose channels share the file's time."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.columns import DYNAMIC, fault_in_names, unit_of
from rfca_rig.campaign.layout import DynamicRun
from rfca_rig.campaign.table import Table, numbers, read_table
from rfca_rig.errors import BadInput
from rfca_rig.recording.model import Column, Stream, Stroke

Floats = NDArray[np.float64]

REST_S = 0.1
STREAM = "table"
_ROUNDING_S = 1e-6


def read_stroke(path: Path, run: DynamicRun) -> Stroke:
    """The stroke in the file, all its columns in one stream "table".

    A channel may be absent, an extra column is kept. Raises BadInput, naming file, line and column, for the first fault.
    """
    table = read_table(path)
    _check_names(table)
    values = numbers(table)
    time = table.names.index("t_s")
    _check_time(table, values[:, time])
    columns = {name: Column(np.ascontiguousarray(values[:, i]), unit_of(name)) for i, name in enumerate(table.names) if i != time}
    stream = Stream(np.ascontiguousarray(values[:, time]), columns)
    return Stroke(run.height_mm / 1e3, run.speed_rad_s, run.repeat, {STREAM: stream}, run.strokes_before)


def _check_names(table: Table) -> None:
    said = fault_in_names(table.names, known=DYNAMIC, needed=("t_s",))
    if said is None and len(table.names) == 1:
        said = f"only t_s, and nothing that was measured; known channels are {', '.join(DYNAMIC[1:])}"
    if said:
        raise BadInput(f"{table.path}:1: {said}")


def _check_time(table: Table, t_s: Floats) -> None:
    """Time must run forwards, start at least 0.1 s before the motion, and reach it: otherwise the rest before it is not known."""
    backwards = np.flatnonzero(np.diff(t_s) <= 0)
    if backwards.size:
        row = int(backwards[0]) + 1
        how = "stands still at" if t_s[row] == t_s[row - 1] else f"runs backwards, from {t_s[row - 1]:g} s to"
        raise table.fault(row, f"column t_s: time {how} {t_s[row]:g} s")
    if t_s[0] > -REST_S + _ROUNDING_S:
        raise table.fault(0, f"column t_s: begins at {t_s[0]:g} s; needs {REST_S:g} s or more before the motion starts at t_s = 0")
    if t_s[-1] <= 0:
        raise table.fault(len(t_s) - 1, f"column t_s: ends at {t_s[-1]:g} s, before the motion starts at 0")
