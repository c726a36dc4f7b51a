"""What a driver and the guardian of its drive know of each other: who takes the torque away where commands stop coming."""

from dataclasses import dataclass
from math import nan
from typing import Protocol

import can

from rfca_rig.errors import DeviceError

LET_GO = 0.25  # of the torque held before: less is none


class LastWord(Protocol):
    """How a drive is told to let go, by somebody who knows nothing else of it. Pure, and a value that another process can be given."""

    def frames(self) -> tuple[can.Message, ...]:
        """Take the torque away, in this order, at any time, any number of times; the last one alone ends the driver's session."""
        ...

    def torque_Nm(self, message: can.Message) -> float | None:
        """The torque that a report of this drive shows, signed as the drive does; None for every other frame."""
        ...

    def least_Nm(self) -> float:
        """What cannot be told from none."""
        ...


class LetGo(can.CanError):
    """The guardian took the torque away. Nothing that could move the drive goes out before it is enabled anew."""


@dataclass(frozen=True)
class Silenced:
    """What a guardian did: it let go after `silent_s` without a command, and was done `took_s` later.

    Since then `reports` of the drive came, the last of which showed `torque_Nm` at the shaft; NaN where there was none.
    """

    silent_s: float
    took_s: float = 0.0
    reports: int = 0
    torque_Nm: float = nan


@dataclass(frozen=True)
class Proof:
    """A guardian that was starved once: the drive was seen without torque after `took_s`; `seen` says what that rests on."""

    took_s: float
    seen: str


class Guard(Protocol):
    """The guardian as a driver sees it."""

    def arm(self) -> None:
        """From now on commands must keep coming. To be called before the frame that energises the drive."""
        ...

    def await_let_go(self, limit_s: float) -> Silenced | None:
        """Sends nothing until the guardian let go, and returns what it did; None where it did nothing within `limit_s`."""
        ...

    def describe(self) -> str:
        """For the recording."""
        ...


def arm(guard: Guard) -> None:
    """Raises DeviceError where there is no guardian left, or an error of the bus not told yet."""
    try:
        guard.arm()
    except LetGo as error:
        raise DeviceError(str(error)) from error
    except can.CanError as error:
        raise DeviceError(f"drive not enabled: {error}") from error


def prove_guard(guard: Guard, held_Nm: float, least_Nm: float, limit_s: float, answers: bool) -> Proof:
    """Starves an enabled drive that holds `held_Nm`, of which less than `least_Nm` cannot be told from nothing.

    `answers` says that the drive reports only when it is spoken to, so that a report shows that the guardian's word reached it.
    Raises DeviceError where the guardian did nothing, the drive said nothing, or still shows a torque.
    """
    did = _what_it_did(guard, limit_s)
    if did is None:
        raise DeviceError(f"guardian not proven: it did nothing within {limit_s:g} s of silence; end this program and start it anew")
    if did.reports == 0:
        raise DeviceError(
            f"guardian not proven: it told the drive to let go after {1e3 * did.silent_s:.0f} ms, and the drive said nothing since; "
            "check its power and the CAN wiring"
        )
    if abs(did.torque_Nm) > max(LET_GO * abs(held_Nm), least_Nm):
        raise DeviceError(f"drive told to let go by the guardian, but it still shows {did.torque_Nm:.2f} N m; press the emergency stop")
    return Proof(did.silent_s + did.took_s, _seen(held_Nm, least_Nm, answers))


def _seen(held_Nm: float, least_Nm: float, answers: bool) -> str:
    if abs(held_Nm) >= least_Nm:
        return f"the {abs(held_Nm):.2f} N m that the motor held were gone"
    reached = "the drive answered the guardian" if answers else "the bus took the guardian's frames"
    return f"{reached}; the motor held nothing that could be seen to go"


def _what_it_did(guard: Guard, limit_s: float) -> Silenced | None:
    try:
        return guard.await_let_go(limit_s)
    except can.CanError as error:
        raise DeviceError(f"guardian not proven: {error}") from error
