"""A CAN bus that a guardian holds: stands where python-can's own would, on the side of the process that commands."""

import os
import socket
import subprocess
from collections import deque
from contextlib import suppress
from multiprocessing.connection import Connection

import can

from rfca_rig.clock import Clock, WallClock
from rfca_rig.drivers.can_bus import CanBusSettings
from rfca_rig.drivers.guard import LastWord, LetGo, Silenced
from rfca_rig.guardian.link import MOST_WAITING_BYTES, GuardianLink
from rfca_rig.guardian.process import FAILED, READY, GuardianAssignment, signature
from rfca_rig.guardian.records import GuardianRecord, RecordKind, frame_of, of_frame, silenced_of
from rfca_rig.guardian.starting import started
from rfca_rig.guardian.torque_off import EVERY_S, LEAST_TIMES

STARTED_WITHIN_S = 30.0
CONFIRMED_WITHIN_S = 0.25
ENDED_WITHIN_S = 1.0
HUNG_S = 0.25
MOST_ARRIVED = 1 << 16


def taken_over(settings: CanBusSettings, last_word: LastWord, clock: Clock) -> can.BusABC:
    """The bus, opened here, after the last word was spoken on it a few times. Raises can.CanError where that cannot be done."""
    try:
        bus = settings.open()
    except Exception as error:  # python-can's interfaces raise all sorts
        raise can.CanInitializationError(f"the bus cannot be opened here: {error or type(error).__name__}") from error
    try:
        for _ in range(LEAST_TIMES):
            for message in last_word.frames():
                bus.send(message, timeout=0.0)
            clock.wait_until(clock.now_s() + EVERY_S)
    except Exception as error:
        bus.shutdown()
        raise can.CanOperationError(f"the drive cannot be told from here: {error or type(error).__name__}") from error
    return bus


