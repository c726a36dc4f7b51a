"""Layouts of campaign.toml, `rfca-campaign/1`, for recordings of a leg, and of experiment.toml,
`rfca-experiment/1`, for any mechanism.
"""

from collections.abc import Iterator
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, field_validator, model_validator

from rfca_rig.description.sections import (
    AboutSection,
    DriveSection,
    Effects,
    GroundSection,
    KnownToSection,
    LegSection,
    SensorSection,
)
from rfca_rig.toml import OPEN, TO_FILL_IN, NotNegative, Positive, Section

CAMPAIGN_FORMAT = "rfca-campaign/1"

# Of the one stream of a stroke whose file holds all devices.
STREAM_NAME = "table"


def _check_filled_in(text: str) -> str:
    """Refuses the question mark of a draft."""
    if text == OPEN:
        raise ValueError(TO_FILL_IN)
    return text


Text = Annotated[str, Field(min_length=1), AfterValidator(_check_filled_in)]


class ColumnSection(Section):
    """[columns.NAME]: which column of the files holds the quantity of that name, where the files
    call it otherwise or have it in another unit: value = sign * number in its unit + offset.
    """

    name: Text = Field(description="of the column in the files")
    unit: Text | None = Field(
        default=None, description="of the column, as kN, deg or ms; that of the quantity if absent"
    )
    sign: Literal[1, -1] = Field(
        default=1, description="-1 where the column counts in the opposite direction"
    )
    offset: float = Field(default=0.0, description="is added, in the quantity's unit")


def _check_inside(file: str) -> str:
    if "\\" in file:
        raise ValueError("write / between folder and file")
    # Runs lie in the campaign's own folder, which is complete wherever it is copied.
    if file.startswith("/") or ".." in file.split("/"):
        raise ValueError("must lie inside the campaign's folder")
    return file


FileInside = Annotated[Text, AfterValidator(_check_inside)]
Streams = Annotated[dict[Text, FileInside], Field(min_length=1)]


class _Run(Section):
    """`strokes_before` is the number of strokes that the leg had made in the campaign before this
    run; needed only to detect slow changes. `columns` takes the place of [columns] where this file
    has other columns than the others.
    """

    strokes_before: Annotated[int, Field(ge=0)] | None = None
    columns: dict[str, ColumnSection] | None = Field(
        default=None, description="of this file, in place of [columns]"
    )


class DynamicRun(_Run):
    """One stroke: its file, its condition, and the number of the repeat. `streams` names a file for
    each device instead, by the device's name, where they sample at times of their own.
    """

    experiment: Literal["dynamic"]
    file: FileInside | None = None
    streams: Streams | None = Field(
        default=None, description="file of each device, in place of one for all"
    )
    height_mm: Positive
    speed_rad_s: Positive
    repeat: Annotated[int, Field(ge=1)]
    starts_at_s: float = Field(
        default=0.0, description="time in the file at which the commanded speed begins to rise"
    )
    ends_at_s: float | None = Field(
        default=None, description="time in the file at which the stroke ends; its last if absent"
    )

    @model_validator(mode="after")
    def _has_files(self) -> Self:
        if (self.file is None) == (self.streams is None):
            raise ValueError("takes file, or else streams with a file for each device")
        return self

    @property
    def files(self) -> dict[str, str]:
        """The file of each stream, by its name."""
        if self.file is not None:
            return {STREAM_NAME: self.file}
        return dict(self.streams or {})

    @model_validator(mode="after")
    def _ends_after_it_begins(self) -> Self:
        if self.ends_at_s is not None and self.ends_at_s <= self.starts_at_s:
            raise ValueError(f"ends_at_s should be after starts_at_s, {self.starts_at_s:g} s")
        return self

    @property
    def condition(self) -> str:
        return f"{self.height_mm:g} mm, {self.speed_rad_s:g} rad/s, repeat {self.repeat}"


