"""Reads a campaign folder, `rfca-campaign/1`, into a recording."""

import difflib
import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.columns import DYNAMIC, STATIC, STATIC_NEEDED, find_name_fault, unit_of
from rfca_rig.campaign.layout import FILE_NAME, FORMAT, CampaignFile, DynamicRun
from rfca_rig.campaign.table import CsvTable, number, numbers, read_table, rows
from rfca_rig.channels import HINGES
from rfca_rig.description.sections import RigSections
from rfca_rig.description.toml import place_of, read_text, read_toml
from rfca_rig.description.torque_rotation import read_named_curve
from rfca_rig.errors import BadInput
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress
from rfca_rig.recording.model import Column, Direction, Recording, StaticStage, Stream, Stroke

Floats = NDArray[np.float64]

# Rest that a recording needs before the motion starts, and the tolerance for rounded times.
REST_S = 0.1
STREAM_NAME = "table"
_ROUNDING_S = 1e-6


DIRECTIONS = ("loading", "unloading")

Extra = dict[str, list[str]]


def read_stages(path: Path, strokes_before: int | None = None, held_s: float | None = None) -> tuple[tuple[StaticStage, ...], Extra]:
    """Read the stages in the file, in its order, and its extra columns as text by name.

    `strokes_before` and `held_s` apply to all stages. Hinge columns may be absent; their angles are then NaN. Raises BadInput, naming file,
    line and column, for the first fault.
    """
    table = read_table(path)
    if fault := find_name_fault(table.names, known=STATIC, needed=STATIC_NEEDED):
        raise BadInput(f"{table.path}:1: {fault}")
    lines = [dict(zip(table.names, cells, strict=True)) for cells in rows(table)]
    extra = {name: [cells[name] for cells in lines] for name in table.names if name not in STATIC}
    stages = tuple(replace(_stage(table, row, cells), strokes_before=strokes_before, held_s=held_s) for row, cells in enumerate(lines))
    return stages, extra


def _stage(table: CsvTable, row: int, cells: Mapping[str, str]) -> StaticStage:
    value = {name: number(table, row, name, cells[name]) for name in STATIC if name in cells and name != "direction"}
    return StaticStage(
        height_m=_positive(table, row, "height_mm", value["height_mm"]) / 1e3,
        stage=_whole(table, row, "stage", value["stage"]),
        direction=_direction(table, row, cells["direction"]),
        shaft_angle_rad=value["shaft_angle_rad"],
        hinge_deg=tuple(value.get(name, math.nan) for name in HINGES),
        fy_N=value["fy_N"],
        fz_N=value["fz_N"],
        tx_Nm=value["tx_Nm"],
    )


def _positive(table: CsvTable, row: int, name: str, value: float) -> float:
    if value <= 0:
        raise table.fault(row, f"column {name}: {value:g} should be greater than 0")
    return value


def _whole(table: CsvTable, row: int, name: str, value: float) -> int:
    if value < 0 or not value.is_integer():
        raise table.fault(row, f"column {name}: {value:g} should be a whole number, 0 or more")
    return int(value)


def _direction(table: CsvTable, row: int, cell: str) -> Direction:
    if cell not in DIRECTIONS:
        raise table.fault(row, f"column direction: {cell!r} should be loading or unloading")
    return cast(Direction, cell)


def read_stroke(path: Path, run: DynamicRun) -> Stroke:
    """Read the stroke in the file, with all its columns in one stream "table".

    A channel may be absent, and extra columns are kept. Raises BadInput, naming file, line and column, for the first fault.
    """
    table = read_table(path)
    _check_names(table)
    values = numbers(table)
    time = table.names.index("t_s")
    _check_time(table, values[:, time])
    columns = {name: Column(np.ascontiguousarray(values[:, i]), unit_of(name)) for i, name in enumerate(table.names) if i != time}
    stream = Stream(np.ascontiguousarray(values[:, time]), columns)
    return Stroke(run.height_mm / 1e3, run.speed_rad_s, run.repeat, {STREAM_NAME: stream}, run.strokes_before)


def _check_names(table: CsvTable) -> None:
    fault = find_name_fault(table.names, known=DYNAMIC, needed=("t_s",))
    if fault is None and len(table.names) == 1:
        fault = f"only t_s, and nothing that was measured; known channels are {', '.join(DYNAMIC[1:])}"
    if fault:
        raise BadInput(f"{table.path}:1: {fault}")


def _check_time(table: CsvTable, t_s: Floats) -> None:
    """Time must run forwards, start at least 0.1 s before the motion, and reach it. Otherwise the level at rest is unknown."""
    # Repeated times are refused as well: they leave derivatives undefined.
    backwards = np.flatnonzero(np.diff(t_s) <= 0)
    if backwards.size:
        row = int(backwards[0]) + 1
        how = "stands still at" if t_s[row] == t_s[row - 1] else f"runs backwards, from {t_s[row - 1]:g} s to"
        raise table.fault(row, f"column t_s: time {how} {t_s[row]:g} s")
    if t_s[0] > -REST_S + _ROUNDING_S:
        raise table.fault(0, f"column t_s: begins at {t_s[0]:g} s; needs {REST_S:g} s or more before the motion starts at t_s = 0")
    if t_s[-1] <= 0:
        raise table.fault(len(t_s) - 1, f"column t_s: ends at {t_s[-1]:g} s, before the motion starts at 0")


