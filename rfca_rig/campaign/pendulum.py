"""Reads a folder of recordings of a pendulum: one or two links without ground, their joints driven
by recorded torques.

The folder holds pendulum.toml and a CSV file per run:

    format = "rfca-pendulum/1"
    title = "..."
    [link1]                                # from the fixed joint; [link2], if any, on its end
    length_m = 0.5                         # to the next joint, or to the tip
    mass_kg = 0.6
    centre_of_mass_m = 0.4                 # from the joint
    inertia_kg_m2 = 0.11                   # about the joint
    joint_damping_Nm_s_per_rad = 0.0       # this and the next five: 0 if left out
    joint_friction_Nm = 0.0
    rotor_inertia_kg_m2 = 0.0              # of the motor's rotor, times the gear ratio squared
    torque_offset_Nm = 0.0                 # added to the recorded torque
    torque_delay_s = 0.0                   # the torque acts so much later than recorded
    zero_offset_rad = 0.0                  # the angle is read so much larger than it is
    driven = true                          # false: the joint has no motor; true if left out
    [known_to]                             # standard uncertainties; a missing key counts as exact
    mass_relative = 0.02                   # inertia changes with mass; keys: docs/pendulums.md
    [columns]                              # names in the CSV files; angles from hanging straight,
    t_s = "time"                           # angle2 from the straight line of link 1
    angle1_rad = "pos1"                    # angle2_rad, speed1_rad_s, torque1_Nm ... alike
    [noise_std]                            # optional: angle_rad, speed_rad_s of one sample
    [[runs]]
    file = "runs/a.csv"
    condition = "slow"                     # runs of one condition are repeats
    repeat = 1
    from_s = 0.0                           # the part that counts; optional
    to_s = 5.0
    driven = false                         # the motors were off; default: if all torques are 0
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from rfca_rig.campaign.experiment import Experiment, MechanismRun, make_experiment
from rfca_rig.campaign.layout import (
    CommandSection,
    ExperimentFile,
    KnownToMechanism,
    RecordingSection,
    RunSection,
    SignalSection,
    Text,
    TimeSection,
)
from rfca_rig.description.sections import AboutSection
from rfca_rig.errors import BadInput
from rfca_rig.escaping import toml_comment
from rfca_rig.model.parameters import GRAVITY_M_S2
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.layout import PENDULUM
from rfca_rig.recording.outside import refuse_outside
from rfca_rig.toml import NotNegative, Positive, Section, format_value, place_of, read_toml, table

MODEL_FORMAT = "rfca-pendulum-model/1"
FILE_NAME = PENDULUM

# Delay of a torque behind the angles; windows are cut with a margin of twice that.
LONGEST_DELAY_S = 0.05
# Keys of [known_to] that an experiment on a mechanism calls otherwise.
_KNOWN_TO = {
    "inertia_relative": "inertia_about_joint_relative",
    "torque_delay_s": "command_delay_s",
}
# Values of a link to which a fit adds.
_ADDED = (
    "centre_of_mass_m",
    "joint_damping_Nm_s_per_rad",
    "joint_friction_Nm",
    "rotor_inertia_kg_m2",
    "torque_offset_Nm",
    "zero_offset_rad",
)
_NEVER_NEGATIVE = ("joint_damping_Nm_s_per_rad", "joint_friction_Nm", "rotor_inertia_kg_m2")
# Of a link about its centre of mass, as a share of that about its joint.
LEAST_INERTIA = 1e-9


class LinkSection(Section):
    """[link1], [link2]: nominal values of one link and the joint that carries it."""

    length_m: Positive = Field(description="from joint to joint")
    mass_kg: Positive = Field(description="mass")
    centre_of_mass_m: NotNegative = Field(
        description="distance of the centre of mass from the joint"
    )
    inertia_kg_m2: Positive = Field(description="inertia about the joint")
    joint_damping_Nm_s_per_rad: NotNegative = Field(
        default=0.0, description="viscous damping of the joint"
    )
    joint_friction_Nm: NotNegative = Field(default=0.0, description="dry friction of the joint")
    torque_offset_Nm: float = Field(default=0.0, description="added to the recorded torque")
    driven: bool = Field(default=True, description="whether the joint has a motor")
    zero_offset_rad: float = Field(default=0.0, description="offset of the recorded angle")
    torque_delay_s: Annotated[float, Field(ge=-LONGEST_DELAY_S, le=LONGEST_DELAY_S)] = Field(
        default=0.0, description="delay of the torque behind the recording"
    )
    rotor_inertia_kg_m2: NotNegative = Field(
        default=0.0, description="rotor inertia times the gear ratio squared"
    )

    @model_validator(mode="after")
    def _turns_heavily_enough(self) -> Self:
        least = self.mass_kg * self.centre_of_mass_m**2
        # Steiner: the inertia about the joint cannot be below that of a point mass at the centre of
        # mass.
        if self.inertia_kg_m2 < least * (1.0 - 1e-9):
            raise ValueError(
                f"inertia_kg_m2 is about the joint and so at least {least:.4g}, mass "
                "times centre of mass squared"
            )
        return self


class KnownToPendulum(Section):
    """[known_to]: the standard uncertainty of each nominal value, for each link independently.
    Values without a key count as exact.
    """

    mass_relative: Positive | None = Field(
        default=None, description="mass of a link; its inertia changes with it"
    )
    centre_of_mass_m: Positive | None = Field(
        default=None, description="distance of the centre of mass from the joint"
    )
    inertia_relative: Positive | None = Field(default=None, description="inertia about the joint")
    joint_damping_Nm_s_per_rad: Positive | None = Field(
        default=None, description="viscous damping; never below 0"
    )
    joint_friction_Nm: Positive | None = Field(
        default=None, description="dry friction; never below 0"
    )
    torque_offset_Nm: Positive | None = Field(
        default=None, description="added to the recorded torque"
    )
    zero_offset_rad: Positive | None = Field(
        default=None, description="offset of the recorded angle"
    )
    torque_delay_s: Annotated[float, Field(gt=0.0, le=LONGEST_DELAY_S / 2)] | None = Field(
        default=None, description="delay of the torque behind the recording"
    )
    rotor_inertia_kg_m2: Positive | None = Field(
        default=None, description="rotor inertia times the gear ratio squared; never below 0"
    )
    torque_error_relative: Annotated[float, Field(ge=0.001, le=0.2)] | None = Field(
        default=None, description="usual error of the torques; 0.01 if not given"
    )


class ColumnsSection(Section):
    """[columns]: the column of each quantity in the CSV files. Speeds may be absent, and torques
    of joints without a motor.
    """

    t_s: Text
    angle1_rad: Text
    angle2_rad: Text | None = None
    speed1_rad_s: Text | None = None
    speed2_rad_s: Text | None = None
    torque1_Nm: Text | None = None
    torque2_Nm: Text | None = None

    def of(self, quantity: str) -> str | None:
        """The column of "angle1_rad" and so on."""
        column: str | None = getattr(self, quantity)
        return column

    def need(self, quantity: str) -> str:
        """The same column, which `_check_columns` has found to be stated."""
        column = self.of(quantity)
        assert column is not None
        return column


class NoiseSection(Section):
    """[noise_std]: noise of one sample. Where it is not given, it is estimated from neighbouring
    samples.
    """

    angle_rad: Positive | None = None
    speed_rad_s: Positive | None = None


class PendulumRunSection(RunSection):
    """`driven` false: the motors were off. Without the key, this is assumed for a run whose
    torques are all zero.
    """

    driven: bool | None = None


class PendulumFile(Section):
    """pendulum.toml: the nominal pendulum, the uncertainties of its values, and the runs."""

    format: Literal["rfca-pendulum/1"]
    title: Annotated[str, Field(max_length=1000)]
    about: AboutSection = AboutSection()
    link1: LinkSection
    link2: LinkSection | None = None
    known_to: KnownToPendulum = KnownToPendulum()
    columns: ColumnsSection
    noise_std: NoiseSection = NoiseSection()
    runs: Annotated[tuple[PendulumRunSection, ...], Field(strict=False, min_length=1)]

    @property
    def links(self) -> tuple[LinkSection, ...]:
        if self.link2 is None:
            return (self.link1,)
        return (self.link1, self.link2)


def run_files(folder: Path) -> tuple[str, ...]:
    """The CSV files of the campaign in `folder`, as paths relative to it. Raises BadInput where
    its description cannot be used.
    """
    return tuple(run.file for run in read_toml(folder / FILE_NAME, PendulumFile).runs)


class PendulumModelFile(Section):
    """Layout of a pendulum's model file."""

    format: Literal["rfca-pendulum-model/1"]
    link1: LinkSection
    link2: LinkSection | None = None
    known_to: KnownToPendulum = KnownToPendulum()

    @property
    def links(self) -> tuple[LinkSection, ...]:
        if self.link2 is None:
            return (self.link1,)
        return (self.link1, self.link2)


