"""Interface between a driver and its guardian, the process that disables the motor when commands
stop. See docs/guardian.md.
"""

from dataclasses import dataclass
from math import nan
from typing import Protocol

import can

from rfca_rig.errors import DeviceError

# Share of the torque held before the silence. Below it the motor counts as off.
TORQUE_OFF_SHARE = 0.25


class TorqueOffFrames(Protocol):
    """Torque-off frames of one drive, for a sender that knows nothing else about it. Pure and
    picklable, so the guardian can have it.
    """

    def frames(self) -> tuple[can.Message, ...]:
        """Frames that disable the motor, in this order, at any time, any number of times. The
        last one alone ends the driver's session.
        """
        ...

    def torque_Nm(self, message: can.Message) -> float | None:
        """Torque in N m that a report of this drive shows, in the sign of the drive; None for
        every other frame.
        """
        ...

    def min_visible_torque_Nm(self) -> float:
        """Smallest torque in N m that can be distinguished from zero."""
        ...


class GuardianTorqueOff(can.CanError):
    """The guardian disabled the motor. No frame that could move the drive is sent until it is
    enabled again.
    """


@dataclass(frozen=True)
class TorqueOffResult:
    """Result of a torque-off by the guardian: it began after `silent_s` without a command and was
    finished `took_s` later.

    `reports` counts the drive's reports since then. The last one showed `torque_Nm` at the shaft,
    NaN if there was none.
    """

    silent_s: float
    took_s: float = 0.0
    reports: int = 0
    torque_Nm: float = nan


@dataclass(frozen=True)
class GuardianProof:
    """Result of a guardian test: the drive was without torque after `took_s`. `seen` names the
    evidence.
    """

    took_s: float
    seen: str


class Guard(Protocol):
    """The guardian, as seen by the driver."""

    def arm(self) -> None:
        """From now on a gap in the commands disables the motor. Call it before the frame that
        energises the drive.
        """
        ...

    def await_let_go(self, limit_s: float) -> TorqueOffResult | None:
        """Sends nothing until the guardian has disabled the motor; returns what it did, None if
        it did nothing within `limit_s`.
        """
        ...

    def describe(self) -> str:
        """One line for the recording."""
        ...


def arm(guard: Guard) -> None:
    """Arms the guardian. Raises DeviceError if it has ended, or if a bus error has not been
    reported yet.
    """
    try:
        guard.arm()
    except GuardianTorqueOff as error:
        raise DeviceError(str(error)) from error
    except can.CanError as error:
        raise DeviceError(f"drive not enabled: {error}") from error


def prove_guard(
    guard: Guard, held_Nm: float, least_Nm: float, limit_s: float, answers: bool
) -> GuardianProof:
    """Tests the guardian: stops the commands to an enabled drive and checks that its torque
    disappears.

    Parameters
    ----------
    guard : Guard
        The armed guardian.
    held_Nm : float
        Shaft torque that the drive held before, in N m.
    least_Nm : float
        Smallest torque that the drive's reports distinguish from zero, in N m.
    limit_s : float
        Time within which the guardian must have acted.
    answers : bool
        True if the drive reports only when it is sent a frame. A report then shows that the
        guardian's frame arrived.

    Raises
    ------
    DeviceError
        If the guardian silenced nothing, the drive sent nothing, or it still shows a torque.
    """
    try:
        silenced = guard.await_let_go(limit_s)
    except can.CanError as error:
        raise DeviceError(f"guardian not proven: {error}") from error
    if silenced is None:
        raise DeviceError(
            f"guardian not proven: it did nothing within {limit_s:g} s of silence; end "
            "this program and start it again"
        )
    # Without a report there is no evidence either way, so a silent drive is never accepted as off.
    if silenced.reports == 0:
        raise DeviceError(
            "guardian not proven: it disabled the drive after "
            f"{1e3 * silenced.silent_s:.0f} ms, and the drive has sent nothing since; "
            "check its power and the CAN wiring"
        )
    # A light load makes a quarter of it too small to be measured; the reports' resolution is then
    # the limit. Written so that a torque that is no number, held or left, is no proof.
    if not abs(silenced.torque_Nm) <= max(least_Nm, TORQUE_OFF_SHARE * abs(held_Nm)):
        raise DeviceError(
            "the guardian disabled the drive, but it still shows "
            f"{silenced.torque_Nm:.2f} N m; press the emergency stop"
        )
    return GuardianProof(silenced.silent_s + silenced.took_s, _evidence(held_Nm, least_Nm, answers))


def _evidence(held_Nm: float, least_Nm: float, answers: bool) -> str:
    if abs(held_Nm) >= least_Nm:
        return f"the {abs(held_Nm):.2f} N m that the motor held were gone"
    # Without a load the torque cannot be seen to disappear: only the delivery of the frames is
    # shown.
    if answers:
        reached = "the drive answered the guardian"
    else:
        reached = "the bus took the guardian's frames"
    return f"{reached}; the motor held nothing that could be seen to go"
