"""The last word to a drive, said until it shows."""

import can

from rfca_rig.drivers.guard import LastWord, Silenced

EVERY_S = 0.005
LEAST_TIMES = 3
FOR_S = 0.5
STUBBORN_S = 10.0  # on a bus that takes nothing: a cable may be plugged in again


class LettingGo:
    """One letting go, begun at `began_s`. Ends when the drive shows no torque, or after 0.5 s; not before the frames went out once."""

    def __init__(self, bus: can.BusABC, last_word: LastWord, began_s: float, silent_s: float) -> None:
        self._bus = bus
        self._last_word = last_word
        self._began_s = began_s
        self._next_s = began_s
        self._silent_s = silent_s
        self._said = 0
        self._reports = 0
        self._torque_Nm = float("nan")
        self._ended_s: float | None = None
        self.failure = ""

    @property
    def is_over(self) -> bool:
        return self._ended_s is not None

    def left_s(self, now_s: float) -> float:
        """Until there is something to do."""
        return max(self._next_s - now_s, 0.0)

    def step(self, now_s: float) -> None:
        """Speaks when it is time; `failure` says why the bus did not take it, and is empty where it did."""
        if self.is_over or now_s < self._next_s:
            return
        if now_s - self._began_s > (FOR_S if self._said else STUBBORN_S):
            self._ended_s = now_s
            return
        self._next_s = now_s + EVERY_S
        self.failure = self._say()
        self._said += not self.failure

    def _say(self) -> str:
        failure = ""
        for message in self._last_word.frames():
            try:
                self._bus.send(message, timeout=0.0)
            except Exception as error:  # python-can's interfaces raise all sorts, and nothing may keep the other frames back
                failure = f"{type(error).__name__}: {error}"
        return failure

    def hear(self, message: can.Message, now_s: float) -> None:
        """A frame of the bus. What was on its way when the word was spoken first proves nothing, so only what follows the third counts."""
        torque_Nm = self._last_word.torque_Nm(message)
        if torque_Nm is None or self._said < LEAST_TIMES or self.is_over:
            return
        self._reports += 1
        self._torque_Nm = torque_Nm
        if abs(torque_Nm) < self._last_word.least_Nm():
            self._ended_s = now_s

    def did(self) -> Silenced:
        ended_s = self._began_s if self._ended_s is None else self._ended_s
        return Silenced(self._silent_s, ended_s - self._began_s, self._reports, self._torque_Nm)
