"""Checks of the shaft: reported, near its target, not too fast, not stuck, no jumps of the encoder."""

from dataclasses import dataclass

import numpy as np

from rfca_rig.drivers.roles import ShaftSamples
from rfca_rig.errors import Tripped
from rfca_rig.protocol.plan import Limits
from rfca_rig.trip_codes import Trip

# A target slower than this may stand for a moment.
JAM_SPEED_RAD_S = 0.2
# Share of the target's speed below which the shaft counts as stuck.
JAM_SHARE = 0.1
# Longer than a soft drive sags into a load.
JAM_S = 0.3
# Allowed between two reports beyond what the speed limit explains: far above any encoder's noise.
JUMP_RAD = 0.2


@dataclass(frozen=True)
class Tracking:
    """Angle and speed of target and shaft at one tick."""

    target_rad: float
    angle_rad: float
    target_speed_rad_s: float
    speed_rad_s: float


class ShaftMonitor:
    """Remembers the last report, and since when the shaft has not followed its target at all."""

    def __init__(self, limits: Limits, now_s: float) -> None:
        self._limits = limits
        self._reported_s = self._moved_s = now_s
        self._last: tuple[float, float] | None = None
        self._torque_Nm = np.nan

    def check_reports(self, now_s: float, shaft: ShaftSamples) -> None:
        """Checks one tick's reports; the block may be empty."""
        if not len(shaft.angle_rad):
            self._check_silence(now_s - self._reported_s)
            return
        self._reported_s = now_s
        self._torque_Nm = float(shaft.torque_Nm[-1])
        self._check_jump(shaft)
        self._last = float(shaft.device_s[-1]), float(shaft.angle_rad[-1])

    def _check_silence(self, silent_s: float) -> None:
        limit_s = self._limits.drive_silent_s
        if silent_s > limit_s:
            raise Tripped(
                Trip.ENCODER_SILENT,
                f"no report of the shaft's angle for {1e3 * silent_s:.0f} ms, limit {1e3 * limit_s:.0f} ms; check the drive's "
                "encoder and its cyclic messages",
            )

    def _check_jump(self, shaft: ShaftSamples) -> None:
        # Plain numbers: a tick brings a few reports, for which numpy takes longer. The last report of the tick before belongs to
        # the block, because a jump may lie between two ticks.
        last, worst_rad = self._last, -1.0
        for time_s, angle_rad in zip(shaft.device_s.tolist(), shaft.angle_rad.tolist(), strict=True):
            if last is not None:
                step_rad = abs(angle_rad - last[1])
                if step_rad > self._limits.speed_rad_s * (time_s - last[0]) + JUMP_RAD:
                    worst_rad = max(worst_rad, step_rad)
            last = time_s, angle_rad
        if worst_rad >= 0.0:
            raise Tripped(
                Trip.JUMP,
                f"the shaft's angle jumped by {np.degrees(worst_rad):.1f} deg from one report to the next; was the drive "
                "restarted, or does the encoder slip? Check the zero before anything moves",
            )

    def check_tracking(self, now_s: float, now: Tracking) -> None:
        """Checks the speed, and the following error, whose limit grows with the target's speed."""
        if abs(now.speed_rad_s) > self._limits.speed_rad_s:
            raise Tripped(
                Trip.OVERSPEED,
                f"shaft at {now.speed_rad_s:.2f} rad/s, limit {self._limits.speed_rad_s:g} rad/s; does the drive obey, and are gear and "
                "encoder as the rig file says?",
            )
        self._check_behind(now)
        self._check_jam(now_s, now)

    def _check_behind(self, now: Tracking) -> None:
        behind_rad = abs(now.target_rad - now.angle_rad)
        # A drive lags in proportion to its speed; a constant limit would be too tight in strokes or too wide at rest.
        limit_rad = self._limits.following_error_rad + self._limits.following_error_s * abs(now.target_speed_rad_s)
        if behind_rad > limit_rad:
            raise Tripped(
                Trip.FOLLOWING,
                f"following error: shaft {np.degrees(behind_rad):.1f} deg from where it should be, limit {np.degrees(limit_rad):.1f} deg "
                f"at {now.target_speed_rad_s:.2f} rad/s; look for a jam, or a drive too weak for this load",
            )

    def _check_jam(self, now_s: float, now: Tracking) -> None:
        # At a low speed the following error reaches its limit late; this check finds a stuck shaft within JAM_S.
        wanted_rad_s = abs(now.target_speed_rad_s)
        if wanted_rad_s < JAM_SPEED_RAD_S or abs(now.speed_rad_s) > JAM_SHARE * wanted_rad_s:
            self._moved_s = now_s
        elif now_s - self._moved_s > JAM_S:
            raise Tripped(
                Trip.JAM,
                f"the shaft has stood for {1e3 * (now_s - self._moved_s):.0f} ms where it should turn at "
                f"{now.target_speed_rad_s:.2f} rad/s, with {self._torque_Nm:.1f} N m from the motor; "
                "look for what holds it, or for a drive too weak for this load",
            )