def read_pendulum(
    folder: Path, allow_outside: bool = False, model_file: Path | None = None
) -> Experiment:
    """The pendulum in `folder` as an experiment on a mechanism.

    Parameters
    ----------
    folder
        Of pendulum.toml.
    allow_outside
        Take links that lead out of the folder.
    model_file
        A model file, whose nominal values are used in place of those of pendulum.toml.

    Raises
    ------
    BadInput
        One line with file, line and column, for the first fault.
    """
    path = folder / FILE_NAME
    described = read_pendulum_file(folder, allow_outside, model_file)
    experiment = make_experiment(
        path,
        _describe_as_experiment(described),
        allow_outside,
        write_pendulum_mjcf(described.links),
    )
    runs = [
        _correct_torques(run, described, section.driven)
        for run, section in zip(experiment.runs, described.runs, strict=True)
    ]
    return replace(experiment, runs=tuple(runs), model=model_file or path)


def read_pendulum_file(
    folder: Path, allow_outside: bool = False, model_file: Path | None = None
) -> PendulumFile:
    """The description in `folder`, checked; with the links and uncertainties of the model file, if
    any. Raises BadInput as `read_pendulum`.
    """
    path = folder / FILE_NAME
    if not path.is_file():
        raise BadInput(
            f"{path}: is not there; recordings of a pendulum are a folder with "
            f"{FILE_NAME} and CSV files"
        )
    if not allow_outside:
        refuse_outside([path], [folder])
    described = read_toml(path, PendulumFile)
    if not allow_outside:
        refuse_outside((folder / run.file for run in described.runs), [folder])
    _check_columns(path, described)
    _check_runs(folder, path, described)
    if model_file is None:
        return described
    model = read_toml(model_file, PendulumModelFile)
    ours = len(described.links)
    theirs = len(model.links)
    # [known_to] is replaced too, so both must describe the same pendulum.
    if ours != theirs:
        raise BadInput(
            f"{model_file}: a model of {theirs} links, but {described.title!r} has {ours}; give "
            "the model file of this pendulum"
        )
    return described.model_copy(
        update={"link1": model.link1, "link2": model.link2, "known_to": model.known_to}
    )


