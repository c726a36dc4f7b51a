"""The two experiments of a campaign, simulated on a world: a stroke, and a table of static stages."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.simulator.engine import Traces, simulate
from rfca_rig.exam.simulator.sensor import Noise, record_columns, sense
from rfca_rig.exam.simulator.world import HINGES, World

Floats = NDArray[np.float64]

# Half of this step changes a valley by less than 1e-4 of its force.
STEP_S = 1e-4
SAMPLE_S = 1e-3
# Time recorded before the command.
BEFORE_S = 0.1
# Angle through which the shaft turns in a stroke.
SWEEP_RAD = 3.23

LOADING_RAD = tuple(float(np.radians(angle)) for angle in (60.0, 75.0, 90.0, 105.0, 120.0, 135.0))
UNLOADING_RAD = tuple(float(np.radians(angle)) for angle in (133.0, 131.0))
STAGES = (*((angle, "loading") for angle in LOADING_RAD), *((angle, "unloading") for angle in UNLOADING_RAD))
MOVE_RAD_S, HOLD_S, READ_S = 1.0, 0.8, 0.1
# Standard deviation of a hinge angle read from a photo.
PHOTO_DEG = 0.15
# A reading averages a tenth of a second, so its noise is smaller than that of a sample.
STATIC_NOISE = Noise(fy_N=0.01, fz_N=0.015, tx_Nm=6e-4)


@dataclass(frozen=True)
class ExamStage:
    """One row of a static table, as in its CSV file; `hinge_deg` is (6,), from the shaft outwards."""

    height_mm: float
    stage: int
    direction: str
    shaft_angle_rad: float
    hinge_deg: tuple[float, ...]
    fy_N: float
    fz_N: float
    tx_Nm: float


def stroke_traces(world: World, speed_rad_s: float, step_s: float = STEP_S) -> Traces:
    """True signals of one stroke, without the sensor, from 0.1 s before the command to the end of the sweep."""
    end_s = SWEEP_RAD / speed_rad_s + world.drive.ramp_s
    t_s: Floats = np.arange(-round(BEFORE_S / SAMPLE_S), int(end_s / SAMPLE_S) + 1, dtype=np.float64) * SAMPLE_S
    late_s = world.drive.late_s
    # The command goes on for 1 s beyond the last sample, so that a late drive does not stop within the recording.
    knots = np.array([[late_s, late_s + world.drive.ramp_s, late_s + end_s + 1.0], [0.0, speed_rad_s, speed_rad_s]])
    return simulate(world, knots, t_s, step_s=step_s)


def record_stroke(world: World, speed_rad_s: float, noise: Noise, random: np.random.Generator) -> dict[str, Floats]:
    """One recorded stroke, as columns (m,) by name."""
    return record_columns(world, stroke_traces(world, speed_rad_s), noise, random)


def static_table(
    world: World, stated_height_mm: float, ramp_s: float, random: np.random.Generator, stages: Sequence[tuple[float, str]] = STAGES
) -> list[ExamStage]:
    """Simulate the `stages` (shaft angle in rad, direction) at one height, one after the other.

    Each row is the mean of the last tenth of a second of its hold. The shaft moves between stages at 1 rad/s and accelerates and brakes
    within `ramp_s`; the shorter this is, the more the tip overshoots.

    The sensor is tared at each stage and averages for a while, so lag, ringing, clock, drift and hum do not show.
    """
    angles = tuple(angle for angle, _ in stages)
    knots, read_s = plan_stages(world.drive.start_angle_rad, angles, ramp_s)
    traces = simulate(world, knots, read_s, width_s=READ_S, step_s=STEP_S)
    steady = replace(
        world, sensing=replace(world.sensing, lag_s=0.0, clock_offset_s=0.0, clock_rate=0.0, ringing_Hz=0.0, drift_N_per_s=0.0, hum_N=0.0)
    )
    fy, fz, tx = sense(steady, traces)
    return [
        ExamStage(
            height_mm=stated_height_mm,
            stage=i + 1,
            direction=stages[i][1],
            shaft_angle_rad=float(traces.motor_angle_rad[i] + random.normal(0.0, 1e-4)),
            hinge_deg=tuple(np.degrees(traces.joint_angles_rad[i, 1:]) + random.normal(0.0, PHOTO_DEG, HINGES)),
            fy_N=float(fy[i] + random.normal(0.0, STATIC_NOISE.fy_N)),
            fz_N=float(fz[i] + random.normal(0.0, STATIC_NOISE.fz_N)),
            tx_Nm=float(tx[i] + random.normal(0.0, STATIC_NOISE.tx_Nm)),
        )
        for i in range(len(angles))
    ]


def plan_stages(start_rad: float, angles_rad: tuple[float, ...], ramp_s: float) -> tuple[Floats, Floats]:
    """Knots (2, m) of times and speeds of a shaft that goes from angle to angle and rests at each, and mid-times of the readings (k,)."""
    times, speeds, read_s, now, here = [0.0], [0.0], [], 0.0, start_rad
    for angle in angles_rad:
        for seconds, reached in (*_moves(angle - here, ramp_s), (HOLD_S, 0.0)):
            now += seconds
            times.append(now)
            speeds.append(float(reached))
        read_s.append(now - 0.5 * READ_S)
        here = angle
    return np.array([times, speeds]), np.array(read_s)


def _moves(way: float, ramp_s: float) -> list[tuple[float, float]]:
    """Durations in s with the speed in rad/s reached after each, for a move from rest to rest; empty where the shaft stays."""
    if way == 0.0:
        return []
    # A short move never reaches full speed: two ramps of ramp_s cover speed * ramp_s.
    speed = float(np.sign(way)) * min(MOVE_RAD_S, abs(way) / ramp_s)
    even_s = way / speed - ramp_s
    return [(ramp_s, speed), *([(even_s, speed)] if even_s > 1e-9 else []), (ramp_s, 0.0)]
