"""A proposed experiment as the protocol file that `rfca-rig dynamic run` and `rfca-rig static run` take."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.description.protocol_file import DynamicFile, StaticFile
from rfca_rig.description.toml import checked
from rfca_rig.recording.atomic import write_atomically

NEXT_PROTOCOL = "next-experiment.toml"
SWEEP_DEG = 200.0  # from the start angle through the ground and up again
SWEEP_RAD = float(np.radians(SWEEP_DEG))
RETURN_RAD_S = 3.0  # at most: no faster than the stroke, which is known to be within the limits
MOVE_RAD_S = 0.4
AVERAGE_S = 0.5
AT_REST: Mapping[str, float] = {"force_band_N": 0.3, "angle_band_deg": 0.2, "for_s": 0.3, "limit_s": 10.0}
SETTLED: Mapping[str, float] = {"force_band_N": 0.1, "angle_band_deg": 0.05, "for_s": 0.5, "limit_s": 15.0}


def protocol_of(proposal: Mapping[str, Any]) -> DynamicFile | StaticFile:
    """The protocol of a proposal with a height, and a speed or stages. Raises BadInput where no rig could take it."""
    if "speed_rad_s" in proposal:
        return checked(_dynamic(proposal), DynamicFile, "the next experiment")
    return checked(_static(proposal), StaticFile, "the next experiment")


def write_next_protocol(folder: Path, proposal: Mapping[str, Any] | None) -> Path | None:
    """Writes the protocol into `folder`; where none is proposed for the rig, one that lies there is taken away. Raises RigError."""
    path = folder / NEXT_PROTOCOL
    if proposal is None or proposal["protocol"] is None:
        path.unlink(missing_ok=True)
        return None
    content = protocol_of(proposal).model_dump(mode="json", exclude_unset=True)
    write_atomically(path, (f"# {proposal['why']}\n" + _toml(content)).encode("utf-8"))
    return path


def _dynamic(proposal: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "experiment": "dynamic",
        "title": "next experiment",
        "repeats": proposal.get("repeats", 1),
        "sweep_deg": SWEEP_DEG,
        "return_speed_rad_s": min(RETURN_RAD_S, proposal["speed_rad_s"]),
        "settle": AT_REST,
        "conditions": [{"height_mm": proposal["height_mm"], "speed_rad_s": proposal["speed_rad_s"]}],
    }


def _static(proposal: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "experiment": "static",
        "title": "next experiment",
        "heights_mm": [proposal["height_mm"]],
        "move_speed_rad_s": MOVE_RAD_S,
        "average_s": AVERAGE_S,
        "settle": SETTLED,
        "stages": proposal["stages"],
    }


def _toml(content: Mapping[str, Any]) -> str:
    """Plain keys first, then tables, then lists of tables."""
    tables = {name: value for name, value in content.items() if isinstance(value, dict)}
    lists = {name: value for name, value in content.items() if isinstance(value, list) and isinstance(value[0], dict)}
    plain = {name: value for name, value in content.items() if name not in tables and name not in lists}
    parts = [_keys(plain), *(f"[{name}]\n{_keys(table)}" for name, table in tables.items())]
    parts += [f"[[{name}]]\n{_keys(entry)}" for name, entries in lists.items() for entry in entries]
    return "\n".join(parts)


def _keys(values: Mapping[str, Any]) -> str:
    """Text without quotes, numbers and lists of numbers are written alike in Python and TOML."""
    return "".join(f'{name} = "{value}"\n' if isinstance(value, str) else f"{name} = {value}\n" for name, value in values.items())
