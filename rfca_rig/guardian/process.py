"""Main function of the guardian process. It holds the CAN bus, and disables the motor whatever
happens to its parent.
"""

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
from rfca_rig.drivers.can_frames import CanBusSettings
from rfca_rig.drivers.guard import TorqueOffFrames, TorqueOffResult
from rfca_rig.guardian.link import (
    GuardianLink,
    GuardianRecord,
    RecordKind,
    from_frame,
    from_result,
    from_text,
    to_frame,
)

# Repetition interval and duration in s, see docs/guardian.md.
REPEAT_S = 0.005
# Repetitions before a report counts as an effect of the frames.
MIN_REPETITIONS = 3
MAX_DURATION_S = 0.5
# Duration in s on a bus that accepts nothing: a cable may be plugged in again.
BUS_FAILED_S = 10.0

# Interval of the alive messages in s.
ALIVE_S = 0.02
# Poll interval in s for buses without a file descriptor to wait on.
POLL_S = 1e-3
# Pause in s after a failed read, so that a broken bus does not take all computing time.
READ_RETRY_S = 0.02
# Scheduling priority; a late guardian is a late torque-off.
NICENESS = -11
# Frames read in one cycle: a flooded bus must not hide a silence.
MAX_FRAMES_PER_CYCLE = 256
READY = "ready"
FAILED = "failed"


class TorqueOffSequence:
    """One torque-off sequence, begun at `began_s`.

    It ends when the drive shows no torque, or after 0.5 s, but not before the frames have been sent
    once.
    """

    def __init__(
        self, bus: can.BusABC, last_word: TorqueOffFrames, began_s: float, silent_s: float
    ) -> None:
        self._bus = bus
        self._last_word = last_word
        self._began_s = began_s
        self._next_s = began_s
        self._silent_s = silent_s
        self._times_sent = 0
        self._reports = 0
        self._torque_Nm = float("nan")
        self._ended_s: float | None = None
        self.failure = ""

    @property
    def is_over(self) -> bool:
        return self._ended_s is not None

    def remaining_s(self, now_s: float) -> float:
        """Time in s until the next step is due."""
        return max(self._next_s - now_s, 0.0)

    def step(self, now_s: float) -> None:
        """Sends the frames if they are due. `failure` is the reason why the bus did not accept
        them, else empty.
        """
        if self.is_over or now_s < self._next_s:
            return
        limit_s = BUS_FAILED_S
        if self._times_sent:
            limit_s = MAX_DURATION_S
        if now_s - self._began_s > limit_s:
            self._ended_s = now_s
            return
        self._next_s = now_s + REPEAT_S
        self.failure = self._send()
        self._times_sent += not self.failure

    def _send(self) -> str:
        failure = ""
        for message in self._last_word.frames():
            try:
                self._bus.send(message, timeout=0.0)
            # The interfaces of python-can raise exceptions of many types, and the other frames must
            # still be sent.
            except Exception as error:
                failure = f"{type(error).__name__}: {error}"
        return failure

    def note_report(self, message: can.Message, now_s: float) -> None:
        """Takes in a frame of the bus. Reports already under way prove nothing, so only those
        after the third sending count.
        """
        torque_Nm = self._last_word.torque_Nm(message)
        if torque_Nm is None or self._times_sent < MIN_REPETITIONS or self.is_over:
            return
        self._reports += 1
        self._torque_Nm = torque_Nm
        if abs(torque_Nm) < self._last_word.min_visible_torque_Nm():
            self._ended_s = now_s

    def result(self) -> TorqueOffResult:
        """Result of the sequence, for the parent process."""
        end_s = self._ended_s
        if end_s is None:
            end_s = self._began_s
        return TorqueOffResult(
            self._silent_s, end_s - self._began_s, self._reports, self._torque_Nm
        )


class CommandTimeout:
    """Timeout state. Until it is armed, and after a silence that was too long, no command that
    moves the drive may pass.
    """

    def __init__(self, limit_s: float) -> None:
        self._limit_s = limit_s
        self._since_s = 0.0
        self.is_armed = False

    def arm(self, t_s: float) -> None:
        self._since_s = t_s
        self.is_armed = True

    def disarm(self) -> None:
        self.is_armed = False

    def may_pass(self, given_s: float, now_s: float) -> bool:
        """Whether a command may pass. It restarts the timeout unless that has expired; one older
        than the limit by now may not pass.
        """
        # Judged by when it was given: a late guardian must not let pass what came after a real
        # silence.
        if not self.is_armed or given_s - self._since_s > self._limit_s:
            return False
        self._since_s = max(self._since_s, given_s)
        return now_s - given_s <= self._limit_s

    def silence_s(self, now_s: float) -> float:
        """Time in s since the last command."""
        return now_s - self._since_s

    def has_expired(self, now_s: float) -> bool:
        return self.is_armed and self.silence_s(now_s) > self._limit_s

    def remaining_s(self, now_s: float) -> float:
        """Time in s until the timeout expires; infinite if it is not armed."""
        if self.is_armed:
            return self._since_s + self._limit_s - now_s
        return float("inf")


