"""A rig file (calibration/*.toml): nominal leg, ground, sensor and drive; devices; limits; and
for a twin, its true properties.
"""

from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import Field, field_validator, model_validator

from rfca_rig.codecs.sensor_axes import SensorAxes
from rfca_rig.description.camera_file import (
    CameraFile,
    CameraSection,
    PhotoFolderSection,
    TwinCameraSection,
)
from rfca_rig.description.model_file import nominal_model, read_named_curve
from rfca_rig.description.sections import (
    DriveSection,
    Effects,
    GroundSection,
    KnownToSection,
    LegSection,
    SensorSection,
)
from rfca_rig.devices import USUAL_WATCHDOG_S, find_motor
from rfca_rig.devices.own import load_own
from rfca_rig.devices.sections import (
    ForceSensorChoice,
    Motor,
    OwnForceSensorSection,
    OwnMotorSection,
)
from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import RigModel
from rfca_rig.protocol.experiments import RigFacts
from rfca_rig.protocol.plan import Limits, Rates
from rfca_rig.toml import NotNegative, Positive, Section, model_of, read_data, read_text
from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.leg_photo import PhotoSetup


class RigSection(Section):
    """`kind` determines whether the devices are twins; every line of output says SIM or REAL
    accordingly.
    """

    title: str = Field(description="name of the rig, printed on reports")
    kind: Literal["twin", "real"] = Field(description="'twin' simulates the devices")
    parked_angle_deg: Annotated[float, Field(ge=-90, le=90)] = Field(
        description="shaft angle at which a run ends, from the horizontal, positive downwards"
    )


AxisName = Literal["x", "-x", "y", "-y", "z", "-z"]
MIRRORED = (
    "is left-handed, which no mounting of a sensor is: a cable or a channel is swapped, or a sign "
    "is wrong; rfca-rig setup sensor finds out which"
)


class SensorCheckSection(Section):
    """Last check of the sensor with a hand and a known mass, as `rfca-rig setup sensor` writes it.

    It holds for the axes and the distance that it names.
    """

    date: str = Field(description="day of the check")
    source: Literal["REAL", "SIM"] = Field(description="the sensor itself, or its twin")
    axes: Annotated[tuple[AxisName, AxisName, AxisName], Field(strict=False)] = Field(
        description="the sensor's axes, found by three pushes"
    )
    mass_kg: Positive = Field(description="mass that was hung on the leg")
    lever_mm: float = Field(description="distance of the mass from the shaft axis, along y")
    force_N: float = Field(description="fz that the mass gave")
    deviation_percent: float = Field(description="fz above the weight of the mass")
    below_shaft_mm: float = Field(description="tx over fy of the push along y")

    def describe(self) -> str:
        """Day, and what the mass read."""
        where = {"REAL": "", "SIM": " on the twin"}[self.source]
        return (
            f"{self.date}{where}: {self.mass_kg:g} kg read {self.force_N:.2f} N, "
            f"{self.deviation_percent:+.1f} %"
        )


class MountedSensorSection(SensorSection):
    """[sensor]: tx_Nm = shaft torque + below_shaft * fy_N. `axes` names the axis of the device
    along the rig's x, y and z.

    The rig's y points along the ground to where the leg reaches, z down, and x away from somebody
    who sees the leg reach to the right. ["-y", "x", "z"] is a sensor that is turned by 90 degrees
    about z. A left-handed choice is refused.
    """

    axes: Annotated[tuple[AxisName, AxisName, AxisName], Field(strict=False)] = Field(
        default=("x", "y", "z"), description="axes of the device along the rig's x, y and z"
    )
    checked: SensorCheckSection | None = Field(
        default=None, description="last check of the sensor, by rfca-rig setup sensor"
    )

    @field_validator("axes")
    @classmethod
    def _is_a_mounting(cls, names: tuple[str, str, str]) -> tuple[str, str, str]:
        axes = SensorAxes(names)
        if not axes.is_permutation:
            raise ValueError("should name each of x, y and z once")
        if not axes.is_right_handed:
            raise ValueError(MIRRORED)
        return names

    @property
    def mounting(self) -> SensorAxes:
        return SensorAxes(self.axes)


