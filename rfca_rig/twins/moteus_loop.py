"""The controller of a moteus in position mode, seen from the shaft: a PID about a target that moves on with the commanded speed."""

from dataclasses import dataclass, replace
from math import inf, isnan, nan

from rfca_rig.twins.plant import ShaftDrive, ShaftState


@dataclass(frozen=True)
class MoteusGains:
    """servo.pid_position at the shaft, and the torque that servo.max_current_A allows."""

    kp_Nm_per_rad: float = 160.0
    ki_Nm_per_rad_s: float = 0.0
    kd_Nm_s_per_rad: float = 8.0
    torque_limit_Nm: float = 40.0


@dataclass(frozen=True)
class PositionCommand:
    """What a frame that writes the mode leaves in the drive, at the shaft; what it leaves out is by default."""

    angle_rad: float = 0.0
    speed_rad_s: float = 0.0
    feed_forward_Nm: float = 0.0
    kp_scale: float = 1.0
    kd_scale: float = 1.0
    torque_limit_Nm: float = nan
    timeout_s: float = 0.0


class MoteusLoop:
    """Holds the moving target. `law` is the torque until the next step; `passed` moves the target on.

    A target that stands still pulls like a spring for the whole step; one that moves pulls with the force it had at the step's
    beginning. It does not wait for a shaft that is held up (servo.max_position_slip is off, as from the factory).
    """

    def __init__(self, gains: MoteusGains) -> None:
        self._gains = gains
        self._command = PositionCommand()
        self.reset()

    def reset(self) -> None:
        """Forgets the target, as every mode without a position does."""
        self._target_rad = nan
        self._integral_Nm = 0.0
        self._limited = False

    def take(self, command: PositionCommand) -> None:
        """A commanded angle is the target at once; without one the target goes on from where it is."""
        self._command = replace(command, speed_rad_s=0.0 if isnan(command.speed_rad_s) else command.speed_rad_s)
        if not isnan(command.angle_rad):
            self._target_rad = command.angle_rad

    def law(self, shaft: ShaftState) -> ShaftDrive:
        """Within the torque limit as of the beginning of the step; beyond it the whole law is scaled down, as in `SpeedLoop`."""
        if isnan(self._target_rad):
            self._target_rad = shaft.angle_rad
        free = self._unlimited(shaft)
        torque_Nm, limit_Nm = abs(free.torque_Nm(shaft.angle_rad, shaft.speed_rad_s)), self._limit_Nm()
        self._limited = torque_Nm > limit_Nm
        return _scaled(free, limit_Nm / torque_Nm) if self._limited else free

    def _unlimited(self, shaft: ShaftState) -> ShaftDrive:
        command, gains = self._command, self._gains
        kp, feed_Nm = gains.kp_Nm_per_rad * command.kp_scale, command.feed_forward_Nm + self._integral_Nm
        moving = command.speed_rad_s != 0.0
        return ShaftDrive(
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
        """The target moves on; the integrator takes in the mean error of the step, and stands still at the torque limit."""
        moved_rad = self._command.speed_rad_s * elapsed_s
        error_rad = self._target_rad + 0.5 * moved_rad - 0.5 * (before.angle_rad + after.angle_rad)
        if not self._limited:
            self._integral_Nm += self._gains.ki_Nm_per_rad_s * error_rad * elapsed_s
        self._target_rad += moved_rad


def damping(gains: MoteusGains, shaft: ShaftState, limit_Nm: float) -> ShaftDrive:
    """The law of a drive that only brakes: towards speed zero, with at most `limit_Nm`."""
    free = ShaftDrive(speed_gain_Nm_s_per_rad=gains.kd_Nm_s_per_rad)
    torque_Nm = abs(free.torque_Nm(shaft.angle_rad, shaft.speed_rad_s))
    return _scaled(free, limit_Nm / torque_Nm) if torque_Nm > limit_Nm else free


def _scaled(law: ShaftDrive, factor: float) -> ShaftDrive:
    return replace(
        law,
        feed_Nm=factor * law.feed_Nm,
        angle_gain_Nm_per_rad=factor * law.angle_gain_Nm_per_rad,
        speed_gain_Nm_s_per_rad=factor * law.speed_gain_Nm_s_per_rad,
    )
