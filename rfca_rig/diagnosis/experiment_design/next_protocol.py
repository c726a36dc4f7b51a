"""A proposed experiment as the protocol file that `rfca-rig dynamic run` and `rfca-rig static run` take."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rfca_rig.description.protocol_file import DynamicFile, StaticFile
from rfca_rig.description.toml import validate
from rfca_rig.description.toml_writing import comment, format_value, table
from rfca_rig.recording.atomic import write_atomically

NEXT_PROTOCOL = "next-experiment.toml"
# Settling and speeds as in protocols/static-angle.toml and protocols/flapping.toml
STATIC: Mapping[str, Any] = {
    "move_speed_rad_s": 0.4,
    "average_s": 0.5,
    "settle": {"force_band_N": 0.1, "angle_band_deg": 0.05, "for_s": 0.5, "limit_s": 15.0},
}
DYNAMIC: Mapping[str, Any] = {
    "sweep_deg": 200.0,  # from the start angle through the ground and up again
    "return_speed_rad_s": 3.0,  # at most: a stroke's speed is within the limits, a greater one may not be
    "settle": {"force_band_N": 0.3, "angle_band_deg": 0.2, "for_s": 0.3, "limit_s": 10.0},
}


def make_protocol(proposal: Mapping[str, Any]) -> DynamicFile | StaticFile:
    """The protocol of a proposal with "height_mm", and "speed_rad_s" or "stages". Raises BadInput where no rig can do it."""
    title, height_mm = "next experiment", proposal["height_mm"]
    if "speed_rad_s" not in proposal:
        static = {"experiment": "static", "title": title, "heights_mm": [height_mm], **STATIC, "stages": proposal["stages"]}
        return validate(static, StaticFile, f"the {title}")
    speed_rad_s, repeats = proposal["speed_rad_s"], proposal.get("repeats", 1)
    # A return that is faster than the stroke could exceed the limits of the rig.
    back = {"return_speed_rad_s": min(DYNAMIC["return_speed_rad_s"], speed_rad_s)}
    conditions = [{"height_mm": height_mm, "speed_rad_s": speed_rad_s}]
    dynamic = {"experiment": "dynamic", "title": title, "repeats": repeats, **DYNAMIC, **back, "conditions": conditions}
    return validate(dynamic, DynamicFile, f"the {title}")


def write_next_protocol(folder: Path, proposal: Mapping[str, Any] | None) -> Path | None:
    """Write the protocol of a proposal into `folder`; where none is proposed for the rig, remove an old one. Raises RigError."""
    path = folder / NEXT_PROTOCOL
    if proposal is None or proposal["protocol"] is None:
        path.unlink(missing_ok=True)
        return None
    content = make_protocol(proposal).model_dump(mode="json", exclude_unset=True)
    settle, entries = content.pop("settle"), "stages" if "stages" in content else "conditions"
    tables = [table("settle", settle), *(table(f"[{entries}]", entry) for entry in content.pop(entries))]
    plain = "".join(f"{name} = {format_value(value)}\n" for name, value in content.items())
    write_atomically(path, (comment(proposal["why"]) + "\n".join([plain, *tables])).encode("utf-8"))
    return path
