"""A frame of classic CAN, whatever text or bytes carry it."""

from dataclasses import dataclass

from rfca_rig.codecs.malformed import MalformedFrame

STANDARD_IDS = 1 << 11
EXTENDED_IDS = 1 << 29
MOST_BYTES = 8


@dataclass(frozen=True, slots=True)
class ClassicFrame:
    """`remote` frames carry no data, only the `length` they ask for. Raises MalformedFrame for what no such frame can be."""

    can_id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    length: int = -1

    def __post_init__(self) -> None:
        if self.length < 0:
            object.__setattr__(self, "length", len(self.data))
        if not 0 <= self.can_id < (EXTENDED_IDS if self.extended else STANDARD_IDS):
            raise MalformedFrame(f"CAN identifier {self.can_id:#x} does not fit {29 if self.extended else 11} bits")
        if self.length > MOST_BYTES or len(self.data) != (0 if self.remote else self.length):
            raise MalformedFrame(f"CAN frame of length {self.length} with {len(self.data)} data bytes, limit {MOST_BYTES}")
