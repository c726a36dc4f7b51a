"""Frames in and out of a CAN bus, with every failure of the bus as a DeviceError."""

from collections.abc import Iterator, Sequence

import can

from rfca_rig.clock import Clock
from rfca_rig.drivers.bus_health import BusHealth
from rfca_rig.drivers.guard import LetGo
from rfca_rig.errors import DeviceError

UNGUARDED = "press the emergency stop if it turns"
STOPPING_S = 0.02
RETRY_S = 1e-3
DAMMED_UP_S = 0.1  # who looks more rarely may find the system's buffer full, and frames missing anywhere in it


def arrived(bus: can.BusABC, health: BusHealth, remedy: str = UNGUARDED) -> Iterator[can.Message]:
    """Every data frame that the bus holds, oldest first; never waits.

    Error frames go to `health`. Raises DeviceError, with what to do, on a failing bus or one that went off.
    """
    try:
        while (message := bus.recv(timeout=0)) is not None:
            if message.is_error_frame:
                health.note(message)
            elif not message.is_remote_frame:
                yield message
        health.look_at(bus)
    except LetGo as error:
        raise DeviceError(str(error)) from error
    except (can.CanError, OSError) as error:
        raise DeviceError(f"CAN bus failed while reading the drive: {error}; {remedy}") from error


def send(bus: can.BusABC, message: can.Message, remedy: str = UNGUARDED) -> None:
    """Raises DeviceError when the bus does not take it."""
    try:
        bus.send(message, timeout=0.0)
    except LetGo as error:
        raise DeviceError(str(error)) from error
    except (can.CanError, OSError) as error:
        identifier = f"{message.arbitration_id:08x}" if message.is_extended_id else f"{message.arbitration_id:03x}"
        raise DeviceError(f"CAN frame 0x{identifier} to the drive not sent: {error}; {remedy}") from error


def send_stop(bus: can.BusABC, clock: Clock, messages: Sequence[can.Message], remedy: str = UNGUARDED) -> None:
    """Frames that take the torque away: one that is not taken is tried again, as a transmit queue may be full for a moment.

    Every frame is tried at least once, whatever became of the one before; all of it takes 20 ms at most. Raises DeviceError where
    one was not taken.
    """
    until_s = clock.now_s() + STOPPING_S
    failures = [failure for message in messages if (failure := _failure(bus, clock, message, remedy, until_s)) is not None]
    if failures:
        raise failures[0]


def _failure(bus: can.BusABC, clock: Clock, message: can.Message, remedy: str, until_s: float) -> DeviceError | None:
    while True:
        try:
            send(bus, message, remedy)
        except DeviceError as error:
            if clock.now_s() + RETRY_S > until_s:
                return error
            clock.wait_until(clock.now_s() + RETRY_S)
        else:
            return None
