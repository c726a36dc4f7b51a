"""JSON messages for everything except samples: log, pictures, stages. Log and pictures use the schema names that Foxglove knows."""

import base64
import json
from collections.abc import Mapping
from math import isnan
from pathlib import Path
from typing import Any

from rfca_rig.drivers.photo_files import read_picture_bytes

NS = 1_000_000_000
# Values of the enumeration in Foxglove's Log schema: 1 debug, 2 info, 3 warning, 4 error, 5 fatal.
LEVELS = {"info": 2, "warning": 3, "error": 4}
FORMATS = {".png": "png", ".jpg": "jpeg", ".jpeg": "jpeg"}

_TIME = {"type": "object", "title": "time", "properties": {"sec": {"type": "integer", "minimum": 0}, "nsec": {"type": "integer"}}}
_TEXT = {"type": "string"}
_NUMBER = {"type": "number"}


def _schema(name: str, /, **properties: Mapping[str, Any]) -> tuple[str, bytes]:
    return name, json.dumps({"title": name, "type": "object", "properties": properties}).encode()


LOG = _schema(
    "foxglove.Log",
    timestamp=_TIME,
    level={"type": "integer"},
    message=_TEXT,
    name=_TEXT,
    file=_TEXT,
    line={"type": "integer", "minimum": 0},
)
IMAGE = _schema(
    "foxglove.CompressedImage", timestamp=_TIME, frame_id=_TEXT, data={"type": "string", "contentEncoding": "base64"}, format=_TEXT
)
STAGE = _schema("rfca_rig.Stage", label=_TEXT, height_mm=_NUMBER, speed_rad_s=_NUMBER, repeat={"type": "integer"}, cut_short=_TEXT)
STATIC = _schema(
    "rfca_rig.StaticStage",
    stage={"type": "integer"},
    direction=_TEXT,
    **dict.fromkeys(("height_mm", "shaft_angle_rad", "fy_N", "fz_N", "tx_Nm"), _NUMBER),
    **{f"hinge{i}_deg": {"type": ["number", "null"]} for i in range(2, 8)},
)


def log(ns: int, message: str, level: str = "info") -> bytes:
    """A foxglove.Log message of one line at `ns` nanoseconds of UTC; `level` is a key of LEVELS."""
    return _json(timestamp=_time(ns), level=LEVELS[level], message=message, name="rfca-rig", file="", line=0)


def image(ns: int, path: Path) -> bytes:
    """A foxglove.CompressedImage message with the bytes of the file, base64 as JSON needs. Raises BadInput where it cannot be read."""
    data = base64.b64encode(read_picture_bytes(path)).decode()
    return _json(timestamp=_time(ns), frame_id="camera", data=data, format=FORMATS[path.suffix.lower()])


def values(**named: Any) -> bytes:
    """A message of plain values by name. JSON has no NaN: it becomes null."""
    return _json(**{name: None if isinstance(value, float) and isnan(value) else value for name, value in named.items()})


def _json(**content: Any) -> bytes:
    # allow_nan=False: Python would write the bare word NaN, which other JSON parsers reject.
    return json.dumps(content, ensure_ascii=False, allow_nan=False).encode()


def _time(ns: int) -> dict[str, int]:
    return {"sec": ns // NS, "nsec": ns % NS}
