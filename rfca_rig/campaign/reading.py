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

from rfca_rig.campaign.layout import (
    CAMPAIGN_FORMAT,
    CampaignFile,
    ColumnSection,
    DynamicRun,
    RawRun,
    StaticRun,
)
from rfca_rig.campaign.recorded_columns import ColumnTable
from rfca_rig.campaign.recorded_files import is_recording, open_columns, refuse_arrays
from rfca_rig.campaign.table import CsvTable, number, read_only_names, read_table, rows
from rfca_rig.campaign.units import (
    IN_ANY_CASE,
    SUFFIXES,
    are_different,
    find_factor,
    unit_in_name,
)
from rfca_rig.description.model_file import read_named_curve
from rfca_rig.description.sections import RigSections
from rfca_rig.errors import BadInput
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress
from rfca_rig.recording.layout import (
    CAMPAIGN,
    HINGES,
    SHAFT,
    UNITS,
    WRENCH,
    is_inside,
    sha256_of,
)
from rfca_rig.recording.model import (
    Column,
    Direction,
    RawStage,
    Recording,
    StaticStage,
    Stream,
    Stroke,
)
from rfca_rig.recording.outside import refuse_outside
from rfca_rig.suggestions import suggestion
from rfca_rig.toml import Key, place_of, read_text, read_toml

DYNAMIC = ("t_s", *SHAFT, *WRENCH)
STATIC_NEEDED = ("height_mm", "stage", "direction", "shaft_angle_rad", "fy_N", "fz_N", "tx_Nm")
STATIC = (*STATIC_NEEDED, *HINGES)
# Columns of static stages that a run of this program has, beside the standard deviations, whose
# names begin with STD.
HINGE_STDS = tuple(name.replace("_deg", "_std_deg") for name in HINGES)
READING_STDS = tuple(name.replace("_deg", "_reading_std_deg") for name in HINGES)
STD = "std_"
SETTLED = {"": None, "no": False, "yes": True}
PICTURES = ("photo", "overlay")
OF_RUNS = (
    *(*HINGE_STDS, *READING_STDS, "settled", "held_s", "strokes_before"),
    *(*PICTURES, "photo_doubts"),
)
# Columns without which a sample would not be there. In others a device may give no value.
ALWAYS_MEASURED = ("t_s", "shaft_angle_rad", "fy_N", "fz_N", "tx_Nm")
# Records of a network that overtake each other are some ms apart.
MOST_DISORDER_S = 0.1

_OTHER_WORDS = {"time": "t", "sec": "s", "degrees": "deg", "radians": "rad"}

Floats = NDArray[np.float64]

# Rest that a recording needs before the motion starts, and the tolerance for rounded times.
REST_S = 0.1
_ROUNDING_S = 1e-6
# Of a start that was read off the recording.
START_ERROR_S = 0.005

DIRECTIONS = ("loading", "unloading")

Extra = dict[str, list[str]]