class StaticRun(_Run):
    """A table of settled stages. `held_s` is how long the shaft had been held at the middle of each
    reading; needed only for legs that creep.
    """

    experiment: Literal["static"]
    file: FileInside
    held_s: Positive | None = None

    @property
    def files(self) -> dict[str, str]:
        """Its file."""
        return {STREAM_NAME: self.file}


class RawRun(Section):
    """Samples of a stage that is no stroke, for a closer look: no analysis uses them. `cut_short`
    is the reason where the stage was not completed.
    """

    experiment: Literal["raw"]
    label: Annotated[str, Field(max_length=1000)]
    height_mm: NotNegative
    cut_short: Annotated[str, Field(max_length=1000)] = ""
    streams: Streams = Field(description="file of each device")

    @property
    def files(self) -> dict[str, str]:
        """The file of each stream, by its name."""
        return dict(self.streams)


Run = Annotated[DynamicRun | StaticRun | RawRun, Field(discriminator="experiment")]


class CampaignFile(Section):
    """campaign.toml: the nominal model before the campaign, the uncertainties of its values, the
    runs, and which columns their files have.
    """

    format: Literal["rfca-campaign/1"]
    title: Annotated[str, Field(max_length=1000)]
    about: AboutSection = AboutSection()
    recorded_as: Literal["SIM", "REAL", "IMPORT"] | None = Field(
        default=None, description="what a run was that export csv wrote; it stays an import"
    )
    leg: LegSection
    ground: GroundSection
    sensor: SensorSection
    drive: DriveSection
    effects: Effects = ()
    known_to: KnownToSection = KnownToSection()
    columns: dict[str, ColumnSection] = Field(default_factory=dict)
    runs: Annotated[tuple[Run, ...], Field(strict=False, min_length=1)]

    def dynamic(self) -> Iterator[tuple[int, DynamicRun]]:
        """The dynamic runs, each with its index in `[[runs]]` from 0."""
        return ((index, run) for index, run in enumerate(self.runs) if isinstance(run, DynamicRun))

    def static(self) -> Iterator[tuple[int, StaticRun]]:
        """The static runs, each with its index in `[[runs]]` from 0."""
        return ((index, run) for index, run in enumerate(self.runs) if isinstance(run, StaticRun))

    def raw(self) -> Iterator[tuple[int, RawRun]]:
        """The raw stages, each with its index in `[[runs]]` from 0."""
        return ((index, run) for index, run in enumerate(self.runs) if isinstance(run, RawRun))


EXPERIMENT_FORMAT = "rfca-experiment/1"


# Factor to SI of each unit that a column may have, by what it measures. Nothing is guessed from a
# column's name.
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
ANGLE_UNITS = {"rad": 1.0, "deg": 0.017453292519943295, "turn": 6.283185307179586}
LENGTH_UNITS = {"m": 1.0, "mm": 1e-3}
ANGLE_SPEED_UNITS = {
    "rad/s": 1.0,
    "deg/s": 0.017453292519943295,
    "rpm": 0.10471975511965977,
    "turn/s": 6.283185307179586,
}
SPEED_UNITS = {"m/s": 1.0, "mm/s": 1e-3}
FORCE_UNITS = {"N": 1.0}
TORQUE_UNITS = {"N m": 1.0, "mN m": 1e-3}
ACCELERATION_UNITS = {"m/s2": 1.0, "g0": 9.80665}
COMMAND_UNITS = {
    "N m": 1.0,
    "mN m": 1e-3,
    "N": 1.0,
    "A": 1.0,
    "mA": 1e-3,
    "V": 1.0,
    "mV": 1e-3,
    "1": 1.0,
}
COUNTS = "count"

