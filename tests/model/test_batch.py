"""A batch gives what the strokes one by one give, in their order, and says which failed."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.errors import SimulationFailed
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.stroke import Job, simulate_stroke, simulate_strokes
from tests.model.legs import PAPER

T = np.arange(1, 400) * 1e-3
MOTION = ramp_to_speed(PAPER.leg.start_angle_rad, 3.0, 0.05, 0.5)
HEAVY = replace(
    PAPER,
    effects=(
        PresentEffect("tip_mass", (("mass_g", 10.0),)),
        PresentEffect("hinge_backlash", (("half_gap_deg", 0.5),)),
    ),
)
BROKEN = replace(PAPER, leg=replace(PAPER.leg, k0_Nm_per_rad=float("nan")))


@pytest.mark.parametrize("threads", [None, 1, 3])
def test_a_batch_is_the_strokes_one_by_one_and_a_failure_stays_its_own(threads):
    jobs = [
        Job(rig, height_m, MOTION, T)
        for height_m in (0.215, 0.235)
        for rig in (PAPER, HEAVY, BROKEN)
    ]
    found = simulate_strokes(jobs, threads)
    assert [isinstance(each, SimulationFailed) for each in found] == [False, False, True] * 2
    for job, each in zip(jobs, found, strict=True):
        if job.rig is not BROKEN:
            alone = simulate_stroke(job.rig, job.height_m, MOTION, T)
            assert each.fz_N == pytest.approx(alone.fz_N, abs=0.02)
            assert each.q_rad == pytest.approx(alone.q_rad, abs=5e-5)


def test_a_batch_does_not_depend_on_the_number_of_threads():
    jobs = [Job(HEAVY, height_m, MOTION, T) for height_m in np.linspace(0.2, 0.24, 20)]
    one, three = (simulate_strokes(jobs, threads) for threads in (1, 3))
    assert all(a.fz_N.tobytes() == b.fz_N.tobytes() for a, b in zip(one, three, strict=True))


def test_like_strokes_share_their_steps_in_whatever_order_they_come():
    """Eight strokes of two conditions would need the steps of both."""
    motions = [
        ramp_to_speed(PAPER.leg.start_angle_rad, speed_rad_s, 0.05, 0.5)
        for speed_rad_s in (2.4, 3.3)
    ]
    jobs = [
        Job(PAPER, 0.21 + 0.02 * (number % 2) + 1e-6 * number, motions[number % 2], T)
        for number in range(16)
    ]
    alone = [simulate_stroke(PAPER, job.height_m, job.motion, T).steps for job in jobs]
    assert [each.steps for each in simulate_strokes(jobs)] == pytest.approx(alone, rel=0.1)


def test_forces_alone_are_those_of_the_whole_stroke():
    jobs = [Job(HEAVY, height_m, MOTION, T) for height_m in (0.215, 0.22)]
    for whole, sensed in zip(
        simulate_strokes(jobs), simulate_strokes(jobs, only_sensed=True), strict=True
    ):
        assert sensed.fz_N.tobytes() == whole.fz_N.tobytes()
        assert sensed.shaft_angle_rad.tobytes() == whole.shaft_angle_rad.tobytes()


def test_an_empty_batch_is_empty():
    assert simulate_strokes([]) == []
