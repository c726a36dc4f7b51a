"""Memory of an ODrive's twin: the settings in use, and those that it starts with. They are reached
by endpoints on the bus and by odrivetool's lines, as over USB.
"""

import re
from collections.abc import Mapping

from rfca_rig.devices.odrive import settings
from rfca_rig.devices.odrive.endpoints import Endpoint
from rfca_rig.devices.odrive.messages import OdriveFirmware
from rfca_rig.errors import BadInput

# Types of the values that are no floats.
_WHOLE_NUMBERS = "uint32"
# Numbers of the twin's endpoints, made up. `calibration/twin-endpoints.json` has the same.
_FIRST_ID = 40
_ID_STEP = 7
_ASSIGNMENT = re.compile(r"odrv0\.([\w.]+)(?:\s*=\s*(\S+))?")


def _number_endpoints() -> dict[str, Endpoint]:
    names = sorted(settings.factory_values(OdriveFirmware.V0_6))
    endpoints = {}
    for place, name in enumerate(names):
        kind = "float"
        if name in settings.SWITCHES:
            kind = "bool"
        elif name == settings.BAUD_RATE or name.startswith("axis0.config.can."):
            kind = _WHOLE_NUMBERS
        endpoints[name] = Endpoint(_FIRST_ID + _ID_STEP * place, kind)
    return endpoints


TWIN_ENDPOINTS: Mapping[str, Endpoint] = _number_endpoints()
_NAMES = {endpoint.endpoint_id: name for name, endpoint in TWIN_ENDPOINTS.items()}


class OdriveMemory:
    """`values` are in use. A restart takes them from what was saved."""

    def __init__(self, values: Mapping[str, float], factory: Mapping[str, float]) -> None:
        self.values = dict(values)
        self._saved = dict(values)
        self._factory = dict(factory)

    def save(self) -> None:
        self._saved = dict(self.values)

    def erase(self) -> None:
        """The settings from its maker become those that it starts with."""
        self._saved = dict(self._factory)

    def restart(self) -> None:
        """What was not saved is lost."""
        self.values = dict(self._saved)

    def find_endpoint(self, endpoint_id: int) -> tuple[str, Endpoint] | None:
        """Name and endpoint of a value that the drive has."""
        name = _NAMES.get(endpoint_id)
        if name is None or name not in self.values:
            return None
        return name, TWIN_ENDPOINTS[name]

    def type_line(self, line: str) -> str:
        """Sets or prints a value, as odrivetool does. Raises BadInput for a line that it would
        not take.
        """
        parts = _ASSIGNMENT.fullmatch(line.strip())
        if parts is None or parts[1] not in self.values:
            raise BadInput(f"odrivetool does not take {line.strip()[:80]!r}")
        name, text = parts.groups()
        if text is not None:
            self.values[name] = _read_value(text)
        return f"{self.values[name]:g}"


def _read_value(text: str) -> float:
    if text in ("True", "False"):
        return float(text == "True")
    try:
        return float(text)
    except ValueError:
        raise BadInput(f"odrivetool does not take the value {text[:40]!r}") from None
