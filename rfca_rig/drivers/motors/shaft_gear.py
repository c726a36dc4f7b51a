"""Conversion between the turns of a drive and the angle of the shaft, and detection of jumps of its encoder.

Causes are a restart of the drive, a new zero, or a slipped encoder.
"""

from math import isfinite, tau

from rfca_rig.errors import BadInput

# Margin in rad on top of any possible motion.
JUMP_MARGIN_RAD = 0.1
# Factor on the faster of the two reported speeds, as the speed between two reports may be higher.
SPEED_FACTOR = 1.5
# Largest acceleration: 40 N m on a bare rotor of 0.008 kg m2.
MAX_ACCELERATION_RAD_S2 = 5000.0
# Cap on the assumed speed, so that a long gap does not allow any step.
MAX_SPEED_RAD_S = 60.0


class ShaftGear:
    """Base of settings with these three values.

    `gear_ratio` is drive turns per shaft turn, `direction` +1 or -1, `zero_turns` the drive's reading with the shaft horizontal.
    """

    gear_ratio: float
    direction: int
    zero_turns: float

    def check_gear(self) -> None:
        """Raises BadInput for invalid values."""
        if self.direction not in {1, -1}:
            raise BadInput(f"drive: direction is {self.direction}, must be 1 or -1")
        if not isfinite(self.zero_turns):
            raise BadInput(f"drive: zero_turns is {self.zero_turns}, must be a number")
        check_positive("gear_ratio", self.gear_ratio)

    def turns(self, angle_rad: float) -> float:
        """Drive position in turns at a shaft angle in rad."""
        return self.zero_turns + self.turns_s(angle_rad)

    def turns_s(self, speed_rad_s: float) -> float:
        """Drive speed in turns/s at a shaft speed in rad/s."""
        return self.direction * self.gear_ratio * speed_rad_s / tau

    @property
    def shaft_rad_per_turn(self) -> float:
        """Shaft angle in rad per turn of the drive, signed."""
        return self.direction * tau / self.gear_ratio

    @property
    def shaft_torque_per_drive_torque(self) -> float:
        """Shaft torque over drive torque, signed, for a gear without losses."""
        return self.direction * self.gear_ratio


def check_positive(name: str, value: float) -> None:
    """Raises BadInput if `value` is not a finite number above 0."""
    if not (isfinite(value) and value > 0.0):
        raise BadInput(f"drive: {name} is {value}, must be above 0")


class EncoderJumpMonitor:
    """Checks each step of the shaft's position. `fault` stays set after a jump, as the zero is lost with it.

    The allowed speed between two reports is 1.5 times the faster of their speeds, plus half of what the largest acceleration adds.
    A step of 0.1 rad more than this speed allows is a jump. The elapsed time is the larger of device time and host time
    between two reads, so that lost reports do not look like a jump.
    """

    def __init__(self) -> None:
        self.fault: str | None = None
        self._last: tuple[float, float, float, float] | None = None

    def follow(self, host_s: float, device_s: float, angle_rad: float, speed_rad_s: float, judged: bool = True) -> None:
        """Takes in one report, later than the last, that the host read at `host_s`. With `judged` False this step is not checked."""
        last, self._last = self._last, (host_s, device_s, angle_rad, abs(speed_rad_s))
        if last is None or self.fault is not None or not judged:
            return
        elapsed_s = max(host_s - last[0], device_s - last[1])
        fastest_rad_s = max(last[3], abs(speed_rad_s)) * SPEED_FACTOR + 0.5 * MAX_ACCELERATION_RAD_S2 * elapsed_s
        by_rad = angle_rad - last[2]
        if abs(by_rad) > JUMP_MARGIN_RAD + min(fastest_rad_s, MAX_SPEED_RAD_S) * elapsed_s:
            self.fault = (
                f"position leapt by {by_rad:.2f} rad within {1e3 * elapsed_s:.1f} ms, more than the shaft can turn; "
                "the drive restarted, was zeroed, or its encoder slipped: find its zero again"
            )
