"""Twin of a CubeMars / T-Motor AK drive in servo mode, on the CAN bus."""

from dataclasses import dataclass, field, replace
from math import degrees, floor, radians, remainder, tau

import can

from rfca_rig.codecs import cubemars_servo
from rfca_rig.codecs.cubemars_servo import Message, OriginMode, Status
from rfca_rig.codecs.odrive import ControlMode
from rfca_rig.errors import MalformedFrame
from rfca_rig.twins.drive_parts import Encoder, LoopGains, MotorSetPoint, MotorThermalModel, SpeedLoop, ThermalParameters
from rfca_rig.twins.wires import SampleGrid
from rfca_rig.twins.world import ShaftDrive, ShaftState, interpolate_motion

# Largest temperature of the signed byte in the status frame.
MAX_TEMPERATURE_degC = 127
# End of the position range of the status frame according to the manual.
MAX_COUNT = 32_000


@dataclass(frozen=True)
class ServoTwinSettings:
    """Configuration of the drive, and variant of its firmware.

    With `watchdog_s` None the drive keeps its last command for ever, otherwise it is disabled after that silence. `wraps`: the
    position of the status frame wraps at 16 bits, else it stops at +-3200 degrees. `ordered_error` is the error that every motion
    command ends in; 0 for a healthy drive.
    """

    drive_id: int = 1
    gear_ratio: float = 9.0
    pole_pairs: int = 21
    torque_constant_Nm_per_A: float = 0.115
    direction: int = 1
    zero_deg: float = 0.0
    gains: LoopGains = field(default_factory=LoopGains)
    status_period_s: float = 2e-3
    watchdog_s: float | None = None
    wraps: bool = True
    ordered_error: int = 0
    warming: ThermalParameters = field(default_factory=lambda: ThermalParameters(air_degC=31.0))