Share = Annotated[float, Field(gt=0, lt=1)]
# Shares of the full speed for the first strokes of a real rig.
FIRST_STROKES = (0.5, 0.75)


# As long as a drive with the usual watchdog would go on without a command.
READING_AGE_MS = 100.0
# Periods of the reports that may pass without one: a report may be lost, and the next one come
# late.
MIN_PERIODS = 3.0


class LimitsSection(Section):
    """Limits that stop the motion at once; every one but `reading_age_ms` must be set.

    `first_strokes` are the shares of a condition's speed for its first strokes, from which the
    force at full speed is predicted before it is applied. Without the key, a real rig runs them at
    0.5 and 0.75, a twin none.
    """

    force_N: Positive = Field(description="largest force on the sensor")
    torque_Nm: Positive = Field(description="largest moment on the sensor")
    speed_rad_s: Positive = Field(description="largest speed of the shaft")
    following_error_deg: Positive = Field(
        description="largest difference between commanded and measured shaft angle"
    )
    following_error_deg_s_per_rad: NotNegative = Field(
        description="added to that limit per commanded speed"
    )
    sensor_silent_ms: Positive = Field(
        description="longest time without a record of the force sensor"
    )
    drive_silent_ms: Positive = Field(description="longest time without a report of the drive")
    sensor_frozen_ms: Positive = Field(
        description="longest time with unchanged values of the force sensor"
    )
    above_expected: Annotated[float, Field(ge=1)] = Field(
        description="largest ratio of the load to the model's prediction"
    )
    above_expected_ms: Positive = Field(description="longest time above that ratio")
    temperature_degC: Positive = Field(description="highest temperature of drive and motor")
    late_ms: Positive = Field(description="largest delay of a cycle of the control loop")
    reading_age_ms: Positive = Field(
        default=READING_AGE_MS,
        description="largest age of the angle and torque that the drive reports",
    )
    first_strokes: Annotated[tuple[Share, ...], Field(strict=False)] | None = Field(
        default=None, description="shares of the speed for the first strokes of a condition"
    )


class TwinDriveSection(Section):
    """The twin's drive, at the shaft: a PI speed loop on a rotor. With low gains the speed sags
    and surges under load.
    """

    rotor_inertia_kg_m2: Positive = Field(description="inertia of the rotor at the shaft")
    speed_gain_Nm_s_per_rad: Positive = Field(description="proportional gain of the speed loop")
    integral_gain_Nm_per_rad: NotNegative = Field(description="integral gain of the speed loop")
    angle_gain_per_s: Positive = Field(description="converts an angle error into a speed")
    torque_limit_Nm: Positive = Field(description="largest torque at the shaft")


class TwinScatterSection(Section):
    """One standard deviation of values that differ from repeat to repeat."""

    friction: NotNegative = Field(default=0.0, description="of the friction coefficient")
    height_mm: NotNegative = Field(default=0.0, description="of the height")


class TwinSection(Section):
    """True properties of the twin where they differ from the nominal model."""

    seed: Annotated[int, Field(ge=0)] = Field(description="seed of all random numbers")
    noise_N: NotNegative = Field(description="standard deviation of a force sample")
    noise_Nm: NotNegative = Field(description="standard deviation of a moment sample")
    concealed: str = Field(
        default="", description="sealed effect that the nominal model lacks, by twin conceal"
    )
    drive: TwinDriveSection
    scatter: TwinScatterSection = TwinScatterSection()
    camera: TwinCameraSection = TwinCameraSection()


