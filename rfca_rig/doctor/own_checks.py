"""Checks of plug-in devices, through their own drivers: are they present, and can their messages be decoded."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import can
import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.description.force_sensor_sections import ForceSensorKeys
from rfca_rig.description.motor_sections import MotorKeys
from rfca_rig.doctor.devices.can import shorten_error
from rfca_rig.doctor.finding import Finding, green, red, yellow
from rfca_rig.drivers.ports import SerialPort
from rfca_rig.drivers.roles import ForceSensor, ShaftMotor
from rfca_rig.errors import RigError

# Observation time and poll interval, and the silence that the driver treats as a fault, in s.
LISTEN_S = 1.5
POLL_S = 5e-3
SILENT_S = 0.5
DRIVE, SENSOR = "drive", "force sensor"
NEXT = "try the driver without the device first:"


Way = TypeVar("Way", can.BusABC, SerialPort)


def check_own_motor(keys: MotorKeys, clock: Clock) -> Iterator[Finding]:
    """Yields the findings on a plug-in motor. Only listens, or requests reports if the drive sends none by itself."""
    yield green("driver", f"{Path(keys.file).name} is loaded, its keys in [motor] are right")
    bus = _open(keys.open, f"CAN bus {keys.interface} {keys.channel}", "[motor]")
    if isinstance(bus, Finding):
        yield bus
        return
    with bus:
        yield judge_own_motor(keys.driver(bus, clock, SILENT_S), clock)


def judge_own_motor(motor: ShaftMotor, clock: Clock) -> Finding:
    """Finding from 1.5 s of data, as decoded by the driver."""
    began_s, reports, last_rad = clock.now_s(), 0, 0.0
    try:
        for _ in _poll(clock):
            shaft = motor.read()
            reports += len(shaft.angle_rad)
            # Most reads return nothing; the last known angle is kept.
            last_rad = float(shaft.angle_rad[-1]) if len(shaft.angle_rad) else last_rad
    except RigError as error:
        return red(DRIVE, str(error), NEXT, "rfca-rig contract YOUR-RIG.toml")
    status = motor.status()
    # Silence is not an error: some drives report only when they are energised.
    if not reports:
        fix = "check its power and the wiring; a drive that reports only on request is asked when the motor is enabled"
        return yellow(DRIVE, f"no report of the shaft within {LISTEN_S:g} s", fix)
    summary = f"{reports / (clock.now_s() - began_s):.0f} reports/s, shaft at {np.degrees(last_rad):.1f} deg, {status.state}"
    if status.fault is not None:
        return red(DRIVE, f"{summary}: {status.fault}", "see the drive's manual for this error")
    return green(DRIVE, summary)


def check_own_sensor(keys: ForceSensorKeys, clock: Clock) -> Iterator[Finding]:
    """Yields the findings on a plug-in force sensor. Streams for 1.5 s, then ends the stream."""
    yield green("driver", f"{Path(keys.file).name} is loaded, its keys in [force_sensor] are right")
    port = _open(keys.open, keys.port, "[force_sensor]")
    if isinstance(port, Finding):
        yield port
        return
    try:
        yield judge_own_sensor(keys.driver(port, clock), clock)
    finally:
        port.close()


def judge_own_sensor(sensor: ForceSensor, clock: Clock) -> Finding:
    """Finding from 1.5 s of data, as decoded by the driver."""
    try:
        sensor.start()
        began_s = clock.now_s()
        # Also where reading fails: the sensor would go on streaming.
        try:
            for _ in _poll(clock):
                sensor.read()
        finally:
            sensor.stop()
    except RigError as error:
        return red(SENSOR, str(error), NEXT, "rfca-rig contract YOUR-RIG.toml")
    health = sensor.health()
    rate_Hz = health.received / (clock.now_s() - began_s)
    summary = f"{rate_Hz:.0f} records/s, {health.lost} lost, {health.malformed} pieces of the stream no records"
    if not health.received:
        return red(SENSOR, f"no record within {LISTEN_S:g} s", "check its power, the cable, and port and bits_per_s under [force_sensor]")
    if health.notes:
        return yellow(SENSOR, f"{summary}: {health.notes[0]}", "look at the sensor and its cable before a run")
    return green(SENSOR, summary)


def _open(opener: Callable[[], Way], name: str, table: str) -> Way | Finding:
    try:
        return opener()
    # The plug-in's `open` and the interfaces of python-can raise exceptions of many types.
    except Exception as error:
        return red("wire", f"{name} cannot be opened: {type(error).__name__}: {shorten_error(error)}", f"check {table} in the rig file")


def _poll(clock: Clock) -> Iterator[None]:
    until_s = clock.now_s() + LISTEN_S
    while clock.now_s() < until_s:
        clock.wait_until(clock.now_s() + POLL_S)
        yield
