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

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from rfca_rig.campaign.table import CsvTable, numbers, read_table, select_samples
from rfca_rig.description.sections import AboutSection
from rfca_rig.errors import BadInput
from rfca_rig.escaping import toml_comment
from rfca_rig.model.pendulum import Pendulum, PendulumLink
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.layout import PENDULUM
from rfca_rig.recording.outside import refuse_outside
from rfca_rig.toml import NotNegative, Positive, Section, format_value, place_of, read_toml, table

FORMAT = "rfca-pendulum/1"
MODEL_FORMAT = "rfca-pendulum-model/1"
FILE_NAME = PENDULUM

# Delay of a torque behind the angles; swings are cut with a margin of twice that.
LONGEST_DELAY_S = 0.05

Text = Annotated[str, Field(min_length=1)]

Floats = NDArray[np.float64]


class LinkSection(Section):
    """[link1], [link2]: nominal values of one link and the joint that carries it; see
    `model.pendulum.PendulumLink`.
    """

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


class NoiseSection(Section):
    """[noise_std]: noise of one sample. Where it is not given, it is estimated from neighbouring
    samples.
    """

    angle_rad: Positive | None = None
    speed_rad_s: Positive | None = None


class RunSection(Section):
    """One recording: its file, its condition in words, its repeat, and the part of it that
    counts.
    """

    file: Text = Field(description="recording, relative to this folder")
    condition: Text = Field(description="recordings of one condition are repeats")
    repeat: Annotated[int, Field(ge=1)] = Field(default=1, description="number of the repeat")
    from_s: float | None = Field(default=None, description="start of the part that counts")
    to_s: float | None = Field(default=None, description="end of the part that counts")

    @field_validator("file")
    @classmethod
    def _inside_the_folder(cls, file: str) -> str:
        if "\\" in file or file.startswith("/") or ".." in file.split("/"):
            raise ValueError("must lie inside the folder, with / between folder and file")
        return file

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.from_s is not None and self.to_s is not None and self.to_s <= self.from_s:
            raise ValueError(f"to_s should be after from_s, {self.from_s:g} s")
        return self


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


@dataclass(frozen=True)
class PendulumRun:
    """One recording: times (m,), joint angles and torques (m, n), speeds (m, n) or None.

    Joints without a motor have torque 0, and so does a run that is not `powered`.
    """

    label: str
    condition: str
    repeat: int
    t_s: Floats
    angle_rad: Floats
    speed_rad_s: Floats | None
    torque_Nm: Floats
    powered: bool = True


@dataclass(frozen=True)
class PendulumCampaign:
    """The nominal pendulum, one standard deviation per key of [known_to] and of [noise_std], and
    the runs.
    """

    title: str
    pendulum: Pendulum
    known_to: dict[str, float]
    noise_std: dict[str, float]
    runs: tuple[PendulumRun, ...]
    about: AboutSection = field(default_factory=AboutSection)


