"""How a CAN bus is opened, as a value that another process can be given."""

from dataclasses import dataclass

import can


@dataclass(frozen=True)
class CanBusSettings:
    """What python-can is told; its own configuration (`CAN_CONFIG`, can.conf) adds what is not named here.

    `data_bitrate` is that of CAN-FD's data phase, None for classic CAN.
    """

    interface: str
    channel: str
    bitrate: int
    data_bitrate: int | None = None

    def open(self) -> can.BusABC:
        """The bus, to be shut by the caller. Raises what python-can raises."""
        if self.data_bitrate is None:
            return can.Bus(interface=self.interface, channel=self.channel, bitrate=self.bitrate)
        return can.Bus(interface=self.interface, channel=self.channel, bitrate=self.bitrate, data_bitrate=self.data_bitrate, fd=True)