def _describe_as_experiment(described: PendulumFile) -> ExperimentFile:
    """The same description in the words of an experiment."""
    columns = described.columns
    joints = range(1, len(described.links) + 1)
    noise = described.noise_std
    signals = [
        SignalSection(
            joint=f"joint{joint}",
            quantity="position",
            column=columns.need(f"angle{joint}_rad"),
            unit="rad",
            noise_std=noise.angle_rad,
        )
        for joint in joints
    ]
    # Speeds of single joints are of no use: all of them, or the angles alone.
    speeds = [columns.of(f"speed{joint}_rad_s") for joint in joints]
    for joint, column in zip(joints, speeds, strict=True):
        if column is not None and None not in speeds:
            signals.append(
                SignalSection(
                    joint=f"joint{joint}",
                    quantity="speed",
                    column=column,
                    unit="rad/s",
                    noise_std=noise.speed_rad_s,
                )
            )
    commands = [
        CommandSection(
            actuator=f"motor{joint}", column=columns.need(f"torque{joint}_Nm"), unit="N m"
        )
        for joint, link in zip(joints, described.links, strict=True)
        if link.driven and columns.of(f"torque{joint}_Nm") is not None
    ]
    known_to = described.known_to.model_dump(exclude_none=True)
    for key, name in _KNOWN_TO.items():
        if key in known_to:
            known_to[name] = known_to.pop(key)
    recordings = [
        RecordingSection(
            file=run.file,
            condition=run.condition,
            repeat=run.repeat,
            from_s=run.from_s,
            to_s=run.to_s,
            driven=run.driven is not False,
        )
        for run in described.runs
    ]
    return ExperimentFile(
        format="rfca-experiment/1",
        title=described.title,
        about=described.about,
        model=FILE_NAME,
        time=TimeSection(column=columns.t_s, unit="s"),
        signals=tuple(signals),
        commands=tuple(commands),
        known_to=KnownToMechanism(**known_to),
        recordings=tuple(recordings),
    )