class GuardedBus(can.BusABC):
    """Implements `drivers.guard.Guard` too. Neither sending nor receiving waits, but for the frames that let the drive go.

    Those pass at any time, and `send` returns once the guardian has put them on the bus. Others pass after `arm`, as long as no
    two are further apart than `silence_s`; where they are, the guardian lets the drive go, the next call raises LetGo, and every
    later frame that could move the drive does, until `arm`. What the real bus refuses, or fails to read, is raised by the next
    call. Where the guardian itself ends or hangs, this process opens the bus and lets the drive go; the next call says so.
    """

    def __init__(self, settings: CanBusSettings, last_word: LastWord, silence_s: float, clock: WallClock) -> None:
        """Raises can.CanInitializationError where the bus cannot be opened, or no guardian started."""
        self._settings, self._last_word, self._silence_s, self._clock = settings, last_word, silence_s, clock
        self._always = {signature(message) for message in last_word.frames()}
        self._closing = signature(last_word.frames()[-1])
        self._process, self._link, info = _started(GuardianAssignment(settings, last_word, silence_s, clock))
        self.channel_info = f"{info}, held by a guardian"
        self._arrived: deque[can.Message] = deque(maxlen=MOST_ARRIVED)
        self._arming = self._confirmed = self._asked = 0
        self._refusal = ""  # of the last frame to be confirmed
        self._is_armed = self._is_off = False
        self._untold: can.CanError | None = None
        self._let_go = ""
        self._silenced: Silenced | None = None
        self._alone: can.BusABC | None = None
        self._fault = ""
        self._heard_s = self._looked_s = clock.now_s()
        super().__init__(channel=settings.channel)

    @property
    def process_id(self) -> int:
        """Of the guardian."""
        return self._process.pid

    @property
    def state(self) -> can.BusState:
        """As the guardian last said it of the real bus."""
        return can.BusState.ERROR if self._is_off else can.BusState.ACTIVE

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        raise NotImplementedError("a bus held by a guardian is opened active and stays so")

    def describe(self) -> str:
        return f"lets go after {1e3 * self._silence_s:g} ms of silence"

    # -- commanding ----------------------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Forgets an earlier letting go. Raises can.CanError for what was not told yet, and where there is no guardian left."""
        self._look()
        self._raise_fault()
        self._raise_untold()
        self._arming += 1
        self._is_armed, self._let_go, self._silenced = True, "", None
        self._link.put(GuardianRecord(RecordKind.ARM, self._clock.now_s(), number=self._arming))
        self._link.flush()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 (the guardian's end is never waited for)
        self._look()
        if signature(msg) in self._always:
            self._send_and_wait(msg)
            return
        self._raise_fault()
        self._raise_untold()
        if not self._is_armed:
            raise LetGo(self._let_go or "guardian lets nothing pass that could move a drive which is not enabled")
        if not self._link.put(of_frame(msg, self._clock.now_s()), may_be_dropped=True):
            raise can.CanOperationError(f"the guardian takes nothing: {MOST_WAITING_BYTES} bytes wait for it")
        self._link.flush()

    def _send_and_wait(self, msg: can.Message) -> None:
        if not self._fault:
            self._asked += 1
            self._link.put(of_frame(msg, self._clock.now_s(), RecordKind.FRAME_TO_CONFIRM, self._asked))
            self._link.flush()
            self._await_confirmed()
        if self._alone is not None:
            self._alone.send(msg, timeout=0.0)
        elif self._fault or self._refusal:
            raise can.CanOperationError(self._fault or self._refusal)
        self._is_armed = self._is_armed and signature(msg) != self._closing

    def _await_confirmed(self) -> None:
        until_s = self._clock.now_s() + CONFIRMED_WITHIN_S
        while self._confirmed < self._asked and not self._fault:
            left_s = until_s - self._clock.now_s()
            if left_s < 0.0:
                self._take_over(f"guardian does not answer within {CONFIRMED_WITHIN_S:g} s")
                return
            self._link.wait(left_s)
            self._look()

    # -- hearing -------------------------------------------------------------------------------------------------------------

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._arrived:
            self._look()
        self._raise_untold()
        if not self._arrived and self._alone is not None:
            return self._alone.recv(timeout), False
        self._raise_fault()
        if not self._arrived and timeout != 0:
            self._link.wait(HUNG_S if timeout is None else min(timeout, HUNG_S))
            self._look()
            self._raise_untold()
        return (self._arrived.popleft() if self._arrived else None), False

    def await_let_go(self, limit_s: float) -> Silenced | None:
        """What the guardian did since the last `arm`; the frames that came meanwhile are there to be received."""
        until_s = self._clock.now_s() + limit_s
        while self._silenced is None and (left_s := until_s - self._clock.now_s()) > 0.0:
            self._link.wait(min(left_s, HUNG_S))
            self._look()
            self._raise_fault()
        if isinstance(self._untold, LetGo):
            self._untold = None
        self._raise_untold()
        return self._silenced

    def _look(self) -> None:
        """Takes in what the guardian said, and whether it is there."""
        if self._fault:
            return
        now_s = self._clock.now_s()
        if now_s - self._looked_s > 0.5 * HUNG_S:
            self._heard_s = max(self._heard_s, now_s)  # what it said while nobody listened may be lost
        self._looked_s = now_s
        for record in self._link.take():
            self._take(record)
        self._link.flush()
        if self._link.is_cut:
            self._take_over("guardian ended by itself")
        elif now_s - self._heard_s > HUNG_S:
            self._take_over(f"guardian hangs, silent for {now_s - self._heard_s:.2f} s")

    def _take(self, record: GuardianRecord) -> None:
        match record.kind:
            case RecordKind.FRAME:
                self._arrived.append(frame_of(record))
            case RecordKind.ALIVE:
                self._heard_s, self._is_off = max(self._heard_s, record.t_s), bool(record.number)
            case RecordKind.CONFIRMED:
                self._confirmed, self._refusal = record.number, record.text
            case RecordKind.BUS_ERROR:
                self._untold = can.CanOperationError(record.text)
            case RecordKind.LET_GO if record.number == self._arming:
                self._is_armed, self._let_go = False, record.text
                self._untold = self._untold or LetGo(record.text)
            case RecordKind.SILENCED if record.number == self._arming:
                self._silenced = silenced_of(record)

    def _raise_untold(self) -> None:
        """Once: stopping a rig needs to hear what the drive says afterwards."""
        untold, self._untold = self._untold, None
        if untold is not None:
            raise untold

    def _raise_fault(self) -> None:
        if self._fault:
            raise can.CanOperationError(self._fault)

    # -- without a guardian --------------------------------------------------------------------------------------------------

    def _take_over(self, why: str) -> None:
        """Whoever is left tells the drive to let go. A guardian that hangs is ended, lest it speak later."""
        why = f"{self._let_go}; {why}" if self._let_go else why
        self._process.kill()
        self._process.wait()
        self._is_armed = False
        try:
            self._alone = taken_over(self._settings, self._last_word, self._clock)
            self._fault = f"{why}; the drive was told to let go from here"
        except can.CanError as error:
            self._fault = f"{why}, and {error}; press the emergency stop"
        self._untold = can.CanOperationError(self._fault)

    def shutdown(self) -> None:
        """Ends the guardian, which lets go of a drive that was not let go before. Raises can.CanError where that is in doubt."""
        if self._is_shutdown:
            return
        super().shutdown()
        try:
            self._close()
        finally:
            self._link.close()
            if self._alone is not None:
                self._alone.shutdown()

    def _close(self) -> None:
        if self._fault:
            return
        self._link.put(GuardianRecord(RecordKind.CLOSE, self._clock.now_s()))
        self._link.flush()
        has_to_let_go = self._is_armed or (self._let_go and self._silenced is None)
        until_s = self._clock.now_s() + ENDED_WITHIN_S
        while not self._link.is_cut and (left_s := until_s - self._clock.now_s()) > 0.0:
            self._link.wait(left_s)
            for record in self._link.take():
                self._take(record)
        if has_to_let_go and self._silenced is None:
            said = self._untold or "it does not say that it did"
            raise can.CanOperationError(f"the guardian, left to let go of the drive: {said}; press the emergency stop")
        self._end_process()

    def _end_process(self) -> None:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(ENDED_WITHIN_S)
        self._process.kill()
        self._process.wait()


def _started(assignment: GuardianAssignment) -> tuple[subprocess.Popen[bytes], GuardianLink, str]:
    try:
        process, child = started(assignment)
    except OSError as error:
        raise can.CanInitializationError(f"no guardian can be started: {error}") from error
    with child:
        what, said = _first_words(child)
        if what != READY:
            process.kill()
            process.wait()
            raise can.CanInitializationError(said)
        return process, GuardianLink(socket.socket(fileno=os.dup(child.fileno()))), said


def _first_words(child: Connection) -> tuple[str, str]:
    try:
        if child.poll(STARTED_WITHIN_S):
            what, said = child.recv()
            return what, said
    except EOFError:
        return FAILED, "the guardian ended before it began"
    return FAILED, f"the guardian did not start within {STARTED_WITHIN_S:g} s"
