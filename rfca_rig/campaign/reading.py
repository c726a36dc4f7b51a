"""Reads a campaign folder, `rfca-campaign/1`, into a recording."""

import difflib
import json
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.layout import CAMPAIGN_FORMAT, CampaignFile, ColumnSection, DynamicRun
from rfca_rig.campaign.table import CsvTable, number, numbers, read_table, rows
from rfca_rig.campaign.units import are_different, find_factor
from rfca_rig.description.model_file import read_named_curve
from rfca_rig.description.sections import RigSections
from rfca_rig.errors import BadInput
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress
from rfca_rig.recording.layout import CAMPAIGN, HINGES, SHAFT, UNITS, WRENCH, sha256_of
from rfca_rig.recording.model import Column, Direction, Recording, StaticStage, Stream, Stroke
from rfca_rig.recording.outside import refuse_outside
from rfca_rig.suggestions import suggestion
from rfca_rig.toml import place_of, read_text, read_toml

DYNAMIC = ("t_s", *SHAFT, *WRENCH)
STATIC_NEEDED = ("height_mm", "stage", "direction", "shaft_angle_rad", "fy_N", "fz_N", "tx_Nm")
STATIC = (*STATIC_NEEDED, *HINGES)

_SUFFIXES = {
    "rad_s2": "rad/s^2",
    "rad_s": "rad/s",
    "deg_s": "deg/s",
    "m_s2": "m/s^2",
    "m_s": "m/s",
    "mm_s": "mm/s",
    "rev_s": "rev/s",
    "rad": "rad",
    "mrad": "mrad",
    "deg": "deg",
    "rpm": "rpm",
    "s": "s",
    "ms": "ms",
    "us": "us",
    "min": "min",
    "N": "N",
    "kN": "kN",
    "mN": "mN",
    "lbf": "lbf",
    "g": "g",
    "kg": "kg",
    "Nm": "N m",
    "Nmm": "N mm",
    "mNm": "mN m",
    "kNm": "kN m",
    "m": "m",
    "mm": "mm",
    "cm": "cm",
    "um": "um",
    "A": "A",
    "mA": "mA",
    "V": "V",
    "mV": "mV",
    "W": "W",
    "C": "degC",
    "K": "K",
    "Hz": "Hz",
    "kHz": "kHz",
    "Pa": "Pa",
    "kPa": "kPa",
    "bar": "bar",
    "pct": "%",
    "counts": "counts",
}
# For comparison without case and signs, as in "FZ [kn]".
_IN_ANY_CASE = {re.sub("[^a-z0-9]", "", suffix.lower()): suffix for suffix in _SUFFIXES}
_OTHER_WORDS = {"time": "t", "sec": "s", "degrees": "deg", "radians": "rad"}

Floats = NDArray[np.float64]

# Rest that a recording needs before the motion starts, and the tolerance for rounded times.
REST_S = 0.1
STREAM_NAME = "table"
_ROUNDING_S = 1e-6

DIRECTIONS = ("loading", "unloading")

Extra = dict[str, list[str]]


def unit_of(name: str) -> str:
    """Unit of a column: that of the known channel, else from the end of the name, else "" for
    none.
    """
    if name in UNITS:
        return UNITS[name]
    ends = [suffix for suffix in _SUFFIXES if name.endswith("_" + suffix)]
    # The longest suffix: a name in rad_s ends in s, too.
    if ends:
        return _SUFFIXES[max(ends, key=len)]
    return ""


def find_name_fault(
    names: Sequence[str], known: Sequence[str], needed: Sequence[str]
) -> str | None:
    """The fault in a table's column names, or None.

    `known` names may be present, `needed` must be. Other names are extra columns and allowed.
    Exception: an extra column that is a known quantity in another unit or spelling, while the table
    lacks that quantity. Keeping it as an extra would lose the channel silently.
    """
    return (
        _nameless(names) or _twice(names) or _find_misnamed(names, known) or _missing(names, needed)
    )


