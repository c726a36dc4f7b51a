"""Recordings as the rig makes them: of the sensor and of the drive, each with its own time."""

import math

import numpy as np

from rfca_rig.recording.model import Column, Recording, StaticStage, Stream, Stroke

WRENCH = ("fx_N", "fy_N", "fz_N", "tx_Nm", "ty_Nm", "tz_Nm")


def stroke(repeat: int, samples: int = 300, seed: int = 1) -> Stroke:
    rng = np.random.default_rng(seed + repeat)
    t_s = -0.1 + np.arange(samples) / 7000.0
    counts = rng.integers(-(2**31), 2**31 - 1, (samples, 6), dtype=np.int32)
    force = {
        name: Column(1e-6 * counts[:, i], name.split("_")[1].replace("Nm", "N m"))
        for i, name in enumerate(WRENCH)
    }
    force["sequence"] = Column(np.arange(samples, dtype=np.int64), "")
    force["status"] = Column(np.full(samples, 2**31, dtype=np.uint32), "")
    force["host_s"] = Column(t_s + rng.normal(0.0, 1e-4, samples), "s")
    shaft_s = t_s[::7].copy()
    shaft = {
        "shaft_angle_rad": Column(rng.normal(size=len(shaft_s)), "rad"),
        "host_s": Column(shaft_s + 1e-3, "s"),
    }
    return Stroke(
        0.215, 2.433, repeat, {"shaft": Stream(shaft_s, shaft), "force": Stream(t_s, force)}
    )


def stage(number: int) -> StaticStage:
    hinges = (-1.5, math.nan, 0.1 + 0.2, 4.0, 5.0, 6.0)
    std = {"fz_N": 0.1 * number} if number != 2 else {}
    settled = {1: True, 2: False}.get(number)
    if number != 3:
        sure = (0.03, math.nan, 0.1, 0.02, 0.02, 0.1 + 0.2)
    else:
        sure = ()
    photo = f"photos/{number:03d}.png" if number != 2 else ""
    doubts = "Märke an Gelenk 3: not seen" if number == 1 else ""
    way = "loading" if number < 3 else "unloading"
    return StaticStage(
        0.235,
        number,
        way,
        1.0472,
        hinges,
        -1.0,
        2.0,
        0.3,
        std,
        settled,
        sure,
        photo,
        photo,
        doubts,
        hinge_reading_std_deg=tuple(0.5 * std_deg for std_deg in sure),
    )


def recording(strokes: int = 3, stages: int = 3) -> Recording:
    return Recording(
        title="Flügel 1",
        source="SIM",
        nominal={
            "leg": {"link_lengths_mm": [54.0, 39.333], "k0_Nm_per_rad": 0.1 + 0.2},
            "ground": {"friction_coefficient": 1},
        },
        known_to={"height_mm": 0.2},
        strokes=tuple(stroke(k) for k in range(1, strokes + 1)),
        static=tuple(stage(k) for k in range(1, stages + 1)),
        provenance={"plan": "stage\n" * 20_000, "seed": "7"},
    )
