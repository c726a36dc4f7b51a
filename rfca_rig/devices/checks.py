"""What the doctor's checks of all devices use: the result of a check, a listener on a CAN bus,
serial ports, the receive buffer.

A result is a colour, the observation, and the fix.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import can

from rfca_rig.clock import Clock
from rfca_rig.drivers.ports import open_udp

# Interval between two reads of the bus, and time for which it is listened to, in s.
POLL_S = 1e-3
LISTEN_S = 1.0
# Error class of a SocketCAN error frame (linux/can/error.h).
CAN_ERROR_BUS_OFF = 0x40

PORT_SUBJECT = "serial port"
RECEIVE_BUFFER_SUBJECT = "receive buffer"
# What Linux charges for a datagram of one record: 256 of them fill the default of 212992 bytes.
KERNEL_BYTES_PER_DATAGRAM = 832


class Colour(StrEnum):
    """Green: in order. Yellow: works, but will cause trouble. Red: does not work."""

    GREEN = "green"
    YELLOW = "yellow"
    RED = "red"


@dataclass(frozen=True)
class Finding:
    """Result of one check: `subject` in a few words, `fix` is what to do, `commands` are lines
    to be typed unchanged.
    """

    subject: str
    colour: Colour
    seen: str
    fix: str = ""
    commands: tuple[str, ...] = ()


@dataclass(frozen=True)
class FoundSensor:
    """Result of a search for a force sensor without a rig file; `name` is empty where there is
    none.

    `address` is what the rig file says of it, `counts` are counts per N and per N m where the
    sensor states them.
    """

    findings: tuple[Finding, ...]
    name: str = ""
    address: str = ""
    counts: tuple[float, float] | None = None


def green(subject: str, seen: str) -> Finding:
    return Finding(subject, Colour.GREEN, seen)


def yellow(subject: str, seen: str, fix: str, *commands: str) -> Finding:
    return Finding(subject, Colour.YELLOW, seen, fix, commands)


def red(subject: str, seen: str, fix: str, *commands: str) -> Finding:
    return Finding(subject, Colour.RED, seen, fix, commands)


def join_ids(numbers: tuple[int, ...]) -> str:
    """Ids as a comma-separated text."""
    return ", ".join(map(str, numbers))


@dataclass(frozen=True)
class CanBusObservation:
    """Observed bus. `error` is None for a bus that opened. Counts of frames and error frames, and
    whether it went bus-off.

    `failed` is how the bus failed while it was open, None if it did not.
    """

    error: str | None = None
    frames: int = 0
    error_frames: int = 0
    went_off: bool = False
    failed: str | None = None


@dataclass(frozen=True)
class ReceivedFrame:
    """A data frame, and the time when it was received."""

    at_s: float
    message: can.Message


class Listener:
    """Collects frames, oldest first, and counts error frames. A bus failure is noted, not
    raised, as it is a finding.
    """

    def __init__(self, bus: can.BusABC, clock: Clock) -> None:
        self._bus = bus
        self._clock = clock
        self.frames: list[ReceivedFrame] = []
        self.error_frames = 0
        self.went_off = False
        self.failed: str | None = None

    def listen(self, seconds: float) -> list[ReceivedFrame]:
        """Listens for `seconds`; returns the frames of that time."""
        first = len(self.frames)
        until_s = self._clock.now_s() + seconds
        while self.failed is None and self._clock.now_s() < until_s:
            self._clock.wait_until(self._clock.now_s() + POLL_S)
            self._drain()
        return self.frames[first:]

    def _drain(self) -> None:
        now_s = self._clock.now_s()
        try:
            while (message := self._bus.recv(timeout=0)) is not None:
                self._take(message, now_s)
        except (can.CanError, OSError) as error:
            self.failed = shorten_error(error)

    def _take(self, message: can.Message, now_s: float) -> None:
        if message.is_error_frame:
            self.error_frames += 1
            self.went_off |= bool(message.arbitration_id & CAN_ERROR_BUS_OFF)
        # Remote frames are requests by other programs, and show nothing about the drive.
        elif not message.is_remote_frame:
            self.frames.append(ReceivedFrame(now_s, message))

    def ask(self, message: can.Message) -> None:
        """Sends a query; a failure to send is noted."""
        if self.failed is not None:
            return
        try:
            self._bus.send(message, timeout=0.0)
        except (can.CanError, OSError) as error:
            self.failed = f"a question was not sent: {shorten_error(error)}"

    def observe(self) -> CanBusObservation:
        return CanBusObservation(
            None, len(self.frames), self.error_frames, self.went_off, self.failed
        )


def mean_period_s(frames: Sequence[ReceivedFrame]) -> float | None:
    """Mean time between frames in s; None for fewer than two, and for frames received at the
    same time.
    """
    if len(frames) < 2 or frames[-1].at_s <= frames[0].at_s:
        return None
    return (frames[-1].at_s - frames[0].at_s) / (len(frames) - 1)


def shorten_error(error: Exception) -> str:
    """Error message of another package, shortened to one line."""
    return " ".join(str(error).split())[:200] or type(error).__name__


@dataclass(frozen=True)
class SerialPortSeen:
    """Observed port. `group` is its owner group, None if the system has no groups; `others` are
    the other serial ports.
    """

    path: str
    exists: bool
    may_open: bool = False
    group: str | None = None
    others: tuple[str, ...] = ()
    product: str = ""


def judge_serial_port(seen: SerialPortSeen, section: str) -> Finding:
    """Finding on a port that the rig file names under `section`."""
    if not seen.exists:
        if seen.others:
            existing = f"there is {', '.join(seen.others)}"
        else:
            existing = "there is no serial port at all"
        return red(
            PORT_SUBJECT,
            f"there is no {seen.path}; {existing}",
            f"plug the cable in, or name the right port under {section}",
        )
    if not seen.may_open:
        return red(
            PORT_SUBJECT, f"{seen.path} is not open to you{_owner_text(seen)}", *_permission(seen)
        )
    return green(PORT_SUBJECT, f"{seen.path} {seen.product}".strip())


def judge_found_port(seen: SerialPortSeen) -> Finding:
    """Finding on a port that was found by a scan; a missing permission may not matter."""
    if not seen.may_open:
        return yellow(
            PORT_SUBJECT,
            f"{seen.path} {seen.product}".strip() + f", not open to you{_owner_text(seen)}",
            *_permission(seen),
        )
    return green(PORT_SUBJECT, f"{seen.path} {seen.product}".strip())


def _owner_text(seen: SerialPortSeen) -> str:
    if seen.group is None:
        return ""
    return f", it belongs to the group {seen.group}"


def _permission(seen: SerialPortSeen) -> tuple[str, ...]:
    """Fix for a missing permission. For a port of root the mode is changed: joining root's group
    would grant too much.
    """
    if seen.group is None or seen.group == "root":
        return "let yourself in until the next restart:", f"sudo chmod a+rw {seen.path}"
    return "join the group, then log out and in again:", f"sudo usermod -aG {seen.group} $USER"


def look_at_serial_port(path: str) -> SerialPortSeen:
    """Observes one port, with the names of the others."""
    products = _list_ports()
    others = tuple(sorted(other for other in products if other != path))
    return _observe(path, products.get(path, ""), others)


def look_for_serial_ports() -> tuple[SerialPortSeen, ...]:
    return tuple(_observe(path, product, ()) for path, product in sorted(_list_ports().items()))


def _list_ports() -> dict[str, str]:
    """Ports found by pyserial, with the product name. Ports of the mainboard without a connector
    are left out.
    """
    from serial.tools import list_ports  # noqa: PLC0415 (little else needs it)

    return {
        port.device: port.product or ""
        for port in list_ports.comports()
        if not port.device.startswith("/dev/ttyS")
    }


def _observe(path: str, product: str, others: tuple[str, ...]) -> SerialPortSeen:
    # On Windows a COM port is not a file and has no group.
    if os.name == "nt":
        return SerialPortSeen(path, path in _list_ports(), True, None, others, product)
    exists = Path(path).exists()
    group = None
    if exists:
        group = _group(path)
    return SerialPortSeen(
        path,
        exists,
        os.access(path, os.R_OK | os.W_OK),
        group,
        others,
        product,
    )


def _group(path: str) -> str | None:
    """Name of the owner group; None if it has no name."""
    try:
        return Path(path).group()
    except KeyError:
        return None


def probe_receive_buffer() -> int:
    """Receive buffer in bytes that the system grants to a request like the driver's; nothing is
    sent.
    """
    # Not connected: a computer without an IPv4 loopback interface has no way even to itself.
    opened, granted_bytes = open_udp()
    opened.close()
    return granted_bytes


def judge_receive_buffer(granted_bytes: int, asked_bytes: int, rate_Hz: float) -> Finding:
    """Finding on the receive buffer. `rate_Hz` is the record rate; in the worst case each record
    has its own datagram.
    """
    if granted_bytes >= asked_bytes:
        return green(
            RECEIVE_BUFFER_SUBJECT,
            f"{granted_bytes >> 10} KiB granted, {asked_bytes >> 10} asked for",
        )
    holds_ms = 1e3 * granted_bytes / KERNEL_BYTES_PER_DATAGRAM / rate_Hz
    summary = (
        f"{granted_bytes >> 10} KiB granted of {asked_bytes >> 10} asked for: {holds_ms:.0f} "
        f"ms of single records at {rate_Hz:g} Hz"
    )
    fix = "allow more; a file in /etc/sysctl.d makes it last over a restart:"
    return yellow(
        RECEIVE_BUFFER_SUBJECT, summary, fix, f"sudo sysctl -w net.core.rmem_max={asked_bytes}"
    )
