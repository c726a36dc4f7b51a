"""A thin strip bent far, against elliptic integrals and against its own invariants."""

import numpy as np
import pytest

from rfca_rig.errors import SimulationFailed
from rfca_rig.model.paper.elastica import (
    Holds,
    bend,
    bend_cantilever,
    cantilever_tip,
    even_mesh,
    mesh_through,
    sensitivity,
)
from tests.model.elliptic import tip_of

EI = 0.26
LENGTH_M = 0.226

# direction of the force and slope of the tip, degrees from the clamped tangent
CASES = [
    (90, 1),
    (90, 30),
    (90, 60),
    (90, 85),
    (60, 50),
    (135, 90),
    (135, 110),
    (160, 110),
    (120, 110),
    (179, 40),
]


def loaded(direction_deg, slope_deg):
    force, x, y = tip_of(EI, LENGTH_M, np.radians(direction_deg), np.radians(slope_deg))
    return (
        force * np.cos(np.radians(direction_deg)),
        force * np.sin(np.radians(direction_deg)),
    ), np.array([x, y])


def errors(direction_deg, slope_deg, elements):
    """Of the tip's place, relative to the length, and of its slope, relative."""
    force, place = loaded(direction_deg, slope_deg)
    bent = bend_cantilever(EI, LENGTH_M, force, elements)
    return np.array(
        [
            np.hypot(*(bent.end_m - place)) / LENGTH_M,
            abs(bent.theta_rad[-1] / np.radians(slope_deg) - 1.0),
        ]
    )


def test_the_closed_form_bends_a_little_as_a_textbook_beam_does():
    force, x, y = tip_of(EI, LENGTH_M, np.pi / 2, 1e-3)
    assert force * LENGTH_M**2 / (2 * EI) == pytest.approx(1e-3, rel=1e-5)
    assert y == pytest.approx(force * LENGTH_M**3 / (3 * EI), rel=1e-5)
    assert LENGTH_M - x == pytest.approx(force**2 * LENGTH_M**5 / (15 * EI**2), rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("direction_deg", "slope_deg"), CASES)
def test_place_and_slope_of_the_tip_are_those_of_elliptic_integrals(direction_deg, slope_deg):
    assert errors(direction_deg, slope_deg, 100).max() < 1e-3


@pytest.mark.parametrize(("direction_deg", "slope_deg"), CASES)
def test_one_richardson_step_is_good_to_a_millionth(direction_deg, slope_deg):
    force, place = loaded(direction_deg, slope_deg)
    tip = cantilever_tip(EI, LENGTH_M, force)
    assert np.hypot(tip.x_m - place[0], tip.y_m - place[1]) < 1e-6 * LENGTH_M
    assert tip.slope_rad == pytest.approx(np.radians(slope_deg), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("direction_deg", "slope_deg"), [(179.9, 60), (179.99, 110), (179, 170)])
def test_a_strip_pushed_nearly_straight_back_buckles(direction_deg, slope_deg):
    assert errors(direction_deg, slope_deg, 100).max() < 2e-3


def test_a_strip_pushed_straight_back_beyond_euler_s_load_has_no_side_to_go_to():
    euler_N = np.pi**2 / 4 * EI / LENGTH_M**2
    assert bend_cantilever(EI, LENGTH_M, (-0.99 * euler_N, 0.0), 100).theta_rad == pytest.approx(
        0.0, abs=1e-9
    )
    with pytest.raises(SimulationFailed, match="a little to one side"):
        bend_cantilever(EI, LENGTH_M, (-1.01 * euler_N, 0.0), 100)


@pytest.mark.parametrize(("direction_deg", "slope_deg"), [(90, 60), (135, 110)])
def test_the_error_falls_with_the_square_of_the_node_distance(direction_deg, slope_deg):
    order = np.log2(errors(direction_deg, slope_deg, 50) / errors(direction_deg, slope_deg, 100))
    assert order == pytest.approx([2.0, 2.0], abs=0.02)


def test_a_strip_bends_to_the_side_it_is_pushed():
    up, down = (bend_cantilever(EI, LENGTH_M, (-5.0, side), 50) for side in (8.0, -8.0))
    assert up.theta_rad[-1] > 0.5
    assert down.theta_rad == pytest.approx(-up.theta_rad, abs=1e-9)


def test_a_force_along_the_strip_leaves_it_straight():
    assert bend_cantilever(EI, LENGTH_M, (50.0, 0.0), 50).theta_rad == pytest.approx(0.0, abs=1e-12)


def test_multipliers_are_the_moments_and_forces_of_what_holds_the_strip():
    mesh = even_mesh(EI, LENGTH_M, 80)
    start = np.linspace(-0.5, 0.5, 81)

    def held(turn, x):
        holds = Holds(np.array([0, 80]), np.array([-0.5, 0.5 + turn]), (x, 0.01))
        return bend(mesh, holds, np.zeros(2), start), holds

    bent, holds = held(0.0, 0.2)
    by_angle = (held(1e-4, 0.2)[0].energy_J - held(-1e-4, 0.2)[0].energy_J) / 2e-4
    by_place = (held(0.0, 0.2 + 1e-5)[0].energy_J - held(0.0, 0.2 - 1e-5)[0].energy_J) / 2e-5
    assert -bent.multipliers[1] == pytest.approx(by_angle, rel=1e-5)
    assert -bent.multipliers[2] == pytest.approx(by_place, rel=1e-4)
    stiffness = sensitivity(bent, holds, np.zeros(2))
    assert stiffness == pytest.approx(stiffness.T, rel=1e-6)
    assert stiffness[1, 1] == pytest.approx(
        (held(-1e-4, 0.2)[0].multipliers[1] - held(1e-4, 0.2)[0].multipliers[1]) / 2e-4, rel=1e-5
    )


def test_every_station_gets_a_node():
    mesh, nodes = mesh_through(EI, LENGTH_M, np.array([0.0, 0.0311, 0.2, LENGTH_M]), 50)
    assert mesh.s_m[nodes] == pytest.approx([0.0, 0.0311, 0.2, LENGTH_M], abs=1e-15)
    assert mesh.weights_m.sum() == pytest.approx(LENGTH_M)


def test_a_shape_that_cannot_be_is_refused_in_one_line():
    too_far = Holds(np.array([0]), np.zeros(1), (2.0 * LENGTH_M, 0.0))
    with pytest.raises(SimulationFailed, match=r"strip of 226\.0 mm .* iterations"):
        bend(even_mesh(EI, LENGTH_M, 40), too_far, np.zeros(2), np.linspace(0.0, 0.4, 41))
