"""Converters from the columns of source files to the CSV files of a set.

Values are rounded to what the sensors resolve. Where a torque is thinned, it is averaged over its
neighbours first, because it is the mean of a held command.
"""

import csv
import io
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.public_data.readers import (
    read_csv_columns,
    read_free_swing,
    read_matlab,
    read_streams,
    read_workbook_sheet,
)
from rfca_rig.public_data.registry import HERE, ConvertedFile, RecordingGroup

Floats = NDArray[np.float64]
Table = dict[str, list[str]]

# Weights of a torque's neighbours where every second sample is kept.
PAIR_WEIGHTS = (1.0, 2.0, 1.0)
# The same where every fourth is kept.
FOUR_WEIGHTS = (1.0, 2.0, 3.0, 4.0, 3.0, 2.0, 1.0)
# The encoder's pulses per degree were divided as integers, 11 for 11.111.
FREE_SWING_SCALE = 0.99
# N m of the hub for an ampere of its motor, as the authors publish.
FLEXIBLE_LINK_Nm_PER_A = 8.925
# A height that jumps by more, and back, is a wrong reading: the leg falls 1 mm at most in a sample.
HEIGHT_JUMP_M = 0.01
MULTIARM_SAMPLES = 5  # of 1 kHz
# Relative difference of a fingerprint that rounding cannot explain: values have 4 digits or more.
TOLERANCE = 1e-3


def convert_simple_pendulum(
    paths: Sequence[Path], every: int = 1, rows: int | None = None
) -> Table:
    """Time, position, speed and torque of the simple pendulum.

    Parameters
    ----------
    paths
        The recording.
    every
        Each sample of this number is kept.
    rows
        How many samples are kept; all if not given.
    """
    source = read_csv_columns(paths[0])
    position = np.round(source["position"], 6)
    speed = np.round(source["velocity"], 6)
    torque = np.round(source["torque"], 6)
    if every > 1:
        torque = average_neighbours(torque, PAIR_WEIGHTS)
    kept = slice(None, None, every)
    table = {
        "time": write_column(np.round(source["time"], 6)[kept], 6),
        "position": write_column(position[kept], 6),
        "velocity": write_column(speed[kept], 4),
        "torque": write_column(torque[kept], 4),
    }
    return {name: texts[:rows] for name, texts in table.items()}


def convert_double_pendulum(paths: Sequence[Path]) -> Table:
    """Time, positions, speeds and torques of both joints, every second sample."""
    source = {name: np.round(values, 5) for name, values in read_csv_columns(paths[0]).items()}
    table = {"time": write_column(source["time"][::2], 5)}
    for name in ("pos_meas1", "pos_meas2"):
        table[name] = write_column(source[name][::2], 5)
    for name in ("vel_meas1", "vel_meas2"):
        table[name] = write_column(source[name][::2], 4)
    for name in ("tau_meas1", "tau_meas2"):
        averaged = average_neighbours(source[name], PAIR_WEIGHTS)
        table[name] = write_column(averaged[::2], 4)
    return table


def convert_acrobot(paths: Sequence[Path]) -> Table:
    """Time, positions, speeds and torques of both joints, every sample."""
    source = read_csv_columns(paths[0])
    names = ("time", "pos_meas1", "pos_meas2", "vel_meas1", "vel_meas2", "tau_meas1", "tau_meas2")
    return {name: write_column(source[name], 6) for name in names}


def convert_free_swing(paths: Sequence[Path]) -> Table:
    """Time and angle of the released rod from 0.4 s to 4.6 s, every fifth sample of 1 kHz."""
    angle_deg = read_free_swing(paths[0])
    kept = np.arange(400, 4601, 5)
    angle_rad = np.deg2rad(FREE_SWING_SCALE * angle_deg[kept])
    return {
        "time_s": write_column(kept / 1000.0, 3),
        "angle_rad": write_digits(angle_rad, 6),
    }


