"""An ATI DAQ F/T: the sampling card, and the calibration file of the transducer; nothing is
sampled.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.devices.ati_daq.codec import parse_calibration
from rfca_rig.devices.ati_daq.section import AtiDaqSection
from rfca_rig.devices.checks import Finding, green, red, shorten_error
from rfca_rig.errors import RigError

CARD = "sampling card"
CALIBRATION = "calibration file"


@dataclass(frozen=True)
class CardsSeen:
    """Observed cards: `devices` are their names, `error` is the message of NI's driver if it
    does not work.
    """

    is_installed: bool
    error: str | None = None
    devices: tuple[str, ...] = ()


def judge_card(seen: CardsSeen, channels: str) -> Finding:
    """Finding on the card of `channels`, in NI's notation, for example Dev1/ai0:5."""
    name = channels.lstrip("/").partition("/")[0]
    if not seen.is_installed:
        return red(
            CARD,
            "NI's package is not installed",
            "install it, and the NI-DAQmx driver from ni.com:",
            'pip install "rfca-rig[daq]"',
        )
    if seen.error is not None:
        return red(
            CARD,
            f"NI's driver does not work: {seen.error}",
            "install the NI-DAQmx driver from ni.com, and restart",
        )
    if name not in seen.devices:
        if seen.devices:
            existing = f"; there is {', '.join(seen.devices)}"
            fix = f'put channels = "{seen.devices[0]}/ai0:5" under [force_sensor]'
            return red(CARD, f"there is no {name}{existing}", fix)
        fix = "plug the card in; NI's tool lists cards:"
        return red(CARD, f"there is no {name}; there is no card at all", fix, "nilsdev")
    return green(CARD, f"{name} is there")


def judge_calibration(path: str, error: str | None) -> Finding:
    """Finding on the calibration file. `error` is why it cannot be used, None if it can."""
    if error is None:
        return green(CALIBRATION, path)
    return red(
        CALIBRATION,
        error,
        "copy the transducer's .cal file beside the rig file, and name it in calibration_file",
    )


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


def check_sensor(keys: AtiDaqSection, clock: Clock) -> Iterator[Finding]:  # noqa: ARG001 (nothing here takes time)
    """Yields the findings on calibration file and card."""
    yield judge_calibration(keys.calibration_file, look_at_calibration(keys.calibration_file))
    yield judge_card(look_for_cards(), keys.channels)