@dataclass(frozen=True)
class GuardianAssignment:
    """The bus to hold, the torque-off frames, and the timeout. `clock` is the parent's; its time
    is the same in both processes.
    """

    bus: CanBusSettings
    last_word: TorqueOffFrames
    silence_s: float
    clock: WallClock


def run_guardian(parent: Connection) -> None:
    """Receives its assignment from the parent, reports whether the bus is open, and holds it until
    the parent is done, or gone.

    SIGTERM, SIGHUP and SIGINT end it, after it has disabled the motor. It has its own session, so
    ^C in the terminal goes to the parent.
    """
    # Raises the priority above processes without a deadline. If the system refuses, the guardian
    # runs at normal priority.
    with suppress(PermissionError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
    orders = EndSignals()
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, orders.end)
    assignment: GuardianAssignment = parent.recv()
    try:
        bus = assignment.bus.open()
    # Interfaces of python-can raise exceptions of many types, even NameError and ImportError if a
    # vendor library is missing.
    except Exception as error:
        parent.send((FAILED, str(error) or type(error).__name__))
        return
    parent.send((READY, str(bus.channel_info)))
    link = GuardianLink(socket.socket(fileno=os.dup(parent.fileno())))
    try:
        Guardian(bus, link, assignment.last_word, assignment.silence_s, assignment.clock).run(
            orders.signal_name
        )
    finally:
        bus.shutdown()
        link.close()


@dataclass
class EndSignals:
    """Names of the signals that asked this process to end; empty while there were none."""

    names: list[str] = field(default_factory=list)

    def end(self, number: int, _frame: FrameType | None) -> None:
        self.names.append(signal.Signals(number).name)

    def signal_name(self) -> str:
        if self.names:
            return self.names[0]
        return ""


