"""Makes drivers and twins of the motors that a rig file may name: the one place that knows them all."""

import can

from rfca_rig.clock import Clock, WallClock
from rfca_rig.codecs.odrive import OdriveFirmware
from rfca_rig.description.device_sections import (
    CubemarsMitSection,
    CubemarsServoSection,
    MoteusSection,
    MotorKeys,
    MotorSection,
    OdriveSection,
    OwnMotorSection,
)
from rfca_rig.description.own_devices import twin_of
from rfca_rig.description.rig_file import RigFile, TwinDriveSection
from rfca_rig.drivers.can_frames import CanBusSettings
from rfca_rig.drivers.guard import Guard, TorqueOffFrames
from rfca_rig.drivers.motors.cubemars import MitTorqueOffFrames, ServoTorqueOffFrames
from rfca_rig.drivers.motors.cubemars_mit import CubemarsMitMotor, MitSettings
from rfca_rig.drivers.motors.cubemars_servo import CubemarsServoMotor, ServoSettings
from rfca_rig.drivers.motors.moteus import MoteusMotor, MoteusSettings
from rfca_rig.drivers.motors.odrive import OdriveMotor, OdriveSettings
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.errors import BadInput
from rfca_rig.guardian.guarded_bus import GuardedBus
from rfca_rig.subprocesses import can_be_started
from rfca_rig.twins.cubemars_mit import CubemarsMitTwin, MitTwinSettings
from rfca_rig.twins.cubemars_servo import CubemarsServoTwin, ServoTwinSettings
from rfca_rig.twins.drive_parts import LoopGains
from rfca_rig.twins.moteus import MoteusGains, MoteusTwin, MoteusTwinSettings
from rfca_rig.twins.odrive import OdriveTwin, OdriveTwinSettings
from rfca_rig.twins.world import MotorTwin

# Watchdog of the twin of a lab's own motor, whose real one the rig file does not state.
USUAL_WATCHDOG_S = 0.1


def open_bus(motor: MotorSection) -> can.BusABC:
    """The bus that [motor] names; the caller shuts it down. Raises what python-can raises."""
    return motor.open() if isinstance(motor, MotorKeys) else _bus(motor).open()


def _bus(motor: MotorSection) -> CanBusSettings:
    return CanBusSettings(motor.interface, motor.channel, motor.bitrate, motor.fd_bitrate)


def open_commanding_bus(rig: RigFile, clock: WallClock) -> can.BusABC:
    """The bus for a run, held by a guardian where the rig file wants one; the caller shuts it down.

    Raises what python-can raises, and BadInput where this system has no guardian.
    """
    last_word = _last_word(rig)
    # Drives without a torque-off sequence here have a watchdog of their own, which is nearer to the motor.
    if last_word is None or not rig.motor.is_guarded:
        return open_bus(rig.motor)
    # Refused, not ignored: a drive without a watchdog must not run without the guardian that its rig file wants.
    if not can_be_started():
        raise BadInput(f"{rig.rig.title}: motor.guardian: this system has none; use Linux, or see docs/guardian.md on going without")
    return GuardedBus(_bus(rig.motor), last_word, rig.motor.guardian_silence_ms / 1e3, clock)


def _last_word(rig: RigFile) -> TorqueOffFrames | None:
    motor, timeout_s = rig.motor, rig.limits.drive_silent_ms / 1e3
    match motor:
        case CubemarsMitSection():
            return MitTorqueOffFrames(_mit(motor, timeout_s))
        case CubemarsServoSection():
            return ServoTorqueOffFrames(_servo(motor, timeout_s))
        case _:
            return None


def make_motor(rig: RigFile, bus: can.BusABC, clock: Clock) -> ShaftMotor:
    """The driver that [motor] names, on its end of the bus."""
    motor, timeout_s = rig.motor, rig.limits.drive_silent_ms / 1e3
    guard: Guard | None = bus if isinstance(bus, GuardedBus) else None
    match motor:
        case OdriveSection():
            return OdriveMotor(bus, clock, _odrive(motor, timeout_s))
        case CubemarsMitSection():
            return CubemarsMitMotor(bus, clock, _mit(motor, timeout_s), guard)
        case CubemarsServoSection():
            return CubemarsServoMotor(bus, clock, _servo(motor, timeout_s), guard)
        case MoteusSection():
            return MoteusMotor(bus, clock, _moteus(motor, timeout_s))
        case MotorKeys():
            return motor.driver(bus, clock, timeout_s)
        case OwnMotorSection():
            raise BadInput(f"{rig.rig.title}: {motor.file} was not loaded; read the rig file from where it stands")


def make_motor_twin(rig: RigFile, drive: TwinDriveSection, bus: can.BusABC) -> MotorTwin:
    """The twin of the drive that [motor] names, on its end of the bus."""
    motor = rig.motor
    match motor:
        case OdriveSection():
            return OdriveTwin(bus, _odrive_twin(motor, drive))
        case CubemarsMitSection():
            # Its gains come over the wire; of [twin.drive] it only uses the torque limit.
            settings = MitTwinSettings(
                drive_id=motor.drive_id,
                model=motor.model,
                direction=motor.direction,
                zero_rad=motor.zero_rad,
                torque_limit_Nm=drive.torque_limit_Nm,
            )
            return CubemarsMitTwin(bus, settings)
        case CubemarsServoSection():
            return CubemarsServoTwin(bus, _servo_twin(motor, drive))
        case MoteusSection():
            return MoteusTwin(bus, _moteus_twin(motor, drive))
        case OwnMotorSection():
            twin: MotorTwin = twin_of(motor)(bus, motor, _gains(drive), USUAL_WATCHDOG_S)
            return twin


