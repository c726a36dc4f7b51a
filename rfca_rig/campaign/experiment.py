"""Reads recordings of any mechanism: a folder with experiment.toml, a model file, and recordings of
one kind.

docs/mechanisms.md shows an experiment.toml. All values from this module are in SI units: rad or m,
rad/s or m/s, N m, N, A or V.

`write_draft` makes a draft of it from a model file and a folder of recordings, with a "?" for
everything that they do not state.
"""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.column_faults import find_glitches
from rfca_rig.campaign.file_kinds import read_beginning, refuse_foreign
from rfca_rig.campaign.free_bodies import convert_poses, list_free_columns, list_free_signals
from rfca_rig.campaign.layout import (
    ANGLE_SPEED_UNITS,
    ANGLE_UNITS,
    COMMAND_UNITS,
    COUNTS,
    EXPERIMENT_FORMAT,
    LENGTH_UNITS,
    SIGNAL_UNITS,
    SPEED_UNITS,
    TIME_UNITS,
    ExperimentFile,
    RecordingSection,
    SignalSection,
)
from rfca_rig.campaign.recorded_columns import ColumnList, ColumnRequest, RecordedColumns
from rfca_rig.campaign.recorded_files import (
    CAN_LOG,
    find_databases,
    find_recordings,
    list_columns,
    list_episodes,
    list_files,
    read_columns,
)
from rfca_rig.campaign.table import select_samples
from rfca_rig.campaign.units import are_different
from rfca_rig.description.sections import AboutSection
from rfca_rig.errors import BadInput
from rfca_rig.escaping import toml_comment
from rfca_rig.mechanism.contact_law import SphereOnPlane
from rfca_rig.mechanism.free_joints import FreeFrame
from rfca_rig.mechanism.load import Mechanism, load_mechanism, make_mechanism
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.layout import EXPERIMENT, is_inside
from rfca_rig.recording.outside import refuse_outside
from rfca_rig.toml import OPEN, format_value, place_of, read_toml

Floats = NDArray[np.float64]

# Nothing is guessed: only the user knows units and columns.
PLACEHOLDER = format_value(OPEN)


@dataclass(frozen=True)
class RecordedSignal:
    """Content of one column: `quantity` is position or speed of the joint `name`, or sensor, of
    which `name` is then the name.

    `unit` and `noise_std` are in SI; `noise_std` is None where it is estimated from the samples.
    """

    quantity: Literal["position", "speed", "sensor"]
    name: str
    unit: str
    noise_std: float | None


@dataclass(frozen=True)
class PrescribedJoint:
    """A joint whose motion is given. `smoothed_s` is the distance of the knots of the spline
    through its column, 0 for all samples.

    `scatter_std` is the deviation of its position from repeat to repeat, in SI, None where its
    column shows that.
    """

    name: str
    unit: str
    smoothed_s: float
    scatter_std: float | None


@dataclass(frozen=True)
class Glitch:
    """A sample that was left out, because a column jumped away in it and came back: when, and by
    how much in the unit of the column.
    """

    column: str
    t_s: float
    jump: float


@dataclass(frozen=True)
class UnitConflict:
    """A column whose file states another unit than experiment.toml does."""

    column: str
    in_file: str
    stated: str

    @property
    def words(self) -> str:
        """What to do about it."""
        return (
            f"the file states the unit {self.in_file}, experiment.toml {self.stated}; correct one"
        )


@dataclass(frozen=True)
class MechanismRun:
    """One recording: times `t_s` (m,) from its beginning, `signals` (m, s) and `commands` (m, u),
    all zero where it was not driven.

    `prescribed` (m, p) are the positions of the prescribed joints. Samples with one of the
    `glitches` are not among the rows. `noise_factors` (m, s) are the noise of each sample over the
    least one of its signal; None where that is constant. `notes` say what was read otherwise than
    it stands in the file.
    """

    label: str
    condition: str
    t_s: Floats
    signals: Floats
    commands: Floats
    driven: bool
    prescribed: Floats
    glitches: tuple[Glitch, ...] = ()
    noise_factors: Floats | None = None
    notes: tuple[str, ...] = ()
    conflicts: tuple[UnitConflict, ...] = ()

    def take(self, rows: NDArray[np.bool_]) -> "MechanismRun":
        """The recording without the other samples; `rows` (m,)."""
        factors = self.noise_factors
        return replace(
            self,
            t_s=self.t_s[rows],
            signals=self.signals[rows],
            commands=self.commands[rows],
            prescribed=self.prescribed[rows],
            noise_factors=None if factors is None else factors[rows],
        )