# What a signal may be, by the SI unit that MuJoCo has it in
SIGNAL_UNITS = {
    "rad": ANGLE_UNITS,
    "m": LENGTH_UNITS,
    "rad/s": ANGLE_SPEED_UNITS,
    "m/s": SPEED_UNITS,
    "N": FORCE_UNITS,
    "N m": TORQUE_UNITS,
    "m/s2": ACCELERATION_UNITS,
}
# SI units that a joint's position or speed may have; None stands for a sensor, which may have any.
OF_QUANTITY = {"position": ("rad", "m"), "speed": ("rad/s", "m/s"), None: tuple(SIGNAL_UNITS)}


def _one_of(unit: str, known: dict[str, float]) -> str:
    if unit not in known:
        raise ValueError(f"should be one of {', '.join(known)}")
    return unit


class TimeSection(Section):
    """[time]: the column of the time in every file, and its unit."""

    column: Text = Field(description="column of the time")
    unit: str = Field(description="s, ms, us or ns")

    @field_validator("unit")
    @classmethod
    def _is_known_unit(cls, unit: str) -> str:
        return _one_of(unit, TIME_UNITS)


class CanSection(Section):
    """[can]: what the frames of CAN logs hold."""

    databases: Annotated[tuple[Text, ...], Field(strict=False, min_length=1)] = Field(
        description="DBC, KCD, SYM or ARXML files, relative to this folder"
    )
    bus: Text | None = Field(
        default=None, description="bus whose frames count, where the log has several"
    )


class SignalSection(Section):
    """[[signals]]: a column with the position or speed of a joint, or a value of one of the model's
    sensors.

    A sensor with three values needs the component in its name, as in `plate_z`. A position in
    counts needs `counts_per_turn`. `sign` is -1 where the column counts in the direction opposite
    to the model.
    """

    joint: Text | None = Field(default=None, description="joint of the model")
    quantity: Literal["position", "speed"] | None = Field(
        default=None, description="what is measured of the joint"
    )
    sensor: Text | None = Field(
        default=None, description="sensor of the model, in place of a joint"
    )
    column: Text = Field(description="column of the recordings")
    unit: str = Field(description="unit of the column")
    sign: Literal[1, -1] = Field(
        default=1, description="-1 where the column counts in the opposite direction"
    )
    counts_per_turn: Positive | None = Field(default=None, description="for the unit count")
    noise_std: Positive | None = Field(
        default=None, description="in the unit of the column; estimated if not given"
    )

    @model_validator(mode="after")
    def _unit_suits(self) -> Self:
        if (self.joint is None) == (self.sensor is None) or (self.joint is None) != (
            self.quantity is None
        ):
            raise ValueError(
                "a signal has a joint with a quantity, position or speed, or else a sensor"
            )
        known = [unit for si in OF_QUANTITY[self.quantity] for unit in SIGNAL_UNITS[si]]
        if self.unit not in (*known, COUNTS) or (
            self.unit == COUNTS and self.quantity != "position"
        ):
            if self.quantity == "position":
                known.append(COUNTS)
            raise ValueError(
                f"unit {self.unit!r} of a {self.quantity or 'sensor'} should be one of "
                f"{', '.join(known)}"
            )
        if (self.unit == COUNTS) != (self.counts_per_turn is not None):
            raise ValueError("counts_per_turn belongs to the unit 'count': give both or none")
        return self

    @property
    def words(self) -> str:
        """Description of the column's content."""
        if self.joint is None:
            return f"sensor {self.sensor}"
        return f"the {self.quantity} of joint {self.joint}"

    @property
    def si_unit(self) -> str:
        """Its unit in MuJoCo."""
        if self.unit == COUNTS:
            return "rad"
        return next(si for si, units in SIGNAL_UNITS.items() if self.unit in units)

    @property
    def factor(self) -> float:
        """Factor from the column to the SI unit, with the sign."""
        if self.counts_per_turn is not None:
            return self.sign * ANGLE_UNITS["turn"] / self.counts_per_turn
        return self.sign * SIGNAL_UNITS[self.si_unit][self.unit]


