"""Torque-off sequence: sends the torque-off frames until the drive's reports show no torque."""

import can

from rfca_rig.drivers.guard import TorqueOffFrames, TorqueOffResult

# Repetition interval and duration in s, see docs/guardian.md.
REPEAT_S = 0.005
# Repetitions before a report counts as an effect of the frames.
MIN_REPETITIONS = 3
MAX_DURATION_S = 0.5
# Duration in s on a bus that accepts nothing: a cable may be plugged in again.
BUS_FAILED_S = 10.0


class TorqueOffSequence:
    """One torque-off sequence, begun at `began_s`.

    It ends when the drive shows no torque, or after 0.5 s, but not before the frames have been sent once.
    """

    def __init__(self, bus: can.BusABC, last_word: TorqueOffFrames, began_s: float, silent_s: float) -> None:
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
        """Sends the frames if they are due. `failure` is the reason why the bus did not accept them, else empty."""
        if self.is_over or now_s < self._next_s:
            return
        if now_s - self._began_s > (MAX_DURATION_S if self._times_sent else BUS_FAILED_S):
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
            # The interfaces of python-can raise exceptions of many types, and the other frames must still be sent.
            except Exception as error:
                failure = f"{type(error).__name__}: {error}"
        return failure

    def hear(self, message: can.Message, now_s: float) -> None:
        """Takes in a frame of the bus. Reports already under way prove nothing, so only those after the third sending count."""
        torque_Nm = self._last_word.torque_Nm(message)
        if torque_Nm is None or self._times_sent < MIN_REPETITIONS or self.is_over:
            return
        self._reports += 1
        self._torque_Nm = torque_Nm
        if abs(torque_Nm) < self._last_word.min_visible_torque_Nm():
            self._ended_s = now_s

    def did(self) -> TorqueOffResult:
        """Result of the sequence, for the parent process."""
        end_s = self._began_s if self._ended_s is None else self._ended_s
        return TorqueOffResult(self._silent_s, end_s - self._began_s, self._reports, self._torque_Nm)
