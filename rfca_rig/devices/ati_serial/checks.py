"""An ATI F/T Controller on a serial port: one second of its stream; never sends a bias."""

from collections.abc import Iterator
from dataclasses import dataclass

from rfca_rig.clock import Clock
from rfca_rig.devices.ati_serial.driver import AtiSerialSensor
from rfca_rig.devices.ati_serial.section import AtiSerialSection
from rfca_rig.devices.checks import (
    Colour,
    Finding,
    green,
    judge_serial_port,
    look_at_serial_port,
    red,
    yellow,
)
from rfca_rig.errors import DeviceError

ANSWER = "sensor"
RATE = "sensor's rate"
HEALTH = "sensor's records"
# Relative difference of the rate that the driver accepts too.
TOLERANCE = 0.03

POLL_S = 5e-3
STREAM_S = 1.0


@dataclass(frozen=True)
class ControllerSeen:
    """Observed short stream. `error` is why it failed, None if it did not; `notes` are the
    driver's remarks on the records.
    """

    path: str
    error: str | None = None
    seconds: float = 0.0
    received: int = 0
    rate_Hz: float = 0.0
    notes: tuple[str, ...] = ()


def judge_controller(seen: ControllerSeen, rate_Hz: float) -> list[Finding]:
    if seen.error is not None:
        return [
            red(
                ANSWER,
                seen.error,
                (
                    "check the controller's power, the cable (a null modem?), and bits_per_s "
                    "under [force_sensor]"
                ),
            )
        ]
    if not seen.received:
        fix = "check record and bits_per_s under [force_sensor]"
        return [
            red(
                ANSWER,
                (
                    f"F/T controller on {seen.path} answers, but no record came in "
                    f"{seen.seconds:.1f} s"
                ),
                fix,
            )
        ]
    return [
        green(ANSWER, f"F/T controller on {seen.path} answers"),
        _rate(seen.rate_Hz, rate_Hz),
        _health(seen),
    ]


def _rate(rate_Hz: float, wanted_Hz: float) -> Finding:
    if abs(rate_Hz / wanted_Hz - 1.0) > TOLERANCE:
        fix = (
            f"put rate_Hz = {rate_Hz:.3g} under [force_sensor], or change the controller's "
            "averaging (SA) and sampling (SF)"
        )
        return red(RATE, f"{rate_Hz:.1f} records/s, the rig file says {wanted_Hz:g}", fix)
    return green(RATE, f"{rate_Hz:.1f} records/s")


def _health(seen: ControllerSeen) -> Finding:
    if seen.notes:
        return yellow(
            HEALTH,
            "; ".join(seen.notes),
            "take every load off the sensor, check the transducer's cable, then look again",
        )
    return green(HEALTH, f"{seen.received} in {seen.seconds:.1f} s, all whole")


def look_at_controller(keys: AtiSerialSection, clock: Clock) -> ControllerSeen:
    try:
        port = keys.open()
    except DeviceError as error:
        return ControllerSeen(keys.port, str(error))
    try:
        return _stream(keys.port, AtiSerialSensor(port, clock, keys), clock)
    except DeviceError as error:
        return ControllerSeen(keys.port, str(error))
    finally:
        port.close()


def _stream(path: str, sensor: AtiSerialSensor, clock: Clock) -> ControllerSeen:
    """Streams and measures the rate from the first record on; the driver's own rate check needs
    longer.
    """
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
                last_s = clock.now_s()
                records = records + arrived
    finally:
        sensor.stop()
    health = sensor.health()
    if first_s is not None and last_s is not None:
        rate_Hz = records / (last_s - first_s)
    else:
        rate_Hz = 0.0
    return ControllerSeen(path, None, STREAM_S, health.received, rate_Hz, tuple(health.notes))


def check_sensor(keys: AtiSerialSection, clock: Clock) -> Iterator[Finding]:
    """Yields the findings on the port and the controller behind it. Streams for one second."""
    port = judge_serial_port(look_at_serial_port(keys.port), "[force_sensor]")
    yield port
    if port.colour is not Colour.RED:
        yield from judge_controller(look_at_controller(keys, clock), keys.rate_Hz)