def _odrive(motor: OdriveSection, timeout_s: float) -> OdriveSettings:
    return OdriveSettings(
        node_id=motor.node_id,
        gear_ratio=motor.gear_ratio,
        direction=motor.direction,
        zero_turns=motor.zero_turns,
        encoder_period_s=motor.encoder_period_ms / 1e3,
        heartbeat_timeout_s=timeout_s,
        dialect=OdriveFirmware(motor.dialect),
        torque_constant_Nm_per_A=motor.torque_constant_Nm_per_A,
    )


def _odrive_twin(motor: OdriveSection, drive: TwinDriveSection) -> OdriveTwinSettings:
    return OdriveTwinSettings(
        node_id=motor.node_id,
        gear_ratio=motor.gear_ratio,
        direction=motor.direction,
        zero_turns=motor.zero_turns,
        gains=_gains(drive),
        encoder_period_s=motor.encoder_period_ms / 1e3,
        dialect=OdriveFirmware(motor.dialect),
        torque_constant_Nm_per_A=motor.torque_constant_Nm_per_A or 1.0,
    )


def _mit(motor: CubemarsMitSection, timeout_s: float) -> MitSettings:
    return MitSettings(
        drive_id=motor.drive_id,
        model=motor.model,
        direction=motor.direction,
        zero_rad=motor.zero_rad,
        speed_gain_Nm_s_per_rad=motor.speed_gain_Nm_s_per_rad,
        angle_gain_per_s=motor.angle_gain_per_s,
        reply_timeout_s=timeout_s,
    )


def _servo(motor: CubemarsServoSection, timeout_s: float) -> ServoSettings:
    return ServoSettings(
        drive_id=motor.drive_id,
        gear_ratio=motor.gear_ratio,
        pole_pairs=motor.pole_pairs,
        torque_constant_Nm_per_A=motor.torque_constant_Nm_per_A,
        direction=motor.direction,
        zero_deg=motor.zero_deg,
        status_period_s=motor.status_period_ms / 1e3,
        status_timeout_s=timeout_s,
    )


def _servo_twin(motor: CubemarsServoSection, drive: TwinDriveSection) -> ServoTwinSettings:
    return ServoTwinSettings(
        drive_id=motor.drive_id,
        gear_ratio=motor.gear_ratio,
        pole_pairs=motor.pole_pairs,
        torque_constant_Nm_per_A=motor.torque_constant_Nm_per_A,
        direction=motor.direction,
        zero_deg=motor.zero_deg,
        gains=_gains(drive),
        status_period_s=motor.status_period_ms / 1e3,
    )


def _moteus(motor: MoteusSection, timeout_s: float) -> MoteusSettings:
    return MoteusSettings(
        drive_id=motor.drive_id,
        can_prefix=motor.can_prefix,
        gear_ratio=motor.gear_ratio,
        direction=motor.direction,
        zero_turns=motor.zero_turns,
        watchdog_s=motor.watchdog_ms / 1e3,
        torque_limit_Nm=motor.torque_limit_Nm,
        reply_timeout_s=timeout_s,
        bitrate_switch=motor.bitrate_switch,
    )


def _moteus_twin(motor: MoteusSection, drive: TwinDriveSection) -> MoteusTwinSettings:
    """A moteus has one PID loop on its target. These gains act on an angle as the cascade of [twin.drive] does."""
    # Cascade: torque = (kv + ki / s) (ka e - w) with kv the speed gain, ki its integral gain, ka the angle gain. For a target at rest, its
    # terms in e, in the integral of e and in w are kp, ki and kd.
    gains = MoteusGains(
        kp_Nm_per_rad=drive.speed_gain_Nm_s_per_rad * drive.angle_gain_per_s + drive.integral_gain_Nm_per_rad,
        ki_Nm_per_rad_s=drive.integral_gain_Nm_per_rad * drive.angle_gain_per_s,
        kd_Nm_s_per_rad=drive.speed_gain_Nm_s_per_rad,
        torque_limit_Nm=drive.torque_limit_Nm,
    )
    return MoteusTwinSettings(
        drive_id=motor.drive_id,
        can_prefix=motor.can_prefix,
        gear_ratio=motor.gear_ratio,
        direction=motor.direction,
        zero_turns=motor.zero_turns,
        gains=gains,
    )


def _gains(drive: TwinDriveSection) -> LoopGains:
    return LoopGains(
        speed_gain_Nm_s_per_rad=drive.speed_gain_Nm_s_per_rad,
        integral_gain_Nm_per_rad=drive.integral_gain_Nm_per_rad,
        angle_gain_per_s=drive.angle_gain_per_s,
        torque_limit_Nm=drive.torque_limit_Nm,
    )
