"""CAN bus held by a guardian: a `can.BusABC` for the process that sends the commands."""

import os
import socket
import subprocess
import sys
from collections import deque
from contextlib import suppress
from multiprocessing.connection import Connection

import can

from rfca_rig import subprocesses
from rfca_rig.clock import Clock, WallClock
from rfca_rig.drivers.can_frames import CanBusSettings
from rfca_rig.drivers.guard import GuardianTorqueOff, TorqueOffFrames, TorqueOffResult
from rfca_rig.guardian.link import (
    MAX_QUEUED_BYTES,
    GuardianLink,
    GuardianRecord,
    RecordKind,
    decode_result,
    from_frame,
    to_frame,
)
from rfca_rig.guardian.process import (
    FAILED,
    MIN_REPETITIONS,
    READY,
    REPEAT_S,
    GuardianAssignment,
    run_guardian,
    signature,
)

MODULE = "rfca_rig.guardian.guarded_bus"

# A new interpreter has to start and open the bus.
STARTED_WITHIN_S = 30.0
# Time in s for a confirmation. MAX_GUARDIAN_SILENCE_S is the silence after which the guardian
# counts as hung; it reports every 20 ms.
CONFIRMED_WITHIN_S = 0.25
ENDED_WITHIN_S = 1.0
MAX_GUARDIAN_SILENCE_S = 0.25
MAX_QUEUED_FRAMES = 1 << 16


def start_guardian(assignment: GuardianAssignment) -> tuple[subprocess.Popen[bytes], Connection]:
    """Starts the guardian process; returns it and a connection to it."""
    return subprocesses.spawn(MODULE, assignment)


def take_over_bus(settings: CanBusSettings, last_word: TorqueOffFrames, clock: Clock) -> can.BusABC:
    """Opens the bus in this process and sends the torque-off frames a few times. Raises
    can.CanError if that fails.
    """
    try:
        bus = settings.open()
    # Interfaces of python-can raise exceptions of many types.
    except Exception as error:
        raise can.CanInitializationError(
            f"the bus cannot be opened here: {str(error) or type(error).__name__}"
        ) from error
    try:
        for _ in range(MIN_REPETITIONS):
            for message in last_word.frames():
                bus.send(message, timeout=0.0)
            clock.wait_until(clock.now_s() + REPEAT_S)
    except Exception as error:
        bus.shutdown()
        raise can.CanOperationError(
            f"the drive cannot be commanded from here: {str(error) or type(error).__name__}"
        ) from error
    return bus