class CubemarsServoTwin:
    """A `MotorTwin` that sends its status cyclically.

    Commands take effect at once and stay in force. A position is absolute, however many turns the shaft has made before.
    """

    def __init__(self, bus: can.BusABC, settings: ServoTwinSettings) -> None:
        self._bus = bus
        self._settings = settings
        self._loop = SpeedLoop(settings.gains)
        self._wanted = MotorSetPoint(ControlMode.TORQUE)
        # Target of a position command with a speed limit; the set-point moves there.
        self._goal_rad: float | None = None
        self._pace_rad_s = 0.0
        self._starts_pacing = False
        self._looping = False
        self._zero_deg = settings.zero_deg
        self._origin_wanted = False
        self._error = 0
        self._fed_s = 0.0
        self._status_ticks = SampleGrid(settings.status_period_s)
        self._restarts = False
        self.encoder = Encoder()
        self.warmth = MotorThermalModel(settings.warming)

    def take_frames(self, now_s: float) -> None:
        """Executes received frames; invalid ones are ignored."""
        while (message := self._bus.recv(timeout=0)) is not None:
            mine = message.is_extended_id and cubemars_servo.drive_of(message.arbitration_id) == self._settings.drive_id
            if mine and not message.is_error_frame and not message.is_remote_frame:
                self._fed_s = now_s
                self._take(message)
        limit_s = self._settings.watchdog_s
        if limit_s is not None and now_s - self._fed_s > limit_s:
            self._push(0.0)

    def _take(self, message: can.Message) -> None:
        try:
            self._obey(cubemars_servo.decode(message.arbitration_id, message.data))
        except MalformedFrame:
            # The firmware does not report invalid frames either.
            return

    def _obey(self, order: Message | None) -> None:
        match order:
            case cubemars_servo.SetCurrent():
                self._push(order.current_A)
            case cubemars_servo.SetOrigin():
                self._origin_wanted = order.origin != OriginMode.FACTORY
            case cubemars_servo.SetSpeed():
                self._turn(ControlMode.VELOCITY, speed_rad_s=order.speed_erpm / self._erpm_s_per_rad)
            case cubemars_servo.SetPosition():
                self._turn(ControlMode.POSITION, angle_rad=self._angle_rad(order.position_deg))
            case cubemars_servo.SetPositionSpeed():
                self._pace_rad_s = abs(order.speed_erpm / self._erpm_s_per_rad)
                goal_rad = self._angle_rad(order.position_deg)
                self._turn(ControlMode.POSITION, angle_rad=self._wanted.angle_rad, goal_rad=goal_rad)

    def _push(self, current_A: float) -> None:
        """Current control. Zero disables the motor and clears an error."""
        self._wanted = MotorSetPoint(ControlMode.TORQUE, torque_Nm=current_A * self._torque_per_A)
        self._goal_rad, self._looping = None, False
        if current_A == 0.0:
            self._error = 0

    def _turn(self, mode: int, angle_rad: float = 0.0, speed_rad_s: float = 0.0, goal_rad: float | None = None) -> None:
        if self._settings.ordered_error:
            self._error = self._settings.ordered_error
        if self._error:
            return
        self._starts_pacing |= goal_rad is not None and self._goal_rad is None
        self._wanted = MotorSetPoint(mode, angle_rad, speed_rad_s)
        self._goal_rad = goal_rad
        if not self._looping:
            self._loop.reset()
        self._looping = True

    def fail(self, error: int) -> None:
        """Puts the drive into an error: it is disabled, and ignores motion commands until a zero current clears it."""
        self._push(0.0)
        self._error = error

    def restart(self) -> None:
        """Power cycle: the drive is disabled and has lost its rotor turn count."""
        self._push(0.0)
        self._restarts = True

    def leap(self, by_rad: float) -> None:
        """Encoder slip: from now on the reported position is shifted by `by_rad`."""
        self._zero_deg += degrees(by_rad)

    def refuse_with(self, error: int) -> None:
        """From now on every motion command ends in this error."""
        self._settings = replace(self._settings, ordered_error=error)

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        """Torque law on the shaft until the next step."""
        if self._restarts:
            self._restarts, reported_deg = False, self._zero_deg + self._settings.direction * degrees(shaft.angle_rad)
            # A single-turn encoder knows its position within a rotor turn only: whole turns are lost.
            self._zero_deg += remainder(reported_deg, 360.0 / self._settings.gear_ratio) - reported_deg
        if self._origin_wanted:
            self._origin_wanted, self._zero_deg = False, -self._settings.direction * degrees(shaft.angle_rad)
        if self._goal_rad is not None and self._starts_pacing:
            # The moving set-point starts where the shaft is, not at an old set-point.
            self._wanted.angle_rad = shaft.angle_rad
        self._starts_pacing = False
        return self._loop.law(self._wanted, shaft)

    def advance(self, elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState, law: ShaftDrive) -> None:
        """Takes in a step of the plant under `law` that ended at `now_s`, and sends the reports that became due in it."""
        self._loop.advance(self._wanted, elapsed_s, before, after)
        self.warmth.advance(elapsed_s, after.torque_Nm)
        if self._goal_rad is not None:
            way_rad, most_rad = self._goal_rad - self._wanted.angle_rad, self._pace_rad_s * elapsed_s
            self._wanted.angle_rad += min(max(way_rad, -most_rad), most_rad)
        due_s = self._status_ticks.until(now_s).tolist()
        for angle_rad, speed_rad_s in interpolate_motion(due_s, elapsed_s, now_s, before, after):
            self._report(angle_rad, speed_rad_s, law.torque_Nm(angle_rad, speed_rad_s))

    def _report(self, angle_rad: float, speed_rad_s: float, torque_Nm: float) -> None:
        reported_deg, speed_rad_s = self.encoder.report(self._zero_deg + self._settings.direction * degrees(angle_rad), speed_rad_s)
        count = floor(reported_deg / cubemars_servo.STATUS_DEG)
        clipped = min(max(count, -MAX_COUNT), MAX_COUNT)
        wrapped = (count + cubemars_servo.STATUS_COUNTS // 2) % cubemars_servo.STATUS_COUNTS - cubemars_servo.STATUS_COUNTS // 2
        status = Status(
            position_count=wrapped if self._settings.wraps else clipped,
            speed_erpm=speed_rad_s * self._erpm_s_per_rad,
            current_A=torque_Nm / self._torque_per_A,
            temperature_degC=min(round(self.warmth.reported_degC), MAX_TEMPERATURE_degC),
            error=self._error,
        )
        frame = cubemars_servo.status(self._settings.drive_id, status)
        self._bus.send(can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=True))

    def _angle_rad(self, position_deg: float) -> float:
        return self._settings.direction * radians(position_deg - self._zero_deg)

    @property
    def _erpm_s_per_rad(self) -> float:
        return self._settings.direction * self._settings.gear_ratio * self._settings.pole_pairs * 60.0 / tau

    @property
    def _torque_per_A(self) -> float:
        return self._settings.direction * self._settings.gear_ratio * self._settings.torque_constant_Nm_per_A
