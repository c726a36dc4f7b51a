"""Everything that a rig file names, one after the other."""

from collections.abc import Iterator
from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.description.force_sensor_sections import ForceSensor, ForceSensorKeys
from rfca_rig.description.motor_sections import MoteusSection, Motor, MotorKeys
from rfca_rig.description.rig_file import RigFile
from rfca_rig.doctor.camera_checks import check_camera
from rfca_rig.doctor.computer_checks import check_computer
from rfca_rig.doctor.finding import Colour, Finding, green
from rfca_rig.doctor.motor_checks import check_motor
from rfca_rig.doctor.own_checks import check_own_motor, check_own_sensor
from rfca_rig.doctor.sensor_checks import check_sensor
from rfca_rig.doctor.shaft_checks import check_shaft

USUAL_WATCHDOG_S = 0.1


def check_rig(rig: RigFile, runs: Path, clock: Clock) -> Iterator[Finding]:
    """Findings as they come. Nothing is sent that could move the shaft; a running stream of the sensor is taken over and ended."""
    if not rig.is_real:
        yield green("devices", f"{_name(rig.motor)} and {_name(rig.force_sensor)} are twins in this process: nothing to be looked for")
        yield from check_computer(runs, clock, None)
        return
    motor, sensor = rig.motor, rig.force_sensor
    is_red = False
    for finding in check_own_motor(motor, clock) if isinstance(motor, MotorKeys) else check_motor(motor, clock):
        is_red |= finding.colour is Colour.RED
        yield finding
    yield from () if is_red else check_shaft(rig, clock)
    yield from check_own_sensor(sensor, clock) if isinstance(sensor, ForceSensorKeys) else check_sensor(sensor, clock)
    yield from check_camera(rig, clock)
    yield from check_computer(runs, clock, _watchdog_s(rig))


def _name(section: Motor | ForceSensor) -> str:
    return Path(section.file).name if isinstance(section, MotorKeys | ForceSensorKeys) else section.device


def _watchdog_s(rig: RigFile) -> float:
    if isinstance(rig.motor, MoteusSection):
        return rig.motor.watchdog_ms / 1e3
    return rig.motor.guardian_silence_ms / 1e3 if rig.motor.is_guarded else USUAL_WATCHDOG_S
