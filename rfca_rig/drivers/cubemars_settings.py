"""Settings of a CubeMars AK drive in MIT or servo mode: address, scale, direction, zero."""

from dataclasses import dataclass
from math import isfinite, radians, tau

from rfca_rig.codecs.cubemars_ranges import GAIN_Nm_S_PER_RAD, MitRanges, mit_ranges
from rfca_rig.codecs.cubemars_servo import STATUS_DEG
from rfca_rig.errors import BadInput

# From 127 on the drive id could equal the first byte of a command, and an echoed command would pass for a reply.
MAX_MIT_ID = 126


@dataclass(frozen=True)
class MitSettings:
    """Settings of a drive in MIT mode. Raises BadInput for invalid values, and for a model that is not in the table.

    `zero_rad` is the reported position with the leg horizontal. `speed_gain_Nm_s_per_rad` (kd, up to 5) belongs to the drive's loop.
    `angle_gain_per_s` belongs to the driver: it converts an angle error to a speed.
    """

    drive_id: int
    model: str
    direction: int = 1
    zero_rad: float = 0.0
    speed_gain_Nm_s_per_rad: float = GAIN_Nm_S_PER_RAD
    angle_gain_per_s: float = 20.0
    # Silence in s from which the drive is at fault, and the limit for enabling.
    reply_timeout_s: float = 0.35
    enable_timeout_s: float = 1.0

    def __post_init__(self) -> None:
        mit_ranges(self.model)
        if not 1 <= self.drive_id <= MAX_MIT_ID:
            raise BadInput(f"drive: drive_id is {self.drive_id}, must be 1..{MAX_MIT_ID}")
        _check_direction(self.direction)
        _check_finite("zero_rad", self.zero_rad)
        for name in ("speed_gain_Nm_s_per_rad", "angle_gain_per_s", "reply_timeout_s", "enable_timeout_s"):
            _check_positive(name, getattr(self, name))
        # The upper end of the kd field in the MIT frame.
        if self.speed_gain_Nm_s_per_rad > GAIN_Nm_S_PER_RAD:
            raise BadInput(f"drive: speed_gain_Nm_s_per_rad is {self.speed_gain_Nm_s_per_rad:g}, limit {GAIN_Nm_S_PER_RAD:g}")

    @property
    def ranges(self) -> MitRanges:
        return mit_ranges(self.model)

    @property
    def max_lag_rad(self) -> float:
        """Angle error in rad at which the drive reaches its largest torque."""
        # The torque is kd times the demanded speed, which is the angle error times the angle gain.
        return self.ranges.torque_Nm / (self.speed_gain_Nm_s_per_rad * self.angle_gain_per_s)


@dataclass(frozen=True)
class ServoSettings:
    """Settings of a drive in servo mode. Raises BadInput for invalid values.

    `gear_ratio` is motor turns per shaft turn, `pole_pairs` the motor's (CubeMarsTool shows both). `torque_constant_Nm_per_A` is the
    motor's before the gear, `zero_deg` the reported position with the leg horizontal, `status_period_s` the upload period.
    """

    drive_id: int
    gear_ratio: float
    pole_pairs: int
    torque_constant_Nm_per_A: float
    direction: int = 1
    zero_deg: float = 0.0
    status_period_s: float = 2e-3
    status_timeout_s: float = 0.35
    enable_timeout_s: float = 1.0

    def __post_init__(self) -> None:
        if not 0 <= self.drive_id <= 0xFF:
            raise BadInput(f"drive: drive_id is {self.drive_id}, must be 0..255")
        _check_direction(self.direction)
        _check_finite("zero_deg", self.zero_deg)
        for name in ("gear_ratio", "pole_pairs", "torque_constant_Nm_per_A", "status_period_s", "status_timeout_s", "enable_timeout_s"):
            _check_positive(name, getattr(self, name))

    def angle_rad(self, position_count: int) -> float:
        """Shaft angle in rad from a position count of the status frame, unwrapped over turns."""
        return self.direction * radians(STATUS_DEG * position_count - self.zero_deg)

    def deg(self, angle_rad: float) -> float:
        """Drive position in degrees at a shaft angle in rad."""
        return self.zero_deg + self.direction * angle_rad * 360.0 / tau

    @property
    def erpm_s_per_rad(self) -> float:
        """Electrical revolutions per minute (ERPM) at a shaft speed of 1 rad/s, signed."""
        # ERPM = motor revolutions per minute times pole pairs; the motor turns `gear_ratio` times as fast as the shaft.
        return self.direction * self.gear_ratio * self.pole_pairs * 60.0 / tau

    @property
    def shaft_torque_per_A(self) -> float:
        """Shaft torque in N m per ampere, signed, for a gear without losses."""
        return self.direction * self.gear_ratio * self.torque_constant_Nm_per_A


def _check_direction(direction: int) -> None:
    if direction not in {1, -1}:
        raise BadInput(f"drive: direction is {direction}, must be 1 or -1")


def _check_finite(name: str, value: float) -> None:
    if not isfinite(value):
        raise BadInput(f"drive: {name} is {value}, must be a number")


def _check_positive(name: str, value: float) -> None:
    if not (isfinite(value) and value > 0.0):
        raise BadInput(f"drive: {name} is {value}, must be above 0")