class Guardian:
    """Forwards frames between parent and bus. Torque-off frames always pass, all others only
    while commands keep coming.
    """

    def __init__(
        self,
        bus: can.BusABC,
        link: GuardianLink,
        last_word: TorqueOffFrames,
        silence_s: float,
        clock: Clock,
    ) -> None:
        self._bus = bus
        self._link = link
        self._last_word = last_word
        self._always = {signature(message) for message in last_word.frames()}
        self._closing = signature(last_word.frames()[-1])
        self._silence = CommandTimeout(silence_s)
        self._clock = clock
        self._arming = 0
        self._torque_off: TorqueOffSequence | None = None
        self._bus_fileno = _fileno(bus)
        self._listen_s = 0.0
        self._alive_s = 0.0
        self._is_off = False
        self._is_done = False

    def run(self, ending_signal: Callable[[], str]) -> None:
        """Runs until the parent closes or is gone, or `ending_signal` names a signal; then
        disables an armed drive and returns.
        """
        try:
            while not (self._is_done or self._link.is_cut or ending_signal()):
                self._wait()
                self.round(self._clock.now_s())
        # A bug in the guardian must not leave the motor running.
        except Exception as mistake:
            self._end(f"because of a mistake of its own ({mistake!r})")
            raise
        if ending_signal():
            self._end(f"because it was ended by {ending_signal()}")
        else:
            self._end("because the program that it guards ended")

    def round(self, now_s: float) -> None:
        """One cycle. Arrived commands are handled first, so that a delayed guardian sees no
        silence that did not exist.
        """
        self._obey(now_s)
        self._receive(now_s)
        if self._silence.has_expired(now_s):
            self._let_go(now_s, f"after {1e3 * self._silence.silence_s(now_s):.0f} ms of silence")
        self._continue_torque_off(now_s)
        self._show_life(now_s)
        self._link.flush()

    def _end(self, why: str) -> None:
        now_s = self._clock.now_s()
        if self._silence.is_armed:
            self._let_go(now_s, why)
        # The process ends only after the torque-off sequence is over.
        while self._torque_off is not None:
            self._continue_torque_off(now_s)
            self._clock.wait_until(now_s + POLL_S)
            now_s = self._clock.now_s()
            self._receive(now_s)
            self._link.flush()
        self._link.flush()

    def _wait(self) -> None:
        now_s = self._clock.now_s()
        until_s = min(self._silence.remaining_s(now_s), self._alive_s + ALIVE_S - now_s)
        if self._torque_off is not None:
            until_s = min(until_s, self._torque_off.remaining_s(now_s))
        listening = now_s >= self._listen_s
        if self._bus_fileno is None or not listening:
            until_s = min(until_s, POLL_S)
        # A bus that just failed is not waited on: it would wake the loop at once.
        watched = [self._link.fileno()]
        if self._bus_fileno is not None and listening:
            watched.append(self._bus_fileno)
        select.select(watched, [], [], max(until_s, 0.0))

    # -- from the parent
    # ----------------------------------------------------------------------------------------------

    def _obey(self, now_s: float) -> None:
        for record in self._link.take():
            match record.kind:
                case RecordKind.FRAME:
                    # Forwards a command in time, and silently drops a late one: the silence itself
                    # is reported when it is detected.
                    if self._silence.may_pass(record.t_s, now_s):
                        failure = self._send(record)
                        if failure:
                            self._report(from_text(RecordKind.BUS_ERROR, now_s, failure))
                case RecordKind.FRAME_TO_CONFIRM:
                    self._forward_and_confirm(record)
                case RecordKind.ARM:
                    self._arming = record.number
                    self._torque_off = None
                    self._silence.arm(record.t_s)
                case RecordKind.CLOSE:
                    self._is_done = True

    def _forward_and_confirm(self, record: GuardianRecord) -> None:
        """Sends a torque-off frame and confirms it. No other frame is accepted this way."""
        message = to_frame(record)
        if signature(message) in self._always:
            failure = self._send(record)
        else:
            failure = "no frame that lets the drive go"
        # The last torque-off frame ends the driver's session, so no further commands are expected.
        if not failure and signature(message) == self._closing:
            self._silence.disarm()
        self._report(from_text(RecordKind.CONFIRMED, record.t_s, failure, record.number))

    def _send(self, record: GuardianRecord) -> str:
        """Sends a frame; returns the reason why the bus did not accept it, else an empty text."""
        try:
            self._bus.send(to_frame(record), timeout=0.0)
        # Exceptions of any type, see `run_guardian`; the error is reported to the parent.
        except Exception as error:
            return str(error) or type(error).__name__
        return ""

    # -- from the bus
    # ----------------------------------------------------------------------------------------------

    def _receive(self, now_s: float) -> None:
        if now_s < self._listen_s:
            return
        try:
            for _ in range(MAX_FRAMES_PER_CYCLE):
                if self._may_hold_a_frame(now_s):
                    message = self._bus.recv(timeout=0)
                else:
                    message = None
                if message is None:
                    break
                # Each frame is passed on at once, since the parent may be waiting for it.
                self._link.put(from_frame(message, message.timestamp), may_be_dropped=True)
                self._link.flush()
                if (
                    self._torque_off is not None
                    and not message.is_error_frame
                    and not message.is_remote_frame
                ):
                    self._torque_off.note_report(message, now_s)
            self._is_off = self._bus.state is can.BusState.ERROR
        # Exceptions of any type, see `run_guardian`; the error is reported to the parent.
        except Exception as error:
            self._listen_s = now_s + READ_RETRY_S
            self._link.put(
                from_text(RecordKind.BUS_ERROR, now_s, str(error) or type(error).__name__),
                may_be_dropped=True,
            )

    def _may_hold_a_frame(self, now_s: float) -> bool:
        """Whether to call `recv`: with some adapters it waits 1 ms despite a timeout of 0. At
        intervals it is called anyway.
        """
        if self._bus_fileno is None or now_s - self._alive_s >= ALIVE_S:
            return True
        return bool(select.select([self._bus_fileno], [], [], 0.0)[0])

    # -- torque off
    # ----------------------------------------------------------------------------------------------

    def _let_go(self, now_s: float, why: str) -> None:
        silent_s = self._silence.silence_s(now_s)
        self._silence.disarm()
        self._torque_off = TorqueOffSequence(self._bus, self._last_word, now_s, silent_s)
        self._continue_torque_off(now_s)
        self._report(from_text(RecordKind.LET_GO, now_s, f"guardian let go {why}", self._arming))

    def _continue_torque_off(self, now_s: float) -> None:
        if self._torque_off is None:
            return
        failed_before = self._torque_off.failure
        self._torque_off.step(now_s)
        failure = self._torque_off.failure
        if failure and failure != failed_before:
            self._report(
                from_text(
                    RecordKind.BUS_ERROR,
                    now_s,
                    f"the guardian's last word was not taken: {failure}",
                )
            )
        if self._torque_off.is_over:
            self._report(from_result(self._torque_off.result(), now_s, self._arming))
            self._torque_off = None

    def _show_life(self, now_s: float) -> None:
        if now_s - self._alive_s >= ALIVE_S:
            self._alive_s = now_s
            self._link.put(
                GuardianRecord(RecordKind.ALIVE, now_s, number=int(self._is_off)),
                may_be_dropped=True,
            )

    def _report(self, record: GuardianRecord) -> None:
        self._link.put(record)


def signature(message: can.Message) -> tuple[int, bool, bytes]:
    """What identifies a frame: arbitration id, id format and data."""
    return message.arbitration_id, message.is_extended_id, bytes(message.data)


def _fileno(bus: can.BusABC) -> int | None:
    """File descriptor of the bus to wait on; None if it has none."""
    try:
        number = bus.fileno()
    except NotImplementedError:
        return None
    # Some interfaces of python-can return -1 where there is none.
    if number < 0:
        return None
    return number
