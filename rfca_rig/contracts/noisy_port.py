"""Serial line with faults, for tests: lost, changed or missing bytes."""

from dataclasses import dataclass, field

from rfca_rig.twins.wires import HostEnd

# Bits to flip in a changed byte.
FLIPPED_BITS = 0x5A


@dataclass
class NoisyPort:
    """The driver's end of the line with faults: the next `drop` bytes are lost, the `spoil` bytes after them are changed.

    At most `most` bytes are reported as waiting at once.
    """

    end: HostEnd
    silent: bool = False
    drop: int = 0
    spoil: int = 0
    most: int = 1 << 16
    held: bytes = field(default=b"")

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived."""
        self._take()
        return min(self.most, len(self.held))

    def _take(self) -> None:
        data = self.end.read(self.end.in_waiting)
        if self.silent:
            data = b""
        lost, data = data[: self.drop], data[self.drop :]
        self.drop -= len(lost)
        spoilt, data = data[: self.spoil], data[self.spoil :]
        self.spoil -= len(spoilt)
        self.held += bytes(number ^ FLIPPED_BITS for number in spoilt) + data

    def read(self, size: int = 1) -> bytes:
        data, self.held = self.held[:size], self.held[size:]
        return data

    def write(self, data: bytes) -> int:
        return self.end.write(data)

    def close(self) -> None:
        self.end.close()
