"""[motor] of a moteus in a rig file."""

from typing import Annotated, Literal

from pydantic import Field

from rfca_rig.devices.sections import MotorSection
from rfca_rig.drivers.encoder_zero import EncoderZero
from rfca_rig.toml import Positive


class MoteusSection(MotorSection):
    """A moteus on CAN-FD. `zero_turns` is its position, in turns of its output, with the leg
    horizontal.

    A gear in its motor_position.rotor_to_output_ratio is already part of its output; `gear_ratio`
    is for a gear after that. `watchdog_ms` is sent with every command: the drive continues for this
    long without the next one.
    """

    device: Literal["moteus"]
    drive_id: Annotated[int, Field(ge=1, le=127)] = Field(description="id.id of the drive")
    gear_ratio: Positive = Field(
        default=1.0, description="of a gear beyond motor_position.rotor_to_output_ratio"
    )
    zero_turns: float = Field(
        description="position with the leg horizontal, in turns of the output"
    )
    rotor_to_output_ratio: Positive = Field(
        default=1.0,
        description="motor_position.rotor_to_output_ratio of the drive, for zero_policy "
        "behind-gear: turns of the output per turn of the motor",
    )
    watchdog_ms: Positive = Field(
        default=100.0, description="time for which the drive continues without a command"
    )
    torque_limit_Nm: Positive | None = Field(
        default=None, description="sent with every command; without it the limit of the drive holds"
    )
    can_prefix: Annotated[int, Field(ge=0, le=0x1FFF)] = Field(
        default=0, description="id.can_prefix of the drive"
    )
    data_bitrate: Annotated[int, Field(gt=0)] = Field(
        default=5_000_000, description="bits/s of the data phase"
    )
    bitrate_switch: bool = Field(default=True, description="whether the data phase is faster")

    @property
    def encoder_zero(self) -> EncoderZero:
        return EncoderZero(
            "zero_turns",
            self.zero_turns,
            "turns",
            self.direction * self.gear_ratio,
            self.rotor_to_output_ratio,
        )

    @property
    def fd_bitrate(self) -> int | None:
        return self.data_bitrate