def _correct_torques(
    run: MechanismRun, described: PendulumFile, driven: bool | None
) -> MechanismRun:
    """The run with the nominal delays and offsets of its torques, which MJCF cannot express.

    Without a statement, torques that are zero throughout mean that the motors were off.
    """
    if driven is None:
        driven = bool(run.commands.any())
    if not driven:
        return replace(run, commands=np.zeros_like(run.commands), driven=False)
    commands = run.commands.copy()
    links = [link for link in described.links if link.driven]
    for motor, link in enumerate(links[: commands.shape[1]]):
        late_s = run.t_s - link.torque_delay_s
        commands[:, motor] = np.interp(late_s, run.t_s, commands[:, motor]) + link.torque_offset_Nm
    return replace(run, commands=commands)


def write_pendulum_mjcf(links: Sequence[LinkSection]) -> str:
    """The pendulum in MJCF: links hanging along -z, hinges about y, a motor in each driven joint.

    The angle of joint 1 counts from the hanging position, that of any other joint from the
    direction of the link before.
    """
    bodies = ""
    # From the last link inwards, as each body contains the text of those beyond it.
    for number in range(len(links), 0, -1):
        bodies = _write_link(links, number, bodies)
    motors = "".join(
        f'<motor name="motor{number}" joint="joint{number}"/>'
        for number, link in enumerate(links, start=1)
        if link.driven
    )
    return f"""<mujoco model="pendulum">
 <compiler angle="radian"/>
 <option gravity="0 0 {-GRAVITY_M_S2!r}" integrator="RK4"/>
 <worldbody>
{bodies} </worldbody>
 <actuator>{motors}</actuator>
</mujoco>
"""


def _write_link(links: Sequence[LinkSection], number: int, further: str) -> str:
    """One link with those beyond it, whose text is `further`."""
    link = links[number - 1]
    at_m = 0.0
    if number > 1:
        at_m = links[number - 2].length_m
    inertia = link.inertia_kg_m2 - link.mass_kg * link.centre_of_mass_m**2
    # MuJoCo refuses point masses: a little inertia about the centre of mass.
    inertia = max(inertia, LEAST_INERTIA * link.inertia_kg_m2)
    # A slender link: the inertia about its own direction hardly matters.
    spin = 1e-3 * inertia
    tip = ""
    if not further:
        tip = f'   <site name="tip" pos="0 0 {-link.length_m!r}"/>\n'
    return f"""  <body name="link{number}" pos="0 0 {-at_m!r}">
   <joint name="joint{number}" axis="0 -1 0" ref="{link.zero_offset_rad!r}" \
damping="{link.joint_damping_Nm_s_per_rad!r}" frictionloss="{link.joint_friction_Nm!r}" \
armature="{link.rotor_inertia_kg_m2!r}"/>
   <inertial pos="0 0 {-link.centre_of_mass_m!r}" mass="{link.mass_kg!r}" \
diaginertia="{inertia!r} {inertia!r} {spin!r}"/>
{tip}{further}  </body>
"""


def _check_columns(path: Path, described: PendulumFile) -> None:
    """Every joint has its angle, every driven one its torque, and no column belongs to an absent
    joint.
    """
    columns = described.columns
    powered = any(run.driven is not False for run in described.runs)
    for joint, link in enumerate(described.links, start=1):
        for quantity, needed in (
            (f"angle{joint}_rad", True),
            (f"torque{joint}_Nm", link.driven and powered),
        ):
            if needed and columns.of(quantity) is None:
                if quantity.startswith("torque"):
                    hint = ", or give driven = false for runs with the motors off"
                else:
                    hint = ""
                raise BadInput(
                    f"{place_of(path, ('columns',))}: columns.{quantity}: missing; name "
                    f"the CSV column that holds it{hint}"
                )
    if described.link2 is None:
        for quantity in ("angle2_rad", "speed2_rad_s", "torque2_Nm"):
            if columns.of(quantity) is not None:
                raise BadInput(
                    f"{place_of(path, ('columns', quantity))}: columns.{quantity}: there "
                    "is no [link2] it could belong to"
                )


