"""What the drivers of CubeMars AK drives share, in MIT and in servo mode.

Settings, torque-off frames, unwrapping of positions, a check of speed against angle, and one of
standstill before energising.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite, radians, tau

import can

from rfca_rig.clock import Clock
from rfca_rig.devices.cubemars.codec import GAIN_Nm_S_PER_RAD, MitRanges, mit_ranges
from rfca_rig.devices.cubemars.codec.mit import (
    MitCommand,
    Special,
    decode_reply,
    encode_command,
    encode_special,
)
from rfca_rig.devices.cubemars.codec.servo import (
    STATUS_A,
    STATUS_DEG,
    Status,
    decode,
    drive_of,
    set_current,
)
from rfca_rig.errors import BadInput, DeviceError, MalformedFrame

# From 127 on the drive id could equal the first byte of a command, and an echoed command would pass
# for a reply.
MAX_MIT_ID = 126

# In steps of the reported torque or current: below ten steps a torque is not distinguished from
# zero.
MIN_LOAD_COUNTS = 10

# Length of a window, and the longest gap between two reports over which the trapezoidal rule is
# used, in s.
WINDOW_S = 0.2
MAX_GAP_S = 0.02
# Least rotation in a window. With less, the resolution of the speed field dominates.
MIN_ROTATION_RAD = 0.1
# Relative difference, and the number of windows in a row that must show it.
MAX_RELATIVE_DIFFERENCE = 0.25
WINDOWS = 3

CODES = 1 << 16
# A code at the end of its range for longer than STUCK_S, at a reported speed above MIN_SPEED_RAD_S,
# is stuck.
STUCK_S = 0.05
MIN_SPEED_RAD_S = 0.5

NO_WATCHDOG_REMEDY = (
    "let a guardian hold its bus (guardian = true), or put a relay into its supply that opens when "
    "this computer falls silent"
)

MAX_SPEED_RAD_S = 0.3
# Longer than a swinging leg stays slow at its turning point.
STANDSTILL_S = 0.05
WAIT_S = 3.0


@dataclass(frozen=True)
class MitSettings:
    """Settings of a drive in MIT mode. Raises BadInput for invalid values, and for a model that is
    not in the table.

    `zero_rad` is the reported position with the leg horizontal. `speed_gain_Nm_s_per_rad` (kd, up
    to 5) belongs to the drive's loop. `angle_gain_per_s` belongs to the driver: it converts an
    angle error to a speed.
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
        for name in (
            "speed_gain_Nm_s_per_rad",
            "angle_gain_per_s",
            "reply_timeout_s",
            "enable_timeout_s",
        ):
            _check_positive(name, getattr(self, name))
        # The upper end of the kd field in the MIT frame.
        if self.speed_gain_Nm_s_per_rad > GAIN_Nm_S_PER_RAD:
            raise BadInput(
                f"drive: speed_gain_Nm_s_per_rad is {self.speed_gain_Nm_s_per_rad:g}, "
                f"limit {GAIN_Nm_S_PER_RAD:g}"
            )

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

    `gear_ratio` is motor turns per shaft turn, `pole_pairs` the motor's (CubeMarsTool shows both).
    `torque_constant_Nm_per_A` is the motor's before the gear, `zero_deg` the reported position with
    the leg horizontal, `status_period_s` the upload period.
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
        for name in (
            "gear_ratio",
            "pole_pairs",
            "torque_constant_Nm_per_A",
            "status_period_s",
            "status_timeout_s",
            "enable_timeout_s",
        ):
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
        # ERPM = motor revolutions per minute times pole pairs; the motor turns `gear_ratio` times
        # as fast as the shaft.
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


