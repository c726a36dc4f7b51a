"""Evaluates the CAN bus of [motor]: can it be opened, and do errors occur while listening."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red, yellow

SUBJECT = "CAN bus"
# Fix and commands for the interfaces of python-can whose drivers have to be installed or set up.
REMEDIES = {
    "socketcand": "start socketcand, or rfca-rig twin serve, and say where it is:",
    "slcan": "check the path of the serial port in channel under [motor], and who may open it",
    "pcan": "install PEAK's driver (on Linux its kernel driver does: interface = 'socketcan'), and check channel, such as PCAN_USBBUS1",
    "kvaser": "install Kvaser's canlib, and check channel, which is a number",
    "gs_usb": "install the package, and check channel, which is a number:",
    "ixxat": "install IXXAT's VCI driver, and check channel, which is a number",
    "vector": "install Vector's XL driver, and check channel, which is a number",
}
COMMANDS = {
    "socketcand": """export CAN_CONFIG='{"host": "127.0.0.1", "port": 29536}'""",
    "gs_usb": 'pip install "python-can[gs-usb]"',
}


@dataclass(frozen=True)
class CanBusObservation:
    """Observed bus. `error` is None for a bus that opened. Counts of frames and error frames, and whether it went bus-off.

    `failed` is how the bus failed while it was open, None if it did not.
    """

    error: str | None = None
    frames: int = 0
    error_frames: int = 0
    went_off: bool = False
    failed: str | None = None


def judge_can_bus(seen: CanBusObservation, interface: str, channel: str, known: tuple[str, ...]) -> Finding:
    """Finding on the bus. `known` are the interfaces of python-can."""
    name = f"{interface} {channel}"
    if interface not in known:
        return red(SUBJECT, f"{interface} is no interface of python-can", f"interface under [motor] must be one of {', '.join(known)}")
    if seen.error is not None:
        remedy = REMEDIES.get(interface, "check interface and channel under [motor], and the adapter's driver")
        commands = (COMMANDS[interface],) if interface in COMMANDS else ()
        return red(SUBJECT, f"{name} cannot be opened: {seen.error}", remedy, *commands)
    if seen.went_off or seen.failed is not None:
        problem = "went off after too many errors" if seen.went_off else f"failed: {seen.failed}"
        return red(SUBJECT, f"{name} {problem}", "check wiring, termination and bit rate, then start the interface anew")
    if seen.error_frames:
        fix = "check that the drive has the bit rate of the rig file, the wiring, and a 120 ohm resistor at both ends"
        return yellow(SUBJECT, f"{name} opens, with {seen.error_frames} error frames beside {seen.frames} good ones", fix)
    return green(SUBJECT, f"{name} opens")