def _check_runs(folder: Path, path: Path, described: PendulumFile) -> None:
    """Every run exists, has a file of its own and is another repeat of its condition."""
    files: dict[str, int] = {}
    repeats: dict[tuple[str, int], int] = {}
    for index, run in enumerate(described.runs):
        where = f"{place_of(path, ('runs', index, 'file'))}: runs[{index + 1}]"
        if run.file in files:
            raise BadInput(
                f"{where}.file: {run.file} is already the file of runs[{files[run.file] + 1}]"
            )
        if not (folder / run.file).is_file():
            raise BadInput(f"{where}.file: {folder / run.file} is not there")
        if (run.condition, run.repeat) in repeats:
            first = repeats[run.condition, run.repeat] + 1
            raise BadInput(
                f"{where}.repeat: {run.condition}, repeat {run.repeat} is already "
                f"runs[{first}]; count the repeats up"
            )
        files[run.file] = repeats[run.condition, run.repeat] = index


def fit_links(links: Sequence[LinkSection], shifts: Mapping[str, float]) -> list[LinkSection]:
    """The links with fitted nominal values.

    Parameters
    ----------
    links
        The nominal links.
    shifts
        Shift of each nominal value by the name of the nuisance parameter, as link1.mass_relative.

    Raises
    ------
    BadInput
        Where no pendulum has these values.
    """
    fitted = []
    for number, link in enumerate(links, start=1):
        shift = {
            key: shifts.get(f"link{number}.{key}", shifts.get(f"joint{number}.{key}", 0.0))
            for key in (*_ADDED, "mass_relative", "inertia_about_joint_relative")
        }
        mass_kg = link.mass_kg * (1.0 + shift["mass_relative"])
        # A heavier link of the same shape: its inertia grows in proportion.
        inertia = link.inertia_kg_m2 * (1.0 + shift["mass_relative"])
        centre_m = link.centre_of_mass_m + shift["centre_of_mass_m"]
        # Steiner's theorem: the inertia about the centre of mass stays where that is shifted.
        inertia += mass_kg * (centre_m**2 - link.centre_of_mass_m**2)
        inertia *= 1.0 + shift["inertia_about_joint_relative"]
        values = {
            **link.model_dump(),
            **{key: getattr(link, key) + shift[key] for key in _ADDED},
            "mass_kg": mass_kg,
            "centre_of_mass_m": centre_m,
            "inertia_kg_m2": inertia,
            "torque_delay_s": link.torque_delay_s + shifts.get("command_delay_s", 0.0),
        }
        for key in _NEVER_NEGATIVE:
            values[key] = max(0.0, values[key])
        fitted.append(LinkSection(**values))
    return fitted


def is_pendulum(experiment: Experiment) -> bool:
    """Whether a pendulum.toml describes the experiment."""
    return experiment.path.name == FILE_NAME


def write_fitted_pendulum(
    path: Path,
    folder: Path,
    shifts: Mapping[str, tuple[float, float]],
    comments: Iterable[str],
) -> None:
    """Write the model file of a fit to the recordings in `folder`.

    Parameters
    ----------
    path
        Of the file, which is written all or nothing.
    folder
        With pendulum.toml.
    shifts
        Value and standard deviation of each fitted nuisance parameter, by its name.
    comments
        Lines at the head of the file.

    Raises
    ------
    BadInput
        Where no pendulum has the fitted values.
    RigError
        Where the disk refuses.
    """
    described = read_toml(folder / FILE_NAME, PendulumFile)
    links = fit_links(described.links, {name: value for name, (value, _) in shifts.items()})
    known_to = described.known_to.model_dump(exclude_none=True)
    # A value that is known by one key for all links is known as well as that of the worst link.
    for key in known_to:
        name = _KNOWN_TO.get(key, key)
        stds = [std for shift, (_, std) in shifts.items() if shift.rpartition(".")[2] == name]
        if stds:
            known_to[key] = max(stds)
    write_pendulum_model(path, links, known_to, comments)


def write_pendulum_model(
    path: Path,
    links: Sequence[LinkSection],
    known_to: Mapping[str, float],
    comments: Iterable[str],
) -> None:
    """Write a model file, all or nothing, with `comments` at its head. Raises RigError where the
    disk refuses.
    """
    head = f"format = {format_value(MODEL_FORMAT)}\n"
    tables = [
        table(f"link{number}", link.model_dump()) for number, link in enumerate(links, start=1)
    ]
    parts = ["".join(map(toml_comment, comments)) + head, *tables, table("known_to", known_to)]
    write_atomically(path, "\n".join(parts).encode("utf-8"))