def unit_of(name: str) -> str:
    """Unit of a column: that of the known channel, else from the end of the name, else "" for
    none.
    """
    if name in UNITS:
        return UNITS[name]
    ends = [suffix for suffix in SUFFIXES if name.endswith("_" + suffix)]
    # The longest suffix: a name in rad_s ends in s, too.
    if ends:
        return SUFFIXES[max(ends, key=len)]
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
        unit = IN_ANY_CASE.get("".join(words[start:]))
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
    units
        The unit of each known name that the campaign states.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    factors: Mapping[str, float] = field(default_factory=dict)
    offsets: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)

    def apply(
        self, table: CsvTable | ColumnTable, quantities: Sequence[str]
    ) -> "tuple[tuple[str, ...], ColumnMap]":
        """The known name of each column of the table, and the part of the map that it needed;
        `quantities` are those that such a table may have.

        Raises BadInput where a column is missing, or the file states a unit that contradicts the
        map.
        """
        used = {}
        for in_file, known in self.names.items():
            if in_file in table.names:
                used[in_file] = known
            elif known in quantities and known not in table.names:
                raise BadInput(
                    f"{table.header}: column {in_file}, which [columns.{known}] names, is "
                    f"missing; the file has {', '.join(table.names)}"
                )
        for name, unit in _list_stated_units(table, used).items():
            known = used.get(name, name)
            stated = ""
            if name in used:
                stated = self.units.get(known, "")
            if stated and are_different(unit, stated):
                raise BadInput(
                    f"{table.path}: column {name}: the file states the unit {unit}, and "
                    f"[columns.{known}] of {CAMPAIGN} {stated}; correct one"
                )
            expected = unit_of(known)
            if expected and not stated and are_different(unit, expected):
                raise BadInput(
                    f"{table.path}: column {name}: the file states the unit {unit}, and {known} "
                    f'is in {expected}; write unit = "{unit}" in [columns.{known}] of {CAMPAIGN}'
                )
        names = tuple(used.get(name, name) for name in table.names)
        factors = {known: self.factors[known] for known in used.values() if known in self.factors}
        return names, replace(self, names=used, factors=factors)

    def convert(self, name: str, values: Floats) -> Floats:
        """Values (m,) of a known quantity from its numbers in the file."""
        if name not in self.factors:
            return values
        return self.factors[name] * values + self.offsets[name]


def _list_stated_units(table: CsvTable | ColumnTable, used: Mapping[str, str]) -> dict[str, str]:
    """The unit of each column that the file itself states, or the name of a column of `used`."""
    stated = {}
    for name, known in used.items():
        label = name
        if isinstance(table, ColumnTable):
            label = table.label(name)
        _, unit = unit_in_name(label)
        if unit and find_factor(unit, unit_of(known)) is not None:
            stated[name] = unit
    return {**stated, **table.units}


def make_column_map(path: Path, columns: Mapping[str, ColumnSection], table: Key = ()) -> ColumnMap:
    """The map that [columns] of the campaign at `path` states, or that of the entry `table`.

    Raises BadInput for an unknown quantity, or a unit that is none of it.
    """
    names: dict[str, str] = {}
    factors = {}
    offsets = {}
    units = {}
    for known, column in columns.items():
        where = place_of(path, (*table, "columns", known))
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
        if column.unit is not None:
            units[known] = column.unit
        if column.unit is not None or column.sign < 0 or column.offset:
            factors[known] = column.sign * factor
            offsets[known] = column.offset
    return ColumnMap(names, factors, offsets, units)


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
    refuse_arrays(path, "static stages, with their directions as text")
    table = read_table(path)
    names, column_map = column_map.apply(table, STATIC)
    table = replace(table, names=names)
    if fault := find_name_fault(table.names, known=STATIC, needed=STATIC_NEEDED):
        raise BadInput(f"{table.path}:1: {fault}")
    lines = [dict(zip(table.names, cells, strict=True)) for cells in rows(table)]
    extra: Extra = {}
    for name in table.names:
        if name not in (*STATIC, *OF_RUNS) and not name.startswith(STD):
            extra[name] = [cells[name] for cells in lines]
    stages = []
    for row, cells in enumerate(lines):
        stage = _stage(table, row, cells, column_map)
        stage = replace(stage, strokes_before=strokes_before, held_s=held_s)
        stages.append(_add_what_runs_have(stage, table, row, cells))
    return tuple(stages), extra


