"""Checks of the motor's side of a rig: interface, bus, drive. They stop at the first red finding."""

from collections.abc import Iterator

import can

from rfca_rig.bench.motors import open_bus
from rfca_rig.clock import Clock
from rfca_rig.codecs.cubemars_drives import mit_ranges
from rfca_rig.codecs.odrive_messages import OdriveFirmware
from rfca_rig.description.motor_sections import (
    CubemarsMitSection,
    CubemarsServoSection,
    MoteusSection,
    Motor,
    MotorSection,
    OdriveSection,
    OwnMotorSection,
)
from rfca_rig.doctor.finding import Colour, Finding
from rfca_rig.doctor.judging.can_bus import CanBusObservation, judge_can_bus
from rfca_rig.doctor.judging.can_interface import judge_can_interface
from rfca_rig.doctor.judging.cubemars_mit import judge_mit
from rfca_rig.doctor.judging.cubemars_servo import judge_servo
from rfca_rig.doctor.judging.moteus import judge_moteus
from rfca_rig.doctor.judging.odrive import OdriveWanted, judge_odrive
from rfca_rig.doctor.judging.serial_port import judge_serial_port
from rfca_rig.doctor.looking.can_bus import Listener, shorten_error
from rfca_rig.doctor.looking.can_interface import look_at_can_interface
from rfca_rig.doctor.looking.cubemars_mit import look_for_mit
from rfca_rig.doctor.looking.cubemars_servo import look_for_servo
from rfca_rig.doctor.looking.moteus import look_for_moteus
from rfca_rig.doctor.looking.odrive import look_for_odrive
from rfca_rig.doctor.looking.serial_port import look_at_serial_port

KNOWN = tuple(sorted(can.VALID_INTERFACES))


def check_motor(motor: Motor, clock: Clock) -> Iterator[Finding]:
    """Yields the findings on interface, bus and drive. Opens the bus of [motor] for about one second."""
    before = _before_the_bus(motor)
    if before is not None:
        yield before
        if before.colour is Colour.RED:
            return
    try:
        bus = open_bus(motor)
    # Interfaces of python-can raise exceptions of many types, even NameError and ImportError if a vendor library is missing.
    except Exception as error:
        yield _bus(motor, CanBusObservation(f"{type(error).__name__}: {shorten_error(error)}"))
        return
    with bus:
        yield from check_drive(motor, Listener(bus, clock))


def _before_the_bus(motor: MotorSection) -> Finding | None:
    """Finding on the kernel interface or serial port below the bus; None if there is none to check."""
    if motor.interface == "socketcan":
        return judge_can_interface(look_at_can_interface(motor.channel), motor.bitrate, motor.fd_bitrate)
    if motor.channel.startswith("/dev/"):
        return judge_serial_port(look_at_serial_port(motor.channel), "[motor]")
    return None


def check_drive(motor: Motor, listener: Listener) -> Iterator[Finding]:
    """Yields the findings on the bus and, unless it is red, on the drive."""
    # The drive is probed first: bus errors may show only once frames have passed.
    findings = _drive(motor, listener)
    bus = _bus(motor, listener.seen())
    yield bus
    if bus.colour is not Colour.RED:
        yield from findings


def _bus(motor: MotorSection, seen: CanBusObservation) -> Finding:
    return judge_can_bus(seen, motor.interface, motor.channel, KNOWN)


def _drive(motor: Motor, listener: Listener) -> list[Finding]:
    match motor:
        case OdriveSection():
            wanted = OdriveWanted(motor.node_id, motor.encoder_period_ms / 1e3, OdriveFirmware(motor.dialect))
            return judge_odrive(look_for_odrive(listener, wanted), wanted)
        case CubemarsMitSection():
            return judge_mit(look_for_mit(listener, motor.drive_id, mit_ranges(motor.model)), motor.drive_id)
        case CubemarsServoSection():
            return judge_servo(look_for_servo(listener, motor.drive_id), motor.drive_id, motor.status_period_ms / 1e3)
        case MoteusSection():
            seen = look_for_moteus(listener, motor.drive_id, motor.can_prefix, motor.bitrate_switch)
            return judge_moteus(seen, motor.drive_id)
        case OwnMotorSection():
            # Checked through its own driver, see `own_checks`.
            return []
