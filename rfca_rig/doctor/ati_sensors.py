"""ATI sensors without a network box: DAQ F/T on a sampling card, and an F/T Controller on a serial port; never sends a bias."""

from dataclasses import dataclass
from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.codecs.ati_calibration import parse_calibration
from rfca_rig.devices.checks import Finding, green, red, shorten_error, yellow
from rfca_rig.drivers.force_sensors.ati_serial import AtiSerialSensor, AtiSerialSettings
from rfca_rig.drivers.ports import open_port
from rfca_rig.errors import DeviceError, RigError

CARD, CALIBRATION = "sampling card", "calibration file"

ANSWER, RATE, HEALTH = "sensor", "sensor's rate", "sensor's records"
# Relative difference of the rate that the driver accepts too.
TOLERANCE = 0.03

POLL_S = 5e-3
STREAM_S = 1.0


@dataclass(frozen=True)
class CardsSeen:
    """Observed cards: `devices` are their names, `error` is the message of NI's driver if it does not work."""

    is_installed: bool
    error: str | None = None
    devices: tuple[str, ...] = ()


def judge_card(seen: CardsSeen, channels: str) -> Finding:
    """Finding on the card of `channels`, in NI's notation, for example Dev1/ai0:5."""
    name = channels.lstrip("/").partition("/")[0]
    if not seen.is_installed:
        return red(CARD, "NI's package is not installed", "install it, and the NI-DAQmx driver from ni.com:", 'pip install "rfca-rig[daq]"')
    if seen.error is not None:
        return red(CARD, f"NI's driver does not work: {seen.error}", "install the NI-DAQmx driver from ni.com, and restart")
    if name not in seen.devices:
        existing = f"; there is {', '.join(seen.devices)}" if seen.devices else "; there is no card at all"
        fix = (
            f'put channels = "{seen.devices[0]}/ai0:5" under [force_sensor]' if seen.devices else "plug the card in; NI's tool lists cards:"
        )
        return red(CARD, f"there is no {name}{existing}", fix, *(() if seen.devices else ("nilsdev",)))
    return green(CARD, f"{name} is there")


def judge_calibration(path: str, error: str | None) -> Finding:
    """Finding on the calibration file. `error` is why it cannot be used, None if it can."""
    if error is None:
        return green(CALIBRATION, path)
    return red(CALIBRATION, error, "copy the transducer's .cal file beside the rig file, and name it in calibration_file")


def look_for_cards() -> CardsSeen:
    try:
        import nidaqmx.errors  # noqa: PLC0415 (an extra, with a driver that few machines have)
        import nidaqmx.system  # noqa: PLC0415
    except ImportError:
        return CardsSeen(False)
    try:
        return CardsSeen(True, None, tuple(nidaqmx.system.System.local().devices.device_names))
    except nidaqmx.errors.Error as error:
        return CardsSeen(True, shorten_error(error))


def look_at_calibration(path: str) -> str | None:
    """Why the file cannot be used; None if it can."""
    try:
        parse_calibration(Path(path).read_bytes(), path)
    except OSError as error:
        return f"{path} cannot be read: {error.strerror}"
    except RigError as error:
        return str(error)
    return None


@dataclass(frozen=True)
class ControllerSeen:
    """Observed short stream. `error` is why it failed, None if it did not; `notes` are the driver's remarks on the records."""

    path: str
    error: str | None = None
    seconds: float = 0.0
    received: int = 0
    rate_Hz: float = 0.0
    notes: tuple[str, ...] = ()


def judge_controller(seen: ControllerSeen, rate_Hz: float) -> list[Finding]:
    if seen.error is not None:
        return [red(ANSWER, seen.error, "check the controller's power, the cable (a null modem?), and bits_per_s under [force_sensor]")]
    if not seen.received:
        fix = "check record and bits_per_s under [force_sensor]"
        return [red(ANSWER, f"F/T controller on {seen.path} answers, but no record came in {seen.seconds:.1f} s", fix)]
    return [green(ANSWER, f"F/T controller on {seen.path} answers"), _rate(seen.rate_Hz, rate_Hz), _health(seen)]


def _rate(rate_Hz: float, wanted_Hz: float) -> Finding:
    if abs(rate_Hz / wanted_Hz - 1.0) > TOLERANCE:
        fix = f"put rate_Hz = {rate_Hz:.3g} under [force_sensor], or change the controller's averaging (SA) and sampling (SF)"
        return red(RATE, f"{rate_Hz:.1f} records/s, the rig file says {wanted_Hz:g}", fix)
    return green(RATE, f"{rate_Hz:.1f} records/s")


def _health(seen: ControllerSeen) -> Finding:
    if seen.notes:
        return yellow(HEALTH, "; ".join(seen.notes), "take every load off the sensor, check the transducer's cable, then look again")
    return green(HEALTH, f"{seen.received} in {seen.seconds:.1f} s, all whole")


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