class GuardedBus(can.BusABC):
    """CAN bus behind a guardian; also implements `drivers.guard.Guard`. Only sending torque-off
    frames waits.

    Torque-off frames pass at any time, and `send` returns once the guardian has put them on the
    bus. Other frames pass after `arm`, as long as no two are further apart than `silence_s`. After
    a longer gap the guardian disables the motor; the next call raises LetGo, and so does every
    later frame that could move the drive, until `arm`. Errors of the real bus are raised by the
    next call. If the guardian itself ends or hangs, this process opens the bus and disables the
    motor; the next call reports it.
    """

    def __init__(
        self,
        settings: CanBusSettings,
        last_word: TorqueOffFrames,
        silence_s: float,
        clock: WallClock,
    ) -> None:
        """Starts the guardian. Raises can.CanInitializationError if it does not start, or cannot
        open the bus.
        """
        self._settings = settings
        self._last_word = last_word
        self._silence_s = silence_s
        self._clock = clock
        self._always = {signature(message) for message in last_word.frames()}
        self._closing = signature(last_word.frames()[-1])
        # For the case that the guardian ends and this process takes over.
        settings.preload()
        self._process, self._link, info = _start_guardian(
            GuardianAssignment(settings, last_word, silence_s, clock)
        )
        self.channel_info = f"{info}, held by a guardian"
        self._arrived: deque[can.Message] = deque(maxlen=MAX_QUEUED_FRAMES)
        self._arming = self._confirmed = self._asked = 0
        # Why the last frame to be confirmed was refused.
        self._refusal = ""
        self._is_armed = self._is_off = False
        self._pending_error: can.CanError | None = None
        self._let_go = ""
        self._silenced: TorqueOffResult | None = None
        self._own_bus: can.BusABC | None = None
        self._fault = ""
        self._heard_s = self._looked_s = clock.now_s()
        super().__init__(channel=settings.channel)

    @property
    def process_id(self) -> int:
        """Process id of the guardian."""
        return self._process.pid

    @property
    def state(self) -> can.BusState:
        """State of the real bus, as last reported by the guardian."""
        if self._is_off:
            return can.BusState.ERROR
        return can.BusState.ACTIVE

    @state.setter
    def state(self, new_state: can.BusState) -> None:
        raise NotImplementedError("a bus held by a guardian is opened active and stays so")

    def describe(self) -> str:
        return f"disables the motor after {1e3 * self._silence_s:g} ms of silence"

    # -- sending
    # ----------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Arms the guardian and forgets an earlier torque-off.

        Raises can.CanError for an error that was not reported yet, and if the guardian has ended.
        """
        self._update()
        self._raise_fault()
        self._raise_pending_error()
        # The number separates reports about this arming from late ones about an earlier one.
        self._arming += 1
        self._is_armed = True
        self._let_go = ""
        self._silenced = None
        self._link.put(GuardianRecord(RecordKind.ARM, self._clock.now_s(), number=self._arming))
        self._link.flush()

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002 (the guardian's end is never waited for)
        self._update()
        # Torque-off frames are exempt from all checks below.
        if signature(msg) in self._always:
            if not self._fault:
                self._asked += 1
                self._link.put(
                    from_frame(msg, self._clock.now_s(), RecordKind.FRAME_TO_CONFIRM, self._asked)
                )
                self._link.flush()
                self._await_confirmed()
            if self._own_bus is not None:
                self._own_bus.send(msg, timeout=0.0)
            elif self._fault or self._refusal:
                raise can.CanOperationError(self._fault or self._refusal)
            # The last torque-off frame ends the session; until `arm` nothing else passes.
            self._is_armed = self._is_armed and signature(msg) != self._closing
            return
        self._raise_fault()
        self._raise_pending_error()
        if not self._is_armed:
            raise GuardianTorqueOff(
                self._let_go
                or "guardian lets nothing pass that could move a drive which is not enabled"
            )
        if not self._link.put(from_frame(msg, self._clock.now_s()), may_be_dropped=True):
            raise can.CanOperationError(
                f"the guardian takes nothing: {MAX_QUEUED_BYTES} bytes wait for it"
            )
        self._link.flush()

    def _await_confirmed(self) -> None:
        until_s = self._clock.now_s() + CONFIRMED_WITHIN_S
        while self._confirmed < self._asked and not self._fault:
            left_s = until_s - self._clock.now_s()
            if left_s < 0.0:
                self._take_over(f"guardian does not answer within {CONFIRMED_WITHIN_S:g} s")
                return
            self._link.wait(left_s)
            self._update()

    # -- receiving
    # ----------------------------------------------------------------------------------------------

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        if not self._arrived:
            self._update()
        self._raise_pending_error()
        if not self._arrived and self._own_bus is not None:
            return self._own_bus.recv(timeout), False
        self._raise_fault()
        if not self._arrived and timeout != 0:
            wait_s = MAX_GUARDIAN_SILENCE_S
            if timeout is not None:
                wait_s = min(timeout, MAX_GUARDIAN_SILENCE_S)
            self._link.wait(wait_s)
            self._update()
            self._raise_pending_error()
        if self._arrived:
            return self._arrived.popleft(), False
        return None, False

    def await_let_go(self, limit_s: float) -> TorqueOffResult | None:
        """Waits for a torque-off by the guardian since the last `arm`; frames that arrive
        meanwhile can be received afterwards.
        """
        until_s = self._clock.now_s() + limit_s
        while self._silenced is None and (left_s := until_s - self._clock.now_s()) > 0.0:
            self._link.wait(min(left_s, MAX_GUARDIAN_SILENCE_S))
            self._update()
            self._raise_fault()
        # This torque-off was expected, so it is not raised as an error.
        if isinstance(self._pending_error, GuardianTorqueOff):
            self._pending_error = None
        self._raise_pending_error()
        return self._silenced

    def _update(self) -> None:
        """Reads the guardian's messages, and checks that it is alive."""
        if self._fault:
            return
        now_s = self._clock.now_s()
        if now_s - self._looked_s > 0.5 * MAX_GUARDIAN_SILENCE_S:
            # This process itself was late: alive messages may have been dropped, so the silence
            # restarts.
            self._heard_s = max(self._heard_s, now_s)
        self._looked_s = now_s
        for record in self._link.take():
            self._take(record)
        self._link.flush()
        if self._link.is_cut:
            self._take_over("guardian ended by itself")
        elif now_s - self._heard_s > MAX_GUARDIAN_SILENCE_S:
            self._take_over(f"guardian hangs, silent for {now_s - self._heard_s:.2f} s")

    def _take(self, record: GuardianRecord) -> None:
        match record.kind:
            case RecordKind.FRAME:
                self._arrived.append(to_frame(record))
            case RecordKind.ALIVE:
                self._heard_s = max(self._heard_s, record.t_s)
                self._is_off = bool(record.number)
            case RecordKind.CONFIRMED:
                self._confirmed = record.number
                self._refusal = record.text
            case RecordKind.BUS_ERROR:
                self._pending_error = can.CanOperationError(record.text)
            case RecordKind.LET_GO if record.number == self._arming:
                self._is_armed = False
                self._let_go = record.text
                self._pending_error = self._pending_error or GuardianTorqueOff(record.text)
            case RecordKind.SILENCED if record.number == self._arming:
                self._silenced = decode_result(record)

    def _raise_pending_error(self) -> None:
        """Raises a pending error once: to stop a rig, later reports of the drive must still be
        readable.
        """
        untold = self._pending_error
        self._pending_error = None
        if untold is not None:
            raise untold

    def _raise_fault(self) -> None:
        if self._fault:
            raise can.CanOperationError(self._fault)

    # -- after the guardian has failed
    # ---------------------------------------------------------------------------------------

    def _take_over(self, why: str) -> None:
        """Disables the motor from this process. A hung guardian is killed first, so that it
        cannot send anything later.
        """
        if self._let_go:
            why = f"{self._let_go}; {why}"
        self._process.kill()
        self._process.wait()
        self._is_armed = False
        try:
            self._own_bus = take_over_bus(self._settings, self._last_word, self._clock)
            self._fault = f"{why}; the drive was disabled from here"
        except can.CanError as error:
            self._fault = f"{why}, and {error}; press the emergency stop"
        self._pending_error = can.CanOperationError(self._fault)

    def shutdown(self) -> None:
        """Ends the guardian, which disables a motor that is still on. Raises can.CanError if it
        does not confirm that.
        """
        if self._is_shutdown:
            return
        super().shutdown()
        try:
            self._close()
        finally:
            self._link.close()
            if self._own_bus is not None:
                self._own_bus.shutdown()

    def _close(self) -> None:
        if self._fault:
            return
        self._link.put(GuardianRecord(RecordKind.CLOSE, self._clock.now_s()))
        self._link.flush()
        must_disable = self._is_armed or (self._let_go and self._silenced is None)
        until_s = self._clock.now_s() + ENDED_WITHIN_S
        while not self._link.is_cut and (left_s := until_s - self._clock.now_s()) > 0.0:
            self._link.wait(left_s)
            for record in self._link.take():
                self._take(record)
        if must_disable and self._silenced is None:
            reason = self._pending_error or "it does not say that it did"
            raise can.CanOperationError(
                f"the guardian, left to let go of the drive: {reason}; press the emergency stop"
            )
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(ENDED_WITHIN_S)
        self._process.kill()
        self._process.wait()


def _start_guardian(
    assignment: GuardianAssignment,
) -> tuple[subprocess.Popen[bytes], GuardianLink, str]:
    try:
        process, child = start_guardian(assignment)
    except OSError as error:
        raise can.CanInitializationError(f"no guardian can be started: {error}") from error
    with child:
        state, message = _read_first_message(child)
        if state != READY:
            process.kill()
            process.wait()
            raise can.CanInitializationError(message)
        # The descriptor is duplicated, as the connection closes its own at the end of the block.
        return process, GuardianLink(socket.socket(fileno=os.dup(child.fileno()))), message


def _read_first_message(child: Connection) -> tuple[str, str]:
    try:
        if child.poll(STARTED_WITHIN_S):
            state, message = child.recv()
            return state, message
    except EOFError:
        return FAILED, "the guardian ended before it began"
    return FAILED, f"the guardian did not start within {STARTED_WITHIN_S:g} s"


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as parent:
        run_guardian(parent)
