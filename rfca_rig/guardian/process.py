"""The process that holds the bus. Whatever becomes of the one that commands, the last word to the drive is spoken here."""

import os
import select
import signal
import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from types import FrameType

import can

from rfca_rig.clock import Clock, WallClock
from rfca_rig.drivers.can_bus import CanBusSettings
from rfca_rig.drivers.guard import LastWord
from rfca_rig.guardian.link import GuardianLink
from rfca_rig.guardian.records import GuardianRecord, RecordKind, frame_of, of_frame, of_silenced, of_text
from rfca_rig.guardian.silence import Silence
from rfca_rig.guardian.torque_off import LettingGo

ALIVE_S = 0.02
POLL_S = 1e-3  # for buses that cannot be waited for
DEAF_S = 0.02  # between two looks at a bus that fails
NICENESS = -11
MOST_FRAMES = 256  # in one round: a flooded bus must not hide a silence
READY, FAILED = "ready", "failed"


@dataclass(frozen=True)
class GuardianAssignment:
    """What to hold, and when to let go of it. `clock` is the parent's: both tell the same time, as the clock behind it is the machine's."""

    bus: CanBusSettings
    last_word: LastWord
    silence_s: float
    clock: WallClock


def guard(parent: Connection) -> None:
    """Takes its assignment from the parent, says whether the bus is open, and holds it until the parent is done, or gone.

    SIGTERM, SIGHUP and SIGINT end it, after the drive was let go. It is of a session of its own: ^C in the terminal is the parent's.
    """
    _ask_for_priority()
    orders = Orders()
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, orders.end)
    assignment: GuardianAssignment = parent.recv()
    try:
        bus = assignment.bus.open()
    except Exception as error:  # python-can's interfaces raise all sorts, NameError and ImportError where the vendor's library is missing
        parent.send((FAILED, str(error) or type(error).__name__))
        return
    parent.send((READY, str(bus.channel_info)))
    link = GuardianLink(socket.socket(fileno=os.dup(parent.fileno())))
    try:
        Guardian(bus, link, assignment.last_word, assignment.silence_s, assignment.clock).run(orders.signal_name)
    finally:
        bus.shutdown()
        link.close()


def _ask_for_priority() -> None:
    """Before everything that has no deadline; a system that does not grant it leaves the guardian as any other process."""
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)


@dataclass
class Orders:
    """Which signal told this process to end; empty while none did."""

    names: list[str] = field(default_factory=list)

    def end(self, number: int, _frame: FrameType | None) -> None:
        self.names.append(signal.Signals(number).name)

    def signal_name(self) -> str:
        return self.names[0] if self.names else ""