@dataclass(frozen=True)
class Experiment:
    """The model file, its recordings, the standard uncertainties of [known_to], and the length of
    windows and bins.

    With `chooses_windows`, a diagnosis chooses the length of the windows, from `window_s` on.
    `most_windows` limits the number of windows. `prescribed` joints follow their columns,
    `contacts` have laws of their own. `alike` groups joints, bodies or actuators of one make: their
    names by the name of the group. With `starts_at_rest` a motion begins in equilibrium; otherwise
    windows start from the measured state. The model may name files in the `model_folders` and in
    its own, anywhere if `allow_outside`. `mjcf` is the model as text where the file at `model`
    describes it in another format. `described` are the columns and units of the recordings.
    `frames` are those of the free joints, whose windows may hold contacts if `holds_impacts`.
    """

    title: str
    path: Path
    described: ExperimentFile
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
    chooses_windows: bool = False
    about: AboutSection = field(default_factory=AboutSection)
    model_folders: tuple[Path, ...] = ()
    allow_outside: bool = False
    mjcf: str = ""
    frames: tuple[FreeFrame, ...] = ()
    holds_impacts: bool = False

    def load_model(self) -> Mechanism:
        """The mechanism, as its model describes it. Raises BadInput where that cannot be used."""
        if self.mjcf:
            return make_mechanism(self.model, self.mjcf)
        return load_mechanism(self.model, self.model_folders, self.allow_outside, self.frames)


def read_experiment(folder: Path, allow_outside: bool = False) -> Experiment:
    """Read the recordings in `folder`. Raises BadInput, one line with file, line and column, for
    the first fault.

    Links that lead out of the folder are refused, unless `allow_outside`. Its model may be
    anywhere, where experiment.toml states the path.
    """
    path = folder / EXPERIMENT
    if not allow_outside:
        refuse_outside([path], [folder])
    described = read_toml(path, ExperimentFile)
    _check_unique(path, described)
    model = folder / described.model
    if not allow_outside:
        files = []
        if is_inside(described.model):
            files.append(model)
        if described.can is not None:
            files += [folder / file for file in described.can.databases if is_inside(file)]
        for run in described.recordings:
            files += list_files(folder / run.file)
        refuse_outside(files, [folder])
    return make_experiment(path, described, allow_outside)


