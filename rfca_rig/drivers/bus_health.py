"""Health of a CAN bus from the error frames of its controller, in the SocketCAN format (linux/can/error.h)."""

import can

from rfca_rig.errors import DeviceError

# Error classes, in the arbitration id.
CONTROLLER, BUS_OFF, RESTARTED, COUNTERS = 0x004, 0x040, 0x100, 0x200
# Bits of data byte 1 of an error frame of class CONTROLLER.
OVERFLOW, PASSIVE, ACTIVE = 0x01 | 0x02, 0x10 | 0x20, 0x40
# Below this error count a controller is error-active.
ACTIVE_AGAIN = 128


class BusHealth:
    """Takes in the error frames of one bus. `fault` warns that the bus is about to fail, while frames still pass.

    A controller counts up errors if no node acknowledges its frames, or if it receives invalid ones. From 128 on it is
    error-passive, and at 256 transmit errors it goes bus-off. With adapters that send no error frames nothing is counted.
    """

    def __init__(self) -> None:
        self.error_frames = 0
        self.overflows = 0
        # (transmit, receive) error counters, if the controller reports them.
        self.counters: tuple[int, int] | None = None
        self._passive = False

    def note(self, message: can.Message) -> None:
        """Takes in one error frame. Raises DeviceError if it reports bus-off."""
        self.error_frames += 1
        # Some adapters send shorter error frames than the eight bytes that the format has.
        classes, data = message.arbitration_id, bytes(message.data).ljust(8, b"\0")
        if classes & BUS_OFF:
            raise DeviceError(_OFF)
        if classes & COUNTERS:
            self.counters = data[6], data[7]
            # Counters below the limit show a recovery even if the frame that reports it was lost.
            self._passive &= max(self.counters) >= ACTIVE_AGAIN
        if classes & RESTARTED:
            self._passive = False
        if classes & CONTROLLER:
            self.overflows += bool(data[1] & OVERFLOW)
            self._passive = bool(data[1] & PASSIVE) or (self._passive and not data[1] & ACTIVE)

    def check_state(self, bus: can.BusABC) -> None:
        """Checks the bus state, for adapters that report bus-off without an error frame. Raises DeviceError if it is off."""
        if bus.state is can.BusState.ERROR:
            raise DeviceError(_OFF)

    @property
    def fault(self) -> str | None:
        """Warning in one line; None while the controller is error-active."""
        if not self._passive:
            return None
        counters = "" if self.counters is None else f", transmit and receive error counters {self.counters[0]} and {self.counters[1]}"
        return f"CAN controller is error-passive{counters}; check wiring, termination and bit rate, and that the drive has power"

    def facts(self) -> dict[str, str]:
        """For the recording."""
        return {"can_error_frames": str(self.error_frames), "can_overflows": str(self.overflows)}


_OFF = "CAN bus is off after too many errors; check wiring and bit rate, then restart the interface"
