"""How an ODrive's motor turns the shaft: address, gear, direction, zero."""

from dataclasses import dataclass
from math import isfinite, tau

from rfca_rig.codecs.odrive_messages import Dialect
from rfca_rig.errors import BadInput


@dataclass(frozen=True)
class OdriveSettings:
    """What the driver must know of the drive.

    `gear_ratio` is motor turns per shaft turn, `direction` +1 or -1, `zero_turns` the encoder's turns where the shaft is
    horizontal. `torque_constant_Nm_per_A` None takes the torque from message 0x1C, else from the measured current 0x14.
    `encoder_period_s` is the drive's cyclic rate of message 0x09. `dialect` is that of its firmware; 0.5 tells no torque, so it
    needs the torque constant. Raises BadInput for values that cannot be.
    """

    node_id: int
    gear_ratio: float = 1.0
    direction: int = 1
    zero_turns: float = 0.0
    torque_constant_Nm_per_A: float | None = None
    encoder_period_s: float = 1e-3
    heartbeat_timeout_s: float = 0.35
    enable_timeout_s: float = 1.0
    dialect: Dialect = Dialect.V0_6

    def __post_init__(self) -> None:
        if not 0 <= self.node_id < 63:
            raise BadInput(f"drive: node_id is {self.node_id}, must be 0..62")
        if self.direction not in {1, -1}:
            raise BadInput(f"drive: direction is {self.direction}, must be 1 or -1")
        if not isfinite(self.zero_turns):
            raise BadInput(f"drive: zero_turns is {self.zero_turns}, must be a number")
        for name in ("gear_ratio", "encoder_period_s", "heartbeat_timeout_s", "enable_timeout_s"):
            _positive(name, getattr(self, name))
        if self.torque_constant_Nm_per_A is not None:
            _positive("torque_constant_Nm_per_A", self.torque_constant_Nm_per_A)
        elif self.dialect == Dialect.V0_5:
            raise BadInput(
                "drive: torque_constant_Nm_per_A is missing; firmware 0.5 tells the motor's current, not its torque "
                "(8.27 / the motor's KV in rpm/V, as in motor.config.torque_constant)"
            )

    def turns(self, angle_rad: float) -> float:
        """Encoder turns at a shaft angle."""
        return self.zero_turns + self.turns_s(angle_rad)

    def turns_s(self, speed_rad_s: float) -> float:
        """Motor speed at a shaft speed."""
        return self.direction * self.gear_ratio * speed_rad_s / tau

    @property
    def shaft_rad_per_turn(self) -> float:
        """Signed: shaft radians per motor turn."""
        return self.direction * tau / self.gear_ratio

    @property
    def shaft_torque_per_motor_torque(self) -> float:
        """Signed, for a gear without losses."""
        return self.direction * self.gear_ratio


def _positive(name: str, value: float) -> None:
    if not (isfinite(value) and value > 0.0):
        raise BadInput(f"drive: {name} is {value}, must be above 0")
