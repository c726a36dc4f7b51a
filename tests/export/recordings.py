"""A small recording with all that can be exported: two strokes of two devices, a static stage
with photo and samples, one cut short.
"""

import json
from pathlib import Path

import cv2
import numpy as np

from rfca_rig.recording.model import Column, RawStage, Recording, StaticStage, Stream, Stroke

STARTS_S = (12.5, 16.75)  # host times of the commanded starts
HOLD_S = 20.0
EVENTS = (
    {"event": "run begins", "t_s": 0.0, "utc": "2026-11-22T01:00:00+00:00", "title": "small"},
    {
        "event": "stage begins",
        "t_s": 12.3,
        "utc": "2026-11-22T01:00:12.300000+00:00",
        "stage": "flap 215 mm",
    },
    {
        "event": "motor off",
        "t_s": 30.0,
        "utc": "2026-11-22T01:00:30.000250+00:00",
        "why": "TRIP L-01: force 312 N",
    },
)


def streams(start_s: float, records: int, seed: int) -> dict[str, Stream]:
    """Two devices with times of their own; forces, and whole numbers that stand for themselves."""
    rng = np.random.default_rng(seed)
    fast = np.arange(records) / 7000.0 - 0.1
    slow = np.arange(records // 14) / 500.0 - 0.1
    delay = rng.uniform(0.0, 2e-3, records)
    delay[7] = 0.0  # the record that took no time says where the clocks meet
    counts = rng.integers(-60_000_000, 40_000_000, (2, records)).astype(np.int32)
    return {
        "shaft": Stream(
            slow,
            {
                "shaft_angle_rad": Column(rng.normal(size=len(slow)), "rad"),
                "host_s": Column(slow + start_s, "s"),
            },
        ),
        "force": Stream(
            fast,
            {
                "fy_N": Column(1e-6 * counts[0], "N"),
                "fz_N": Column(1e-6 * counts[1], "N"),
                "rdt_sequence": Column(
                    np.arange(2**32 - 5, 2**32 - 5 + records, dtype=np.int64), ""
                ),
                "status": Column(np.full(records, 0x80020000, dtype=np.uint32), ""),
                "host_s": Column(fast + start_s + delay, "s"),
            },
        ),
    }


def recording(records: int = 1400) -> Recording:
    strokes = tuple(
        Stroke(0.215, 2.433, i, streams(start_s, records, i))
        for i, start_s in enumerate(STARTS_S, start=1)
    )
    hinges = (-5.5, -4.8, -4.0, -3.2, -2.2, float("nan"))
    static = StaticStage(
        0.215,
        1,
        "loading",
        1.047,
        hinges,
        -2.3,
        -2.36,
        1.18,
        settled=True,
        photo="photos/001.png",
        overlay="overlays/001.jpg",
    )
    raw = (
        RawStage("hold 1 at 60.0 deg, 215 mm, loading", 0.215, streams(HOLD_S, 700, 7)),
        RawStage("flap 215 mm, 2.433 rad/s, repeat 3", 0.215, streams(25.0, 700, 9), "TRIP L-01"),
    )
    events = "".join(json.dumps(event) + "\n" for event in EVENTS)
    return Recording(
        "small",
        "SIM",
        {"leg": {"k0_Nm_per_rad": 10.98}},
        {},
        strokes,
        (static,),
        {"events": events, "seed": "1"},
        raw,
    )


def lay_photos(folder: Path) -> None:
    """The picture files of the recording, but for the overlay, which got lost."""
    (folder / "photos").mkdir(parents=True)
    cv2.imwrite(str(folder / "photos/001.png"), np.full((6, 8, 3), 200, np.uint8))
