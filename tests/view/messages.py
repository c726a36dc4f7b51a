"""Messages as the view's server sends them, with the leg of the paper."""

import math
from typing import Any

LENGTHS_M = [0.054, *[0.039333] * 6]
CHANNELS = [
    {
        "name": name,
        "label": name.split("_")[0],
        "unit": "N" if name.endswith("N") else "N m",
        "plot": "force" if name.endswith("N") else "moment",
    }
    for name in ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")
] + [
    {"name": "shaft_angle_deg", "label": "shaft", "unit": "deg", "plot": "angle"},
    {"name": "shaft_speed_rad_s", "label": "speed", "unit": "rad/s", "plot": "speed"},
]
NAMES = [channel["name"] for channel in CHANNELS]
STAGES = [
    {"label": "rack to 215.0 mm", "kind": "height", "duration_s": 0.0},
    *[
        stage
        for repeat in range(1, 13)
        for stage in (
            {"label": "shaft to 14.1 deg", "kind": "move", "duration_s": 2.3},
            {"label": "come to rest", "kind": "rest", "duration_s": 10.0},
            {
                "label": f"flap 215 mm, 2.433 rad/s, repeat {repeat}",
                "kind": "flap",
                "duration_s": 1.86,
            },
        )
    ],
]
LIMITS = [
    {"name": "force", "unit": "N", "limit": 300.0, "code": "L-01"},
    {"name": "moment", "unit": "N m", "limit": 25.0, "code": "L-02"},
    {"name": "force above expected", "unit": "ms", "limit": 30.0, "code": "L-03"},
    {"name": "moment above expected", "unit": "ms", "limit": 30.0, "code": "L-04"},
    {"name": "speed", "unit": "rad/s", "limit": 20.0, "code": "F-01"},
    {"name": "following error", "unit": "deg", "limit": 20.0, "code": "F-02"},
    {"name": "sensor silent", "unit": "ms", "limit": 50.0, "code": "S-01"},
    {"name": "drive silent", "unit": "ms", "limit": 300.0, "code": "D-02"},
    {"name": "drive temperature", "unit": "degC", "limit": 80.0, "code": "D-04"},
    {"name": "loop late", "unit": "ms", "limit": 50.0, "code": "C-01"},
]
SHARES = (0.18, 0.27, 0.0, 0.0, 0.15, 0.12, 0.02, 0.04, 0.51, 0.05)
HEALTH = [
    {"name": "force records", "value": "15 000 /s", "is_good": True},
    {"name": "lost", "value": "0", "is_good": True},
    {"name": "worst loop gap", "value": "3.1 ms", "is_good": True},
    {"name": "sensor status", "value": "healthy", "is_good": True},
    {"name": "drive temperature", "value": "41 degC", "is_good": True},
    {"name": "recorder behind", "value": "12 kB", "is_good": True},
    {"name": "view behind", "value": "18 ms", "is_good": True},
]


def hello(**changed: Any) -> dict[str, Any]:
    return {
        "kind": "hello",
        "title": "Table II",
        "mark": "SIM",
        "mode": "live",
        "can_stop": True,
        "span_s": 8.0,
        "channels": CHANNELS,
        "stages": STAGES,
        "limits": LIMITS,
        "leg": {"link_lengths_m": LENGTHS_M, "link_thickness_m": 0.006},
        "duration_s": None,
        "docs": "/trips",
        **changed,
    }


def state(now_s: float = 0.0, **changed: Any) -> dict[str, Any]:
    shares = zip(LIMITS, SHARES, strict=True)
    return {
        "kind": "state",
        "now_s": now_s,
        "stage": 6,
        "stage_done": 0.4,
        "done": 0.21,
        "eta_s": 134.0,
        "limits": {
            limit["name"]: {
                "value": share * limit["limit"],
                "share": share,
                "peak_share": min(1.4 * share, 1.0),
                "limit": limit["limit"],
            }
            for limit, share in shares
        },
        "health": HEALTH,
        "said": ["SIM flap 215 mm, 2.433 rad/s, repeat 1: valley (1.107 s, -53.35 N)"],
        "ended": None,
        "trip": None,
        **changed,
    }


def trace(
    from_s: float,
    dt_s: float,
    reset: bool = False,
    **values: list[float | None] | list[tuple[float, float]],
) -> dict[str, Any]:
    """Of the named channels; a value is [low, high] or one number for both, None for no record.
    Other channels have none.
    """
    count = max(len(some) for some in values.values())
    pairs = {
        name: [v if isinstance(v, tuple) else (v, v) for v in values.get(name, [None] * count)]
        for name in NAMES
    }
    low = {name: [pair[0] for pair in some] for name, some in pairs.items()}
    high = {name: [pair[1] for pair in some] for name, some in pairs.items()}
    return {
        "kind": "trace",
        "dt_s": dt_s,
        "from_s": from_s,
        "low": low,
        "high": high,
        **({"reset": True} if reset else {}),
    }


def bent_leg(shaft_rad: float, curl_deg: float) -> list[list[float]]:
    """Points of a leg whose hinges all bend alike."""
    points = [[0.0, 0.0]]
    angle = shaft_rad
    for length in LENGTHS_M:
        points.append(
            [points[-1][0] + length * math.cos(angle), points[-1][1] + length * math.sin(angle)]
        )
        angle += math.radians(curl_deg)
    return points


def leg(**changed: Any) -> dict[str, Any]:
    return {
        "kind": "leg",
        "height_m": 0.215,
        "leg": bent_leg(1.9, -14.0),
        "ghost": bent_leg(1.94, -13.0),
        "source": "model at measured shaft angle",
        "force": [-17.0, -52.0],
        **changed,
    }


def expected(
    value: list[float], low: list[float] | None = None, high: list[float] | None = None
) -> dict[str, Any]:
    """Of fz, every 0.1 s, in the strokes of one condition."""
    lines = {"value": value}
    if low is not None and high is not None:
        lines |= {"low": low, "high": high}
    return {"kind": "expected", "condition": "a", "dt_s": 0.1, "channels": {"fz_N": lines}}


def strokes(*places: tuple[float, float]) -> dict[str, Any]:
    placed = [{"from_s": from_s, "to_s": to_s, "condition": "a"} for from_s, to_s in places]
    return {"kind": "strokes", "strokes": placed}
