"""A bus that keeps a copy of every frame that passes: of any node, and those that are sent here."""

from dataclasses import dataclass

import can

from rfca_rig.clock import Clock
from rfca_rig.drivers.can_frames import arrival_s


@dataclass(frozen=True)
class PassedFrame:
    """A frame with the host time at which it arrived, or was sent."""

    host_s: float
    message: can.Message
    is_sent: bool = False


class FrameTap(can.BusABC):
    """Passes everything on to the `bus` that it stands before. `take` hands out what has passed."""

    def __init__(self, bus: can.BusABC, clock: Clock) -> None:
        super().__init__(channel=bus.channel_info)
        self.channel_info = bus.channel_info
        self._bus = bus
        self._clock = clock
        self._passed: list[PassedFrame] = []
        # A frame cannot have arrived before the bus was last found empty.
        self._empty_s = clock.now_s()

    @property
    def state(self) -> can.BusState:
        """As the bus that it stands before."""
        return self._bus.state

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        self._bus.state = new_state

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._bus.send(msg, timeout)
        self._passed.append(PassedFrame(self._clock.now_s(), msg, is_sent=True))

    def recv(self, timeout: float | None = None) -> can.Message | None:
        """As every bus."""
        message = self._bus.recv(timeout)
        now_s = self._clock.now_s()
        if message is None:
            self._empty_s = now_s
            return None
        wall_s = self._clock.wall_time().timestamp()
        host_s = arrival_s(message, self._empty_s, now_s, wall_s)
        self._passed.append(PassedFrame(host_s, message))
        return message

    def take(self) -> list[PassedFrame]:
        """Frames since the last call, in the order in which they passed."""
        passed = self._passed
        self._passed = []
        return passed

    def discard(self) -> None:
        """Drops what has passed, and what waits in the bus: of frames that piled up while nobody
        read, some may be missing.
        """
        while self._bus.recv(timeout=0) is not None:
            pass
        self._empty_s = self._clock.now_s()
        self._passed = []

    def shutdown(self) -> None:
        super().shutdown()
        self._bus.shutdown()
