"""Reads recordings of any mechanism: a folder with experiment.toml, a model file, and CSV files, HDF5 files or bags.

docs/mechanisms.md shows an experiment.toml. All values from this module are in SI units: rad or m, rad/s or m/s, N m, N, A or V.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.experiment_layout import FILE_NAME, ExperimentFile
from rfca_rig.campaign.recorded_columns import ColumnRequest
from rfca_rig.campaign.recorded_files import read_columns
from rfca_rig.campaign.table import select_samples
from rfca_rig.description.sections import AboutSection
from rfca_rig.description.toml import place_of, read_toml
from rfca_rig.errors import BadInput
from rfca_rig.mechanism.contact_law import SphereOnPlane

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RecordedSignal:
    """Content of one column: `quantity` is position or speed of the joint `name`, or sensor, of which `name` is then the name.

    `unit` and `noise_std` are in SI; `noise_std` is None where it is estimated from the samples.
    """

    quantity: Literal["position", "speed", "sensor"]
    name: str
    unit: str
    noise_std: float | None


@dataclass(frozen=True)
class PrescribedJoint:
    """A joint whose motion is given. `smoothed_s` is the distance of the knots of the spline through its column, 0 for all samples.

    `scatter_std` is the deviation of its position from repeat to repeat, in SI, None where its column shows that.
    """

    name: str
    unit: str
    smoothed_s: float
    scatter_std: float | None


@dataclass(frozen=True)
class MechanismRun:
    """One recording: times `t_s` (m,) from its beginning, `signals` (m, s) and `commands` (m, u), all zero where it was not driven.

    `prescribed` (m, p) are the positions of the prescribed joints.
    """

    label: str
    condition: str
    t_s: Floats
    signals: Floats
    commands: Floats
    driven: bool
    prescribed: Floats


@dataclass(frozen=True)
class Experiment:
    """The model file, its recordings, the standard uncertainties of [known_to], and the length of windows and bins.

    `most_windows` limits the number of windows. `prescribed` joints follow their columns, `contacts` have laws of their own. `alike` groups
    joints, bodies or actuators of one make: their names by the name of the group. With `starts_at_rest` a motion begins in equilibrium;
    otherwise windows start from the measured state.
    """

    title: str
    path: Path
    model: Path
    signals: tuple[RecordedSignal, ...]
    actuators: tuple[str, ...]
    known_to: dict[str, float]
    window_s: float
    bin_s: float
    most_windows: int
    runs: tuple[MechanismRun, ...]
    prescribed: tuple[PrescribedJoint, ...] = ()
    contacts: tuple[SphereOnPlane, ...] = ()
    alike: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    starts_at_rest: bool = False
    about: AboutSection = field(default_factory=AboutSection)


def read_experiment(folder: Path) -> Experiment:
    """Read the recordings in `folder`. Raises BadInput, one line with file, line and column, for the first fault."""
    path = folder / FILE_NAME
    described = read_toml(path, ExperimentFile)
    _check_unique(path, described)
    signals = tuple(
        RecordedSignal(
            # A sign of -1 belongs to the values; a standard deviation has none.
            s.quantity or "sensor",
            s.joint or s.sensor or "",
            s.si_unit,
            None if s.noise_std is None else abs(s.noise_std * s.factor),
        )
        for s in described.signals
    )
    return Experiment(
        title=described.title,
        path=path,
        model=folder / described.model,
        signals=signals,
        actuators=tuple(command.actuator for command in described.commands),
        known_to=described.known_to.model_dump(exclude_none=True),
        window_s=described.windows.length_s,
        bin_s=described.windows.bin_s,
        most_windows=described.windows.at_most,
        runs=tuple(_read_run(folder, described, place) for place in range(len(described.recordings))),
        prescribed=tuple(
            PrescribedJoint(p.joint, p.si_unit, p.smoothed_s, None if p.scatter_std is None else abs(p.scatter_std * p.factor))
            for p in described.prescribed
        ),
        contacts=tuple(
            SphereOnPlane(sphere, c.plane, c.stiffness_N_per_m1p5, c.damping_s_per_m, c.friction, c.presliding_mm / 1e3, c.drag_N_s_per_m)
            for c in described.contacts
            for sphere in c.spheres
        ),
        alike=dict(described.alike),
        starts_at_rest=described.start.state == "at rest",
        about=described.about,
    )


def measure_seconds(folder: Path) -> float | None:
    """Total duration of the recordings in `folder`; None where they cannot be read."""
    try:
        return sum(float(run.t_s[-1] - run.t_s[0]) for run in read_experiment(folder).runs)
    except (BadInput, OSError):
        return None


def _check_unique(path: Path, described: ExperimentFile) -> None:
    """Refuses a joint's quantity, actuator, file or repeat of a condition that appears twice."""
    keys: list[tuple[str, list[tuple[str, ...]]]] = [
        ("signals", [(signal.joint or signal.sensor or "", signal.quantity or "sensor") for signal in described.signals]),
        ("commands", [(command.actuator,) for command in described.commands]),
        ("prescribed", [(prescribed.joint,) for prescribed in described.prescribed]),
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
    if not (folder / run.file).exists():
        where = place_of(folder / FILE_NAME, ("recordings", place, "file"))
        raise BadInput(f"{where}: recordings[{place + 1}].file: {folder / run.file} is not there")
    # An undriven run needs no columns of commands, and its commands are zero.
    signals, commands = described.signals, described.commands if run.driven else ()
    # Words for the message about a missing column.
    holds = {signal.column: signal.words for signal in signals}
    holds |= {command.column: f"the command of actuator {command.actuator}" for command in commands}
    holds |= {prescribed.column: f"the motion of joint {prescribed.joint}" for prescribed in described.prescribed}
    recording = read_columns(folder / run.file, ColumnRequest(described.time, holds, described.windows.bin_s))
    t_s, values = recording.t_s, recording.values
    inside = select_samples(recording, t_s, run.from_s, run.to_s)
    recorded = np.column_stack([signal.factor * values[signal.column] for signal in signals])
    commanded = np.zeros((len(t_s), len(described.commands)))
    for number, command in enumerate(commands):
        column = command.factor * values[command.column]
        # straight lines through these means push as steps do, to second order in the time between rows
        commanded[:, number] = 0.5 * (column + np.append(column[:1], column[:-1])) if command.held else column
    prescribed = np.empty((len(t_s), len(described.prescribed)))
    for number, given in enumerate(described.prescribed):
        prescribed[:, number] = given.factor * values[given.column]
    label = f"{run.condition}, repeat {run.repeat}"
    return MechanismRun(label, run.condition, t_s[inside], recorded[inside], commanded[inside], bool(commands), prescribed[inside])
