"""[motor] and [force_sensor] in a rig file: base classes of their sections, and the section that
`device` selects from the registry.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import can
from pydantic import (
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    GetJsonSchemaHandler,
    field_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, PydanticKnownError, core_schema

from rfca_rig.clock import Clock
from rfca_rig.devices import (
    FORCE_SENSORS,
    MOTORS,
    MotorMake,
    SensorMake,
    find_motor,
    find_sensor,
    list_motors,
    list_sensors,
    load_object,
)
from rfca_rig.drivers.can_frames import CanBusSettings
from rfca_rig.drivers.encoder_zero import EncoderZero, ZeroPolicy
from rfca_rig.drivers.ports import SerialPort, open_port
from rfca_rig.drivers.roles import ForceSensor, ShaftMotor
from rfca_rig.errors import BadInput
from rfca_rig.toml import Positive, Section, SelectedByData

# Rate of commands during a stroke, and of the reports of a drive that only answers commands.
LOOP_RATE_HZ = 500.0


class MotorSection(Section):
    """Keys of every drive on CAN: the bus, and the direction in which it turns the shaft.

    On a real rig a `guardian` owns the bus of a drive that has no watchdog. It is a process that
    removes the torque when no command arrives for `guardian_silence_ms`.
    """

    needs_guardian: ClassVar[bool] = False

    if TYPE_CHECKING:
        # Each section states its own word.
        device: str

    direction: Literal[1, -1] = Field(
        description="-1 where the drive counts up while the leg turns up"
    )
    interface: str = Field(default="socketcan", description="interface of python-can, or fdcanusb")
    channel: str = Field(default="can0", description="channel of that interface")
    bitrate: Annotated[int, Field(gt=0)] = Field(default=1_000_000, description="bits/s of the bus")
    guardian: bool | None = Field(
        default=None,
        description="for drives without a watchdog: whether a guardian owns the bus of a real rig",
    )
    guardian_silence_ms: Annotated[float, Field(ge=20, le=300)] = Field(
        default=100.0,
        description="time without a command after which the guardian removes the torque",
    )
    zero_policy: ZeroPolicy | None = Field(
        default=None,
        description="what of the zero survives a power-down of the drive: all of it (absolute), "
        "all but whole turns of the motor (behind-gear), nothing (incremental)",
    )

    @field_validator("guardian")
    @classmethod
    def _only_where_it_is_needed(cls, guardian: bool | None) -> bool | None:
        # A drive's own watchdog is tested before a run; a guardian beside it has no purpose.
        if guardian and not cls.needs_guardian:
            raise ValueError(
                "is for drives without a watchdog; this one has its own, which is proven "
                "before a run: leave the key out"
            )
        return guardian

    @property
    def title(self) -> str:
        """The drive in messages."""
        return self.device

    @property
    def encoder_zero(self) -> EncoderZero | None:
        """What the drive's reading says of the shaft; None where the section does not know."""
        return None

    @property
    def is_guarded(self) -> bool:
        """Whether a guardian owns the bus on a real rig."""
        # A drive without a watchdog is guarded unless the file says otherwise.
        if self.guardian is None:
            return self.needs_guardian
        return self.guardian

    @property
    def reports_Hz(self) -> float:
        """Rate at which the drive reports the shaft."""
        return LOOP_RATE_HZ

    @property
    def fd_bitrate(self) -> int | None:
        """Bits/s of the data phase for drives with CAN-FD, else None."""
        return None

    def open(self) -> can.BusABC:
        """Open the bus, to be shut down by the caller. Override it for a drive without a CAN
        bus. Raises the errors of python-can.
        """
        return CanBusSettings(self.interface, self.channel, self.bitrate, self.fd_bitrate).open()

    def driver(self, bus: can.BusABC, clock: Clock, silent_s: float) -> ShaftMotor:
        """The driver on that bus; no report for `silent_s` is a fault. The make of a built-in
        drive makes it instead.
        """
        raise NotImplementedError(f"{type(self).__name__} defines no driver(bus, clock, silent_s)")


class OwnMotorSection(MotorSection):
    """A lab's own drive, driven by the class MOTOR in `file`; `twin_file` defines its TWIN. Both
    are relative to the rig file's folder.

    Other keys are only passed on here. MOTOR validates them when the rig file is read.
    """

    # A lab's class defines keys that are unknown here.
    model_config = ConfigDict(extra="allow")

    device: Literal["own"]
    file: Annotated[str, Field(min_length=1)]
    twin_file: Annotated[str, Field(min_length=1)] | None = None

    @property
    def title(self) -> str:
        return Path(self.file).name


class SpeedDriveKeys(MotorSection):
    """Base class of the keys of a drive with speed commands (`SpeedDrive`), and of the driver that
    is made from them.

    `zero_turns` is the encoder's reading, in motor turns, with the leg horizontal. A drive that
    reports only on request has no `report_period_ms`. `angle_gain_per_s` converts an angle error
    into a speed.
    """

    gear_ratio: Positive = 1.0
    zero_turns: float
    report_period_ms: Positive | None = None
    angle_gain_per_s: Positive = 20.0

    @property
    def encoder_zero(self) -> EncoderZero:
        return EncoderZero(
            "zero_turns", self.zero_turns, "turns", self.direction * self.gear_ratio, 1.0
        )

    @property
    def reports_Hz(self) -> float:
        if self.report_period_ms is None:
            return LOOP_RATE_HZ
        return 1e3 / self.report_period_ms


