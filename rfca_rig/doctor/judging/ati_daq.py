"""An ATI DAQ F/T: NI's package and driver, the card that the channels name, the transducer's calibration file."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red

CARD, CALIBRATION = "sampling card", "calibration file"


@dataclass(frozen=True)
class CardsSeen:
    """`devices` are the cards' names; `error` is what NI's driver says where it is not there."""

    is_installed: bool
    error: str | None = None
    devices: tuple[str, ...] = ()


def judge_card(seen: CardsSeen, channels: str) -> Finding:
    """`channels` as NI names them, such as Dev1/ai0:5."""
    name = channels.lstrip("/").partition("/")[0]
    if not seen.is_installed:
        return red(CARD, "NI's package is not installed", "install it, and the NI-DAQmx driver from ni.com:", 'pip install "rfca-rig[daq]"')
    if seen.error is not None:
        return red(CARD, f"NI's driver does not work: {seen.error}", "install the NI-DAQmx driver from ni.com, and restart")
    if name not in seen.devices:
        there = f"; there is {', '.join(seen.devices)}" if seen.devices else "; there is no card at all"
        fix = (
            f'put channels = "{seen.devices[0]}/ai0:5" under [force_sensor]' if seen.devices else "plug the card in; NI's tool lists cards:"
        )
        return red(CARD, f"there is no {name}{there}", fix, *(() if seen.devices else ("nilsdev",)))
    return green(CARD, f"{name} is there")


def judge_calibration(path: str, error: str | None) -> Finding:
    """`error` is why the file cannot be used, None where it can."""
    if error is None:
        return green(CALIBRATION, path)
    return red(CALIBRATION, error, "copy the transducer's .cal file beside the rig file, and name it in calibration_file")
