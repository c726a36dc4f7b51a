"""[motor] in a rig file: one section per kind of drive, told apart by `device`."""

from typing import Annotated, ClassVar, Literal

import can
from pydantic import ConfigDict, Field, field_validator, model_validator

from rfca_rig.clock import Clock
from rfca_rig.codecs.cubemars_ranges import MIT_RANGES
from rfca_rig.description.sections import Positive, Section
from rfca_rig.drivers.can_bus import CanBusSettings
from rfca_rig.drivers.roles import ShaftMotor

LOOP_RATE_HZ = 500.0  # of commands while a stroke runs: what a drive that only answers reports at


class MotorSection(Section):
    """What every drive on CAN has: the bus, and which way it turns the shaft.

    On a real rig a `guardian` holds the bus of a drive that has no watchdog: a process that takes the torque away where no
    command came for `guardian_silence_ms`.
    """

    needs_guardian: ClassVar[bool] = False

    direction: Literal[1, -1]
    interface: str = "socketcan"
    channel: str = "can0"
    bitrate: Annotated[int, Field(gt=0)] = 1_000_000
    guardian: bool | None = None
    guardian_silence_ms: Annotated[float, Field(ge=20, le=300)] = 100.0

    @field_validator("guardian")
    @classmethod
    def _only_where_it_is_needed(cls, guardian: bool | None) -> bool | None:
        if guardian and not cls.needs_guardian:
            raise ValueError("is for drives without a watchdog; this one has its own, which is proven before a run: leave the key out")
        return guardian

    @property
    def is_guarded(self) -> bool:
        """Whether a guardian holds the bus on a real rig."""
        return self.needs_guardian if self.guardian is None else self.guardian

    @property
    def reports_Hz(self) -> float:
        """How often the drive reports the shaft."""
        return LOOP_RATE_HZ

    @property
    def fd_bitrate(self) -> int | None:
        """Bits/s of the data phase where the drive speaks CAN-FD."""
        return None


class OdriveSection(MotorSection):
    """An ODrive. `zero_turns` is the encoder's reading, in motor turns, with the leg horizontal.

    `dialect` is that of its firmware; 0.5 reports current instead of torque, so it needs motor.config.torque_constant.
    """

    device: Literal["odrive"]
    node_id: Annotated[int, Field(ge=0, le=63)]
    gear_ratio: Positive
    zero_turns: float
    encoder_period_ms: Positive
    dialect: Literal["0.5", "0.6"] = "0.6"
    torque_constant_Nm_per_A: Positive | None = None

    @model_validator(mode="after")
    def _torque_can_be_told(self) -> "OdriveSection":
        if self.dialect == "0.5" and self.torque_constant_Nm_per_A is None:
            raise ValueError('dialect "0.5" needs torque_constant_Nm_per_A, as in the drive\'s motor.config.torque_constant')
        return self

    @property
    def reports_Hz(self) -> float:
        return 1e3 / self.encoder_period_ms


class CubemarsMitSection(MotorSection):
    """A CubeMars / T-Motor AK drive in MIT mode. `model` decides the scale of every value; `zero_rad` is read with the leg horizontal.

    The drive's position goes 12.5 rad either way and begins anew when it wraps: it must be switched on with the leg less than two
    turns from where its zero was set. `speed_gain_Nm_s_per_rad` (kd) is sent to the drive, `angle_gain_per_s` is the driver's.
    """

    needs_guardian: ClassVar[bool] = True

    device: Literal["cubemars-mit"]
    drive_id: Annotated[int, Field(ge=1, le=126)]
    model: str
    zero_rad: float
    speed_gain_Nm_s_per_rad: Annotated[float, Field(gt=0, le=5)] = 5.0
    angle_gain_per_s: Positive = 20.0

    @field_validator("model")
    @classmethod
    def _known_model(cls, model: str) -> str:
        if model not in MIT_RANGES:
            raise ValueError(f"should be one of {', '.join(MIT_RANGES)}")
        return model


class CubemarsServoSection(MotorSection):
    """A CubeMars / T-Motor AK drive in servo mode. `zero_deg` is what it reports with the leg horizontal.

    Pole pairs and gear ratio stand in CubeMarsTool, the torque constant (of the motor, before the gear) in the data sheet; without
    them its speeds and currents mean nothing.
    """

    needs_guardian: ClassVar[bool] = True

    device: Literal["cubemars-servo"]
    drive_id: Annotated[int, Field(ge=0, le=255)]
    gear_ratio: Positive
    pole_pairs: Annotated[int, Field(gt=0)]
    torque_constant_Nm_per_A: Positive
    zero_deg: float
    status_period_ms: Positive

    @property
    def reports_Hz(self) -> float:
        return 1e3 / self.status_period_ms


class MoteusSection(MotorSection):
    """A moteus on CAN-FD. `zero_turns` is its position, in turns of its output, with the leg horizontal.

    A gear that its motor_position.rotor_to_output_ratio counts is in its output already; `gear_ratio` is what comes after that.
    `watchdog_ms` goes out with every command: so long does the drive go on without the next.
    """

    device: Literal["moteus"]
    drive_id: Annotated[int, Field(ge=1, le=127)]
    gear_ratio: Positive = 1.0
    zero_turns: float
    watchdog_ms: Positive = 100.0
    torque_limit_Nm: Positive | None = None
    can_prefix: Annotated[int, Field(ge=0, le=0x1FFF)] = 0
    data_bitrate: Annotated[int, Field(gt=0)] = 5_000_000
    bitrate_switch: bool = True

    @property
    def fd_bitrate(self) -> int | None:
        return self.data_bitrate


class OwnMotorSection(MotorSection):
    """A drive of a lab's own, led by what `file` defines as MOTOR; `twin_file` defines its TWIN. Both count from the rig file's folder.

    Here the other keys are only carried along: what they must be, MOTOR says when the rig file is read (`own_devices`).
    """

    model_config = ConfigDict(extra="allow")

    device: Literal["own"]
    file: Annotated[str, Field(min_length=1)]
    twin_file: Annotated[str, Field(min_length=1)] | None = None


class MotorKeys(OwnMotorSection):
    """What a lab's file inherits for its MOTOR: the keys of [motor], and the driver they make.

    `zero_turns` is the encoder's reading, in motor turns, with the leg horizontal; a drive that reports only when asked has no
    `report_period_ms`. `angle_gain_per_s` turns an angle that is missing into a speed.
    """

    model_config = ConfigDict(extra="forbid")

    gear_ratio: Positive = 1.0
    zero_turns: float
    report_period_ms: Positive | None = None
    angle_gain_per_s: Positive = 20.0

    @property
    def reports_Hz(self) -> float:
        return LOOP_RATE_HZ if self.report_period_ms is None else 1e3 / self.report_period_ms

    def open(self) -> can.BusABC:
        """The bus, to be shut by the caller; override it for a drive that is on none. Raises what python-can raises."""
        return CanBusSettings(self.interface, self.channel, self.bitrate, self.fd_bitrate).open()

    def driver(self, bus: can.BusABC, clock: Clock, silent_s: float) -> ShaftMotor:
        """The driver on that bus; no report for `silent_s` is a fault."""
        raise NotImplementedError("MOTOR defines no driver(bus, clock, silent_s)")


Motor = Annotated[
    OdriveSection | CubemarsMitSection | CubemarsServoSection | MoteusSection | OwnMotorSection, Field(discriminator="device")
]