class RigFile(Section):
    """A whole rig file."""

    rig: RigSection
    leg: LegSection
    ground: GroundSection
    sensor: MountedSensorSection
    drive: DriveSection
    effects: Effects = ()
    known_to: KnownToSection | None = None
    limits: LimitsSection
    motor: Motor
    force_sensor: ForceSensorChoice
    camera: CameraSection | None = None
    twin: TwinSection | None = None

    @model_validator(mode="after")
    def _twin_is_described(self) -> "RigFile":
        if self.rig.kind == "twin" and self.twin is None:
            raise ValueError("a rig of kind 'twin' needs a [twin] section")
        return self

    @model_validator(mode="after")
    def _reports_come_often_enough(self) -> "RigFile":
        period_ms = 1e3 / self.motor.reports_Hz
        if self.limits.reading_age_ms < MIN_PERIODS * period_ms:
            raise ValueError(
                f"limits.reading_age_ms is {self.limits.reading_age_ms:g}, and the drive "
                f"reports every {period_ms:g} ms; give at least "
                f"{MIN_PERIODS:g} periods, {MIN_PERIODS * period_ms:g} ms, or set the "
                "drive to report more often"
            )
        return self

    @model_validator(mode="after")
    def _marks_are_on_the_leg(self) -> "RigFile":
        links = len(self.leg.link_lengths_mm)
        if self.camera and any(mark.link > links for mark in self.camera.marks.places):
            raise ValueError(f"camera.marks.places: names a link beyond the leg's {links}")
        return self

    @property
    def is_real(self) -> bool:
        return self.rig.kind == "real"

    @property
    def source(self) -> Literal["REAL", "SIM"]:
        """The mark of what is recorded with this rig."""
        if self.is_real:
            return "REAL"
        return "SIM"

    @property
    def watchdog_s(self) -> float:
        """Time without a command after which the drive, or its guardian, removes the torque."""
        key = find_motor(self.motor.device).watchdog_key
        if self.motor.is_guarded:
            key = "guardian_silence_ms"
        if key is None:
            return USUAL_WATCHDOG_S
        return float(getattr(self.motor, key)) / 1e3

    def nominal(self) -> dict[str, Any]:
        """The sections that go into every recording, as plain data."""
        sections = {"leg", "ground", "sensor", "drive"}
        if self.effects:
            sections.add("effects")
        # Recorded forces are in the rig's axes, so the mounting is no part of the model.
        mounting = {"sensor": {"axes", "checked"}}
        return self.model_dump(include=sections, exclude=mounting, exclude_none=True, mode="json")

    def model(self) -> RigModel:
        """The nominal model."""
        return nominal_model(self.nominal())

    def facts(self) -> RigFacts:
        """The properties of the rig that a plan needs."""
        photo_limit_s = 0.0
        if self.camera:
            photo_limit_s = self.camera.photo_limit_s
        return RigFacts(
            start_angle_rad=self.leg.start_angle_rad,
            parked_angle_rad=float(np.radians(self.rig.parked_angle_deg)),
            ramp_s=self.drive.ramp_s,
            limits=self._limits(),
            rates=Rates(self.force_sensor.rate_Hz, self.motor.reports_Hz),
            photo_limit_s=photo_limit_s,
            first_strokes=self._first_strokes(),
        )

    def _first_strokes(self) -> tuple[float, ...]:
        # Ascending, so that each stroke is the next small step towards full speed.
        if self.limits.first_strokes is not None:
            return tuple(sorted(self.limits.first_strokes))
        if self.is_real:
            return FIRST_STROKES
        return ()

    def eye(self) -> PhotoSetup | None:
        """Evaluates the camera's photos; None without [camera]. Raises BadInput where its
        calibration cannot be used.
        """
        if self.camera is None:
            return None
        path = Path(self.camera.calibration_file)
        if not path.is_file():
            raise BadInput(
                f"{path}: not there; [camera] of the rig file names it as "
                "calibration_file; rfca-rig calibrate camera makes it"
            )
        return self.eye_behind(read_text(path), path)

    def eye_behind(self, camera_text: str, path: Path) -> PhotoSetup | None:
        """The same with the text of a calibration that was at `path`."""
        if self.camera is None:
            return None
        lengths_m = tuple(length_mm / 1e3 for length_mm in self.leg.link_lengths_mm)
        return PhotoSetup(
            _camera_before_the_plane(camera_text, path),
            self.camera.marks.plan(lengths_m),
            lengths_m,
        )

    def _limits(self) -> Limits:
        limits = self.limits
        return Limits(
            force_N=limits.force_N,
            torque_Nm=limits.torque_Nm,
            speed_rad_s=limits.speed_rad_s,
            following_error_rad=float(np.radians(limits.following_error_deg)),
            following_error_s=float(np.radians(limits.following_error_deg_s_per_rad)),
            sensor_silent_s=1e-3 * limits.sensor_silent_ms,
            drive_silent_s=1e-3 * limits.drive_silent_ms,
            sensor_frozen_s=1e-3 * limits.sensor_frozen_ms,
            above_expected=limits.above_expected,
            above_expected_s=1e-3 * limits.above_expected_ms,
            temperature_C=limits.temperature_degC,
            late_s=1e-3 * limits.late_ms,
            reading_age_s=1e-3 * limits.reading_age_ms,
        )