def read_campaign(folder: Path, report_progress: ProgressCount = ignore_progress) -> Recording:
    """Read the campaign in `folder`, with strokes and stages in the order of campaign.toml. Nothing is written.

    Raises BadInput, one line with file, line and column, for the first fault.
    """
    path = folder / FILE_NAME
    if not path.is_file():
        raise BadInput(f"{path}: is not there; a campaign is a folder with {FILE_NAME} and CSV files")
    campaign = read_named_curve(read_toml(path, CampaignFile), folder)
    _check_files(folder, campaign)
    _check_conditions(path, campaign)
    static, extra = _stages(folder, campaign)
    return Recording(
        title=campaign.title,
        source="IMPORT",
        nominal=_nominal(campaign),
        known_to=campaign.known_to.model_dump(mode="json", exclude_unset=True),
        strokes=_strokes(folder, campaign, report_progress),
        static=static,
        provenance=_provenance(folder, campaign, extra),
    )


def _strokes(folder: Path, campaign: CampaignFile, report_progress: ProgressCount) -> tuple[Stroke, ...]:
    return tuple(read_stroke(folder / run.file, run) for _, run in iterate_with_progress(list(campaign.dynamic()), report_progress))


def _stages(folder: Path, campaign: CampaignFile) -> tuple[tuple[StaticStage, ...], dict[str, Extra]]:
    tables = {run.file: read_stages(folder / run.file, run.strokes_before, run.held_s) for _, run in campaign.static()}
    stages = tuple(stage for found, _ in tables.values() for stage in found)
    return stages, {file: extra for file, (_, extra) in tables.items() if extra}


def _nominal(campaign: CampaignFile) -> dict[str, Any]:
    # Only what the file states; defaults are not recorded as if they had been stated.
    plain = campaign.model_dump(mode="json", exclude_unset=True)
    return {name: plain[name] for name in RigSections.model_fields if name in plain}


def _provenance(folder: Path, campaign: CampaignFile, extra: dict[str, Extra]) -> dict[str, str]:
    """Source of the numbers: the description verbatim, a hash per file, and data without another place in the format."""
    hashes = {run.file: hashlib.sha256((folder / run.file).read_bytes()).hexdigest() for run in campaign.runs}
    found = {"format": FORMAT, FILE_NAME: read_text(folder / FILE_NAME), "sha256": json.dumps(hashes)}
    if extra:
        found["static_extra_columns"] = json.dumps(extra, ensure_ascii=False)
    return found


def _check_files(folder: Path, campaign: CampaignFile) -> None:
    """Every run has a file of its own, and every CSV in their folders has a run. Otherwise a file would be ignored silently."""
    named: dict[str, int] = {}
    for place, run in enumerate(campaign.runs):
        if run.file in named:
            raise BadInput(f"{_entry(folder, place, 'file')}: {run.file} is already the file of runs[{named[run.file] + 1}]")
        if not (folder / run.file).is_file():
            raise BadInput(f"{_entry(folder, place, 'file')}: {folder / run.file} is not there{_hint(folder, campaign, run.file)}")
        named[run.file] = place
    left_out = sorted(found for found in _csv_files(folder, campaign) if found not in named)
    if left_out:
        more = f" (nor {len(left_out) - 1} more)" if len(left_out) > 1 else ""
        raise BadInput(f"{folder / left_out[0]}: no run in {FILE_NAME} names it{more}; add a [[runs]] entry or take it away")


def _csv_files(folder: Path, campaign: CampaignFile) -> Iterator[str]:
    # CSV files directly in the campaign's folder may be anything and are not searched.
    folders = {folder / "runs"} | {(folder / run.file).parent for run in campaign.runs}
    for place in sorted(folders - {folder}):
        if place.is_dir():
            yield from (found.relative_to(folder).as_posix() for found in place.iterdir() if found.suffix.lower() == ".csv")


def _hint(folder: Path, campaign: CampaignFile, file: str) -> str:
    unnamed = set(_csv_files(folder, campaign)) - {run.file for run in campaign.runs}
    close = difflib.get_close_matches(file, sorted(unnamed), n=1, cutoff=0.6)
    return f"; did you mean {close[0]}?" if close else ""


def _check_conditions(path: Path, campaign: CampaignFile) -> None:
    first_of: dict[tuple[float, float, int], tuple[int, DynamicRun]] = {}
    counted_at: dict[int, int] = {}
    for place, run in campaign.dynamic():
        if run.strokes_before is not None:
            # Two runs with the same count would stand for the same stroke.
            first = counted_at.setdefault(run.strokes_before, place)
            if first != place:
                where = _entry(path.parent, place, "strokes_before")
                raise BadInput(f"{where}: {run.strokes_before} strokes were before runs[{first + 1}] already; count each stroke once")
        key = (run.height_mm, run.speed_rad_s, run.repeat)
        if key in first_of:
            before, other = first_of[key]
            raise BadInput(f"{_entry(path.parent, place, 'repeat')}: {run.condition} is already runs[{before + 1}] ({other.file})")
        first_of[key] = (place, run)


def _entry(folder: Path, place: int, key: str) -> str:
    return f"{place_of(folder / FILE_NAME, ('runs', place, key))}: runs[{place + 1}].{key}"
