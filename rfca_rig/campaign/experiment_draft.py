"""Draft of experiment.toml from a model file and a folder of recordings, with a "?" for everything that they do not state."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rfca_rig.campaign.experiment_layout import (
    ANGLE_SPEED_UNITS,
    ANGLE_UNITS,
    COMMAND_UNITS,
    COUNTS,
    FILE_NAME,
    FORMAT,
    LENGTH_UNITS,
    SIGNAL_UNITS,
    SPEED_UNITS,
    TIME_UNITS,
)
from rfca_rig.campaign.recorded_files import find_recordings, list_columns
from rfca_rig.description.toml import format_value
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.recording.atomic import write_atomically

# Nothing is guessed: only the user knows units and columns.
PLACEHOLDER = '"?"'


def write_draft(mechanism: Mechanism, folder: Path) -> Path:
    """Write the draft into `folder` and return its path.

    Raises
    ------
    BadInput
        Where experiment.toml exists, there is no recording, or one cannot be read.
    """
    path, found = folder / FILE_NAME, find_recordings(folder)
    if path.exists():
        raise BadInput(f"{path}: is there already; remove it, or edit it")
    if not found:
        raise BadInput(f"{folder}: holds no recording (.csv, .h5, .hdf5, .mcap, or a ROS 2 bag); --data names the folder of the recordings")
    write_atomically(path, make_draft(mechanism, folder, found).encode("utf-8"))
    return path


def make_draft(mechanism: Mechanism, folder: Path, found: Mapping[str, Sequence[Path]]) -> str:
    """The text of the draft, for the first kind of recordings in `found`; all files share the names of their columns."""
    # One experiment has one set of columns, hence one kind of file.
    kind, *others = found
    files = found[kind]
    columns = list_columns(files[0])
    times = columns.times
    lines = [
        f'# Replace every "?". Then: rfca-rig diagnose {folder.name}',
        f"format = {format_value(FORMAT)}",
        f"title = {format_value(folder.resolve().name)}",
        f"model = {format_value(Path(os.path.relpath(mechanism.path, folder)).as_posix())}",
        "",
        f"# Columns of {files[0].relative_to(folder).as_posix()}, with their smallest and largest values:",
        *(f"#   {note}" for note in columns.notes),
        *(f"#   {name}: {_extent(values)}" for name, values in columns.values.items()),
        "",
        "[time]",
        f"column = {format_value(times[0]) if len(times) == 1 else PLACEHOLDER}{'' if times else f'  # {columns.no_time}'}",
        f"unit = {format_value(columns.time_unit) if columns.time_unit else f'{PLACEHOLDER}  # {_any_of(TIME_UNITS)}'}",
    ]
    for place, joint in enumerate(mechanism.joints):
        slides = bool(mechanism.is_slide[place])
        position, speed = (LENGTH_UNITS, SPEED_UNITS) if slides else ({**ANGLE_UNITS, COUNTS: 0.0}, ANGLE_SPEED_UNITS)
        hint = "" if slides else "; a count needs counts_per_turn"
        lines += _table("signals", {"joint": format_value(joint), "quantity": format_value("position")}, f"{_any_of(position)}{hint}")
        lines += _table(
            "signals", {"joint": format_value(joint), "quantity": format_value("speed")}, _any_of(speed), "if speeds were not recorded"
        )
    for sensor, (_, unit) in mechanism.sensor_values.items():
        lines += _table("signals", {"sensor": format_value(sensor)}, _any_of(SIGNAL_UNITS[unit]), "if it was not recorded")
    for actuator in mechanism.actuators:
        lines += _table(
            "commands", {"actuator": format_value(actuator)}, f"{_any_of(COMMAND_UNITS)}; measured, or else commanded", "if it was off"
        )
        lines.append("# held = true  # where it was commanded, and acts until the next row; a measured one runs straight from row to row")
    lines += [
        "",
        "# How well the values of the model file are known: one standard deviation. What is not listed counts as exact.",
        "# docs/mechanisms.md lists all keys. A prior that is too narrow distorts the answer; one that is too wide can hide an effect.",
        "[known_to]",
        f"mass_relative = {PLACEHOLDER}  # 0.01 for bodies that were weighed, 0.05 from drawings",
        *(
            ()
            if mechanism.is_slide.all()
            else (f"zero_offset_deg = {PLACEHOLDER}  # of the encoders, 0.3 for joints that were set by hand",)
        ),
        f"torque_error_relative = {PLACEHOLDER}  # usual error of the torques: 0.01 from a torque sensor, 0.03 from a motor current",
    ]
    lines += [f"\n# Left out, as they are of another kind: {len(found[other])} x {other}" for other in others]
    for number, file in enumerate(files, start=1):
        lines += ["", "[[recordings]]", f"file = {format_value(file.relative_to(folder).as_posix())}", f'condition = "recording {number}"']
    return "\n".join(lines) + "\n"


def _table(name: str, known: dict[str, str], units: str, remove: str = "") -> list[str]:
    fields = [f"{key} = {value}" for key, value in known.items()]
    return [
        "",
        f"[[{name}]]{f'  # remove this table {remove}' if remove else ''}",
        *fields,
        f"column = {PLACEHOLDER}",
        f"unit = {PLACEHOLDER}  # {units}",
    ]


def _any_of(units: dict[str, float]) -> str:
    *names, last = units
    return f"{', '.join(names)} or {last}" if names else last


def _extent(values: np.ndarray[tuple[int], np.dtype[np.float64]] | None) -> str:
    return "no numbers" if values is None else f"{values.min():.4g} to {values.max():.4g}"
