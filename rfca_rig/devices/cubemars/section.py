"""[motor] of a CubeMars / T-Motor AK drive in a rig file, in MIT and in servo mode."""

from math import tau
from typing import Annotated, ClassVar, Literal

from pydantic import Field, field_validator

from rfca_rig.devices.cubemars.codec import MIT_RANGES, mit_ranges
from rfca_rig.devices.sections import MotorSection
from rfca_rig.drivers.encoder_zero import EncoderZero
from rfca_rig.toml import Positive


class CubemarsMitSection(MotorSection):
    """A CubeMars / T-Motor AK drive in MIT mode. `model` determines the scale of every value;
    `zero_rad`, or `zero_deg`, is read with the leg horizontal.

    The drive's position covers 12.5 rad either way and starts again when it wraps. Switch it on
    with the leg less than two turns from where its zero was set. `speed_gain_Nm_s_per_rad` (kd) is
    sent to the drive, `angle_gain_per_s` is the driver's.
    """

    needs_guardian: ClassVar[bool] = True

    device: Literal["cubemars-mit"]
    drive_id: Annotated[int, Field(ge=1, le=126)] = Field(
        description="number of the drive on the bus"
    )
    model: str = Field(
        description="type plate, which determines the scale of every value",
        json_schema_extra={"enum": list(MIT_RANGES)},
    )
    zero_rad: float = Field(description="reading with the leg horizontal")
    speed_gain_Nm_s_per_rad: Annotated[float, Field(gt=0, le=5)] = Field(
        default=5.0, description="kd of the drive"
    )
    angle_gain_per_s: Positive = Field(
        default=20.0, description="converts an angle error into a speed"
    )

    @field_validator("model")
    @classmethod
    def _is_known_model(cls, model: str) -> str:
        if model not in MIT_RANGES:
            raise ValueError(f"should be one of {', '.join(MIT_RANGES)}")
        return model

    @property
    def encoder_zero(self) -> EncoderZero:
        return EncoderZero(
            "zero_rad",
            self.zero_rad,
            "rad",
            self.direction * tau,
            tau / mit_ranges(self.model).gear_ratio,
        )


class CubemarsServoSection(MotorSection):
    """A CubeMars / T-Motor AK drive in servo mode. `zero_deg` is its reading with the leg
    horizontal.

    Pole pairs and gear ratio are in CubeMarsTool, the torque constant (of the motor, before the
    gear) in the data sheet. Without them its speeds and currents have no meaning.
    """

    needs_guardian: ClassVar[bool] = True

    device: Literal["cubemars-servo"]
    drive_id: Annotated[int, Field(ge=0, le=255)] = Field(
        description="number of the drive on the bus"
    )
    gear_ratio: Positive = Field(description="turns of the motor per turn of the shaft")
    pole_pairs: Annotated[int, Field(gt=0)] = Field(
        description="of the motor; CubeMarsTool shows them"
    )
    torque_constant_Nm_per_A: Positive = Field(
        description="of the motor, before the gear; in its data sheet"
    )
    zero_deg: float = Field(description="reading with the leg horizontal")
    status_period_ms: Positive = Field(
        description="period of the status message, as set in the drive"
    )

    @property
    def encoder_zero(self) -> EncoderZero:
        return EncoderZero(
            "zero_deg", self.zero_deg, "deg", self.direction * 360.0, 360.0 / self.gear_ratio
        )

    @property
    def reports_Hz(self) -> float:
        return 1e3 / self.status_period_ms