def _nameless(names: Sequence[str]) -> str | None:
    for column, name in enumerate(names, start=1):
        if not name.isprintable() or not name:
            return f"column {column} has no readable name ({name!r}); name every column or drop it"
    return None


def _twice(names: Sequence[str]) -> str | None:
    for index, name in enumerate(names):
        if name in names[:index]:
            return (
                f"column {name} is there twice, as column {names.index(name) + 1} and as "
                f"column {index + 1}"
            )
    return None


def _missing(names: Sequence[str], needed: Sequence[str]) -> str | None:
    for name in needed:
        if name not in names:
            return f"column {name} is missing; the file has {', '.join(names)}"
    return None


def _find_misnamed(names: Sequence[str], known: Sequence[str]) -> str | None:
    absent = {_quantity(name)[0]: name for name in known if name not in names}
    for name in names:
        quantity, unit = _quantity(name)
        if name in known or quantity not in absent:
            continue
        right = absent[quantity]
        if unit == _quantity(right)[1]:
            return f"column {name}: write it {right}"
        if unit:
            return (
                f"column {name}: this quantity is known in {UNITS.get(right, 'mm')}, as "
                f"{right}; convert it and rename the column, or state it in [columns.{right}]"
            )
        return (
            f"column {name}: its name says no unit; write {right} if that is its unit, else "
            f"state it in [columns.{right}]"
        )
    return None


def _quantity(name: str) -> tuple[str, str]:
    """("fz", "kN") from "fz_kN", "Fz (kN)" or "FZ [kn]"; the unit is "" where the name ends in
    none.
    """
    words = [
        _OTHER_WORDS.get(word, word) for word in re.sub("[^a-z0-9]+", " ", name.lower()).split()
    ]
    for start in range(1, len(words)):
        unit = _IN_ANY_CASE.get("".join(words[start:]))
        if unit is not None:
            return "_".join(words[:start]), unit
    return "_".join(words), ""