def _add_what_runs_have(
    stage: StaticStage, table: CsvTable, row: int, cells: Mapping[str, str]
) -> StaticStage:
    """The stage with the columns that `export csv` writes of a run, where the table has them."""

    def read(name: str) -> float:
        return _number_or_nan(table, row, name, cells.get(name, ""))

    added: dict[str, Any] = {
        "hinge_std_deg": tuple(read(name) for name in HINGE_STDS),
        "hinge_reading_std_deg": tuple(read(name) for name in READING_STDS),
        "photo_doubts": cells.get("photo_doubts", ""),
    }
    for name in PICTURES:
        added[name] = cells.get(name, "")
        if not is_inside(added[name]):
            raise table.fault(row, f"column {name}: should be a path inside the campaign's folder")
    stds = {name.removeprefix(STD): read(name) for name in cells if name.startswith(STD)}
    added["std"] = {name: value for name, value in stds.items() if not math.isnan(value)}
    if cells.get("held_s"):
        added["held_s"] = read("held_s")
    if cells.get("strokes_before"):
        added["strokes_before"] = _whole(table, row, "strokes_before", read("strokes_before"))
    settled = cells.get("settled", "")
    if settled not in SETTLED:
        raise table.fault(row, f"column settled: {settled!r} should be yes, no or empty")
    return replace(stage, settled=SETTLED[settled], **added)


def _number_or_nan(table: CsvTable, row: int, name: str, cell: str) -> float:
    """The cell as a number; NaN where it is empty or says so."""
    if not cell or cell.lower() == "nan":
        return math.nan
    return number(table, row, name, cell)


def _stage(
    table: CsvTable, row: int, cells: Mapping[str, str], column_map: ColumnMap
) -> StaticStage:
    value = {}
    for name in STATIC:
        if name in HINGES and cells.get(name) == "nan":
            # No photo gave the angle.
            value[name] = math.nan
        elif name in cells and name != "direction":
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


def read_stroke(folder: Path, run: DynamicRun, column_map: ColumnMap = NO_MAP) -> Stroke:
    """Read a stroke from its files in `folder`, of any kind, by the names and in the units of
    `column_map`. All columns of one file become one stream.

    A channel may be absent, and extra columns of numbers are kept. Raises BadInput, naming file,
    line and column, for the first fault.
    """
    streams = {}
    for name, file in run.files.items():
        table = open_columns(folder / file)
        quantities: tuple[str, ...] = DYNAMIC
        if run.streams is not None:
            # Each device has some of the quantities.
            quantities = ("t_s",)
        stream = _read_stream(table, column_map, quantities, run.streams is not None)
        t_s = stream.t_s
        # Not for 0, so that a file's own times keep every digit.
        if run.starts_at_s:
            t_s = t_s - run.starts_at_s
        stream = replace(stream, t_s=t_s)
        if run.ends_at_s is not None:
            stream = _cut(table, stream, run.ends_at_s - run.starts_at_s)
        needed_s = 0.0
        if run.streams is None:
            needed_s = REST_S - (START_ERROR_S if run.starts_at_s else _ROUNDING_S)
        _check_span(table, stream.t_s, needed_s)
        streams[name] = stream
    measured = {name for stream in streams.values() for name in stream.columns}
    for in_file, known in column_map.names.items():
        if known in DYNAMIC and known not in (*measured, "t_s"):
            raise BadInput(
                f"{folder / file}: column {in_file}, which [columns.{known}] names, is in none of "
                f"the files {', '.join(run.files.values())}"
            )
    return Stroke(run.height_mm / 1e3, run.speed_rad_s, run.repeat, streams, run.strokes_before)


def read_raw_stage(folder: Path, run: RawRun) -> RawStage:
    """Read the samples of a stage that is no stroke, from the files of its devices in `folder`."""
    streams = {}
    for name, file in run.streams.items():
        if only_names := read_only_names(folder / file):
            columns = {column: Column(np.zeros(0), unit_of(column)) for column in only_names[1:]}
            streams[name] = Stream(np.zeros(0), columns)
        else:
            table = open_columns(folder / file)
            streams[name] = _read_stream(table, NO_MAP, ("t_s",), is_of_device=True)
    return RawStage(run.label, run.height_mm / 1e3, streams, run.cut_short)


