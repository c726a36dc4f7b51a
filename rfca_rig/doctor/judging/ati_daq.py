"""Evaluates an ATI DAQ F/T: NI's package and driver, the sampling card, the calibration file."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red

CARD, CALIBRATION = "sampling card", "calibration file"


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