@dataclass(frozen=True)
class MitTorqueOffFrames:
    """Torque off in MIT mode: a command with zero gains, as the drive remembers the last one,
    then EXIT. The drive answers both.
    """

    settings: MitSettings

    def zero_gain_command(self) -> can.Message:
        """Command with zero gains. Zero torque has no code; the nearest one is under 0.001 of
        the range, and acts only while enabled.
        """
        return self._to_drive(
            encode_command(self.settings.ranges, MitCommand(0.0, 0.0, 0.0, 0.0, 0.0))
        )

    def frames(self) -> tuple[can.Message, ...]:
        return self.zero_gain_command(), self._to_drive(encode_special(Special.EXIT))

    def _to_drive(self, data: bytes) -> can.Message:
        return can.Message(arbitration_id=self.settings.drive_id, data=data, is_extended_id=False)

    def torque_Nm(self, message: can.Message) -> float | None:
        drive = self.settings.drive_id
        # Replies come under id 0 or the drive's own, depending on firmware; the first byte names
        # the drive.
        if (
            message.is_extended_id
            or message.arbitration_id not in {0, drive}
            or not message.data
            or message.data[0] != drive
        ):
            return None
        try:
            return decode_reply(self.settings.ranges, message.data).torque_Nm
        except MalformedFrame:
            return None

    def min_visible_torque_Nm(self) -> float:
        # The torque field has 12 bits over the range -torque_Nm..torque_Nm: 4095 steps.
        return MIN_LOAD_COUNTS * 2.0 * self.settings.ranges.torque_Nm / 4095


@dataclass(frozen=True)
class ServoTorqueOffFrames:
    """Torque off in servo mode: a current of zero. The drive reports its current cyclically."""

    settings: ServoSettings

    def frames(self) -> tuple[can.Message, ...]:
        identifier, data = set_current(self.settings.drive_id, 0.0)
        return (can.Message(arbitration_id=identifier, data=data, is_extended_id=True),)

    def torque_Nm(self, message: can.Message) -> float | None:
        if not message.is_extended_id or drive_of(message.arbitration_id) != self.settings.drive_id:
            return None
        try:
            report = decode(message.arbitration_id, message.data)
        except MalformedFrame:
            return None
        if isinstance(report, Status):
            return report.current_A * self.settings.shaft_torque_per_A
        return None

    def min_visible_torque_Nm(self) -> float:
        return MIN_LOAD_COUNTS * STATUS_A * abs(self.settings.shaft_torque_per_A)


def describe_light_load(held_Nm: float, least_Nm: float) -> str:
    """Why no watchdog is proven by a motor that held less than `least_Nm`."""
    return (
        f"drive's watchdog not proven: the motor held {abs(held_Nm):.3f} N m, too little to see it "
        f"let go (at least {least_Nm:.3f}); park the leg off the vertical, or {NO_WATCHDOG_REMEDY}"
    )


class SpeedCheck:
    """Compares the integral of the reported speed with the change of the reported angle, window by
    window.

    `fault` gives the factor between them, once three windows in a row with motion differ by more
    than a quarter. `scales` names the settings to check.
    """

    def __init__(self, scales: str) -> None:
        self._scales = scales
        self.fault: str | None = None
        self.forgive()

    def forgive(self) -> None:
        """Clears the fault and starts a new window."""
        self.fault = None
        self._last: tuple[float, float, float] | None = None
        self._apart = 0
        self._open()

    def _open(self) -> None:
        self._elapsed_s = self._turned_rad = self._integral_rad = 0.0

    def follow(self, t_s: float, angle_rad: float, speed_rad_s: float) -> None:
        """Takes in one report, later than the last."""
        before = self._last
        self._last = (t_s, angle_rad, speed_rad_s)
        if before is None or t_s - before[0] > MAX_GAP_S:
            self._open()
            return
        elapsed_s = t_s - before[0]
        self._elapsed_s += elapsed_s
        self._turned_rad += angle_rad - before[1]
        self._integral_rad += 0.5 * (speed_rad_s + before[2]) * elapsed_s
        if self._elapsed_s >= WINDOW_S:
            self._judge()
            self._open()

    def _judge(self) -> None:
        most_rad = max(abs(self._turned_rad), abs(self._integral_rad))
        if most_rad < MIN_ROTATION_RAD:
            return
        if abs(self._turned_rad - self._integral_rad) > MAX_RELATIVE_DIFFERENCE * most_rad:
            self._apart = self._apart + 1
        else:
            self._apart = 0
        if self._apart >= WINDOWS:
            if self._turned_rad:
                factor = self._integral_rad / self._turned_rad
            else:
                factor = float("inf")
            self.fault = (
                f"the speed that the drive reports is {factor:.2g} times that of its angle; "
                f"check {self._scales}"
            )


