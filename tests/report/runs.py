"""Recordings of runs with all that a run leaves behind: plan, limits, events, both clocks; made
up, so that every number is known.
"""

import json

import numpy as np

from rfca_rig.protocol.plan import (
    Cycles,
    Flap,
    Hold,
    HoldTiming,
    Limits,
    Plan,
    Rates,
    SettleCriterion,
    StiffnessCheck,
)
from rfca_rig.protocol.written_plan import serialize_plan
from rfca_rig.recording.model import Column, RawStage, Recording, StaticStage, Stream
from tests.report.recordings import BELIEVED, CONDITIONS, KNOWN_TO, strokes

LIMITS = Limits(300.0, 25.0, 20.0, 0.35, 0.14, 0.05, 0.5, 0.2, 2.0, 0.1, 80.0, 0.05, 0.1)
FLAPS = tuple(Flap(h, v, repeat, 0.05, 3.4) for h, v in CONDITIONS for repeat in (1, 2))
TRIP = "TRIP L-01: force 50.5 N, limit 50 N; raise the rack or go slower"
CHECKED_DEG = (75.0, 100.0, 125.0)


def plan_of(*stages, experiment="dynamic"):
    return Plan("A <run> & more", experiment, stages, LIMITS, Rates(7000.0, 500.0))


def begins(*labels):
    return [
        {"event": "stage begins", "t_s": 1.0 + 3.0 * place, "stage": label}
        for place, label in enumerate(labels)
    ]


def run(plan, events=(), ended="done", reason="done", source="SIM", **parts):
    texts = serialize_plan(plan) if plan else {}
    tares = [
        {"event": "tare", "t_s": 0.5, "utc": "2000", "fz_N": 3.1},
        {"event": "tare", "t_s": 9.0, "utc": "2000", "fz_N": 3.2},
    ]
    provenance = {
        **texts,
        "events": "\n".join(json.dumps(event) for event in (*tares, *events)),
        "ended": ended,
        "exit_status": "0" if ended == "done" else "3",
        "reason": reason,
        "lasted_s": "64.9",
        "worst_loop_gap_ms": "12.5",
        "standstill": "the shaft turned by 11.1 deg after the torque was gone",
        "tare_drift": "0.100 N, 0.0000 N m from the first rest in the air to the last",
        "sensor_records": "1000 received, 7 lost, 0 twice",
        "motor_make": "ODrive, CANSimple",
        "motor_firmware": "0.6.10",
        "sensor_serial_number": "FT-31415",
        "rig_file": "one\ntwo\nthree\n",
    }
    whole = {"strokes": (), "static": (), "raw": (), **parts}
    return Recording("A <run> & more", source, BELIEVED, KNOWN_TO, provenance=provenance, **whole)


def done():
    return run(plan_of(*FLAPS), begins(*(flap.label for flap in FLAPS)), strokes=strokes())


def tripped():
    """The first stroke is whole, the second was cut short at 50.5 N, two were not begun."""
    t_s = np.linspace(0.0, 0.5, 200)
    fz = Column(np.where(t_s < 0.49, -20.0, -50.5), "N")
    cut = RawStage(
        FLAPS[1].label,
        FLAPS[1].height_m,
        {"force": Stream(t_s, {"fz_N": fz, "fy_N": Column(np.zeros(200), "N")})},
        TRIP,
    )
    motor_off = {"event": "motor off", "t_s": 5.5, "why": TRIP}
    events = [*begins(FLAPS[0].label, FLAPS[1].label), motor_off]
    return run(plan_of(*FLAPS), events, TRIP, "L-01", "REAL", strokes=strokes()[:1], raw=(cut,))


def static_stage(number, angle_deg, fz_N, direction="loading"):
    std = {"fy_N": 0.1, "fz_N": 0.1, "tx_Nm": 0.006}
    return StaticStage(
        0.2228, number, direction, np.radians(angle_deg), (np.nan,) * 6, -0.5, fz_N, 1.0, std, True
    )


def worn(drift=-0.08):
    """Two stiffness checks with 40 cycles between; the forces of the second are less by 8 %."""
    settle = SettleCriterion(0.1, 0.001, 0.3, 10.0)
    timing = HoldTiming(0.2, 0.5)
    holds = [
        Hold(0.2228, n, "loading", np.radians(CHECKED_DEG[(n - 1) % 3]), settle, timing)
        for n in range(1, 7)
    ]
    cycles = Cycles(0.2228, 6.0, 1, 40)
    stages = (
        *holds[:3],
        StiffnessCheck(1, 3, 0.05),
        cycles,
        *holds[3:],
        StiffnessCheck(2, 3, 0.05),
    )
    values = {
        "cycle": Column(np.arange(1, 41, dtype=np.uint32), ""),
        "peak_force_N": Column(np.linspace(51.0, 47.0, 40), "N"),
        "peak_moment_Nm": Column(np.full(40, 5.0), "N m"),
        "min_fz_N": Column(np.linspace(-44.0, -40.0, 40), "N"),
        "mean_speed_rad_s": Column(np.full(40, 6.0), "rad/s"),
    }
    block = RawStage(cycles.label, 0.2228, {"cycles": Stream(np.arange(40.0), values)})
    factor = (1.0, 1.0, 1.0, *(1.0 + drift,) * 3)
    static = tuple(
        static_stage(n, CHECKED_DEG[(n - 1) % 3], -10.0 * ((n - 1) % 3 + 1) * factor[n - 1])
        for n in range(1, 7)
    )
    events = begins(
        *(hold.label for hold in holds[:3]), cycles.label, *(hold.label for hold in holds[3:])
    )
    return run(
        plan_of(*stages, experiment="fatigue"),
        events,
        "stiffness drifted",
        "worn-out",
        static=static,
        raw=(block,),
    )


def clocked(ppm, jitter_s, seconds=60.0, restarts=False):
    """One stream whose device gains `ppm` on the host, with samples that come late by up to
    `jitter_s`.
    """
    rng = np.random.default_rng(4)
    host_s = np.arange(0.0, seconds, 0.002)
    device_s = (host_s - rng.uniform(0.0, jitter_s, len(host_s))) * (1.0 + 1e-6 * ppm) + 5.0
    if restarts:
        device_s[host_s < 0.5 * seconds] += 100.0
    columns = {"host_s": Column(host_s, "s"), "device_s": Column(device_s, "s")}
    stage = RawStage("hold", 0.215, {"force": Stream(host_s - 3.0, columns)})
    return Recording("clocks", "SIM", {}, {}, (), (), {}, (stage,))
