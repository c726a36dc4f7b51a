"""[motor] and [force_sensor] in a rig file: one section per kind of drive or sensor, selected by `device`."""

from typing import Annotated, ClassVar, Literal

import can
from pydantic import ConfigDict, Field, field_validator, model_validator

from rfca_rig.clock import Clock
from rfca_rig.codecs.ati_serial import RecordForm
from rfca_rig.codecs.cubemars_drives import MIT_RANGES
from rfca_rig.description.sections import Positive, Section
from rfca_rig.drivers.can_frames import CanBusSettings
from rfca_rig.drivers.force_sensors.ati_serial import AtiSerialSettings
from rfca_rig.drivers.ports import SerialPort, open_port
from rfca_rig.drivers.roles import ForceSensor as ForceSensorRole
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.errors import BadInput

# Rate of commands during a stroke, and of the reports of a drive that only answers commands.
LOOP_RATE_HZ = 500.0


class MotorSection(Section):
    """Keys of every drive on CAN: the bus, and the direction in which it turns the shaft.

    On a real rig a `guardian` owns the bus of a drive that has no watchdog. It is a process that removes the torque when no command arrives
    for `guardian_silence_ms`.
    """

    needs_guardian: ClassVar[bool] = False

    direction: Literal[1, -1] = Field(description="-1 where the drive counts up while the leg turns up")
    interface: str = Field(default="socketcan", description="interface of python-can")
    channel: str = Field(default="can0", description="channel of that interface")
    bitrate: Annotated[int, Field(gt=0)] = Field(default=1_000_000, description="bits/s of the bus")
    guardian: bool | None = Field(default=None, description="for drives without a watchdog: whether a guardian owns the bus of a real rig")
    guardian_silence_ms: Annotated[float, Field(ge=20, le=300)] = Field(
        default=100.0, description="time without a command after which the guardian removes the torque"
    )

    @field_validator("guardian")
    @classmethod
    def _only_where_it_is_needed(cls, guardian: bool | None) -> bool | None:
        # A drive's own watchdog is tested before a run; a guardian beside it has no purpose.
        if guardian and not cls.needs_guardian:
            raise ValueError("is for drives without a watchdog; this one has its own, which is proven before a run: leave the key out")
        return guardian

    @property
    def is_guarded(self) -> bool:
        """Whether a guardian owns the bus on a real rig."""
        # A drive without a watchdog is guarded unless the file says otherwise.
        return self.needs_guardian if self.guardian is None else self.guardian

    @property
    def reports_Hz(self) -> float:
        """Rate at which the drive reports the shaft."""
        return LOOP_RATE_HZ

    @property
    def fd_bitrate(self) -> int | None:
        """Bits/s of the data phase for drives with CAN-FD, else None."""
        return None


class OdriveSection(MotorSection):
    """An ODrive. `zero_turns` is the encoder's reading, in motor turns, with the leg horizontal.

    `dialect` is that of its firmware. 0.5 reports current instead of torque and therefore needs motor.config.torque_constant.
    """

    device: Literal["odrive"]
    node_id: Annotated[int, Field(ge=0, le=63)] = Field(description="axis0.config.can.node_id of the drive")
    gear_ratio: Positive = Field(description="turns of the motor per turn of the shaft")
    zero_turns: float = Field(description="encoder reading with the leg horizontal, in turns of the motor")
    encoder_period_ms: Positive = Field(description="period of the cyclic message 0x09, as set in the drive")
    dialect: Literal["0.5", "0.6"] = Field(default="0.6", description="of the firmware")
    torque_constant_Nm_per_A: Positive | None = Field(
        default=None, description="for dialect 0.5: motor.config.torque_constant of the drive"
    )

    @model_validator(mode="after")
    def _check_torque_is_reported(self) -> "OdriveSection":
        if self.dialect == "0.5" and self.torque_constant_Nm_per_A is None:
            raise ValueError('dialect "0.5" needs torque_constant_Nm_per_A, as in the drive\'s motor.config.torque_constant')
        return self

    @property
    def reports_Hz(self) -> float:
        return 1e3 / self.encoder_period_ms


class CubemarsMitSection(MotorSection):
    """A CubeMars / T-Motor AK drive in MIT mode. `model` determines the scale of every value; `zero_rad`, or `zero_deg`, is read with
    the leg horizontal.

    The drive's position covers 12.5 rad either way and starts again when it wraps. Switch it on with the leg less than two turns from where
    its zero was set. `speed_gain_Nm_s_per_rad` (kd) is sent to the drive, `angle_gain_per_s` is the driver's.
    """

    needs_guardian: ClassVar[bool] = True

    device: Literal["cubemars-mit"]
    drive_id: Annotated[int, Field(ge=1, le=126)] = Field(description="number of the drive on the bus")
    model: str = Field(description="type plate, which determines the scale of every value", json_schema_extra={"enum": list(MIT_RANGES)})
    zero_rad: float = Field(description="reading with the leg horizontal")
    speed_gain_Nm_s_per_rad: Annotated[float, Field(gt=0, le=5)] = Field(default=5.0, description="kd of the drive")
    angle_gain_per_s: Positive = Field(default=20.0, description="converts an angle error into a speed")

    @field_validator("model")
    @classmethod
    def _is_known_model(cls, model: str) -> str:
        if model not in MIT_RANGES:
            raise ValueError(f"should be one of {', '.join(MIT_RANGES)}")
        return model


