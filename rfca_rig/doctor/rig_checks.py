"""Everything that a rig file names, one after the other."""

from collections.abc import Iterator
from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.description.motor_sections import MoteusSection
from rfca_rig.description.rig_file import RigFile
from rfca_rig.doctor.camera_checks import check_camera
from rfca_rig.doctor.computer_checks import check_computer
from rfca_rig.doctor.finding import Finding, green
from rfca_rig.doctor.motor_checks import check_motor
from rfca_rig.doctor.sensor_checks import check_sensor

USUAL_WATCHDOG_S = 0.1


def check_rig(rig: RigFile, runs: Path, clock: Clock) -> Iterator[Finding]:
    """Findings as they come. Nothing is sent that could move the shaft; a running stream of the sensor is taken over and ended."""
    if not rig.is_real:
        yield green("devices", f"{rig.motor.device} and {rig.force_sensor.device} are twins in this process: nothing to be looked for")
        yield from check_computer(runs, clock, None)
        return
    yield from check_motor(rig.motor, clock)
    yield from check_sensor(rig.force_sensor, clock)
    yield from check_camera(rig, clock)
    yield from check_computer(runs, clock, _watchdog_s(rig))


def _watchdog_s(rig: RigFile) -> float:
    if isinstance(rig.motor, MoteusSection):
        return rig.motor.watchdog_ms / 1e3
    return rig.motor.guardian_silence_ms / 1e3 if rig.motor.is_guarded else USUAL_WATCHDOG_S
