"""Sending and receiving CAN frames; every bus failure becomes a DeviceError."""

from collections.abc import Iterator, Sequence

import can

from rfca_rig.clock import Clock
from rfca_rig.drivers.bus_health import BusHealth
from rfca_rig.drivers.guard import GuardianTorqueOff
from rfca_rig.errors import DeviceError

EMERGENCY_STOP_REMEDY = "press the emergency stop if it turns"
# Time in s for all torque-off frames together, and between two attempts. Drivers promise torque off within 20 ms.
STOPPING_S = 0.02
RETRY_S = 1e-3
# After a longer pause between two reads the receive buffer may have overflowed, with frames missing anywhere.
MAX_READ_PAUSE_S = 0.1


def receive_frames(bus: can.BusABC, health: BusHealth, remedy: str = EMERGENCY_STOP_REMEDY) -> Iterator[can.Message]:
    """Every data frame that the bus holds, oldest first; never waits.

    Error frames go to `health`. Raises DeviceError, with the remedy, if the bus fails or went bus-off.
    """
    try:
        while (message := bus.recv(timeout=0)) is not None:
            if message.is_error_frame:
                health.note(message)
            elif not message.is_remote_frame:
                yield message
        # Not every adapter reports bus-off by an error frame.
        health.check_state(bus)
    # A torque-off by the guardian is reported with its own text, not as a bus failure.
    except GuardianTorqueOff as error:
        raise DeviceError(str(error)) from error
    except (can.CanError, OSError) as error:
        raise DeviceError(f"CAN bus failed while reading the drive: {error}; {remedy}") from error


def send(bus: can.BusABC, message: can.Message, remedy: str = EMERGENCY_STOP_REMEDY) -> None:
    """Sends one frame without waiting. Raises DeviceError, with the remedy, if the bus does not accept it."""
    try:
        bus.send(message, timeout=0.0)
    except GuardianTorqueOff as error:
        raise DeviceError(str(error)) from error
    except (can.CanError, OSError) as error:
        identifier = f"{message.arbitration_id:08x}" if message.is_extended_id else f"{message.arbitration_id:03x}"
        raise DeviceError(f"CAN frame 0x{identifier} to the drive not sent: {error}; {remedy}") from error


def send_stop(bus: can.BusABC, clock: Clock, messages: Sequence[can.Message], remedy: str = EMERGENCY_STOP_REMEDY) -> None:
    """Sends torque-off frames. A frame that is not accepted is tried again, as the transmit queue may be full for a moment.

    Every frame is tried at least once, even if the one before failed; all of it takes 20 ms at most. Raises DeviceError if one was
    not accepted.
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
