"""Opens the bus that a rig file names, and listens on it."""

from collections.abc import Sequence
from dataclasses import dataclass

import can

from rfca_rig.clock import Clock
from rfca_rig.doctor.judging.can_bus import CanBusSeen

POLL_S = 1e-3
LISTEN_S = 1.0
CAN_ERROR_BUS_OFF = 0x40  # error class of a SocketCAN error frame (linux/can/error.h)


@dataclass(frozen=True)
class HeardFrame:
    """A data frame, and when it was taken off the bus."""

    at_s: float
    message: can.Message


class Listener:
    """Keeps what it hears, oldest first, and counts error frames. A bus that fails is noted, not raised: that is what is looked for."""

    def __init__(self, bus: can.BusABC, clock: Clock) -> None:
        self._bus = bus
        self._clock = clock
        self.frames: list[HeardFrame] = []
        self.error_frames = 0
        self.went_off = False
        self.failed: str | None = None

    def listen(self, seconds: float) -> list[HeardFrame]:
        """What came within that time."""
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
            self.failed = one_line(error)

    def _take(self, message: can.Message, now_s: float) -> None:
        if message.is_error_frame:
            self.error_frames += 1
            self.went_off |= bool(message.arbitration_id & CAN_ERROR_BUS_OFF)
        elif not message.is_remote_frame:
            self.frames.append(HeardFrame(now_s, message))

    def ask(self, message: can.Message) -> None:
        """Sends a question; where the bus does not take it, that is noted."""
        if self.failed is not None:
            return
        try:
            self._bus.send(message, timeout=0.0)
        except (can.CanError, OSError) as error:
            self.failed = f"a question was not sent: {one_line(error)}"

    def seen(self) -> CanBusSeen:
        return CanBusSeen(None, len(self.frames), self.error_frames, self.went_off, self.failed)


def period_s(frames: Sequence[HeardFrame]) -> float | None:
    """Mean time from frame to frame; None for fewer than two, and for frames that all came at once."""
    if len(frames) < 2 or frames[-1].at_s <= frames[0].at_s:
        return None
    return (frames[-1].at_s - frames[0].at_s) / (len(frames) - 1)


def one_line(error: Exception) -> str:
    """What another package says, fit for a line."""
    return " ".join(str(error).split())[:200] or type(error).__name__
