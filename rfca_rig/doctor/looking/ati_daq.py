"""Lists NI sampling cards, if NI's package is installed, and checks the calibration file."""

from pathlib import Path

from rfca_rig.codecs.ati_calibration import parse_calibration
from rfca_rig.doctor.judging.ati_daq import CardsSeen
from rfca_rig.doctor.looking.can_bus import shorten_error
from rfca_rig.errors import RigError


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
