"""Streams from an F/T Controller for one second, through its driver; never sends a bias."""

from rfca_rig.clock import Clock
from rfca_rig.doctor.judging.ati_serial import ControllerSeen
from rfca_rig.drivers.force_sensors.ati_serial import AtiSerialSensor, AtiSerialSettings
from rfca_rig.drivers.ports import open_port
from rfca_rig.errors import DeviceError

POLL_S = 5e-3
STREAM_S = 1.0


def look_at_controller(path: str, settings: AtiSerialSettings, clock: Clock) -> ControllerSeen:
    try:
        port = open_port(path, settings.bits_per_s)
    except DeviceError as error:
        return ControllerSeen(path, str(error))
    try:
        return _stream(path, AtiSerialSensor(port, clock, settings), clock)
    except DeviceError as error:
        return ControllerSeen(path, str(error))
    finally:
        port.close()


def _stream(path: str, sensor: AtiSerialSensor, clock: Clock) -> ControllerSeen:
    """Streams and measures the rate from the first record on; the driver's own rate check needs longer."""
    sensor.start()
    first_s = last_s = None
    records = 0
    until_s = clock.now_s() + STREAM_S
    # Also where reading fails: the controller would go on streaming.
    try:
        while clock.now_s() < until_s:
            clock.wait_until(clock.now_s() + POLL_S)
            arrived = len(sensor.read().sequence)
            if arrived and first_s is None:
                first_s = clock.now_s()
            elif arrived and first_s is not None:
                last_s, records = clock.now_s(), records + arrived
    finally:
        sensor.stop()
    health = sensor.health()
    rate_Hz = records / (last_s - first_s) if first_s is not None and last_s is not None else 0.0
    return ControllerSeen(path, None, STREAM_S, health.received, rate_Hz, tuple(health.notes))