class CubemarsServoSection(MotorSection):
    """A CubeMars / T-Motor AK drive in servo mode. `zero_deg` is its reading with the leg horizontal.

    Pole pairs and gear ratio are in CubeMarsTool, the torque constant (of the motor, before the gear) in the data sheet. Without them its
    speeds and currents have no meaning.
    """

    needs_guardian: ClassVar[bool] = True

    device: Literal["cubemars-servo"]
    drive_id: Annotated[int, Field(ge=0, le=255)] = Field(description="number of the drive on the bus")
    gear_ratio: Positive = Field(description="turns of the motor per turn of the shaft")
    pole_pairs: Annotated[int, Field(gt=0)] = Field(description="of the motor; CubeMarsTool shows them")
    torque_constant_Nm_per_A: Positive = Field(description="of the motor, before the gear; in its data sheet")
    zero_deg: float = Field(description="reading with the leg horizontal")
    status_period_ms: Positive = Field(description="period of the status message, as set in the drive")

    @property
    def reports_Hz(self) -> float:
        return 1e3 / self.status_period_ms


class MoteusSection(MotorSection):
    """A moteus on CAN-FD. `zero_turns` is its position, in turns of its output, with the leg horizontal.

    A gear in its motor_position.rotor_to_output_ratio is already part of its output; `gear_ratio` is for a gear after that. `watchdog_ms`
    is sent with every command: the drive continues for this long without the next one.
    """

    device: Literal["moteus"]
    drive_id: Annotated[int, Field(ge=1, le=127)] = Field(description="id.id of the drive")
    gear_ratio: Positive = Field(default=1.0, description="of a gear beyond motor_position.rotor_to_output_ratio")
    zero_turns: float = Field(description="position with the leg horizontal, in turns of the output")
    watchdog_ms: Positive = Field(default=100.0, description="time for which the drive continues without a command")
    torque_limit_Nm: Positive | None = Field(default=None, description="sent with every command; without it the limit of the drive holds")
    can_prefix: Annotated[int, Field(ge=0, le=0x1FFF)] = Field(default=0, description="id.can_prefix of the drive")
    data_bitrate: Annotated[int, Field(gt=0)] = Field(default=5_000_000, description="bits/s of the data phase")
    bitrate_switch: bool = Field(default=True, description="whether the data phase is faster")

    @property
    def fd_bitrate(self) -> int | None:
        return self.data_bitrate


class OwnMotorSection(MotorSection):
    """A lab's own drive, driven by the class MOTOR in `file`; `twin_file` defines its TWIN. Both are relative to the rig file's folder.

    Other keys are only passed on here. MOTOR validates them when the rig file is read (`own_devices`).
    """

    # A lab's class defines keys that are unknown here.
    model_config = ConfigDict(extra="allow")

    device: Literal["own"]
    file: Annotated[str, Field(min_length=1)]
    twin_file: Annotated[str, Field(min_length=1)] | None = None


class MotorKeys(OwnMotorSection):
    """Base class of a lab's MOTOR: the keys of [motor], and the driver that is made from them.

    `zero_turns` is the encoder's reading, in motor turns, with the leg horizontal. A drive that reports only on request has no
    `report_period_ms`. `angle_gain_per_s` converts an angle error into a speed.
    """

    # A wrong key is refused again, now that the lab's class states all of them.
    model_config = ConfigDict(extra="forbid")

    gear_ratio: Positive = 1.0
    zero_turns: float
    report_period_ms: Positive | None = None
    angle_gain_per_s: Positive = 20.0

    @property
    def reports_Hz(self) -> float:
        return LOOP_RATE_HZ if self.report_period_ms is None else 1e3 / self.report_period_ms

    def open(self) -> can.BusABC:
        """Open the bus, to be shut down by the caller. Override it for a drive without a CAN bus. Raises the errors of python-can."""
        return CanBusSettings(self.interface, self.channel, self.bitrate, self.fd_bitrate).open()

    def driver(self, bus: can.BusABC, clock: Clock, silent_s: float) -> ShaftMotor:
        """The driver on that bus; no report for `silent_s` is a fault."""
        raise NotImplementedError("MOTOR defines no driver(bus, clock, silent_s)")


Motor = Annotated[
    OdriveSection | CubemarsMitSection | CubemarsServoSection | MoteusSection | OwnMotorSection, Field(discriminator="device")
]


Port = Annotated[int, Field(gt=0, le=65535)]


