"""Strokes of a leg as other people's programs write them: names, units, signs, dialects and kinds
of file that are not ours.
"""

import gzip
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io
from numpy.typing import NDArray

from rfca_rig.campaign.reading import DYNAMIC
from rfca_rig.recording.model import Recording, Stroke

Floats = NDArray[np.float64]

# Numbers in a unit per number in that of the quantity.
FACTORS = {
    "s": 1.0,
    "ms": 1e3,
    "us": 1e6,
    "ns": 1e9,
    "min": 1.0 / 60.0,
    "rad": 1.0,
    "deg": 180.0 / np.pi,
    "turn": 0.5 / np.pi,
    "rad/s": 1.0,
    "deg/s": 180.0 / np.pi,
    "rpm": 30.0 / np.pi,
    "N": 1.0,
    "kN": 1e-3,
    "mN": 1e3,
    "lbf": 1.0 / 4.4482216152605,
    "kgf": 1.0 / 9.80665,
    "N m": 1.0,
    "N*m": 1.0,
    "Nm": 1.0,
    "N mm": 1e3,
    "Nmm": 1e3,
    "mNm": 1e3,
    "kNm": 1e-3,
}
FACTORS["\N{DEGREE SIGN}"] = FACTORS["deg"]


@dataclass(frozen=True)
class Written:
    """How a quantity stands in the files: value in the file = sign * factor of its unit * value."""

    name: str
    unit: str
    sign: int = 1


@dataclass(frozen=True)
class Format:
    """How a program writes its files.

    Parameters
    ----------
    columns
        How each quantity stands there; the others are not written.
    kind
        csv, csv.gz, h5, mat, parquet, feather or tdms.
    separator, decimal, preamble, encoding
        Of text.
    unit_row
        A row of units below the names, or attributes of arrays.
    shift_s
        The time of the start of stroke number n is shift_s * (n + 1).
    group
        Of arrays, in front of their names.
    """

    columns: Mapping[str, Written]
    kind: str = "csv"
    separator: str = ","
    decimal: str = "."
    preamble: Sequence[str] = ()
    unit_row: bool = False
    shift_s: float = 0.0
    group: str = ""
    encoding: str = "utf-8"
    extra: Mapping[str, str] = field(default_factory=dict)


def sample_stroke(stroke: Stroke, rate_Hz: float | None) -> dict[str, Floats]:
    """All quantities of a stroke at one rate, by their known names; None for the samples of its
    one stream.
    """
    if rate_Hz is None:
        (stream,) = stroke.streams.values()
        columns = {name: stream.columns[name].values for name in DYNAMIC[1:]}
        return {"t_s": stream.t_s, **columns}
    begins = max(stream.t_s[0] for stream in stroke.streams.values())
    ends = min(stream.t_s[-1] for stream in stroke.streams.values())
    samples = np.arange(np.ceil(begins * rate_Hz), np.floor(ends * rate_Hz) + 1)
    truth = {"t_s": np.round(samples / rate_Hz, 9)}
    for name in DYNAMIC[1:]:
        recorded = stroke.channel(name)
        if recorded is not None:
            truth[name] = np.interp(truth["t_s"], *recorded)
    return truth


def as_written(truth: Mapping[str, Floats], how: Format, number: int) -> dict[str, Floats]:
    """The columns of a file, by their names in it."""
    columns = {}
    for known, written in how.columns.items():
        values = truth[known]
        if known == "t_s":
            values = values + how.shift_s * (number + 1)
        columns[written.name] = written.sign * FACTORS[written.unit] * values
    return columns


def write_stroke(path: Path, truth: Mapping[str, Floats], how: Format, number: int) -> Path:
    """Write one stroke; returns the file's path, with the ending of its kind."""
    columns = as_written(truth, how, number)
    units = {written.name: written.unit for written in how.columns.values()}
    path = path.with_name(f"{path.name}.{how.kind}")
    if how.kind in ARRAYS:
        ARRAYS[how.kind](path, columns, units if how.unit_row else {}, how)
        return path
    content = _as_text(columns, units, how).encode(how.encoding)
    if how.kind.endswith("gz"):
        content = gzip.compress(content)
    path.write_bytes(content)
    return path


def _write_hdf5(
    path: Path, columns: Mapping[str, Floats], units: Mapping[str, str], how: Format
) -> None:
    with h5py.File(path, "w") as file:
        for name, values in columns.items():
            dataset = file.create_dataset(how.group + name, data=values)
            if name in units:
                dataset.attrs["units"] = units[name]


def _write_matlab(
    path: Path, columns: Mapping[str, Floats], _units: Mapping[str, str], _how: Format
) -> None:
    scipy.io.savemat(path, dict(columns))


def _write_parquet(
    path: Path, columns: Mapping[str, Floats], _units: Mapping[str, str], _how: Format
) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import parquet

    parquet.write_table(pyarrow.table(dict(columns)), path)


def _write_feather(
    path: Path, columns: Mapping[str, Floats], _units: Mapping[str, str], _how: Format
) -> None:
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import feather

    feather.write_feather(pyarrow.table(dict(columns)), path)


def _write_tdms(
    path: Path, columns: Mapping[str, Floats], units: Mapping[str, str], _how: Format
) -> None:
    nptdms = pytest.importorskip("nptdms")
    with nptdms.TdmsWriter(path) as writer:
        channels = []
        for name, values in columns.items():
            stated = {"unit_string": units[name]} if name in units else {}
            channels.append(nptdms.ChannelObject("stroke", name, values, properties=stated))
        writer.write_segment(channels)


ARRAYS = {
    "h5": _write_hdf5,
    "mat": _write_matlab,
    "parquet": _write_parquet,
    "feather": _write_feather,
    "tdms": _write_tdms,
}


def _as_text(columns: Mapping[str, Floats], units: Mapping[str, str], how: Format) -> str:
    names = [*columns, *how.extra]
    lines = [*how.preamble, how.separator.join(names)]
    if how.unit_row:
        lines.append(
            how.separator.join([*(units[name] for name in columns), *(["-"] * len(how.extra))])
        )
    for row in zip(*columns.values(), strict=True):
        cells = [repr(float(value)).replace(".", how.decimal) for value in row]
        lines.append(how.separator.join([*cells, *how.extra.values()]))
    return "\n".join(lines) + "\n"


def write_folder(
    folder: Path, recording: Recording, how: Format, rate_Hz: float | None = None
) -> list[dict[str, Floats]]:
    """Write all strokes of a recording; returns the truth of each, in the order of their names."""
    folder.mkdir(parents=True)
    truths = []
    for number, stroke in enumerate(recording.strokes):
        truth = sample_stroke(stroke, rate_Hz)
        name = (
            f"{number + 1:02d} h{1e3 * stroke.height_m:.0f}mm {stroke.speed_rad_s:g}rad_s "
            f"rep{stroke.repeat}"
        )
        write_stroke(folder / name, truth, how, number)
        truths.append(truth)
    return truths
