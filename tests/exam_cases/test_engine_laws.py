"""Laws with memory against their closed forms."""

import numpy as np
import pytest

from rfca_rig.exam.nominal_world import nominal_world
from rfca_rig.exam.simulator.experiment import _floor
from rfca_rig.exam.simulator.floor import (
    BUMP,
    BUMP_AT,
    BUMP_WIDTH,
    LEVER,
    LEVER_POWER,
    bouc_wen,
    dahl,
    dashpot_angle,
    elevation,
    lever_reduction,
    normal_force,
)
from rfca_rig.exam.simulator.step import CYCLES, RIPPLE, START, add_ripple, command_speed


def test_dry_friction_is_full_after_a_finite_way_and_turns_with_the_direction():
    creep = 0.5e-3
    assert dahl(0.0, 2.0 * creep, creep) == pytest.approx(1.0)
    assert dahl(0.3, 100.0 * creep, creep) == 1.0
    assert dahl(1.0, -100.0 * creep, creep) == -1.0
    assert dahl(0.4, 0.0, creep) == pytest.approx(0.4)


def test_dry_friction_does_not_depend_on_the_steps():
    one = dahl(-0.5, 4e-4, 5e-4)
    many = -0.5
    for _ in range(50):
        many = dahl(many, 8e-6, 5e-4)
    assert many == pytest.approx(one, abs=1e-12)


def test_loop_is_the_exponential_of_bouc_and_wen():
    z = -1.0
    width = 0.1
    for _ in range(20000):
        z = bouc_wen(z, 1e-5, width)
    assert z == pytest.approx(1.0 - 2.0 * np.exp(-0.2 / width), abs=2e-4)


def test_dashpot_relaxes_exponentially_after_a_step():
    x = 0.0
    tau = 0.2
    h = 1e-3
    for _ in range(300):
        x = dashpot_angle(x, 1.0, 1.0, h, tau)
    assert x == pytest.approx(1.0 - np.exp(-0.3 / tau), abs=1e-5)


def test_normal_force_is_the_campaigns_law():
    floor = _floor(nominal_world(0.215))
    assert normal_force(floor, 4e-3, 0.0) == pytest.approx(1e5 * 4e-3**1.5)
    assert normal_force(floor, 4e-3, 0.5) == pytest.approx(1.5 * 1e5 * 4e-3**1.5)
    assert normal_force(floor, 4e-3, -0.5) == pytest.approx(0.5 * 1e5 * 4e-3**1.5)
    assert normal_force(floor, 4e-3, -1.5) == 0.0


@pytest.mark.parametrize("power", [1.0, 0.8, 1.25])
def test_friction_acts_higher_in_a_deeper_print_by_a_share_of_a_typical_depth(power):
    floor = _floor(nominal_world(0.215))
    floor[LEVER] = 0.5
    floor[LEVER_POWER] = power
    assert lever_reduction(floor, 3e-3) == pytest.approx(1.5e-3)
    assert lever_reduction(floor, 12e-3) == pytest.approx(1.5e-3 * 4.0**power)


def test_a_bump_has_its_own_slope():
    floor = _floor(nominal_world(0.215))
    floor[BUMP] = 2e-3
    floor[BUMP_AT] = 0.1
    floor[BUMP_WIDTH] = 0.02
    rise, slope = elevation(floor, 0.11)
    assert slope == pytest.approx(
        (elevation(floor, 0.11 + 1e-6)[0] - elevation(floor, 0.11 - 1e-6)[0]) / 2e-6, rel=1e-6
    )
    assert rise == pytest.approx(2e-3 * np.exp(-0.25))


def test_command_ramps_and_ripples():
    knots = np.array([[0.0, 0.05, 2.0], [0.0, 2.0, 2.0]])
    assert [command_speed(knots, t) for t in (-0.1, 0.0, 0.025, 0.05, 1.0, 2.1)] == pytest.approx(
        [0.0, 0.0, 1.0, 2.0, 2.0, 0.0]
    )
    drive = np.zeros(16)
    drive[START] = 0.2
    drive[RIPPLE] = 0.1
    drive[CYCLES] = 4.0
    assert add_ripple(drive, 0.2 + np.pi / 4.0, 2.0) == pytest.approx(1.8)