class Guardian:
    """From the link to the bus and back. Only what lets the drive go passes at any time, the rest while commands keep coming."""

    def __init__(self, bus: can.BusABC, link: GuardianLink, last_word: LastWord, silence_s: float, clock: Clock) -> None:
        self._bus = bus
        self._link = link
        self._last_word = last_word
        self._always = {signature(message) for message in last_word.frames()}
        self._closing = signature(last_word.frames()[-1])
        self._silence = Silence(silence_s)
        self._clock = clock
        self._arming = 0
        self._letting_go: LettingGo | None = None
        self._bus_fileno = _fileno(bus)
        self._listen_s = 0.0
        self._alive_s = 0.0
        self._is_off = False
        self._is_done = False

    def run(self, told_to_end: Callable[[], str]) -> None:
        """Until the parent closes or is gone, or `told_to_end` names a signal; then lets go of a drive that is armed, and returns."""
        try:
            while not (self._is_done or self._link.is_cut or told_to_end()):
                self._wait()
                self.round(self._clock.now_s())
        except Exception as mistake:
            self._end(f"because of a mistake of its own ({mistake!r})")
            raise
        self._end(f"because it was told to end by {told_to_end()}" if told_to_end() else "because the program that it guards ended")

    def round(self, now_s: float) -> None:
        """One look at everything. What came is looked at first, so that a guardian who was late finds no silence where there was none."""
        self._obey(now_s)
        self._hear(now_s)
        if self._silence.is_too_long(now_s):
            self._let_go(now_s, f"after {1e3 * self._silence.lasted_s(now_s):.0f} ms of silence")
        self._carry_on(now_s)
        self._show_life(now_s)
        self._link.flush()

    def _end(self, why: str) -> None:
        now_s = self._clock.now_s()
        if self._silence.is_armed:
            self._let_go(now_s, why)
        while self._letting_go is not None:
            self._carry_on(now_s)
            self._clock.wait_until(now_s + POLL_S)
            now_s = self._clock.now_s()
            self._hear(now_s)
            self._link.flush()
        self._link.flush()

    def _wait(self) -> None:
        now_s = self._clock.now_s()
        until_s = min(self._silence.left_s(now_s), self._alive_s + ALIVE_S - now_s)
        if self._letting_go is not None:
            until_s = min(until_s, self._letting_go.left_s(now_s))
        listening = now_s >= self._listen_s
        if self._bus_fileno is None or not listening:
            until_s = min(until_s, POLL_S)
        watched = [self._link.fileno(), *([self._bus_fileno] if self._bus_fileno is not None and listening else [])]
        select.select(watched, [], [], max(until_s, 0.0))

    # -- from the parent -----------------------------------------------------------------------------------------------------

    def _obey(self, now_s: float) -> None:
        for record in self._link.take():
            match record.kind:
                case RecordKind.FRAME:
                    self._forward(record, now_s)
                case RecordKind.FRAME_TO_CONFIRM:
                    self._forward_and_confirm(record)
                case RecordKind.ARM:
                    self._arming, self._letting_go = record.number, None
                    self._silence.arm(record.t_s)
                case RecordKind.CLOSE:
                    self._is_done = True

    def _forward(self, record: GuardianRecord, now_s: float) -> None:
        """Refuses what comes too late, without a word: that there was a silence is told when it is found."""
        if self._silence.may_pass(record.t_s, now_s):
            failure = self._sent(record)
            if failure:
                self._tell(of_text(RecordKind.BUS_ERROR, now_s, failure))

    def _forward_and_confirm(self, record: GuardianRecord) -> None:
        """What lets the drive go, and nothing else, is sent this way."""
        message = frame_of(record)
        failure = self._sent(record) if signature(message) in self._always else "no frame that lets the drive go"
        if not failure and signature(message) == self._closing:
            self._silence.disarm()
        self._tell(of_text(RecordKind.CONFIRMED, record.t_s, failure, record.number))

    def _sent(self, record: GuardianRecord) -> str:
        """Why the bus did not take it; empty where it did."""
        try:
            self._bus.send(frame_of(record), timeout=0.0)
        except Exception as error:  # as above; the parent hears of it
            return str(error) or type(error).__name__
        return ""

    # -- from the bus --------------------------------------------------------------------------------------------------------

    def _hear(self, now_s: float) -> None:
        if now_s < self._listen_s:
            return
        try:
            for _ in range(MOST_FRAMES):
                message = self._bus.recv(timeout=0) if self._may_hold_a_frame(now_s) else None
                if message is None:
                    break
                self._hand_on(message, now_s)
            self._is_off = self._bus.state is can.BusState.ERROR
        except Exception as error:  # as above; the parent hears of it
            self._listen_s = now_s + DEAF_S
            self._link.put(of_text(RecordKind.BUS_ERROR, now_s, str(error) or type(error).__name__), may_be_dropped=True)

    def _may_hold_a_frame(self, now_s: float) -> bool:
        """`recv` of some adapters waits a millisecond where nothing is there, in spite of its timeout. Now and then it is asked anyway."""
        if self._bus_fileno is None or now_s - self._alive_s >= ALIVE_S:
            return True
        return bool(select.select([self._bus_fileno], [], [], 0.0)[0])

    def _hand_on(self, message: can.Message, now_s: float) -> None:
        self._link.put(of_frame(message, message.timestamp), may_be_dropped=True)
        self._link.flush()
        if self._letting_go is not None and not message.is_error_frame and not message.is_remote_frame:
            self._letting_go.hear(message, now_s)

    # -- letting go ----------------------------------------------------------------------------------------------------------

    def _let_go(self, now_s: float, why: str) -> None:
        silent_s = self._silence.lasted_s(now_s)
        self._silence.disarm()
        self._letting_go = LettingGo(self._bus, self._last_word, now_s, silent_s)
        self._carry_on(now_s)
        self._tell(of_text(RecordKind.LET_GO, now_s, f"guardian let go {why}", self._arming))

    def _carry_on(self, now_s: float) -> None:
        if self._letting_go is None:
            return
        failed_before = self._letting_go.failure
        self._letting_go.step(now_s)
        failure = self._letting_go.failure
        if failure and failure != failed_before:
            self._tell(of_text(RecordKind.BUS_ERROR, now_s, f"the guardian's last word was not taken: {failure}"))
        if self._letting_go.is_over:
            self._tell(of_silenced(self._letting_go.did(), now_s, self._arming))
            self._letting_go = None

    def _show_life(self, now_s: float) -> None:
        if now_s - self._alive_s >= ALIVE_S:
            self._alive_s = now_s
            self._link.put(GuardianRecord(RecordKind.ALIVE, now_s, number=int(self._is_off)), may_be_dropped=True)

    def _tell(self, record: GuardianRecord) -> None:
        self._link.put(record)


def signature(message: can.Message) -> tuple[int, bool, bytes]:
    """What a drive tells frames apart by."""
    return message.arbitration_id, message.is_extended_id, bytes(message.data)


def _fileno(bus: can.BusABC) -> int | None:
    """What can be waited for; None where the bus has no such thing."""
    try:
        number = bus.fileno()
    except NotImplementedError:
        return None
    return number if isinstance(number, int) and number >= 0 else None
