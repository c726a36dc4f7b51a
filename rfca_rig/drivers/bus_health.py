"""How the CAN controller says the bus is: its error frames, in the form that SocketCAN gives them (linux/can/error.h)."""

import can

from rfca_rig.errors import DeviceError

CONTROLLER, BUS_OFF, RESTARTED, COUNTERS = 0x004, 0x040, 0x100, 0x200  # error classes, in the arbitration id
OVERFLOW, PASSIVE, ACTIVE = 0x01 | 0x02, 0x10 | 0x20, 0x40  # in data byte 1 of CONTROLLER
ACTIVE_AGAIN = 128  # a controller whose counters are below that is error-active


class BusHealth:
    """Takes in the error frames of one bus. `fault` says that the bus is about to be lost, while frames still pass.

    A controller whose frames nobody acknowledges, or that hears garbage, counts errors up; from 128 on it is error-passive, and
    at 256 sent in vain it goes off. Adapters that send no error frames leave all of this at nothing.
    """

    def __init__(self) -> None:
        self.error_frames = 0
        self.overflows = 0
        self.counters: tuple[int, int] | None = None  # (transmit, receive), where the controller tells them
        self._passive = False

    def note(self, message: can.Message) -> None:
        """Takes in one error frame. Raises DeviceError where it says that the bus is off."""
        self.error_frames += 1
        classes, data = message.arbitration_id, bytes(message.data).ljust(8, b"\0")
        if classes & BUS_OFF:
            raise DeviceError(_OFF)
        if classes & COUNTERS:
            self.counters = data[6], data[7]
            self._passive &= max(self.counters) >= ACTIVE_AGAIN
        if classes & RESTARTED:
            self._passive = False
        if classes & CONTROLLER:
            self.overflows += bool(data[1] & OVERFLOW)
            self._passive = bool(data[1] & PASSIVE) or (self._passive and not data[1] & ACTIVE)

    def look_at(self, bus: can.BusABC) -> None:
        """For adapters that tell it without a frame. Raises DeviceError where the bus is off."""
        if bus.state is can.BusState.ERROR:
            raise DeviceError(_OFF)

    @property
    def fault(self) -> str | None:
        """In one line, None while the controller is error-active."""
        if not self._passive:
            return None
        counters = "" if self.counters is None else f", transmit and receive error counters {self.counters[0]} and {self.counters[1]}"
        return f"CAN controller is error-passive{counters}; check wiring, termination and bit rate, and that the drive has power"

    def facts(self) -> dict[str, str]:
        """For the recording."""
        return {"can_error_frames": str(self.error_frames), "can_overflows": str(self.overflows)}


_OFF = "CAN bus is off after too many errors; check wiring and bit rate, then restart the interface"
