"""What the doctor's checks of all devices use: the result of a check, and a listener on a CAN bus.

A result is a colour, the observation, and the fix.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import can

from rfca_rig.clock import Clock

# Interval between two reads of the bus, and time for which it is listened to, in s.
POLL_S = 1e-3
LISTEN_S = 1.0
# Error class of a SocketCAN error frame (linux/can/error.h).
CAN_ERROR_BUS_OFF = 0x40


class Colour(StrEnum):
    """Green: in order. Yellow: works, but will cause trouble. Red: does not work."""

    GREEN = "green"
    YELLOW = "yellow"
    RED = "red"


@dataclass(frozen=True)
class Finding:
    """Result of one check: `subject` in a few words, `fix` is what to do, `commands` are lines to be typed unchanged."""

    subject: str
    colour: Colour
    seen: str
    fix: str = ""
    commands: tuple[str, ...] = ()


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
    """Observed bus. `error` is None for a bus that opened. Counts of frames and error frames, and whether it went bus-off.

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
    """Collects frames, oldest first, and counts error frames. A bus failure is noted, not raised, as it is a finding."""

    def __init__(self, bus: can.BusABC, clock: Clock) -> None:
        self._bus = bus
        self._clock = clock
        self.frames: list[ReceivedFrame] = []
        self.error_frames = 0
        self.went_off = False
        self.failed: str | None = None

    def listen(self, seconds: float) -> list[ReceivedFrame]:
        """Listens for `seconds`; returns the frames of that time."""
        first, until_s = len(self.frames), self._clock.now_s() + seconds
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
        return CanBusObservation(None, len(self.frames), self.error_frames, self.went_off, self.failed)


def mean_period_s(frames: Sequence[ReceivedFrame]) -> float | None:
    """Mean time between frames in s; None for fewer than two, and for frames received at the same time."""
    if len(frames) < 2 or frames[-1].at_s <= frames[0].at_s:
        return None
    return (frames[-1].at_s - frames[0].at_s) / (len(frames) - 1)


def shorten_error(error: Exception) -> str:
    """Error message of another package, shortened to one line."""
    return " ".join(str(error).split())[:200] or type(error).__name__