class PrescribedSection(Section):
    """[[prescribed]]: a joint whose motion is given by a column, measured or commanded, and not
    simulated.

    Its column is smoothed by a cubic spline with knots `smoothed_s` apart; 0 interpolates every
    sample, for a column without noise. `scatter_std` is the deviation of the joint's position from
    repeat to repeat that the column does not show, in the column's unit.
    """

    joint: Text = Field(description="joint of the model")
    column: Text = Field(description="column of the position")
    unit: str = Field(description="unit of the column")
    sign: Literal[1, -1] = Field(
        default=1, description="-1 where the column counts in the opposite direction"
    )
    counts_per_turn: Positive | None = Field(default=None, description="for the unit count")
    smoothed_s: NotNegative = Field(
        default=0.02, description="distance of the knots of the smoothing spline; 0 for none"
    )
    scatter_std: Positive | None = Field(
        default=None, description="deviation from repeat to repeat, in the unit of the column"
    )

    @model_validator(mode="after")
    def _is_position(self) -> Self:
        self._as_signal()
        return self

    def _as_signal(self) -> SignalSection:
        """The same column as a measured position, which has the same units."""
        return SignalSection(
            joint=self.joint,
            quantity="position",
            column=self.column,
            unit=self.unit,
            sign=self.sign,
            counts_per_turn=self.counts_per_turn,
        )

    @property
    def si_unit(self) -> str:
        """Its unit in MuJoCo."""
        return self._as_signal().si_unit

    @property
    def factor(self) -> float:
        """Factor from the column to the SI unit, with the sign."""
        return self._as_signal().factor


class ContactSection(Section):
    """[[contacts]]: a sphere on a plane with its own stiffness and damping, in place of MuJoCo's
    contact between the two geoms.

    The normal force is stiffness depth^1.5 (1 + damping depth'). Friction sticks, yields by
    `presliding_mm` at mu N, and then slides.
    """

    spheres: Annotated[tuple[Text, ...], Field(strict=False, min_length=1)] = Field(
        description="geoms of the model"
    )
    plane: Text = Field(description="geom of the model")
    stiffness_N_per_m1p5: Positive = Field(description="normal force over depth^1.5")
    damping_s_per_m: NotNegative = Field(
        default=0.0, description="share of the normal force per approach speed"
    )
    friction: NotNegative = Field(default=0.0, description="Coulomb friction coefficient")
    presliding_mm: Positive = Field(
        default=0.1, description="elastic deflection of a sticking point before it slides"
    )
    drag_N_s_per_m: NotNegative = Field(
        default=0.0, description="force over sliding speed, beside friction"
    )


class StartSection(Section):
    """[start]: "estimated" cuts a recording into windows, each starting from the measured state.

    "at rest" makes it one window that begins in static equilibrium. Recordings of one condition are
    then repeats of one motion, whose mean is compared.
    """

    state: Literal["estimated", "at rest"] = Field(
        default="estimated", description="state at the start of a window"
    )


class CommandSection(Section):
    """[[commands]]: a column with the command of an actuator or, better, with its measured value.

    The model's actuator converts the SI value of this unit into a torque: `gear` in N m/A for a
    column in A. A command that is `held` acts from its row to the next. Others are linear between
    rows, as measured values are.
    """

    actuator: Text = Field(description="actuator of the model")
    column: Text = Field(description="column of the recordings")
    unit: str = Field(description="unit of the column")
    sign: Literal[1, -1] = Field(
        default=1, description="-1 where the column counts in the opposite direction"
    )
    held: bool = Field(default=False, description="a command acts until the next row")

    @field_validator("unit")
    @classmethod
    def _is_known_unit(cls, unit: str) -> str:
        return _one_of(unit, COMMAND_UNITS)

    @property
    def factor(self) -> float:
        """Factor from the column to SI, with the sign."""
        return self.sign * COMMAND_UNITS[self.unit]