class DevicesRigSection(Section):
    """[rig] of a file without a leg."""

    title: str = Field(description="name of the rig, printed on reports")
    kind: Literal["real"] = Field(description="a twin needs a whole rig file")


class DevicesFile(Section):
    """A rig file without a leg: a motor, a force sensor or both, which `record` listens to."""

    rig: DevicesRigSection
    motor: Motor | None = None
    force_sensor: ForceSensorChoice | None = None

    @model_validator(mode="after")
    def _has_a_device(self) -> "DevicesFile":
        if self.motor is None and self.force_sensor is None:
            raise ValueError("has neither [motor] nor [force_sensor]; give one of them or both")
        return self


def read_devices(path: Path) -> RigFile | DevicesFile:
    """Read the rig file in `path`, of which devices are enough: without [leg] and what a run with
    motion needs besides. Raises BadInput as `read_rig` does.
    """
    text = read_text(path)
    data = read_data(path)
    if not data.keys() <= DevicesFile.model_fields.keys():
        return read_rig(path)
    devices = model_of(text, DevicesFile, path)
    return _resolve_sensor_files(path.parent, _with_own_devices(text, path, devices))


def read_rig(path: Path) -> RigFile:
    """Read the rig in `path`. Raises BadInput, with file and line, where it cannot be used."""
    text = read_text(path)
    rig = read_named_curve(model_of(text, RigFile, path), path.parent)
    return _with_files_beside(path.parent, _with_own_devices(text, path, rig))


File = TypeVar("File", RigFile, DevicesFile)


def _with_own_devices(text: str, path: Path, rig: File) -> File:
    """The rig, with the sections of a lab's own devices validated by their files."""
    # A section was read with any keys at first; its own class now replaces it.
    for table, section in (("motor", rig.motor), ("force_sensor", rig.force_sensor)):
        if isinstance(section, OwnMotorSection | OwnForceSensorSection):
            rig = rig.model_copy(update={table: load_own(table, section, text, path)})
    return rig


def _with_files_beside(folder: Path, rig: RigFile) -> RigFile:
    """The rig, with its paths resolved from its own folder."""
    rig = _resolve_sensor_files(folder, rig)
    camera = rig.camera
    if camera is not None:
        paths = ["calibration_file"]
        if isinstance(camera, PhotoFolderSection):
            paths.append("folder")
        rig = rig.model_copy(update={"camera": _from(folder, camera, *paths)})
    return rig


def _resolve_sensor_files(folder: Path, rig: File) -> File:
    sensor: ForceSensorChoice | None = rig.force_sensor
    if sensor is None or not sensor.file_keys:
        return rig
    return rig.model_copy(update={"force_sensor": _from(folder, sensor, *sensor.file_keys)})


def _from(folder: Path, section: Section, *keys: str) -> Section:
    return section.model_copy(update={key: str(folder / getattr(section, key)) for key in keys})


def _camera_before_the_plane(text: str, path: Path) -> CameraModel:
    try:
        return model_of(text, CameraFile, path).model()
    except BadInput as error:
        message = str(error)
        # Some faults come with their file and line, others without.
        if str(path) not in message:
            message = f"{path}: {message}"
        raise BadInput(message) from None
