"""Bus, network, clock, drive, recorder and camera that do what they should until a cause says
otherwise.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime, timedelta

import can

from rfca_rig.clock import TwinClock
from rfca_rig.devices.odrive.messages import AxisState, OdriveCommand
from rfca_rig.devices.odrive.twin import OdriveTwin
from rfca_rig.drivers.roles import Photo
from rfca_rig.recording.backend import InProcessRecorder
from rfca_rig.recording.journal import JournalBlock
from rfca_rig.recording.run_writer import Picture
from rfca_rig.twins.wires import LinkEnd
from rfca_rig.twins.world import ShaftDrive, ShaftState

MOTION = frozenset({OdriveCommand.INPUT_POS, OdriveCommand.INPUT_VEL, OdriveCommand.INPUT_TORQUE})


class BreakableBus(can.BusABC):
    """The driver's end of the wire; `alter` does to a received frame whatever it wants, and None
    takes it away.

    Every frame that the driver wants to send is kept, with the time; `fetch_photo` are those that
    left.
    """

    def __init__(self, end: can.BusABC, clock: TwinClock) -> None:
        super().__init__(channel=end.channel_info)
        self.channel_info = end.channel_info
        self._end = end
        self._clock = clock
        self.sent: list[tuple[float, can.Message]] = []
        self.taken: list[tuple[float, can.Message]] = []
        self.send_error: Exception | None = None
        self.receive_error: Exception | None = None
        self.refuses_until_s = 0.0
        self.alter: Callable[[can.Message], can.Message | None] | None = None

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self.sent.append((self._clock.now_s(), msg))
        if self.send_error is not None:
            raise self.send_error
        if self._clock.now_s() < self.refuses_until_s:
            raise can.CanOperationError(
                "Failed to transmit: No buffer space available [Error Code 105]"
            )
        self._end.send(msg, timeout)
        self.taken.append(self.sent[-1])

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if self.receive_error is not None:
            raise self.receive_error
        message = self._end.recv(timeout)
        while message is not None and self.alter is not None:
            altered = self.alter(message)
            if altered is not None:
                return altered, False
            message = self._end.recv(timeout)
        return message, False

    def told_to_let_go_s(self) -> float | None:
        """When an order to go idle first left, after the one that last closed the loop, if any
        did.
        """
        first = _first_idle(self.taken)
        if first is None:
            return None
        return self.taken[first][0]

    def motion_after_stop(self) -> int:
        """Frames that would move the motor, after the driver first wanted to send that order;
        set-points before it was enabled are none.
        """
        first = _first_idle(self.sent)
        if first is None or not any(_closes_loop(message) for _, message in self.sent[:first]):
            return 0
        return sum(message.arbitration_id & 0x1F in MOTION for _, message in self.sent[first:])


def _first_idle(frames: list[tuple[float, can.Message]]) -> int | None:
    first: int | None = None
    for at, (_, message) in enumerate(frames):
        if message.arbitration_id & 0x1F == OdriveCommand.AXIS_STATE:
            if _closes_loop(message):
                first = None
            else:
                first = at if first is None else first
    return first


def _closes_loop(message: can.Message) -> bool:
    return (
        message.arbitration_id & 0x1F == OdriveCommand.AXIS_STATE
        and message.data[0] == AxisState.CLOSED_LOOP
    )


class BreakableLink:
    """The driver's end of the sensor's network; `alter` does to the datagrams whatever it wants."""

    def __init__(self, end: LinkEnd) -> None:
        self._end = end
        self.alter: Callable[[list[bytes]], list[bytes]] | None = None
        self.error: Exception | None = None

    def send(self, datagram: bytes) -> None:
        self._end.send(datagram)

    def receive_all(self) -> list[bytes]:
        if self.error is not None:
            raise self.error
        received = self._end.receive_all()
        if self.alter:
            return self.alter(received)
        return received

    def close(self) -> None:
        self._end.close()


@dataclass
class BreakableClock:
    """The engine's clock; `late_s` is slept too long, once, and `meanwhile` happens every 10 ms
    of that.
    """

    clock: TwinClock
    late_s: float = 0.0
    wall_step: timedelta = timedelta()
    meanwhile: Callable[[], None] | None = None

    def now_s(self) -> float:
        return self.clock.now_s()

    def start_time(self) -> datetime:
        return self.clock.start_time()

    def wall_time(self) -> datetime:
        return self.clock.wall_time() + self.wall_step

    def wait_until(self, t_s: float) -> None:
        late_s = self.late_s
        self.late_s = 0.0
        while self.meanwhile is not None and late_s > 0.0:
            self.meanwhile()
            self.clock.wait_until(self.clock.now_s() + 0.01)
            late_s -= 0.01
        self.clock.wait_until(t_s + late_s)


@dataclass
class RunawayDrive:
    """A drive that, once `away`, gives a torque of its own for as long as its loop is closed."""

    twin: OdriveTwin
    away_Nm: float | None = None

    def take_frames(self, now_s: float) -> None:
        self.twin.take_frames(now_s)

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        law = self.twin.drive(shaft)
        if self.away_Nm is None or law == ShaftDrive():
            return law
        return ShaftDrive(feed_Nm=self.away_Nm)

    def advance(
        self, elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState, law: ShaftDrive
    ) -> None:
        self.twin.advance(elapsed_s, now_s, before, after, law)


@dataclass
class BreakableKeeper:
    """A recorder; `error` is what it answers to the next block."""

    keeper: InProcessRecorder
    error: Exception | None = None

    @property
    def acknowledged(self) -> int:
        return self.keeper.acknowledged

    def give(self, block: JournalBlock) -> None:
        if self.error is not None:
            raise self.error
        self.keeper.give(block)

    def keep_photo(self, picture: Picture) -> str:
        if self.error is not None:
            raise self.error
        return self.keeper.keep_photo(picture)

    def finish(self, why: str) -> None:
        self.keeper.finish(why)


@dataclass
class BreakableCamera:
    """A `Photographer` whose photos come at once, until `frozen` or `error`."""

    photo: Photo
    frozen: bool = False
    error: Exception | None = None
    asked: int = field(default=0)

    def begin(self) -> None:
        self.asked += 1
        if self.error is not None:
            raise self.error

    def fetch_photo(self) -> Photo | None:
        if self.frozen:
            return None
        return self.photo

    def close(self) -> None:
        """Nothing is held open."""

    def identity(self) -> dict[str, str]:
        return {"camera": "none"}