def make_experiment(
    path: Path, described: ExperimentFile, allow_outside: bool = False, mjcf: str = ""
) -> Experiment:
    """The experiment of a description, with its recordings.

    Parameters
    ----------
    path
        Of the file with the description.
    described
        The description; files are relative to the folder of `path`.
    allow_outside
        The model may name files anywhere.
    mjcf
        The model as text, where no MJCF or URDF file holds it.

    Raises
    ------
    BadInput
        Where a recording cannot be used.
    """
    folder = path.parent
    model = folder / described.model
    runs = [_read_run(folder, described, index) for index in range(len(described.recordings))]
    frames: tuple[FreeFrame, ...] = ()
    if described.free:
        frames, converted = convert_poses(path, described, [run.signals for run in runs])
        runs = [
            replace(run, signals=of_run.values, noise_factors=of_run.noise_factors).take(
                of_run.is_usable
            )
            for run, of_run in zip(runs, converted, strict=True)
        ]
    described = described.model_copy(
        update={"signals": (*described.signals, *list_free_signals(described))}
    )
    signals = tuple(
        RecordedSignal(
            s.quantity or "sensor",
            s.joint or s.sensor or "",
            s.si_unit,
            _std_in_si(s.noise_std, s.factor),
        )
        for s in described.signals
    )
    return Experiment(
        title=described.title,
        path=path,
        described=described,
        model=model,
        mjcf=mjcf,
        model_folders=(folder, model.parent),
        allow_outside=allow_outside,
        signals=signals,
        actuators=tuple(command.actuator for command in described.commands),
        known_to=described.known_to.model_dump(exclude_none=True),
        window_s=described.windows.shortest_s,
        chooses_windows=described.windows.length_s is None and described.start.state != "at rest",
        bin_s=described.windows.bin_s,
        most_windows=described.windows.at_most,
        runs=tuple(_leave_out_glitches(run, described.signals) for run in runs),
        frames=frames,
        holds_impacts=described.windows.impacts,
        prescribed=tuple(
            PrescribedJoint(
                p.joint,
                p.si_unit,
                p.smoothed_s,
                _std_in_si(p.scatter_std, p.factor),
            )
            for p in described.prescribed
        ),
        contacts=tuple(
            SphereOnPlane(
                sphere,
                c.plane,
                c.stiffness_N_per_m1p5,
                c.damping_s_per_m,
                c.friction,
                c.presliding_mm / 1e3,
                c.drag_N_s_per_m,
            )
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
        (
            "signals",
            [
                (signal.joint or signal.sensor or "", signal.quantity or "sensor")
                for signal in described.signals
            ],
        ),
        ("commands", [(command.actuator,) for command in described.commands]),
        ("prescribed", [(prescribed.joint,) for prescribed in described.prescribed]),
        ("recordings", [_key_of(run) for run in described.recordings]),
        ("recordings", [(run.condition, f"repeat {run.repeat}") for run in described.recordings]),
    ]
    for table, entries in keys:
        for index, key in enumerate(entries):
            if key in entries[:index]:
                first = entries.index(key) + 1
                raise BadInput(
                    f"{place_of(path, (table, index))}: {table}[{index + 1}]: "
                    f"{', '.join(key)} is already {table}[{first}]"
                )


def _key_of(run: RecordingSection) -> tuple[str, ...]:
    """What no other recording may be."""
    if run.episode is None:
        return (run.file,)
    return run.file, f"episode {run.episode}"


def _std_in_si(std: float | None, factor: float) -> float | None:
    """A standard deviation, None where it is not stated."""
    if std is None:
        return None
    # A sign of -1 belongs to the values; a standard deviation has none.
    return abs(std * factor)


def _read_run(folder: Path, described: ExperimentFile, index: int) -> MechanismRun:
    run = described.recordings[index]
    if not (folder / run.file).exists():
        where = place_of(folder / EXPERIMENT, ("recordings", index, "file"))
        raise BadInput(f"{where}: recordings[{index + 1}].file: {folder / run.file} is not there")
    # An undriven run needs no columns of commands, and its commands are zero.
    signals = described.signals
    commands = described.commands
    if not run.driven:
        commands = ()
    # Words for the message about a missing column.
    holds = {signal.column: signal.words for signal in signals}
    holds |= {command.column: f"the command of actuator {command.actuator}" for command in commands}
    holds |= {
        prescribed.column: f"the motion of joint {prescribed.joint}"
        for prescribed in described.prescribed
    }
    for free in described.free:
        holds |= list_free_columns(free)
    request = ColumnRequest(
        described.time,
        holds,
        described.windows.bin_s,
        databases=_list_databases(folder, described),
        bus=described.can.bus if described.can else None,
        episode=run.episode,
    )
    recording = read_columns(folder / run.file, request)
    t_s = recording.t_s
    values = recording.values
    inside = select_samples(recording, t_s, run.from_s, run.to_s)
    columns = [signal.factor * values[signal.column] for signal in signals]
    for free in described.free:
        columns += [values[column] for column in (*free.position, *free.orientation)]
    recorded = np.column_stack(columns)
    commanded = np.zeros((len(t_s), len(described.commands)))
    for number, command in enumerate(commands):
        column = command.factor * values[command.column]
        # straight lines through these means push as steps do, to second order in the time between
        # rows
        if command.held:
            commanded[:, number] = 0.5 * (column + np.append(column[:1], column[:-1]))
        else:
            commanded[:, number] = column
    prescribed = np.empty((len(t_s), len(described.prescribed)))
    for number, given in enumerate(described.prescribed):
        prescribed[:, number] = given.factor * values[given.column]
    label = f"{run.condition}, repeat {run.repeat}"
    return MechanismRun(
        label,
        run.condition,
        t_s[inside],
        recorded[inside],
        commanded[inside],
        bool(commands),
        prescribed[inside],
        notes=recording.notes,
        conflicts=_find_unit_conflicts(described, recording),
    )


def _list_databases(folder: Path, described: ExperimentFile) -> list[Path]:
    """The databases of [can]. Raises BadInput where one is not there."""
    if described.can is None:
        return []
    databases = [folder / file for file in described.can.databases]
    for index, file in enumerate(databases):
        if not file.is_file():
            where = place_of(folder / EXPERIMENT, ("can", "databases", index))
            raise BadInput(f"{where}: can.databases: {file} is not there")
    return databases


def _find_unit_conflicts(
    described: ExperimentFile, recording: RecordedColumns
) -> tuple[UnitConflict, ...]:
    """The columns whose unit the file states otherwise."""
    stated = {described.time.column: described.time.unit}
    stated |= {signal.column: signal.unit for signal in described.signals}
    stated |= {command.column: command.unit for command in described.commands}
    stated |= {joint.column: joint.unit for joint in described.prescribed}
    conflicts = []
    for column, unit in stated.items():
        in_file = recording.units.get(column, "")
        if in_file and column in recording.values and are_different(in_file, unit):
            conflicts.append(UnitConflict(column, in_file, unit))
    return tuple(conflicts)


def _leave_out_glitches(run: MechanismRun, signals: Sequence[SignalSection]) -> MechanismRun:
    """The recording without samples in which a position or speed jumps away and comes back. A
    force may do so.
    """
    glitches = []
    is_kept = np.ones(len(run.t_s), dtype=bool)
    for signal, recorded in zip(signals, run.signals.T, strict=True):
        if signal.quantity is None:
            continue
        for sample in find_glitches(recorded):
            jump = float(recorded[sample] - recorded[sample - 1]) / signal.factor
            glitches.append(Glitch(signal.column, float(run.t_s[sample]), jump))
            is_kept[sample] = False
    if not glitches:
        return run
    return replace(run.take(is_kept), glitches=tuple(glitches))


def write_draft(mechanism: Mechanism, folder: Path, allow_outside: bool = False) -> Path:
    """Write the draft into `folder` and return its path. Links to recordings elsewhere are refused,
    unless `allow_outside`.

    Raises
    ------
    BadInput
        Where experiment.toml exists, there is no recording, or one cannot be read.
    """
    path = folder / EXPERIMENT
    recordings = find_recordings(folder)
    if path.exists():
        raise BadInput(f"{path}: is there already; remove it, or edit it")
    if not recordings:
        for file in sorted(folder.rglob("*")):
            if file.is_file():
                refuse_foreign(file, read_beginning(file))
        raise BadInput(
            f"{folder}: holds no recording (.csv, .tsv, .lvm, .h5, .hdf5, .mat, .mcap, a CAN log, "
            "or a ROS bag); --data names the folder of the recordings"
        )
    if not allow_outside:
        files = find_databases(folder)
        for of_kind in recordings.values():
            for recording in of_kind:
                files += list_files(recording)
        refuse_outside(files, [folder])
    write_atomically(path, make_draft(mechanism, folder, recordings).encode("utf-8"))
    return path


def make_draft(mechanism: Mechanism, folder: Path, found: Mapping[str, Sequence[Path]]) -> str:
    """The text of the draft, for the first kind of recordings in `found`; all files share the
    names of their columns.
    """
    # One experiment has one set of columns, hence one kind of file.
    kind, *others = found
    files = found[kind]
    databases = find_databases(folder)
    columns = list_columns(files[0], databases)
    lines = [
        _comment(f'Replace every "?". Then: rfca-rig check {folder.name}'),
        f"format = {format_value(EXPERIMENT_FORMAT)}",
        f"title = {format_value(folder.resolve().name)}",
        f"model = {format_value(Path(os.path.relpath(mechanism.path, folder)).as_posix())}",
        "",
        "# For the head of every page; remove the signs # in front.",
        *(f'# about.{name} = ""' for name in AboutSection.model_fields),
        "",
        _comment(
            f"Columns of {files[0].relative_to(folder).as_posix()}, with their smallest "
            "and largest values:"
        ),
        *(_comment(f"  {note}") for note in columns.notes),
        *(
            _comment(f"  {name}{_label(columns, name)}: {_extent(values)}")
            for name, values in columns.values.items()
        ),
        *_draft_time(columns),
    ]
    if kind == CAN_LOG:
        names = [file.relative_to(folder).as_posix() for file in databases]
        lines += ["", "[can]", f"databases = {format_value(names)}"]
    for index, joint in enumerate(mechanism.joints):
        slides = bool(mechanism.is_slide[index])
        if slides:
            position = LENGTH_UNITS
            speed = SPEED_UNITS
            hint = ""
        else:
            position = {**ANGLE_UNITS, COUNTS: 0.0}
            speed = ANGLE_SPEED_UNITS
            hint = "; a count needs counts_per_turn"
        lines += _table(
            "signals",
            {"joint": format_value(joint), "quantity": format_value("position")},
            f"{_any_of(position)}{hint}",
        )
        lines += _table(
            "signals",
            {"joint": format_value(joint), "quantity": format_value("speed")},
            _any_of(speed),
            "if speeds were not recorded",
        )
    for sensor, (_, unit) in mechanism.sensor_values.items():
        lines += _table(
            "signals",
            {"sensor": format_value(sensor)},
            _any_of(SIGNAL_UNITS[unit]),
            "if it was not recorded",
        )
    for actuator in mechanism.actuators:
        lines += _table(
            "commands",
            {"actuator": format_value(actuator)},
            f"{_any_of(COMMAND_UNITS)}; measured, or else commanded",
            "if it was off",
        )
        lines.append(
            "# held = true  # where it was commanded, and acts until the next row; a "
            "measured one runs straight from row to row"
        )
    lines += [
        "",
        (
            "# How well the values of the model file are known: one standard deviation. What "
            "is not listed counts as exact."
        ),
        (
            "# docs/mechanisms.md lists all keys. A prior that is too narrow distorts the "
            "answer; one that is too wide can hide an effect."
        ),
        "[known_to]",
        f"mass_relative = {PLACEHOLDER}  # 0.01 for bodies that were weighed, 0.05 from drawings",
        *(
            ()
            if mechanism.is_slide.all()
            else (
                (
                    f"zero_offset_deg = {PLACEHOLDER}  # of the encoders, 0.3 for joints that "
                    "were set by hand"
                ),
            )
        ),
        (
            f"torque_error_relative = {PLACEHOLDER}  # of the torques: 0.01 from a sensor or "
            "torque control, 0.03 from a motor current"
        ),
        "# Often uncertain too; remove the sign # in front.",
        "# centre_of_mass_m = 0.002",
        "# command_delay_s = 0.002",
    ]
    lines += [
        f"\n# Left out, as they are of another kind: {len(found[other])} x {other}"
        for other in others
    ]
    for number, (file, episode) in enumerate(_list_recordings(files, columns), start=1):
        lines += [
            "",
            "[[recordings]]",
            f"file = {format_value(file.relative_to(folder).as_posix())}",
            f'condition = "recording {number}"',
        ]
        if episode is not None:
            lines.append(f"episode = {episode}")
    return "\n".join(lines) + "\n"


def _draft_time(columns: ColumnList) -> list[str]:
    """The lines of [time]."""
    if len(columns.times) == 1:
        time_column = format_value(columns.times[0])
    else:
        time_column = PLACEHOLDER
    if not columns.times:
        time_column += f"  {_comment(columns.no_time)}"
    time_unit = f"{PLACEHOLDER}  # {_any_of(TIME_UNITS)}"
    if columns.time_unit:
        time_unit = format_value(columns.time_unit)
    return ["", "[time]", f"column = {time_column}", f"unit = {time_unit}"]


def _list_recordings(
    files: Sequence[Path], columns: ColumnList
) -> Iterator[tuple[Path, int | None]]:
    """The recordings in all files, of which the first has these columns: a file each, or each
    episode of the files.
    """
    for file in files:
        episodes: tuple[int, ...] = ()
        if file == files[0]:
            episodes = columns.episodes
        # Files of a data set hold one episode each, or all of them several.
        elif len(columns.episodes) > 1:
            episodes = list_episodes(file)
        if len(episodes) > 1:
            for episode in episodes:
                yield file, episode
        else:
            yield file, None


def _label(columns: ColumnList, name: str) -> str:
    if name in columns.labels:
        return f" ({columns.labels[name]})"
    return ""


def _comment(text: str) -> str:
    return toml_comment(text).rstrip("\n")


def _table(name: str, known: dict[str, str], units: str, remove: str = "") -> list[str]:
    fields = [f"{key} = {value}" for key, value in known.items()]
    head = f"[[{name}]]"
    if remove:
        head += f"  # remove this table {remove}"
    return [
        "",
        head,
        *fields,
        f"column = {PLACEHOLDER}",
        f"unit = {PLACEHOLDER}  # {units}",
    ]


def _any_of(units: dict[str, float]) -> str:
    *names, last = units
    if names:
        return f"{', '.join(names)} or {last}"
    return last


def _extent(values: np.ndarray[tuple[int], np.dtype[np.float64]] | None) -> str:
    if values is None:
        return "no numbers"
    return f"{values.min():.4g} to {values.max():.4g}"