class WrappedPosition:
    """Unwraps a code that wraps every 65 536 counts: between two codes the shaft took the shorter
    way.

    This holds while it turns less than half the span between two reports. Some firmware stops the
    code at the end of its range instead. The code then stands still although the drive reports a
    speed, and the angle is lost. `ends` are the codes where this can happen. `fault` reports this,
    or a jump larger than any motion: a restart, a new zero, or an encoder slip. A jump is never
    cleared, as the zero is lost with it.
    """

    def __init__(self, ends: frozenset[int], most_counts_s: float, margin_counts: float) -> None:
        self._ends = ends
        self._most_counts_s = most_counts_s
        self._margin_counts = margin_counts
        self._last: tuple[float, int] | None = None
        self._stuck_from_s: float | None = None
        self._count: int | None = None
        self._stuck: str | None = None
        self.leap: str | None = None

    @property
    def fault(self) -> str | None:
        return self.leap or self._stuck

    def forgive(self) -> None:
        """Clears the stuck fault and the last report; the turn count stays."""
        self._stuck = None
        self._last = self._stuck_from_s = None

    def follow(self, code: int, t_s: float, speed_rad_s: float, judged: bool = True) -> int:
        """The unwrapped code, counted from the first one. With `judged` False no jump is looked
        for at this step.
        """
        before = self._count
        if before is None:
            before = code
        # Signed difference in -32768..32767, the shorter way around.
        step = (code - before + CODES // 2) % CODES - CODES // 2
        self._count = before + step
        if self._last is not None and judged:
            self._look_for_leap(step, t_s - self._last[0])
        self._look_for_end(code, t_s, speed_rad_s)
        self._last = t_s, code
        return self._count

    def _look_for_leap(self, step: int, elapsed_s: float) -> None:
        farthest = self._most_counts_s * elapsed_s + self._margin_counts
        # After a long gap the shaft could have gone half the span, so a jump cannot be
        # distinguished from motion.
        if farthest < CODES // 2 and abs(step) > farthest:
            self.leap = (
                f"position leapt by {step} counts within {1e3 * elapsed_s:.1f} ms, more "
                "than the drive can turn; "
                "it restarted, was zeroed, or its encoder slipped: find its zero again"
            )

    def _look_for_end(self, code: int, t_s: float, speed_rad_s: float) -> None:
        if (
            code not in self._ends
            or abs(speed_rad_s) < MIN_SPEED_RAD_S
            or (self._last is not None and self._last[1] != code)
        ):
            self._stuck_from_s = None
        elif self._stuck_from_s is None:
            self._stuck_from_s = t_s
        elif t_s - self._stuck_from_s > STUCK_S:
            self._stuck = (
                f"position stands at the end of its range (code {code}) while the shaft "
                "turns: this firmware does not count on; "
                "turn the shaft back, and restart the drive near its zero"
            )


def await_standstill(clock: Clock, speed_rad_s: Callable[[], float]) -> None:
    """Waits until the shaft has been at rest for 50 ms.

    `speed_rad_s` waits one poll interval and returns the shaft speed after it. Raises DeviceError
    if the shaft still turns after 3 s.
    """
    began_s = swung_s = clock.now_s()
    while (now_s := clock.now_s()) - swung_s < STANDSTILL_S:
        now_rad_s = speed_rad_s()
        # Written so that a speed that is no number, as before the first report, is no standstill.
        if not abs(now_rad_s) <= MAX_SPEED_RAD_S:
            swung_s = clock.now_s()
        if now_s - began_s > WAIT_S:
            raise DeviceError(
                f"drive not enabled: without torque the shaft turns at {now_rad_s:.2g} "
                "rad/s, and does not come to rest within "
                f"{WAIT_S:g} s (limit {MAX_SPEED_RAD_S:g} rad/s); steady the leg, and start again"
            )