def _read_stream(
    table: ColumnTable, column_map: ColumnMap, quantities: Sequence[str], is_of_device: bool
) -> Stream:
    """All columns of a file, by their known names; of one device they may have gaps, and records
    that overtake each other.
    """
    names, column_map = column_map.apply(table, quantities)
    _check_names(table, names)
    in_file = {}
    for known, name in zip(names, table.names, strict=True):
        if known in DYNAMIC or name in table.extras:
            in_file[known] = name
    kept = ["t_s", *(known for known in in_file if known != "t_s")]
    whole: tuple[str, ...] = DYNAMIC
    if is_of_device:
        whole = ALWAYS_MEASURED
    gaps = tuple(in_file[known] for known in kept if known not in whole)
    values = table.read([in_file[known] for known in kept], gaps)
    for index, known in enumerate(kept):
        values[:, index] = column_map.convert(known, values[:, index])
    _check_forwards(table, values[:, 0], MOST_DISORDER_S if is_of_device else 0.0)
    columns = {}
    for index, known in enumerate(kept[1:], start=1):
        column = np.ascontiguousarray(values[:, index])
        is_count = known not in DYNAMIC and in_file[known] in table.counts
        # The file's first and last cell were looked at, not those between them.
        if is_count and (column == np.round(column)).all():
            column = column.astype(np.int64)
        columns[known] = Column(column, unit_of(known))
    return Stream(np.ascontiguousarray(values[:, 0]), columns)


def _cut(table: ColumnTable, stream: Stream, end_s: float) -> Stream:
    """The samples up to a time. Raises BadInput where there are none."""
    is_before = stream.t_s <= end_s
    if not is_before.any():
        raise BadInput(f"{table.path}: no sample lies before ends_at_s")
    columns = {}
    for name, column in stream.columns.items():
        columns[name] = Column(column.data[is_before], column.unit)
    return Stream(stream.t_s[is_before], columns)


def _check_names(table: ColumnTable, names: Sequence[str]) -> None:
    # Arrays are named by their path in the file.
    own_names = list(names)
    if table.first_line is None:
        own_names = list(dict.fromkeys(table.label(name) for name in names))
    fault = find_name_fault(own_names, known=DYNAMIC, needed=()) or _missing(names, ("t_s",))
    if fault is None and len(names) == 1:
        fault = (
            f"only t_s, and nothing that was measured; known channels are {', '.join(DYNAMIC[1:])}"
        )
    if fault:
        raise BadInput(f"{table.header}: {fault}")


def _check_forwards(table: ColumnTable, t_s: Floats, most_back_s: float) -> None:
    """Time must run forwards, or by `most_back_s` backwards at most. Without it, repeated times are
    refused as well: they leave derivatives undefined.
    """
    backwards = np.flatnonzero(np.diff(t_s) <= -most_back_s)
    if backwards.size:
        row = int(backwards[0]) + 1
        if t_s[row] == t_s[row - 1]:
            how = "stands still at"
        else:
            how = f"runs backwards, from {t_s[row - 1]:g} s to"
        raise table.fault(row, f"column t_s: time {how} {t_s[row]:g} s")


