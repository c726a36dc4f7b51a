"""Settings of a CAN bus, as a picklable value that another process can open."""

from dataclasses import dataclass

import can


@dataclass(frozen=True)
class CanBusSettings:
    """Arguments of `can.Bus`; python-can's own configuration (`CAN_CONFIG`, can.conf) supplies the rest.

    `data_bitrate` is the bit rate of the CAN-FD data phase, None for classic CAN.
    """

    interface: str
    channel: str
    bitrate: int
    data_bitrate: int | None = None

    def open(self) -> can.BusABC:
        """Opens the bus; the caller shuts it down. Raises what python-can raises."""
        if self.data_bitrate is None:
            return can.Bus(interface=self.interface, channel=self.channel, bitrate=self.bitrate)
        return can.Bus(interface=self.interface, channel=self.channel, bitrate=self.bitrate, data_bitrate=self.data_bitrate, fd=True)