def convert_flexible_link(paths: Sequence[Path]) -> Table:
    """Time, angle and torque of the first hub until 10.05 s, every fourth sample of 500 Hz."""
    source = read_matlab(paths[0])
    hub = _find_variable(paths[0], source, "data_th11")
    current = _find_variable(paths[0], source, "data_Im1")
    averaged = average_neighbours(current[:, 2], FOUR_WEIGHTS)
    # The first samples lack neighbours on one side; published errors are of unchanged ones.
    averaged[:3] = current[:3, 2]
    torque_Nm = FLEXIBLE_LINK_Nm_PER_A * averaged
    kept = np.arange(2, 5023, 4)
    return {
        "time_s": write_column(hub[kept, 0] - hub[0, 0], 3),
        "hub_angle_rad": write_digits(np.deg2rad(hub[kept, 2]), 6),
        "torque_Nm": write_digits(torque_Nm[kept], 6),
    }


def convert_hop(paths: Sequence[Path]) -> Table:
    """Force of the plate, angles and torques of hip and knee, and height, without a sample in
    which the height jumps and comes back.

    Parameters
    ----------
    paths
        Force, joint positions, joint torques, height.
    """
    index, (force, angle, torque, height) = read_streams(paths)
    steps = np.abs(np.diff(height[:, 0])) > HEIGHT_JUMP_M
    is_jump = np.zeros(len(index), dtype=bool)
    is_jump[1:-1] = steps[:-1] & steps[1:]
    columns = {
        "t_s": (index - index[0]) / 1000.0,
        "Fz_N": force[:, 2],
        "q_hfe_rad": angle[:, 0],
        "q_kfe_rad": angle[:, 1],
        "tau_hfe_Nm": torque[:, 0],
        "tau_kfe_Nm": torque[:, 1],
        "height_m": height[:, 0],
    }
    table = {}
    for name, values in columns.items():
        table[name] = [repr(float(value)) for value in values[~is_jump]]
    return table


def convert_ball_drop(paths: Sequence[Path], sheet: str, drop: int) -> Table:
    """Time and height of one drop of a ball.

    Parameters
    ----------
    paths
        The workbook, with a sheet for each ball: drop, time, height, speed.
    sheet
        Name of the ball.
    drop
        1 or 2.
    """
    times = []
    heights = []
    for row in read_workbook_sheet(paths[0], sheet)[1:]:
        if row and row[0] and int(float(row[0])) == drop:
            times.append(float(row[1]))
            heights.append(float(row[2]))
    return {
        "t_s": write_column(np.array(times), 6),
        "height_m": write_column(np.array(heights), 6),
    }


def convert_multiarm(paths: Sequence[Path], links: int, stretch: int) -> Table:
    """Angles of all joints in one stretch of a free swing, every fifth sample of 1 kHz. The
    source has the angle of each link in space.

    Parameters
    ----------
    paths
        The file of all stretches, as cells with rows of angles and of speeds.
    links
        Number of links.
    stretch
        Number of the stretch, from 1; those for validation follow those for identification.
    """
    source = read_matlab(paths[0])
    cells = [
        cell
        for name in ("Y_id", "Y_vad")
        for cell in _find_variable(paths[0], source, name).ravel()
    ]
    in_space_rad = [_hanging_at_zero(cells, link) for link in range(links)]
    table = {}
    previous: Floats | float = 0.0
    count = 0
    for number, of_link in enumerate(in_space_rad, start=1):
        angle_rad = of_link[stretch - 1][::MULTIARM_SAMPLES]
        table[f"q{number}"] = [f"{value:.6f}" for value in angle_rad - previous]
        previous = angle_rad
        count = len(angle_rad)
    time_s = MULTIARM_SAMPLES / 1000.0 * np.arange(count)
    return {"t": [f"{value:.6f}" for value in time_s], **table}