class KnownToMechanism(Section):
    """[known_to]: the standard uncertainty of each nominal value, for each body, joint or actuator
    independently.

    Values without a key count as exact. `torque_error_relative` is the usual error of the torques.
    """

    mass_relative: Positive | None = Field(
        default=None, description="mass of a body; its inertia changes with it"
    )
    inertia_relative: Positive | None = Field(
        default=None, description="inertia of a body about its centre of mass"
    )
    inertia_about_joint_relative: Positive | None = Field(
        default=None, description="inertia of a body about its joint, a hinge"
    )
    centre_of_mass_m: Positive | None = Field(
        default=None, description="distance of the centre of mass from the body's frame"
    )
    joint_stiffness_relative: Positive | None = Field(default=None, description="spring of a joint")
    joint_damping_Nm_s_per_rad: Positive | None = Field(
        default=None, description="viscous damping of a hinge; never below 0"
    )
    joint_damping_N_s_per_m: Positive | None = Field(
        default=None, description="viscous damping of a slide; never below 0"
    )
    joint_friction_Nm: Positive | None = Field(
        default=None, description="dry friction of a hinge; never below 0"
    )
    joint_friction_N: Positive | None = Field(
        default=None, description="dry friction of a slide; never below 0"
    )
    rotor_inertia_kg_m2: Positive | None = Field(
        default=None, description="rotor inertia behind the gear of a hinge; never below 0"
    )
    rotor_inertia_kg: Positive | None = Field(
        default=None, description="rotor inertia behind the gear of a slide; never below 0"
    )
    torque_offset_Nm: Positive | None = Field(
        default=None, description="steady torque in hinges with an actuator"
    )
    force_offset_N: Positive | None = Field(
        default=None, description="steady force in slides with an actuator"
    )
    zero_offset_rad: Positive | None = Field(
        default=None, description="offset of a hinge's reading"
    )
    zero_offset_m: Positive | None = Field(default=None, description="offset of a slide's reading")
    command_gain_relative: Positive | None = Field(
        default=None, description="torque constant of an actuator"
    )
    command_delay_s: Annotated[float, Field(gt=0.0, le=0.025)] | None = Field(
        default=None, description="delay of all commands behind the recording"
    )
    sensor_offset_N: Positive | None = Field(default=None, description="offset of a force sensor")
    sensor_offset_Nm: Positive | None = Field(default=None, description="offset of a torque sensor")
    contact_stiffness_relative: Positive | None = Field(
        default=None, description="stiffness of all contacts"
    )
    contact_damping_relative: Positive | None = Field(
        default=None, description="damping of all contacts"
    )
    contact_friction_relative: Positive | None = Field(
        default=None, description="friction of all contacts"
    )
    contact_presliding_relative: Positive | None = Field(
        default=None, description="presliding of all [[contacts]]"
    )
    contact_drag_relative: Positive | None = Field(
        default=None, description="drag of all [[contacts]]"
    )
    start_swing_relative: Positive | None = Field(
        default=None, description="of motions from rest: distance of the start from equilibrium"
    )
    start_swing_rate_per_s: Positive | None = Field(
        default=None, description="of motions from rest: rate of that distance"
    )
    torque_error_relative: Annotated[float, Field(ge=0.001, le=0.2)] | None = Field(
        default=None, description="usual error of the torques; 0.01 if not given"
    )


# a mechanism of laboratory size moves visibly within it, and the error of its start does not grow
# much
SHORTEST_WINDOW_S = 0.5


