"""[motor] of an ODrive in a rig file."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rfca_rig.devices.sections import MotorSection
from rfca_rig.drivers.encoder_zero import EncoderZero
from rfca_rig.toml import Positive


class OdriveSection(MotorSection):
    """An ODrive. `zero_turns` is the encoder's reading, in motor turns, with the leg horizontal.

    `dialect` is that of its firmware. 0.5 reports current instead of torque and therefore needs
    motor.config.torque_constant.
    """

    device: Literal["odrive"]
    node_id: Annotated[int, Field(ge=0, le=62)] = Field(
        description="axis0.config.can.node_id of the drive; 63 is that of a drive without one"
    )
    gear_ratio: Positive = Field(description="turns of the motor per turn of the shaft")
    zero_turns: float = Field(
        description="encoder reading with the leg horizontal, in turns of the motor"
    )
    encoder_period_ms: Positive = Field(
        description="period of the cyclic message 0x09, as set in the drive"
    )
    dialect: Literal["0.5", "0.6"] = Field(default="0.6", description="of the firmware")
    torque_constant_Nm_per_A: Positive | None = Field(
        default=None, description="for dialect 0.5: motor.config.torque_constant of the drive"
    )

    @model_validator(mode="after")
    def _check_torque_is_reported(self) -> "OdriveSection":
        if self.dialect == "0.5" and self.torque_constant_Nm_per_A is None:
            raise ValueError(
                'dialect "0.5" needs torque_constant_Nm_per_A, as in the drive\'s '
                "motor.config.torque_constant"
            )
        return self

    @property
    def encoder_zero(self) -> EncoderZero:
        return EncoderZero(
            "zero_turns", self.zero_turns, "turns", self.direction * self.gear_ratio, 1.0
        )

    @property
    def reports_Hz(self) -> float:
        return 1e3 / self.encoder_period_ms
