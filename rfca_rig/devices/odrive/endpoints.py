"""ODrive's `flat_endpoints.json`: the numbers by which firmware 0.6 knows its values on the bus.

They differ from firmware to firmware. The file of a firmware is on ODrive's page of firmware
releases. A value is four bytes or fewer, little-endian, as the type of its endpoint says.
"""

import json
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rfca_rig.devices.odrive.messages import Version
from rfca_rig.errors import BadInput
from rfca_rig.toml import read_text

RELEASES = "https://docs.odriverobotics.com/releases/firmware"
# By the type in the file. Types of eight bytes do not fit a frame, and no setting has one.
LAYOUTS = {
    "bool": struct.Struct("<?"),
    "uint8": struct.Struct("<B"),
    "int8": struct.Struct("<b"),
    "uint16": struct.Struct("<H"),
    "int16": struct.Struct("<h"),
    "uint32": struct.Struct("<I"),
    "int32": struct.Struct("<i"),
    "float": struct.Struct("<f"),
}
MAX_ENDPOINT_ID = 0xFFFF


@dataclass(frozen=True)
class Endpoint:
    """A value of the drive: its number, and its type as in `LAYOUTS`."""

    endpoint_id: int
    kind: str

    def encode(self, value: float) -> bytes:
        """The bytes of a value; whole numbers are rounded."""
        if self.kind == "float":
            return LAYOUTS[self.kind].pack(value)
        return LAYOUTS[self.kind].pack(round(value))

    def decode(self, data: bytes) -> float | None:
        """The value in the first bytes; None for too few of them."""
        layout = LAYOUTS[self.kind]
        if len(data) < layout.size:
            return None
        return float(layout.unpack_from(data)[0])


@dataclass(frozen=True)
class EndpointFile:
    """Endpoints by their paths, and the versions of firmware and board that have them."""

    source: str
    firmware: str
    hardware: str
    endpoints: Mapping[str, Endpoint]

    def check_version(self, version: Version) -> None:
        """Raises BadInput for a drive that has other endpoints."""
        firmware = ".".join(map(str, version.firmware))
        hardware = ".".join(map(str, version.hardware))
        if (firmware, hardware) != (self.firmware, self.hardware):
            raise BadInput(
                f"{self.source}: is for firmware {self.firmware} on board {self.hardware}, the "
                f"drive has {firmware} on board {hardware}; take the file of that firmware and "
                f"board from {RELEASES}"
            )


def read_endpoint_file(path: Path) -> EndpointFile:
    """Raises BadInput for a file that is not ODrive's `flat_endpoints.json`."""
    try:
        content = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        raise BadInput(f"{path}: is no JSON: {error}; {_where()}") from error
    if not isinstance(content, dict) or not isinstance(content.get("endpoints"), dict):
        raise BadInput(f"{path}: has no table of endpoints; {_where()}")
    firmware = content.get("fw_version")
    hardware = content.get("hw_version")
    if not isinstance(firmware, str) or not isinstance(hardware, str):
        raise BadInput(f"{path}: does not say fw_version and hw_version; {_where()}")
    endpoints = {}
    for name, entry in content["endpoints"].items():
        endpoint = _read_endpoint(entry)
        if endpoint is not None:
            endpoints[name] = endpoint
    return EndpointFile(str(path), firmware, hardware, endpoints)


def _read_endpoint(entry: Any) -> Endpoint | None:
    """None for a function, and for a type that no setting has."""
    if not isinstance(entry, dict):
        return None
    number = entry.get("id")
    kind = entry.get("type")
    if not isinstance(number, int) or not 0 <= number <= MAX_ENDPOINT_ID or kind not in LAYOUTS:
        return None
    return Endpoint(number, str(kind))


def _where() -> str:
    return f"take the flat_endpoints.json of the drive's firmware from {RELEASES}"