class MotorKeys(SpeedDriveKeys, OwnMotorSection):
    """Base class of a lab's MOTOR in a file that the rig file names."""

    # A wrong key is refused again, now that the lab's class states all of them.
    model_config = ConfigDict(extra="forbid")


class ForceSensorSection(Section):
    """Keys of every force sensor. `file_keys` are those that name a file beside the rig file."""

    file_keys: ClassVar[tuple[str, ...]] = ()

    if TYPE_CHECKING:
        # Each section states its own word, and its own limits.
        device: str
        rate_Hz: float

    @property
    def title(self) -> str:
        """The sensor in messages."""
        return self.device

    def driver(self, port: Any, clock: Clock) -> ForceSensor:
        """The driver on that port. The make of a built-in sensor makes it instead."""
        raise NotImplementedError(f"{type(self).__name__} defines no driver(port, clock)")


class SerialSensorKeys(ForceSensorSection):
    """Base class of the keys of a sensor on a serial port, which sends counts."""

    device: str
    counts_per_N: Positive
    counts_per_Nm: Positive
    rate_Hz: Positive
    port: str = "/dev/ttyUSB0"
    bits_per_s: Annotated[int, Field(gt=0)] = 115_200

    def open(self) -> SerialPort:
        """Open the connection to the sensor, to be closed by the caller. Override it for a sensor
        that is not on a serial port.

        Raises DeviceError.
        """
        return open_port(self.port, self.bits_per_s)


class OwnForceSensorSection(ForceSensorSection):
    """A lab's own sensor, read by the class FORCE_SENSOR in `file`; `twin_file` defines its TWIN.
    Both are relative to the rig file's folder. Other keys are only passed on here. FORCE_SENSOR
    validates them when the rig file is read.
    """

    # A lab's class defines keys that are unknown here.
    model_config = ConfigDict(extra="allow")

    device: Literal["own"]
    file: Annotated[str, Field(min_length=1)]
    twin_file: Annotated[str, Field(min_length=1)] | None = None
    rate_Hz: Positive

    @property
    def title(self) -> str:
        return Path(self.file).name

    def open(self) -> SerialPort:
        # Own devices are loaded relative to the rig file; a section made without a file has no
        # driver.
        raise BadInput(f"{self.file} was not loaded; read the rig file from where it stands")


class ForceSensorKeys(SerialSensorKeys, OwnForceSensorSection):
    """Base class of a lab's FORCE_SENSOR: the keys of [force_sensor], and the driver that is
    made from them.
    """

    # A wrong key is refused again, now that the lab's class states all of them.
    model_config = ConfigDict(extra="forbid")

    device: Literal["own"]

    def driver(self, port: SerialPort, clock: Clock) -> ForceSensor:
        """The driver on that port."""
        raise NotImplementedError("FORCE_SENSOR defines no driver(port, clock)")


# By identity, which makes it hashable: an optional table needs that, and a registry is a dict.
@dataclass(frozen=True, eq=False)
class SelectedByDevice(SelectedByData):
    """Annotation of a section that `device` selects from the registry. Only the section of that
    kind is imported.

    Parameters
    ----------
    base
        The base class of all sections.
    find, list_kinds
        The make of a kind, and all kinds.
    built_in
        The table of the built-in kinds.
    """

    base: type[Section]
    find: Callable[[str], MotorMake | SensorMake]
    list_kinds: Callable[[], tuple[str, ...]]
    built_in: Mapping[str, str]

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self.validate)

    def __get_pydantic_json_schema__(
        self, schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """The schema of all built-in kinds."""
        sections = {
            kind: load_object(self.find(kind).section).__pydantic_core_schema__
            for kind in self.built_in
        }
        return handler(core_schema.tagged_union_schema(sections, "device"))

    def validate(self, data: Any) -> Section:
        """The section of the kind that `data` names. Faults have the types that pydantic gives a
        union of sections.
        """
        if isinstance(data, self.base):
            return data
        if not isinstance(data, Mapping):
            raise PydanticKnownError("model_attributes_type")
        section = self.section_of(data)
        if section is None:
            words = {
                "discriminator": "'device'",
                "tag": str(data.get("device")),
                "expected_tags": ", ".join(map(repr, self.list_kinds())),
            }
            if "device" in data:
                raise PydanticKnownError("union_tag_invalid", words)
            raise PydanticKnownError("union_tag_not_found", words)
        return section.model_validate(data)

    def section_of(self, data: Mapping[str, Any]) -> type[Section] | None:
        """The class of the section that `data` names, None for a kind that is not known."""
        try:
            section = load_object(self.find(str(data.get("device"))).section)
        except KeyError:
            return None
        except BadInput as error:
            raise PydanticCustomError(
                "device_not_loaded", "{reason}", {"reason": str(error)}
            ) from None
        if not (isinstance(section, type) and issubclass(section, self.base)):
            raise PydanticCustomError(
                "device_not_loaded",
                f"the section of device {data['device']!r} does not inherit {self.base.__name__}",
            )
        return section


Motor = Annotated[MotorSection, SelectedByDevice(MotorSection, find_motor, list_motors, MOTORS)]
ForceSensorChoice = Annotated[
    ForceSensorSection,
    SelectedByDevice(ForceSensorSection, find_sensor, list_sensors, FORCE_SENSORS),
]