@dataclass(frozen=True)
class ColumnMap:
    """How the files of a campaign call the known quantities, and in which units they have them.

    Parameters
    ----------
    names
        The known name of each column that the files call otherwise.
    factors, offsets
        Of each known name: what its numbers are multiplied by, and what is added.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    factors: Mapping[str, float] = field(default_factory=dict)
    offsets: Mapping[str, float] = field(default_factory=dict)

    def apply(self, table: CsvTable, quantities: Sequence[str]) -> "tuple[CsvTable, ColumnMap]":
        """The table with the known names, and the part of the map that it needed; `quantities` are
        those that such a table may have.

        Raises BadInput where a column is missing, or the file states a unit that contradicts the
        map.
        """
        used = {}
        for in_file, known in self.names.items():
            if in_file in table.names:
                used[in_file] = known
            elif known in quantities and known not in table.names:
                raise BadInput(
                    f"{table.path}:{table.dialect.names + 1}: column {in_file}, which "
                    f"[columns.{known}] names, is missing; the file has {', '.join(table.names)}"
                )
        for name, unit in table.units.items():
            known = used.get(name, name)
            expected = unit_of(known)
            is_stated = name in used and known in self.factors
            if expected and not is_stated and are_different(unit, expected):
                raise BadInput(
                    f"{table.path}: column {name}: the file states the unit {unit}, and {known} "
                    f'is in {expected}; write unit = "{unit}" in [columns.{known}] of {CAMPAIGN}'
                )
        names = tuple(used.get(name, name) for name in table.names)
        factors = {known: self.factors[known] for known in used.values() if known in self.factors}
        return replace(table, names=names), replace(self, names=used, factors=factors)

    def convert(self, name: str, values: Floats) -> Floats:
        """Values (m,) of a known quantity from its numbers in the file."""
        if name not in self.factors:
            return values
        return self.factors[name] * values + self.offsets[name]


def make_column_map(path: Path, columns: Mapping[str, ColumnSection]) -> ColumnMap:
    """The map that [columns] of the campaign at `path` states. Raises BadInput for an unknown
    quantity, or a unit that is none of it.
    """
    names: dict[str, str] = {}
    factors = {}
    offsets = {}
    for known, column in columns.items():
        where = place_of(path, ("columns", known))
        if known not in (*DYNAMIC, *STATIC):
            quantities = sorted({*DYNAMIC, *STATIC})
            raise BadInput(f"{where}: columns.{known}: {suggestion(known, quantities)}")
        if column.name in names:
            raise BadInput(
                f"{where}: columns.{known}: column {column.name} is already that of "
                f"{names[column.name]}"
            )
        names[column.name] = known
        unit = unit_of(known)
        factor: float | None = 1.0
        if column.unit is not None:
            factor = find_factor(column.unit, unit)
        if factor is None:
            raise BadInput(
                f"{where}: columns.{known}.unit: {column.unit!r} cannot be converted to {unit}"
            )
        if column.unit is not None or column.sign < 0 or column.offset:
            factors[known] = column.sign * factor
            offsets[known] = column.offset
    return ColumnMap(names, factors, offsets)


NO_MAP = ColumnMap()


def read_stages(
    path: Path,
    strokes_before: int | None = None,
    held_s: float | None = None,
    column_map: ColumnMap = NO_MAP,
) -> tuple[tuple[StaticStage, ...], Extra]:
    """Read the stages in the file, in its order, and its extra columns as text by name.

    `strokes_before` and `held_s` apply to all stages, `column_map` to all columns. Hinge columns
    may be absent; their angles are then NaN. Raises BadInput, naming file, line and column, for the
    first fault.
    """
    table, column_map = column_map.apply(read_table(path), STATIC)
    if fault := find_name_fault(table.names, known=STATIC, needed=STATIC_NEEDED):
        raise BadInput(f"{table.path}:1: {fault}")
    lines = [dict(zip(table.names, cells, strict=True)) for cells in rows(table)]
    extra: Extra = {}
    for name in table.names:
        if name not in STATIC:
            extra[name] = [cells[name] for cells in lines]
    stages = tuple(
        replace(_stage(table, row, cells, column_map), strokes_before=strokes_before, held_s=held_s)
        for row, cells in enumerate(lines)
    )
    return stages, extra


def _stage(
    table: CsvTable, row: int, cells: Mapping[str, str], column_map: ColumnMap
) -> StaticStage:
    value = {}
    for name in STATIC:
        if name in cells and name != "direction":
            as_it_stands = np.array([number(table, row, name, cells[name])])
            value[name] = float(column_map.convert(name, as_it_stands)[0])
    cell = cells["direction"]
    if cell not in DIRECTIONS:
        raise table.fault(row, f"column direction: {cell!r} should be loading or unloading")
    return StaticStage(
        height_m=_positive(table, row, "height_mm", value["height_mm"]) / 1e3,
        stage=_whole(table, row, "stage", value["stage"]),
        direction=cast(Direction, cell),
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


def read_stroke(path: Path, run: DynamicRun, column_map: ColumnMap = NO_MAP) -> Stroke:
    """Read the stroke in the file, with all its columns in one stream "table", by the names and in
    the units of `column_map`.

    A channel may be absent, and extra columns are kept. Raises BadInput, naming file, line and
    column, for the first fault.
    """
    table, column_map = column_map.apply(read_table(path), DYNAMIC)
    _check_names(table)
    values = numbers(table)
    for index, name in enumerate(table.names):
        values[:, index] = column_map.convert(name, values[:, index])
    time = table.names.index("t_s")
    _check_time(table, values[:, time])
    columns = {
        name: Column(np.ascontiguousarray(values[:, i]), unit_of(name))
        for i, name in enumerate(table.names)
        if i != time
    }
    stream = Stream(np.ascontiguousarray(values[:, time]), columns)
    return Stroke(
        run.height_mm / 1e3, run.speed_rad_s, run.repeat, {STREAM_NAME: stream}, run.strokes_before
    )


def _check_names(table: CsvTable) -> None:
    fault = find_name_fault(table.names, known=DYNAMIC, needed=("t_s",))
    if fault is None and len(table.names) == 1:
        fault = (
            f"only t_s, and nothing that was measured; known channels are {', '.join(DYNAMIC[1:])}"
        )
    if fault:
        raise BadInput(f"{table.path}:1: {fault}")


def _check_time(table: CsvTable, t_s: Floats) -> None:
    """Time must run forwards, start at least 0.1 s before the motion, and reach it. Otherwise
    the level at rest is unknown.
    """
    # Repeated times are refused as well: they leave derivatives undefined.
    backwards = np.flatnonzero(np.diff(t_s) <= 0)
    if backwards.size:
        row = int(backwards[0]) + 1
        if t_s[row] == t_s[row - 1]:
            how = "stands still at"
        else:
            how = f"runs backwards, from {t_s[row - 1]:g} s to"
        raise table.fault(row, f"column t_s: time {how} {t_s[row]:g} s")
    if t_s[0] > -REST_S + _ROUNDING_S:
        raise table.fault(
            0,
            (
                f"column t_s: begins at {t_s[0]:g} s; needs {REST_S:g} s or more before the "
                "motion starts at t_s = 0"
            ),
        )
    if t_s[-1] <= 0:
        raise table.fault(
            len(t_s) - 1, f"column t_s: ends at {t_s[-1]:g} s, before the motion starts at 0"
        )


def read_campaign(
    folder: Path, report_progress: ProgressCount = ignore_progress, allow_outside: bool = False
) -> Recording:
    """Read the campaign in `folder`, with strokes and stages in the order of campaign.toml. Nothing
    is written.

    Links that lead out of the folder, and a curve elsewhere, are refused, unless `allow_outside`.

    Raises BadInput, one line with file, line and column, for the first fault.
    """
    path = folder / CAMPAIGN
    if not path.is_file():
        raise BadInput(
            f"{path}: is not there; a campaign is a folder with {CAMPAIGN} and CSV files"
        )
    if not allow_outside:
        refuse_outside([path], [folder])
    described = read_toml(path, CampaignFile)
    if not allow_outside:
        section = described.leg.torque_rotation
        named = [run.file for run in described.runs]
        if section is not None and section.curve is not None:
            named.append(section.curve)
        refuse_outside((folder / name for name in named), [folder])
    campaign = read_named_curve(described, folder)
    _check_files(folder, campaign)
    _check_conditions(path, campaign)
    static, extra = _stages(folder, campaign)
    # Before the hashes, because it says which file cannot be read.
    strokes = _strokes(folder, campaign, report_progress)
    hashes = {run.file: sha256_of(folder / run.file) for run in campaign.runs}
    provenance = {
        "format": CAMPAIGN_FORMAT,
        CAMPAIGN: read_text(folder / CAMPAIGN),
        "sha256": json.dumps(hashes),
    }
    about = campaign.about
    stated = {
        "started_at": about.date,
        "operator": about.operator,
        "sample": about.specimen,
        "rig": about.rig,
    }
    provenance |= {name: text for name, text in stated.items() if text}
    if extra:
        provenance["static_extra_columns"] = json.dumps(extra, ensure_ascii=False)
    return Recording(
        title=campaign.title,
        source="IMPORT",
        nominal=_nominal(campaign),
        known_to=campaign.known_to.model_dump(mode="json", exclude_unset=True),
        strokes=strokes,
        static=static,
        provenance=provenance,
    )


def _strokes(
    folder: Path, campaign: CampaignFile, report_progress: ProgressCount
) -> tuple[Stroke, ...]:
    column_map = make_column_map(folder / CAMPAIGN, campaign.columns)
    return tuple(
        read_stroke(folder / run.file, run, column_map)
        for _, run in iterate_with_progress(list(campaign.dynamic()), report_progress)
    )


def _stages(
    folder: Path, campaign: CampaignFile
) -> tuple[tuple[StaticStage, ...], dict[str, Extra]]:
    column_map = make_column_map(folder / CAMPAIGN, campaign.columns)
    tables = {
        run.file: read_stages(folder / run.file, run.strokes_before, run.held_s, column_map)
        for _, run in campaign.static()
    }
    stages = tuple(stage for file_stages, _ in tables.values() for stage in file_stages)
    return stages, {file: extra for file, (_, extra) in tables.items() if extra}


def _nominal(campaign: CampaignFile) -> dict[str, Any]:
    # Only what the file states; defaults are not recorded as if they had been stated.
    plain = campaign.model_dump(mode="json", exclude_unset=True)
    return {name: plain[name] for name in RigSections.model_fields if name in plain}


def _check_files(folder: Path, campaign: CampaignFile) -> None:
    """Every run has a file of its own, and every CSV in their folders has a run. Otherwise a
    file would be ignored silently.
    """
    named: dict[str, int] = {}
    for index, run in enumerate(campaign.runs):
        if run.file in named:
            raise BadInput(
                f"{_entry(folder, index, 'file')}: {run.file} is already the file of "
                f"runs[{named[run.file] + 1}]"
            )
        if not (folder / run.file).is_file():
            raise BadInput(
                f"{_entry(folder, index, 'file')}: {folder / run.file} is not "
                f"there{_hint(folder, campaign, run.file)}"
            )
        named[run.file] = index
    left_out = sorted(file for file in _csv_files(folder, campaign) if file not in named)
    if left_out:
        if len(left_out) > 1:
            more = f" (nor {len(left_out) - 1} more)"
        else:
            more = ""
        raise BadInput(
            f"{folder / left_out[0]}: no run in {CAMPAIGN} names it{more}; add a [[runs]] "
            "entry or take it away"
        )


def _csv_files(folder: Path, campaign: CampaignFile) -> Iterator[str]:
    # CSV files directly in the campaign's folder may be anything and are not searched.
    folders = {folder / "runs"} | {(folder / run.file).parent for run in campaign.runs}
    for subfolder in sorted(folders - {folder}):
        if subfolder.is_dir():
            yield from (
                file.relative_to(folder).as_posix()
                for file in subfolder.iterdir()
                if file.suffix.lower() == ".csv"
            )


def _hint(folder: Path, campaign: CampaignFile, file: str) -> str:
    unnamed = set(_csv_files(folder, campaign)) - {run.file for run in campaign.runs}
    close = difflib.get_close_matches(file, sorted(unnamed), n=1, cutoff=0.6)
    if close:
        return f"; did you mean {close[0]}?"
    return ""


def _check_conditions(path: Path, campaign: CampaignFile) -> None:
    first_of: dict[tuple[float, float, int], tuple[int, DynamicRun]] = {}
    counted_at: dict[int, int] = {}
    for index, run in campaign.dynamic():
        if run.strokes_before is not None:
            # Two runs with the same count would stand for the same stroke.
            first = counted_at.setdefault(run.strokes_before, index)
            if first != index:
                where = _entry(path.parent, index, "strokes_before")
                raise BadInput(
                    f"{where}: {run.strokes_before} strokes were before runs[{first + 1}] "
                    "already; count each stroke once"
                )
        key = (run.height_mm, run.speed_rad_s, run.repeat)
        if key in first_of:
            before, other = first_of[key]
            raise BadInput(
                f"{_entry(path.parent, index, 'repeat')}: {run.condition} is already "
                f"runs[{before + 1}] ({other.file})"
            )
        first_of[key] = (index, run)


def _entry(folder: Path, index: int, key: str) -> str:
    return f"{place_of(folder / CAMPAIGN, ('runs', index, key))}: runs[{index + 1}].{key}"