class WindowsSection(Section):
    """[windows]: recordings are cut into windows, which are simulated from the measured state, and
    into bins, which are compared.

    Without `length_s`, a diagnosis makes the windows of each recording as long as the model allows,
    from SHORTEST_WINDOW_S on; `check`, `fit` and `report` take that shortest length. Of more
    windows than `at_most`, only that many are used, evenly spread. More of them take more time, and
    the model's own error limits their gain.
    """

    length_s: Positive | None = Field(
        default=None, description="length of a window; as long as the model allows if not given"
    )
    bin_s: Positive = Field(default=0.05, description="length of a bin, whose mean is compared")
    # Number of windows over all recordings.
    at_most: Annotated[int, Field(ge=3)] = Field(
        default=48, description="number of windows over all recordings"
    )

    impacts: bool = Field(
        default=False, description="whether windows of free bodies may hold contacts"
    )

    @model_validator(mode="after")
    def _holds_bins(self) -> Self:
        if self.bin_s > self.shortest_s / 2.0:
            raise ValueError(
                f"bin_s = {self.bin_s:g} is more than half of length_s, "
                f"{self.shortest_s:g}; a window needs several bins"
            )
        return self

    @property
    def shortest_s(self) -> float:
        """The stated length, or SHORTEST_WINDOW_S."""
        return self.length_s or SHORTEST_WINDOW_S


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


class RecordingSection(RunSection):
    """[[recordings]]: with `driven` false the actuators were off, and the file needs no columns
    for them.
    """

    driven: bool = Field(default=True, description="false where the actuators were off")
    episode: Annotated[int, Field(ge=0)] | None = Field(
        default=None, description="number of the episode, where a file of LeRobot holds several"
    )


class FreeSection(Section):
    """[[free]]: the columns with the pose of a body on a free joint.

    The orientation is a unit quaternion, which turns the body's frame into that of the world.
    """

    joint: Text = Field(description="free joint of the model")
    position: Annotated[tuple[Text, Text, Text], Field(strict=False)] = Field(
        description="columns with x, y and z of the body's frame"
    )
    unit: Literal["m", "mm"] = Field(description="unit of these columns")
    orientation: Annotated[tuple[Text, Text, Text, Text], Field(strict=False)] = Field(
        description="columns with the quaternion, in the order w, x, y, z"
    )
    position_noise_std: Positive | None = Field(
        default=None, description="in that unit; estimated if not given"
    )
    angle_noise_std_rad: Positive | None = Field(
        default=None, description="of the orientation; estimated if not given"
    )

    @property
    def factor(self) -> float:
        """From the unit to m."""
        return LENGTH_UNITS[self.unit]


class ExperimentFile(Section):
    """experiment.toml: a model file, the meaning of the recordings' columns, the uncertainties of
    the model's values, and the recordings.
    """

    format: Literal["rfca-experiment/1"]
    title: Annotated[str, Field(max_length=1000)] = Field(description="name of the experiment")
    about: AboutSection = AboutSection()
    model: Text = Field(description="MJCF or URDF file, relative to this folder")
    time: TimeSection
    can: CanSection | None = None
    signals: Annotated[tuple[SignalSection, ...], Field(strict=False)] = ()
    free: Annotated[tuple[FreeSection, ...], Field(strict=False)] = ()
    commands: Annotated[tuple[CommandSection, ...], Field(strict=False)] = ()
    prescribed: Annotated[tuple[PrescribedSection, ...], Field(strict=False)] = ()
    contacts: Annotated[tuple[ContactSection, ...], Field(strict=False)] = ()
    start: StartSection = StartSection()
    alike: dict[Text, Annotated[tuple[Text, ...], Field(strict=False, min_length=2)]] = Field(
        default_factory=dict, description="names of joints, bodies or actuators that share values"
    )
    known_to: KnownToMechanism = KnownToMechanism()
    windows: WindowsSection = WindowsSection()
    recordings: Annotated[tuple[RecordingSection, ...], Field(strict=False, min_length=1)]

    @model_validator(mode="after")
    def _has_signals(self) -> Self:
        if not (self.signals or self.free):
            raise ValueError("nothing was recorded: give [[signals]], or [[free]] for free bodies")
        return self
