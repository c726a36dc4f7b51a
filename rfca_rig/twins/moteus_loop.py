"""Controller of a moteus in position mode, at the shaft: a PID about a target that moves at the commanded speed."""

from dataclasses import dataclass, replace
from math import inf, isnan, nan

from rfca_rig.twins.plant import ShaftDrive, ShaftState


@dataclass(frozen=True)
class MoteusGains:
    """Gains of servo.pid_position, converted to the shaft, and the torque that servo.max_current_A allows."""

    kp_Nm_per_rad: float = 160.0
    ki_Nm_per_rad_s: float = 0.0
    kd_Nm_s_per_rad: float = 8.0
    torque_limit_Nm: float = 40.0


@dataclass(frozen=True)
class PositionCommand:
    """Command registers after a frame that writes the mode, converted to the shaft. Fields not written have these defaults."""

    angle_rad: float = 0.0
    speed_rad_s: float = 0.0
    feed_forward_Nm: float = 0.0
    kp_scale: float = 1.0
    kd_scale: float = 1.0
    torque_limit_Nm: float = nan
    timeout_s: float = 0.0


class MoteusLoop:
    """Control loop with a moving target. `law` is the torque until the next step; `passed` advances the target.

    A target at rest acts like a spring during the whole step; a moving one with its force at the beginning of the step. The target
    does not wait for a blocked shaft (servo.max_position_slip is off, the factory setting).
    """

    def __init__(self, gains: MoteusGains) -> None:
        self._gains = gains
        self._command = PositionCommand()
        self.reset()

    def reset(self) -> None:
        """Clears target and integrator, as every mode without a position does."""
        self._target_rad = nan
        self._integral_Nm = 0.0
        self._limited = False

    def take(self, command: PositionCommand) -> None:
        """Takes a command. A commanded angle becomes the target at once; without one the target continues from its present value."""
        self._command = replace(command, speed_rad_s=0.0 if isnan(command.speed_rad_s) else command.speed_rad_s)
        if not isnan(command.angle_rad):
            self._target_rad = command.angle_rad

    def law(self, shaft: ShaftState) -> ShaftDrive:
        """Torque law, limited at the beginning of the step. Beyond the limit the whole law is scaled down, as in `SpeedLoop`."""
        # Without a target, after a reset, the loop starts from the measured angle.
        if isnan(self._target_rad):
            self._target_rad = shaft.angle_rad
        free = self._unlimited_law(shaft)
        torque_Nm, limit_Nm = abs(free.torque_Nm(shaft.angle_rad, shaft.speed_rad_s)), self._limit_Nm()
        self._limited = torque_Nm > limit_Nm
        return _scale(free, limit_Nm / torque_Nm) if self._limited else free

    def _unlimited_law(self, shaft: ShaftState) -> ShaftDrive:
        command, gains = self._command, self._gains
        kp, feed_Nm = gains.kp_Nm_per_rad * command.kp_scale, command.feed_forward_Nm + self._integral_Nm
        moving = command.speed_rad_s != 0.0
        return ShaftDrive(
            # A spring to a fixed angle would lag behind a moving target, so its force is held for the step.
            feed_Nm=feed_Nm + kp * (self._target_rad - shaft.angle_rad) if moving else feed_Nm,
            angle_gain_Nm_per_rad=0.0 if moving else kp,
            angle_rad=self._target_rad,
            speed_gain_Nm_s_per_rad=gains.kd_Nm_s_per_rad * command.kd_scale,
            speed_rad_s=command.speed_rad_s,
        )

    def _limit_Nm(self) -> float:
        commanded_Nm = inf if isnan(self._command.torque_limit_Nm) else self._command.torque_limit_Nm
        return min(commanded_Nm, self._gains.torque_limit_Nm)

    def passed(self, elapsed_s: float, before: ShaftState, after: ShaftState) -> None:
        """Advances the target, and the integrator by the mean error of the step; at the torque limit it is held (anti-windup)."""
        moved_rad = self._command.speed_rad_s * elapsed_s
        # Mean error of the step: target and shaft at their middle (trapezoidal rule).
        error_rad = self._target_rad + 0.5 * moved_rad - 0.5 * (before.angle_rad + after.angle_rad)
        if not self._limited:
            self._integral_Nm += self._gains.ki_Nm_per_rad_s * error_rad * elapsed_s
        self._target_rad += moved_rad


def damping(gains: MoteusGains, shaft: ShaftState, limit_Nm: float) -> ShaftDrive:
    """Torque law of a drive that brakes towards speed zero, with at most `limit_Nm`."""
    free = ShaftDrive(speed_gain_Nm_s_per_rad=gains.kd_Nm_s_per_rad)
    torque_Nm = abs(free.torque_Nm(shaft.angle_rad, shaft.speed_rad_s))
    return _scale(free, limit_Nm / torque_Nm) if torque_Nm > limit_Nm else free


def _scale(law: ShaftDrive, factor: float) -> ShaftDrive:
    return replace(
        law,
        feed_Nm=factor * law.feed_Nm,
        angle_gain_Nm_per_rad=factor * law.angle_gain_Nm_per_rad,
        speed_gain_Nm_s_per_rad=factor * law.speed_gain_Nm_s_per_rad,
    )
