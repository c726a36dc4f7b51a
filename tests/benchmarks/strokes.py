"""What strokes cost: batches on all cores, links, effects, the first one of a process.

Run: python -m tests.benchmarks.strokes
"""

import subprocess
import sys
import time
from dataclasses import replace

import numpy as np

from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.model.stroke import Job, simulate_stroke, simulate_stroke_at_speed, simulate_strokes
from tests.benchmarks.__main__ import compare_s, median_s
from tests.model.legs import PAPER

T = np.arange(1, 1401) * 1e-3
STACKED = (
    ("hinge_coulomb_friction", (("torque_Nm", 0.02),)),
    ("spring_relaxation", (("strength_relative", 0.1), ("time_constant_s", 0.2))),
    ("ground_stribeck", (("rise_relative", 0.2), ("speed_m_s", 0.1))),
    ("fluid_drag", (("coefficient_N_s2_per_m3", 1.0),)),
    (
        "frame_compliance",
        (("frequency_Hz", 30.0), ("moving_mass_kg", 5.0), ("damping_ratio", 0.05)),
    ),
)
FIRST = (
    "import numpy as np; from rfca_rig.model.stroke import simulate_stroke_at_speed; from "
    "tests.model.legs import PAPER; "
)
FIRST += "simulate_stroke_at_speed(PAPER, 0.215, 2.433, np.arange(1, 1401) * 1e-3)"


def stroke(rig: RigModel) -> object:
    return simulate_stroke_at_speed(rig, 0.215, 2.433, T)


def many_links(links: int) -> RigModel:
    """The same leg cut into more pieces: hinges stiffer in proportion, so that it bends alike."""
    leg = PAPER.leg
    pieces = (0.29 / links,) * links
    stiffer = links / 7.0
    return replace(
        PAPER,
        leg=replace(
            leg,
            link_lengths_m=pieces,
            link_masses_kg=(0.32 / links,) * links,
            k0_Nm_per_rad=leg.k0_Nm_per_rad * stiffer,
            k2_per_rad2=leg.k2_per_rad2 * stiffer**2,
            hinge_damping_Nm_s_per_rad=leg.hinge_damping_Nm_s_per_rad * stiffer,
        ),
    )


def side_by_side(spread: float) -> float:
    """CPU time of eight strokes in one block over that of the eight one after the other;
    stiffnesses differ by up to `spread`.
    """
    motion = ramp_to_speed(PAPER.leg.start_angle_rad, 2.433, PAPER.drive.ramp_s, float(T[-1]))
    shares = np.linspace(0.0, spread, 8)
    jobs = [
        Job(
            replace(PAPER, leg=replace(PAPER.leg, k0_Nm_per_rad=10.98 * (1.0 + share))),
            0.215,
            motion,
            T,
        )
        for share in shares
    ]
    alone = [(job.rig, job.height_m, job.motion, job.t_s) for job in jobs]
    return compare_s(
        lambda: simulate_strokes(jobs, threads=1),
        lambda: [simulate_stroke(*one) for one in alone],
        21,
    )[1]


def batch(size: int) -> float:
    """Strokes per second of a batch with different parameters, on all cores."""
    random = np.random.default_rng(1)
    rigs = [
        replace(
            PAPER,
            leg=replace(PAPER.leg, k0_Nm_per_rad=10.98 * random.uniform(0.8, 1.2)),
            ground=replace(PAPER.ground, friction_coefficient=random.uniform(0.3, 0.6)),
        )
        for _ in range(size)
    ]
    motion = ramp_to_speed(PAPER.leg.start_angle_rad, 2.433, PAPER.drive.ramp_s, float(T[-1]))
    begin = time.perf_counter()
    simulate_strokes([Job(rig, 0.215, motion, T) for rig in rigs])
    return size / (time.perf_counter() - begin)


def main() -> None:
    one_s = median_s(lambda: stroke(PAPER), 31)
    per_s = batch(1000)
    print(
        f"one stroke {1e3 * one_s:.2f} ms; 1000 different ones on all cores: {per_s:.0f} "
        f"strokes/s, {per_s * one_s:.2f} x one core"
    )
    for spread in (0.001, 0.05, 0.4):
        print(
            f"eight side by side, stiffness up to {spread:.1%} apart: "
            f"{side_by_side(spread):.3f} x one after the other"
        )
    for links in (3, 7, 14, 28, 50):
        rig = many_links(links)
        print(
            f"{links:3d} links {median_s(lambda rig=rig: stroke(rig), 3) / one_s:8.1f} x "
            "a stroke of seven"
        )
    for count in range(1, len(STACKED) + 1):
        rig = replace(
            PAPER, effects=tuple(PresentEffect(name, values) for name, values in STACKED[:count])
        )
        print(
            f"{count} effects {median_s(lambda rig=rig: stroke(rig), 5) / one_s:6.2f} x "
            "the plain stroke"
        )
    begin = time.perf_counter()
    subprocess.run([sys.executable, "-c", FIRST], check=True)
    print(
        f"fresh process to first stroke, compiled code on disk: {time.perf_counter() - begin:.2f} s"
    )


if __name__ == "__main__":
    main()