class NetFtSection(Section):
    """An ATI Net F/T. The counts per unit are on its configuration page and in its calibration certificate.

    `configuration` states where the box's settings are checked before each stream: on its configuration page ("http": counts, units and
    rate), at its command interface ("commands": counts and units), or not at all ("unchecked"). `buffered` takes many records per datagram,
    as many as the box's RDT buffer size.
    """

    device: Literal["ati-net-ft"]
    counts_per_N: Positive = Field(description="on the configuration page of the box")
    counts_per_Nm: Positive = Field(description="on the configuration page of the box")
    rate_Hz: Annotated[float, Field(gt=0, le=7912)] = Field(description="RDT output rate of the box")
    host: str = Field(default="192.168.1.1", description="address of the box")
    port: Port = Field(default=49152, description="port of its RDT stream")
    configuration: Literal["http", "commands", "unchecked"] = Field(
        default="http", description="where the settings of the box are checked before each stream"
    )
    http_port: Port = Field(default=80, description="port of its configuration page")
    command_port: Port = Field(default=49151, description="port of its command interface")
    buffered: bool = Field(default=True, description="many records per datagram, as many as the RDT buffer size of the box")


class AtiSerialSection(Section):
    """An ATI F/T Controller (CTL, CON) on a serial port. The counts per unit are in its calibration certificate.

    `rate_Hz` is the rate at which the controller sends. It follows from its averaging and the serial line. A run measures it and is refused
    if it differs.
    """

    device: Literal["ati-serial"]
    counts_per_N: Positive = Field(description="in the calibration certificate")
    counts_per_Nm: Positive = Field(description="in the calibration certificate")
    rate_Hz: Positive = Field(description="rate at which the controller sends; a run measures it")
    port: str = Field(default="/dev/ttyUSB0", description="serial port")
    bits_per_s: Annotated[int, Field(gt=0)] = Field(default=38_400, description="of the serial line")
    record: Literal["ascii", "binary", "binary-checksum"] = Field(default="ascii", description="form of a record")

    def settings(self) -> AtiSerialSettings:
        """The settings for the driver."""
        form = RecordForm(self.record)
        return AtiSerialSettings(self.counts_per_N, self.counts_per_Nm, self.rate_Hz, form, self.bits_per_s, address=self.port)

    @model_validator(mode="after")
    def _line_carries_it(self) -> "AtiSerialSection":
        # The driver knows which rates a line can carry; its refusal becomes a message with the line of the file.
        try:
            self.settings()
        except BadInput as error:
            raise ValueError(str(error)) from None
        return self


class AtiDaqSection(Section):
    """An ATI DAQ F/T: gage voltages through a sampling card. `calibration_file` is the .cal file that came with the transducer.

    Its path is relative to the folder of the rig file. `unloaded_V` are the voltages of the unloaded sensor, in the order of the channels.
    `channels` are six differential inputs in the notation of the card's maker, and a seventh for the thermistor where the calibration
    compensates temperature.
    """

    device: Literal["ati-daq"]
    calibration_file: Annotated[str, Field(min_length=1)] = Field(
        description="the .cal file of the transducer, from the folder of this file"
    )
    rate_Hz: Annotated[float, Field(gt=0, le=40_000)] = Field(description="samples/s of each channel")
    unloaded_V: Annotated[tuple[float, ...], Field(strict=False, min_length=6, max_length=7)] = Field(
        default=(0.0,) * 6, description="voltages of the unloaded sensor, in the order of the channels"
    )
    channels: str = Field(default="Dev1/ai0:5", description="six differential inputs, and a seventh for a thermistor")


class OwnForceSensorSection(Section):
    """A lab's own sensor, read by the class FORCE_SENSOR in `file`; `twin_file` defines its TWIN. Both are relative to the rig file's
    folder.  Other keys are only passed on here. FORCE_SENSOR validates them when the rig file is read (`own_devices`).
    """

    # A lab's class defines keys that are unknown here.
    model_config = ConfigDict(extra="allow")

    device: Literal["own"]
    file: Annotated[str, Field(min_length=1)]
    twin_file: Annotated[str, Field(min_length=1)] | None = None
    rate_Hz: Positive


class ForceSensorKeys(OwnForceSensorSection):
    """Base class of a lab's FORCE_SENSOR: the keys of [force_sensor], and the driver that is made from them."""

    # A wrong key is refused again, now that the lab's class states all of them.
    model_config = ConfigDict(extra="forbid")

    counts_per_N: Positive
    counts_per_Nm: Positive
    port: str = "/dev/ttyUSB0"
    bits_per_s: Annotated[int, Field(gt=0)] = 115_200

    def open(self) -> SerialPort:
        """Open the connection to the sensor, to be closed by the caller. Override it for a sensor that is not on a serial port.

        Raises DeviceError.
        """
        return open_port(self.port, self.bits_per_s)

    def driver(self, port: SerialPort, clock: Clock) -> ForceSensorRole:
        """The driver on that port."""
        raise NotImplementedError("FORCE_SENSOR defines no driver(port, clock)")


ForceSensor = Annotated[NetFtSection | AtiSerialSection | AtiDaqSection | OwnForceSensorSection, Field(discriminator="device")]
