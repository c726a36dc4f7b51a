"""Frames in and out of a CAN bus, with every failure of the bus as a DeviceError."""

from collections.abc import Iterator

import can

from rfca_rig.errors import DeviceError

CAN_ERROR_BUS_OFF = 0x40  # error class of a SocketCAN error frame (linux/can/error.h)


def arrived(bus: can.BusABC) -> Iterator[can.Message]:
    """Every data frame that the bus holds, oldest first; never waits. Raises DeviceError on a failing bus or one that went off."""
    try:
        while (message := bus.recv(timeout=0)) is not None:
            if message.is_error_frame:
                _raise_if_off(message.arbitration_id)
            elif not message.is_remote_frame:
                yield message
    except (can.CanError, OSError) as error:
        raise DeviceError(f"CAN bus failed while reading the drive: {error}; press the emergency stop if it turns") from error


def send(bus: can.BusABC, message: can.Message) -> None:
    """Raises DeviceError when the bus does not take it."""
    try:
        bus.send(message, timeout=0.0)
    except (can.CanError, OSError) as error:
        identifier = f"{message.arbitration_id:08x}" if message.is_extended_id else f"{message.arbitration_id:03x}"
        raise DeviceError(f"CAN frame 0x{identifier} to the drive not sent: {error}; press the emergency stop if it turns") from error


def _raise_if_off(error_class: int) -> None:
    if error_class & CAN_ERROR_BUS_OFF:
        raise DeviceError("CAN bus is off after too many errors; check wiring and bit rate, then restart the interface")
