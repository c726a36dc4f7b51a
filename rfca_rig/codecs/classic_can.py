"""A frame of classic CAN, independent of its transport."""

from dataclasses import dataclass

from rfca_rig.errors import MalformedFrame

STANDARD_IDS = 1 << 11
EXTENDED_IDS = 1 << 29
MAX_BYTES = 8


@dataclass(frozen=True, slots=True)
class ClassicFrame:
    """A frame. `remote` frames carry no data, only the `length` that they request. Raises MalformedFrame for an impossible frame."""

    can_id: int
    data: bytes = b""
    extended: bool = False
    remote: bool = False
    length: int = -1

    def __post_init__(self) -> None:
        # A frozen dataclass can set a default that depends on another field only this way.
        if self.length < 0:
            object.__setattr__(self, "length", len(self.data))
        if not 0 <= self.can_id < (EXTENDED_IDS if self.extended else STANDARD_IDS):
            raise MalformedFrame(f"CAN identifier {self.can_id:#x} does not fit {29 if self.extended else 11} bits")
        if self.length > MAX_BYTES or len(self.data) != (0 if self.remote else self.length):
            raise MalformedFrame(f"CAN frame of length {self.length} with {len(self.data)} data bytes, limit {MAX_BYTES}")
