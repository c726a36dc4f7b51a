"""Reads recordings of any mechanism: a folder with experiment.toml, a model file and CSV files.

docs/mechanisms.md shows an experiment.toml. Everything is in SI units behind this module: rad or m, rad/s or m/s, N m, N, A or V.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.experiment_layout import FILE_NAME, TIME_UNITS, ExperimentFile, WindowsSection
from rfca_rig.campaign.table import Table, check_time, column, read_table
from rfca_rig.description.toml import place_of, read_toml
from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]

FEWEST_SAMPLES = 10


@dataclass(frozen=True)
class RecordedSignal:
    """What one column holds: the position or the speed of a joint. `noise_std` in SI, None where it is to be found from the samples."""

    joint: str
    is_speed: bool
    is_distance: bool
    noise_std: float | None


@dataclass(frozen=True)
class MechanismRun:
    """One recording: times `t_s` (m,) from its beginning, `signals` (m, s) and `commands` (m, u), all zero where it was not driven."""

    label: str
    condition: str
    t_s: Floats
    signals: Floats
    commands: Floats
    driven: bool


@dataclass(frozen=True)
class Experiment:
    """The model file, what was recorded of it, and the standard uncertainties of [known_to]."""

    title: str
    path: Path
    model: Path
    signals: tuple[RecordedSignal, ...]
    actuators: tuple[str, ...]
    known_to: dict[str, float]
    windows: WindowsSection
    runs: tuple[MechanismRun, ...]


def experiment_among(paths: Sequence[Path]) -> Path | None:
    """The folder with experiment.toml among `paths`, None where there is none. Raises BadInput where it does not stand alone."""
    found = [path for path in paths if (path / FILE_NAME).is_file()]
    if found and len(paths) > 1:
        raise BadInput(f"{found[0]}: holds {FILE_NAME}, which names a model of its own; give it alone")
    return found[0] if found else None


def read_experiment(folder: Path) -> Experiment:
    """The recordings in `folder`. Raises BadInput, one line naming file, line and column, for the first thing that cannot be used."""
    path = folder / FILE_NAME
    described = read_toml(path, ExperimentFile)
    _check_unique(path, described)
    signals = tuple(
        RecordedSignal(s.joint, s.quantity == "speed", s.is_distance, None if s.noise_std is None else abs(s.noise_std * s.factor))
        for s in described.signals
    )
    return Experiment(
        title=described.title,
        path=path,
        model=folder / described.model,
        signals=signals,
        actuators=tuple(command.actuator for command in described.commands),
        known_to=described.known_to.model_dump(exclude_none=True),
        windows=described.windows,
        runs=tuple(_read_run(folder, described, place) for place in range(len(described.recordings))),
    )


def _check_unique(path: Path, described: ExperimentFile) -> None:
    """No joint's quantity, no actuator, no file and no repeat of a condition comes twice."""
    keys: list[tuple[str, list[tuple[str, ...]]]] = [
        ("signals", [(signal.joint, signal.quantity) for signal in described.signals]),
        ("commands", [(command.actuator,) for command in described.commands]),
        ("recordings", [(run.file,) for run in described.recordings]),
        ("recordings", [(run.condition, f"repeat {run.repeat}") for run in described.recordings]),
    ]
    for table, found in keys:
        for place, key in enumerate(found):
            if key in found[:place]:
                first = found.index(key) + 1
                raise BadInput(f"{place_of(path, (table, place))}: {table}[{place + 1}]: {', '.join(key)} is already {table}[{first}]")


def _read_run(folder: Path, described: ExperimentFile, place: int) -> MechanismRun:
    run = described.recordings[place]
    if not (folder / run.file).is_file():
        where = place_of(folder / FILE_NAME, ("recordings", place, "file"))
        raise BadInput(f"{where}: recordings[{place + 1}].file: {folder / run.file} is not there")
    table = read_table(folder / run.file)
    t_s = TIME_UNITS[described.time.unit] * _column(table, described.time.column, "the time")
    check_time(table, t_s)
    inside = run.counts(t_s)
    if inside.sum() < FEWEST_SAMPLES:
        raise BadInput(f"{table.path}: {inside.sum()} samples between from_s and to_s; needs {FEWEST_SAMPLES} or more")
    signals = [s.factor * _column(table, s.column, f"the {s.quantity} of joint {s.joint}") for s in described.signals]
    commands = [
        c.factor * _column(table, c.column, f"the command of actuator {c.actuator}") if run.driven else np.zeros(len(t_s))
        for c in described.commands
    ]
    return MechanismRun(
        label=f"{run.condition}, repeat {run.repeat}",
        condition=run.condition,
        t_s=t_s[inside],
        signals=np.column_stack(signals)[inside],
        commands=np.column_stack(commands)[inside] if commands else np.empty((int(inside.sum()), 0)),
        driven=run.driven and bool(commands),
    )


def _column(table: Table, name: str, holds: str) -> Floats:
    if name not in table.names:
        raise BadInput(f"{table.path}:1: column {name}, which is to hold {holds}, is missing; the file has {', '.join(table.names)}")
    return column(table, name)