def _hanging_at_zero(cells: Sequence[Any], link: int) -> list[Floats]:
    """Angles of a link in all stretches, counted from where it hangs: the mean of the last
    stretch is near a multiple of pi, since the source counts from below or from above.
    """
    angles_rad = [np.asarray(cell, dtype=np.float64)[link] for cell in cells]
    offset_rad = np.pi * np.round(np.mean(angles_rad[-1]) / np.pi)
    return [angle_rad - offset_rad for angle_rad in angles_rad]


def _find_variable(path: Path, source: Mapping[str, Any], name: str) -> Any:
    if name not in source:
        present = ", ".join(sorted(key for key in source if not key.startswith("__")))
        raise BadInput(f"{path}: has no variable {name}; there are {present}")
    return source[name]


def average_neighbours(values: Floats, weights: Sequence[float]) -> Floats:
    """The weighted mean of each value and its neighbours (samples,); the first and last value
    count on beyond the ends.
    """
    beyond = len(weights) // 2
    extended = np.concatenate([np.full(beyond, values[0]), values, np.full(beyond, values[-1])])
    return np.convolve(extended, np.array(weights) / sum(weights), mode="valid")


def write_column(values: Floats, decimals: int) -> list[str]:
    """Values (samples,) as texts with at most so many decimals."""
    texts = []
    for value in values:
        text = f"{value:.{decimals}f}".rstrip("0").rstrip(".")
        texts.append("0" if text == "-0" else text)
    return texts


def write_digits(values: Floats, digits: int) -> list[str]:
    """Values (samples,) as texts with at most so many significant digits."""
    return [f"{value:.{digits}g}" for value in values]


CONVERTERS: dict[str, Callable[..., Table]] = {
    "acrobot": convert_acrobot,
    "ball drop": convert_ball_drop,
    "double pendulum": convert_double_pendulum,
    "flexible link": convert_flexible_link,
    "free swing": convert_free_swing,
    "hop": convert_hop,
    "multiarm": convert_multiarm,
    "simple pendulum": convert_simple_pendulum,
}


def convert_file(group: RecordingGroup, file: ConvertedFile, paths: Sequence[Path]) -> str:
    """A recording as the text of its CSV file.

    Raises
    ------
    BadInput
        A source file has another content than expected, or the result another size.
    """
    table = CONVERTERS[group.converter](paths, **file.options)
    fingerprint = take_fingerprint(table)
    expected = read_fingerprints()[f"{group.name}/{file.name}"]
    if not is_alike(fingerprint, expected):
        raise BadInput(
            f"{paths[0]}: {len(fingerprint) - 1} columns of {fingerprint[0]:.0f} rows with rms "
            f"{format_rms(fingerprint)} became of it, and {expected[0]:.0f} rows with rms "
            f"{format_rms(expected)} were expected; rfca-rig cannot convert this file"
        )
    rows = zip(*table.values(), strict=True)
    lines = [",".join(table), *(",".join(row) for row in rows)]
    return "\n".join(lines) + "\n"


def take_fingerprint(table: Table) -> tuple[float, ...]:
    """The number of rows, then the root mean square of each column."""
    columns = [np.array(texts, dtype=np.float64) for texts in table.values()]
    return (float(len(columns[0])), *(float(np.sqrt(np.mean(c**2))) for c in columns))


def is_alike(fingerprint: Sequence[float], expected: Sequence[float]) -> bool:
    """Whether both are of the same recording, up to rounding."""
    return len(fingerprint) == len(expected) and np.allclose(
        fingerprint, expected, rtol=TOLERANCE, atol=0.0
    )


def format_rms(fingerprint: Sequence[float]) -> str:
    """The root mean squares with as many digits as are compared."""
    return ", ".join(f"{value:.4g}" for value in fingerprint[1:])


def read_fingerprints() -> dict[str, tuple[float, ...]]:
    """The fingerprint of every converted file, by group and name."""
    text = (HERE / "fingerprints.csv").read_text(encoding="utf-8")
    fingerprints = {}
    for row in csv.DictReader(io.StringIO(text)):
        values = [float(value) for value in row["rms"].split()]
        fingerprints[row["file"]] = (float(row["rows"]), *values)
    return fingerprints