def read_pendulum_campaign(folder: Path, allow_outside: bool = False) -> PendulumCampaign:
    """Read the recordings in `folder`. Raises BadInput, one line with file, line and column, for
    the first fault.

    Links that lead out of the folder are refused, unless `allow_outside`.
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
    return PendulumCampaign(
        title=described.title,
        pendulum=make_pendulum(*described.links),
        known_to=described.known_to.model_dump(exclude_none=True),
        noise_std=described.noise_std.model_dump(exclude_none=True),
        runs=tuple(_run(folder, described, run) for run in described.runs),
        about=described.about,
    )


def run_files(folder: Path) -> tuple[str, ...]:
    """The CSV files of the campaign in `folder`, as paths relative to it. Raises BadInput where
    its description cannot be used.
    """
    return tuple(run.file for run in read_toml(folder / FILE_NAME, PendulumFile).runs)


def make_pendulum(*links: LinkSection | None) -> Pendulum:
    """The pendulum of these sections, from the fixed joint outwards; None stands for an absent
    link.
    """
    return Pendulum(tuple(PendulumLink(**link.model_dump()) for link in links if link is not None))


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


def _run(folder: Path, described: PendulumFile, run: PendulumRunSection) -> PendulumRun:
    table = read_table(folder / run.file)
    values = numbers(table)
    columns = described.columns
    joints = range(1, len(described.links) + 1)
    t_s = _column(table, values, columns, "t_s")
    inside = select_samples(table, t_s, run.from_s, run.to_s)
    speeds = [f"speed{joint}_rad_s" for joint in joints]
    # Undriven joints need no column of torques.
    torques = [
        _column(table, values, columns, f"torque{joint}_Nm")
        if link.driven and run.driven is not False
        else np.zeros(len(t_s))
        for joint, link in zip(joints, described.links, strict=True)
    ]
    torque_Nm = np.column_stack(torques)[inside]
    angles = [_column(table, values, columns, f"angle{joint}_rad") for joint in joints]
    # Speeds of single joints are of no use: all of them, or the angles alone.
    has_speeds = all(columns.of(speed) for speed in speeds)
    return PendulumRun(
        label=f"{run.condition}, repeat {run.repeat}",
        condition=run.condition,
        repeat=run.repeat,
        t_s=t_s[inside],
        angle_rad=np.column_stack(angles)[inside],
        speed_rad_s=np.column_stack([_column(table, values, columns, speed) for speed in speeds])[
            inside
        ]
        if has_speeds
        else None,
        torque_Nm=torque_Nm,
        # Without a statement, torques that are zero throughout mean that the motors were off.
        powered=bool(torque_Nm.any()) if run.driven is None else run.driven,
    )


def _column(table: CsvTable, values: Floats, columns: ColumnsSection, quantity: str) -> Floats:
    name = columns.of(quantity)
    if name not in table.names:
        if quantity.startswith("torque"):
            hint = "; if the motors were off, give driven = false for this run"
        else:
            hint = ""
        raise BadInput(
            f"{table.path}:1: column {name}, which is to hold {quantity}, is missing; the "
            f"file has {', '.join(table.names)}{hint}"
        )
    # A contiguous copy, which does not keep the whole table in memory.
    return np.ascontiguousarray(values[:, table.names.index(name)])


class PendulumModelFile(Section):
    """Layout of a pendulum's model file."""

    format: Literal["rfca-pendulum-model/1"]
    link1: LinkSection
    link2: LinkSection | None = None
    known_to: KnownToPendulum = KnownToPendulum()


def with_model_file(campaign: PendulumCampaign, path: Path) -> PendulumCampaign:
    """The campaign with the nominal values of the model file at `path`. Raises BadInput where it
    cannot be used or has other links.
    """
    described = read_toml(path, PendulumModelFile)
    pendulum = make_pendulum(described.link1, described.link2)
    ours = len(campaign.pendulum.links)
    theirs = len(pendulum.links)
    # [known_to] is replaced too, so both must describe the same pendulum.
    if ours != theirs:
        raise BadInput(
            f"{path}: a model of {theirs} links, but {campaign.title!r} has {ours}; give "
            "the model file of this pendulum"
        )
    return replace(
        campaign, pendulum=pendulum, known_to=described.known_to.model_dump(exclude_none=True)
    )


def write_pendulum_model(
    path: Path, pendulum: Pendulum, known_to: Mapping[str, float], comments: Iterable[str]
) -> None:
    """Write a model file, all or nothing, with `comments` at its head. Raises RigError where the
    disk refuses.
    """
    head = f"format = {format_value(MODEL_FORMAT)}\n"
    links = [
        table(f"link{number}", asdict(link)) for number, link in enumerate(pendulum.links, start=1)
    ]
    parts = ["".join(map(toml_comment, comments)) + head, *links, table("known_to", known_to)]
    write_atomically(path, "\n".join(parts).encode("utf-8"))