def _check_span(table: ColumnTable, t_s: Floats, needed_s: float) -> None:
    """Time must start at least 0.1 s before the motion, and reach it. Otherwise the level at rest
    is unknown. `needed_s` is that time with its tolerance, 0 for none.
    """
    if needed_s and t_s[0] > -needed_s:
        raise table.fault(
            0,
            (
                f"column t_s: begins at {t_s[0]:g} s; needs {REST_S:g} s or more before the "
                "motion starts at t_s = 0; state the time of the start as starts_at_s of the run"
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
        named = _list_files(described)
        if section is not None and section.curve is not None:
            named.append(section.curve)
        refuse_outside((folder / name for name in named), [folder])
    campaign = read_named_curve(described, folder)
    _check_files(folder, campaign)
    _check_conditions(path, campaign)
    static, extra = _stages(folder, campaign)
    # Before the hashes, because it says which file cannot be read.
    strokes = _strokes(folder, campaign, report_progress)
    raw = tuple(read_raw_stage(folder, run) for _, run in campaign.raw())
    hashes = {file: sha256_of(folder / file) for file in _list_files(campaign)}
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
        "recorded_as": campaign.recorded_as,
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
        raw=raw,
    )


def _list_files(campaign: CampaignFile) -> list[str]:
    """The files of all runs."""
    return [file for run in campaign.runs for file in run.files.values()]


def _strokes(
    folder: Path, campaign: CampaignFile, report_progress: ProgressCount
) -> tuple[Stroke, ...]:
    return tuple(
        read_stroke(folder, run, _map_of_run(folder, campaign, index, run))
        for index, run in iterate_with_progress(list(campaign.dynamic()), report_progress)
    )


def _map_of_run(
    folder: Path, campaign: CampaignFile, index: int, run: DynamicRun | StaticRun
) -> ColumnMap:
    """The run's own map, else that of all files."""
    if run.columns is None:
        return make_column_map(folder / CAMPAIGN, campaign.columns)
    return make_column_map(folder / CAMPAIGN, run.columns, ("runs", index))


def _stages(
    folder: Path, campaign: CampaignFile
) -> tuple[tuple[StaticStage, ...], dict[str, Extra]]:
    tables = {
        run.file: read_stages(
            folder / run.file,
            run.strokes_before,
            run.held_s,
            _map_of_run(folder, campaign, index, run),
        )
        for index, run in campaign.static()
    }
    stages = tuple(stage for file_stages, _ in tables.values() for stage in file_stages)
    return stages, {file: extra for file, (_, extra) in tables.items() if extra}


def _nominal(campaign: CampaignFile) -> dict[str, Any]:
    # Only what the file states; defaults are not recorded as if they had been stated.
    plain = campaign.model_dump(mode="json", exclude_unset=True)
    return {name: plain[name] for name in RigSections.model_fields if name in plain}


def _check_files(folder: Path, campaign: CampaignFile) -> None:
    """Every run has a file of its own, and every recording in their folders has a run. Otherwise a
    file would be ignored silently.
    """
    named: dict[str, int] = {}
    for index, run in enumerate(campaign.runs):
        key = "file"
        if getattr(run, "streams", None) is not None:
            key = "streams"
        for file in run.files.values():
            if file in named:
                raise BadInput(
                    f"{_entry(folder, index, key)}: {file} is already the file of "
                    f"runs[{named[file] + 1}]"
                )
            if not (folder / file).is_file():
                raise BadInput(
                    f"{_entry(folder, index, key)}: {folder / file} is not "
                    f"there{_hint(folder, campaign, file)}"
                )
            named[file] = index
    left_out = sorted(file for file in _recorded_files(folder, campaign) if file not in named)
    if left_out:
        if len(left_out) > 1:
            more = f" (nor {len(left_out) - 1} more)"
        else:
            more = ""
        raise BadInput(
            f"{folder / left_out[0]}: no run in {CAMPAIGN} names it{more}; add a [[runs]] "
            "entry or take it away"
        )


def _recorded_files(folder: Path, campaign: CampaignFile) -> Iterator[str]:
    # Files directly in the campaign's folder may be anything and are not searched.
    folders = {folder / "runs"} | {(folder / file).parent for file in _list_files(campaign)}
    for subfolder in sorted(folders - {folder}):
        if subfolder.is_dir():
            yield from (
                file.relative_to(folder).as_posix()
                for file in subfolder.iterdir()
                if is_recording(file)
            )


def _hint(folder: Path, campaign: CampaignFile, file: str) -> str:
    unnamed = set(_recorded_files(folder, campaign)) - {*_list_files(campaign)}
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
                f"runs[{before + 1}] ({', '.join(other.files.values())})"
            )
        first_of[key] = (index, run)


def _entry(folder: Path, index: int, key: str) -> str:
    return f"{place_of(folder / CAMPAIGN, ('runs', index, key))}: runs[{index + 1}].{key}"
