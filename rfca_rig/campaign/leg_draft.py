"""Draft of campaign.toml for a folder with other people's recordings of a leg.

Every guess is marked as one, with its reason. What cannot be guessed is a question mark, which
`check` names. Entry point: `write_leg_draft`.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from rfca_rig.campaign.column_guesses import (
    ColumnGuess,
    Guesses,
    guess_columns,
    guess_static_columns,
    is_static,
    named_in_s,
)
from rfca_rig.campaign.layout import CAMPAIGN_FORMAT, CampaignFile
from rfca_rig.campaign.motion_guesses import RecordedMotion, measure_motion
from rfca_rig.campaign.reading import (
    DYNAMIC,
    REST_S,
    START_ERROR_S,
    STATIC,
    STATIC_NEEDED,
    unit_of,
)
from rfca_rig.campaign.recorded_columns import ColumnTable
from rfca_rig.campaign.recorded_files import find_recordings, open_columns
from rfca_rig.campaign.units import find_factor
from rfca_rig.description.rig_draft import NOT_COULOMB, USUAL, lines_of_table
from rfca_rig.description.sections import AboutSection
from rfca_rig.errors import BadInput
from rfca_rig.escaping import toml_comment
from rfca_rig.recording import run_folder
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.layout import CAMPAIGN, RECORDING
from rfca_rig.recording.outside import refuse_outside
from rfca_rig.toml import OPEN, format_value

Floats = NDArray[np.float64]

GUESS = "guess"
# Columns without which a stroke is of no use.
NEEDED = ("t_s", "fz_N")
SECTIONS = ("leg", "ground", "sensor", "drive", "known_to")
# Speeds of one condition differ by less, those of two conditions by more.
SAME_CONDITION = 0.04
# Of legs on benches, in mm: a number of a file's name in this range may be a height.
HEIGHTS_MM = (40.0, 1500.0)
# Strokes at one command differ in their start by less.
SAME_START_S = 0.02

_NUMBER = r"(\d+(?:[.,p]\d+)?)"
_HEIGHTS = (
    (re.compile(rf"{_NUMBER}[ _-]?(mm|cm)(?![a-z])"), ""),
    (
        re.compile(
            rf"(?<![a-z])(?:h|height|rack|hoehe|höhe)[ _=-]*{_NUMBER}[ _-]?(mm|cm|m)?(?![a-z])"
        ),
        "mm",
    ),
)
_SPEEDS = (
    (re.compile(rf"{_NUMBER}[ _-]?(rad|deg)[ _-]?(?:per|/)?[ _-]?s(?![a-z])"), ""),
    (re.compile(rf"{_NUMBER}[ _-]?(rpm)(?![a-z])"), ""),
    (re.compile(rf"(?<![a-z])(?:v|w|omega|speed|vel)[ _=-]*{_NUMBER}"), "rad"),
)
_REPEAT = re.compile(r"(?<![a-z])(?:rep|repeat|run|trial|take|nr|no|r|n|#)[ _=-]*(\d+)(?![\d.,])")
_SPEED_UNITS = {"rad": "rad/s", "deg": "deg/s", "rpm": "rpm"}


@dataclass(frozen=True)
class DraftedStroke:
    """One stroke of the draft; what is None is not known.

    Parameters
    ----------
    file
        Relative to the folder.
    table
        Its columns.
    guesses
        Which of them hold the quantities.
    motion
        What the recorded angle shows.
    height_mm, speed_rad_s
        The condition, each with the reason for it.
    """

    file: str
    table: ColumnTable
    guesses: Guesses
    motion: RecordedMotion | None = None
    height_mm: tuple[float, str] | None = None
    speed_rad_s: tuple[float, str] | None = None


@dataclass(frozen=True)
class LegDraft:
    """The draft: its file, the number of values to fill in, of guesses and of usual values."""

    path: Path
    open_values: int
    guesses: int
    usual_values: int


def write_leg_draft(
    folder: Path, usual: Mapping[str, Any], allow_outside: bool = False
) -> LegDraft:
    """Write campaign.toml into `folder`. Links to recordings elsewhere are refused, unless
    `allow_outside`.

    Parameters
    ----------
    folder
        Of the recordings, in any kind of file.
    usual
        The tables of the shipped twin, from which the nominal model comes.

    Raises
    ------
    BadInput
        Where campaign.toml exists, there is no recording of a stroke, or one cannot be read.
    """
    path = folder / CAMPAIGN
    if not folder.is_dir():
        raise BadInput(f"{folder}: is not there, or no folder; --data names that of the recordings")
    if path.exists():
        raise BadInput(f"{path}: is there already; remove it, or edit it")
    if run_folder.is_run(folder) or (folder / RECORDING).is_file():
        raise BadInput(f"{folder}: is a run, which every command reads as it stands")
    recordings = [file for files in find_recordings(folder).values() for file in files]
    if not recordings:
        raise BadInput(
            f"{folder}: holds no recording (.csv, .tsv, .lvm, .h5, .hdf5, .mat, .tdms, .mf4, "
            ".parquet, .feather or .mcap); --data names the folder of the recordings"
        )
    if not allow_outside:
        refuse_outside(recordings, [folder])
    text = make_leg_draft(folder, sorted(recordings), usual)
    write_atomically(path, text.encode("utf-8"))
    guesses, usual_values = count_unchecked(text)
    return LegDraft(path, text.count(f"= {format_value(OPEN)}"), guesses, usual_values)


def count_unchecked(text: str) -> tuple[int, int]:
    """How many values of campaign.toml are marked as guesses, and how many as usual values."""
    usual_values = sum(line.rstrip().endswith(USUAL) for line in text.splitlines())
    return text.count(f"{GUESS}: "), usual_values


def make_leg_draft(folder: Path, recordings: Sequence[Path], usual: Mapping[str, Any]) -> str:
    """The text of the draft. Raises BadInput as `write_leg_draft` does."""
    tables: list[DraftedStroke] = []
    static: list[tuple[str, ColumnTable]] = []
    left_out: list[str] = []
    for recording in recordings:
        name = recording.relative_to(folder).as_posix()
        table = None if recording.is_dir() else open_columns(recording)
        if table is None:
            left_out.append(f"{name}: is a folder; give a bag as one .mcap or .db3 file")
        elif is_static(table):
            static.append((name, table))
        else:
            tables.append(DraftedStroke(name, table, {}))
    guessed, columns = _guess_strokes(tables)
    strokes = [stroke for stroke in guessed if "t_s" in stroke.guesses]
    left_out += _list_left_out(guessed)
    if not strokes and not static:
        raise BadInput(f"{folder}: holds no stroke: {left_out[0]}")
    lines = [
        _comment(f'Replace every "?". Then: rfca-rig check {folder.name}'),
        _comment(f"'{GUESS}' marks what was guessed from the recordings, for the reason given."),
        _comment(f"A line that ends in '{USUAL}' holds a value of the paper's leg."),
        f"format = {format_value(CAMPAIGN_FORMAT)}",
        f"title = {format_value(folder.resolve().name)}",
        "",
        "# For the head of every page; remove the signs # in front.",
        *(f'# about.{name} = ""' for name in AboutSection.model_fields),
        *_list_sections(usual, strokes),
    ]
    if strokes:
        lines += _list_columns(columns, strokes[0].table, DYNAMIC, "columns", NEEDED)
    for stroke, repeat, why in _with_repeats(_with_conditions(strokes)):
        lines += _list_stroke(stroke, repeat, why, columns)
    for name, table in static:
        lines += _list_static(name, table, columns)
    for words in left_out:
        lines += ["", _comment(f"Left out: {words}")]
    return "\n".join(lines) + "\n"


def _list_left_out(strokes: Sequence[DraftedStroke]) -> list[str]:
    """What is wrong with each file that is no stroke."""
    words = []
    for stroke in strokes:
        if "t_s" not in stroke.guesses:
            names = ", ".join(stroke.table.names)
            words.append(f"{stroke.file}: no column is a time by its name; it has {names}")
    return words


def _guess_strokes(strokes: Sequence[DraftedStroke]) -> tuple[list[DraftedStroke], Guesses]:
    """The strokes with their columns and motions, and the columns that most of them have."""
    groups: dict[tuple[object, ...], list[DraftedStroke]] = {}
    for stroke in strokes:
        form = (stroke.table.names, tuple(sorted(stroke.table.units.items())))
        groups.setdefault(form, []).append(stroke)
    guessed = []
    most: Guesses = {}
    largest = 0
    for group in groups.values():
        guesses = guess_columns([stroke.table for stroke in group])
        if "t_s" in guesses and len(group) > largest:
            largest = len(group)
            most = guesses
        for stroke in group:
            motion = _measure(stroke.table, guesses)
            guessed.append(replace(stroke, guesses=guesses, motion=motion))
    guessed.sort(key=lambda stroke: stroke.file)
    return guessed, most


def _measure(table: ColumnTable, guesses: Guesses) -> RecordedMotion | None:
    """What the recorded angle shows, or that of the recorded speed; None where neither is known.
    An angle in an unknown unit shows times alone.
    """
    time = guesses.get("t_s")
    if time is None or OPEN in (time.name, time.unit):
        return None
    for known, unit in (("shaft_angle_rad", "rad"), ("shaft_speed_rad_s", "rad/s")):
        guess = guesses.get(known)
        if guess is None or OPEN in (guess.name, guess.sign):
            continue
        factor = float(guess.sign)
        if guess.unit != OPEN:
            factor *= float(find_factor(guess.unit or unit, unit) or 1.0)
        values = table.read([time.name, guess.name])
        t_s = named_in_s(time, values[:, 0])
        if (np.diff(t_s) <= 0.0).any():
            return None
        angle = factor * values[:, 1]
        if known == "shaft_speed_rad_s":
            angle = cumulative_trapezoid(angle, t_s, initial=0.0)
        motion = measure_motion(t_s, angle)
        if motion is not None and guess.unit == OPEN:
            motion = replace(motion, speed_rad_s=None)
        if motion is not None and (guess.unit == OPEN or known == "shaft_speed_rad_s"):
            motion = replace(motion, rest_rad=None)
        return motion
    return None


def _with_conditions(strokes: Sequence[DraftedStroke]) -> list[DraftedStroke]:
    """The strokes with heights and speeds from their names, and speeds from their motions where no
    name states one.
    """
    stated = []
    for stroke in strokes:
        height, speed = find_condition(stroke.file, stroke.motion)
        stated.append(replace(stroke, height_mm=height, speed_rad_s=speed))
    speeds = [_speed_of(stroke) for stroke in stated if stroke.speed_rad_s is None]
    means = _group([speed for speed in speeds if speed is not None])
    conditions = []
    for stroke in stated:
        recorded = _speed_of(stroke)
        if stroke.speed_rad_s is None and recorded is not None:
            _, mean = min((abs(mean - recorded), mean) for mean in means)
            rounded = float(f"{mean:.3g}")
            condition = (rounded, "by the recorded angle")
            conditions.append(replace(stroke, speed_rad_s=condition))
        else:
            conditions.append(stroke)
    return conditions


def _speed_of(stroke: DraftedStroke) -> float | None:
    """The recorded speed of a stroke in rad/s; None where it is not known."""
    if stroke.motion is None:
        return None
    return stroke.motion.speed_rad_s


def _group(speeds: Iterable[float]) -> list[float]:
    """The means of the speeds of each condition."""
    groups: list[list[float]] = []
    for speed in sorted(speeds):
        if groups and speed <= groups[-1][0] * (1.0 + SAME_CONDITION):
            groups[-1].append(speed)
        else:
            groups.append([speed])
    return [float(np.mean(group)) for group in groups]


def find_condition(
    file: str, motion: RecordedMotion | None
) -> tuple[tuple[float, str] | None, tuple[float, str] | None]:
    """Height in mm and speed in rad/s that the name of a file states, each with the reason; None
    where it states none, or two.
    """
    name = Path(file).with_suffix("").as_posix().lower().removesuffix(".csv")
    heights: dict[float, str] = {}
    for pattern, usual in _HEIGHTS:
        for number, unit in pattern.findall(name):
            factor = find_factor(unit or usual, "mm")
            heights[round(_as_number(number) * float(factor or 1.0), 6)] = "by the file's name"
    speeds: dict[float, str] = {}
    for pattern, usual in _SPEEDS:
        for found in pattern.findall(name):
            number, unit = found if isinstance(found, tuple) else (found, usual)
            factor = float(find_factor(_SPEED_UNITS[unit], "rad/s") or 1.0)
            speeds[round(_as_number(number) * factor, 6)] = "by the file's name"
        if speeds:
            break
    plain = [_as_number(number) for number in re.findall(_NUMBER, Path(name).name)]
    if not speeds and motion is not None and motion.speed_rad_s is not None:
        near = [value for value in plain if 0.8 <= value / motion.speed_rad_s <= 1.25]
        if len(set(near)) == 1 and not float(near[0]).is_integer():
            speeds[near[0]] = "a number of the file's name, near the recorded speed"
    if not heights:
        low, high = HEIGHTS_MM
        others = [value for value in plain if low <= value <= high and value not in speeds]
        if len(set(others)) == 1:
            heights[others[0]] = "the only number of the file's name that may be one, in mm"
    height = next(iter(heights.items())) if len(heights) == 1 else None
    speed = next(iter(speeds.items())) if len(speeds) == 1 else None
    return height, speed


def _as_number(text: str) -> float:
    return float(text.replace(",", ".").replace("p", "."))


def _with_repeats(strokes: Sequence[DraftedStroke]) -> list[tuple[DraftedStroke, int, str]]:
    """The strokes with the number of their repeat and the reason for it: by name where that numbers
    all of a condition, else in the order of the names.
    """
    groups: dict[tuple[object, object], list[DraftedStroke]] = {}
    for stroke in strokes:
        height = stroke.height_mm[0] if stroke.height_mm else None
        speed = stroke.speed_rad_s[0] if stroke.speed_rad_s else None
        groups.setdefault((height, speed), []).append(stroke)
    repeats = {}
    for group in groups.values():
        numbers = []
        for stroke in group:
            found = _REPEAT.findall(Path(stroke.file).with_suffix("").name.lower())
            numbers.append(int(found[-1]) if found else 0)
        is_numbered = min(numbers) > 0 and len(set(numbers)) == len(numbers)
        for place, (stroke, number) in enumerate(zip(group, numbers, strict=True), start=1):
            if is_numbered:
                repeats[stroke.file] = (number, "by the file's name")
            else:
                repeats[stroke.file] = (place, "in the order of the names")
    return [(stroke, *repeats[stroke.file]) for stroke in strokes]


def _list_sections(usual: Mapping[str, Any], strokes: Sequence[DraftedStroke]) -> list[str]:
    """The sections of the nominal model: usual values, and what the motions show."""
    values = {name: dict(usual[name]) for name in SECTIONS}
    for key in NOT_COULOMB:
        values["ground"].pop(key, None)
    known: dict[str, dict[str, Any]] = {name: {} for name in SECTIONS}
    known["leg"]["hinge_torque_Nm"] = usual["leg"]["hinge_torque_Nm"]
    known["drive"]["mode"] = usual["drive"]["mode"]
    guessed: dict[str, dict[str, str]] = {name: {} for name in SECTIONS}
    motions = [stroke.motion for stroke in strokes if stroke.motion is not None]
    starts = []
    for stroke in strokes:
        angle = stroke.guesses.get("shaft_angle_rad")
        if stroke.motion and stroke.motion.rest_rad is not None and angle and angle.offset != OPEN:
            starts.append(stroke.motion.rest_rad)
    if starts:
        values["leg"]["start_angle_rad"] = float(np.median(starts))
        guessed["leg"]["start_angle_rad"] = f"{GUESS}: the shaft's angle before it moves"
    if motions:
        values["drive"]["ramp_s"] = float(f"{np.median([motion.ramp_s for motion in motions]):.2g}")
        guessed["drive"]["ramp_s"] = f"{GUESS}: by the recorded angle"
    schema = CampaignFile.model_json_schema()
    lines = []
    for name in SECTIONS:
        text = lines_of_table(
            name,
            schema["properties"][name],
            schema["$defs"],
            known[name],
            values[name],
            guessed[name],
        )
        lines += ["", *"".join(text).rstrip("\n").split("\n")]
    return lines


def _list_columns(
    guesses: Guesses,
    table: ColumnTable,
    quantities: Sequence[str],
    head: str,
    needed: Sequence[str],
) -> list[str]:
    """A table [columns], with a reason above each entry, and what the files have."""
    lines = [""]
    if head == "columns":
        lines.append(_comment("value = sign * number in its unit + offset"))
        lines.append(
            _comment(f"Columns of {table.path.name}, with their smallest and largest values:")
        )
        lines += [_comment(f"  {words}") for words in _describe_columns(table)]
    lines.append(f"[{head}]")
    for known in quantities:
        guess = guesses.get(known)
        if guess is None and known in needed:
            lines += [
                _comment("no column is this by its name; remove the line if it was not recorded"),
                f"{known} = {_open_entry(known)}",
            ]
        elif guess is not None and not _is_plain(known, guess):
            lines += [
                _comment(f"{GUESS}: {'; '.join(guess.reasons)}"),
                f"{known} = {_entry(guess)}",
            ]
    used = {guess.name for guess in guesses.values()}
    unused = [name for name in table.names if name not in used]
    if unused:
        lines.append(_comment(f"not used: {', '.join(unused)}"))
    return lines


def _describe_columns(table: ColumnTable) -> list[str]:
    """Each column with its range and the unit that the file states."""
    words = []
    for name in table.names:
        if name in table.extras:
            values = table.read([name])[:, 0]
            text = f"{name}: {values.min():.4g} to {values.max():.4g}"
        else:
            text = f"{name}: no numbers"
        if unit := table.units.get(name):
            text += f" {unit}"
        words.append(text)
    return [*table.notes, *words]


def _is_plain(known: str, guess: ColumnGuess) -> bool:
    """Whether the reader takes the column as it stands, without an entry."""
    return guess.name == known and not guess.unit and (guess.sign, guess.offset) == (1, 0.0)


def _entry(guess: ColumnGuess) -> str:
    fields: dict[str, Any] = {"name": guess.name}
    if guess.unit:
        fields["unit"] = guess.unit
    if guess.sign != 1:
        fields["sign"] = guess.sign
    if guess.offset != 0.0:
        fields["offset"] = guess.offset
    return format_value(fields)


def _open_entry(known: str) -> str:
    if unit_of(known):
        return format_value({"name": OPEN, "unit": OPEN})
    return format_value({"name": OPEN})


def _list_stroke(
    stroke: DraftedStroke, repeat: int, why_repeat: str, columns: Guesses
) -> list[str]:
    lines = [
        "",
        "[[runs]]",
        'experiment = "dynamic"',
        f"file = {format_value(stroke.file)}",
        _guessed("height_mm", stroke.height_mm, "height of the shaft above the floor"),
        _guessed("speed_rad_s", stroke.speed_rad_s, "commanded speed of the shaft"),
        _guessed("repeat", (repeat, why_repeat), ""),
    ]
    lines += _list_span(stroke)
    if stroke.guesses != columns:
        lines += _list_columns(
            stroke.guesses, stroke.table, DYNAMIC, "runs.columns", ("t_s", "fz_N")
        )
    return lines


def _list_span(stroke: DraftedStroke) -> list[str]:
    """When the stroke starts and ends by the clock of its file."""
    motion = stroke.motion
    lines = []
    if motion is None and _begins_before_0(stroke):
        return [_guessed("starts_at_s", (0.0, "the file counts from before 0"), "")]
    if motion is None:
        return [_guessed("starts_at_s", None, "time in the file when the speed begins to rise")]
    # A file whose own zero is near the start was counted from there.
    if not motion.first_s < 0.0 or abs(motion.start_s) > SAME_START_S:
        lines.append(_guessed("starts_at_s", (motion.start_s, "by the recorded angle"), ""))
    if motion.end_s is not None:
        lines.append(_guessed("ends_at_s", (motion.end_s, "the shaft stops"), ""))
    return lines


def _begins_before_0(stroke: DraftedStroke) -> bool:
    """Whether the file's own times say that something begins at 0."""
    time = stroke.guesses["t_s"]
    if OPEN in (time.name, time.unit):
        return False
    t_s = named_in_s(time, stroke.table.read([time.name])[:, 0])
    return bool(t_s[0] <= -REST_S + START_ERROR_S and t_s[-1] > 0.0)


def _guessed(key: str, value: tuple[float, str] | None, meaning: str) -> str:
    if value is None:
        return f"{key} = {format_value(OPEN)}  {_comment(meaning)}"
    number, reason = value
    return f"{key} = {number!r}  {_comment(f'{GUESS}: {reason}')}"


def _list_static(name: str, table: ColumnTable, columns: Guesses) -> list[str]:
    guesses = guess_static_columns(table)
    lines = ["", "[[runs]]", 'experiment = "static"', f"file = {format_value(name)}"]
    needs_own = any(not _is_plain(known, guess) for known, guess in guesses.items())
    # Without a table of its own, that of the strokes would be looked for in it.
    if needs_own or columns or any(known not in guesses for known in STATIC_NEEDED):
        lines += _list_columns(guesses, table, STATIC, "runs.columns", STATIC_NEEDED)
    return lines


def _comment(text: str) -> str:
    return toml_comment(text).rstrip("\n")
