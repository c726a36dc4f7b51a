"""The leg as it is drawn, against the stroke of the model that it is taken from."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke_at_speed
from rfca_rig.view.leg_pose import LegShapes, leg_points
from tests.model.legs import PAPER as RIG

HEIGHT_M = 0.215
SPEED_RAD_S = 2.433
SWEEP_DEG = 200.0
LENGTHS_M = np.array(RIG.leg.link_lengths_m)
START_RAD = RIG.leg.start_angle_rad


@pytest.fixture(scope="module")
def shapes() -> LegShapes:
    made = LegShapes(RIG)
    made.prepare(HEIGHT_M, SPEED_RAD_S, SWEEP_DEG)
    return made


@pytest.fixture(scope="module")
def stroke() -> SimulatedStroke:
    """At other instants than those of the table."""
    return simulate_stroke_at_speed(RIG, HEIGHT_M, SPEED_RAD_S, np.arange(0.0, 1.44, 0.0107))


def test_a_stroke_is_drawn_as_the_model_bends_it_at_every_instant(shapes, stroke):
    drawn = np.array(
        [shapes.at_shaft(HEIGHT_M, angle, SPEED_RAD_S) for angle in stroke.shaft_angle_rad]
    )
    modelled = np.array([leg_points(q, LENGTHS_M) for q in stroke.q_rad])
    assert np.abs(drawn - modelled).max() < 1e-4  # a tenth of a millimetre


@given(turned_rad=st.floats(-20.0, 20.0))
def test_links_keep_their_lengths_at_every_angle(shapes, turned_rad):
    drawn = shapes.at_shaft(HEIGHT_M, turned_rad, SPEED_RAD_S)
    assert drawn.shape == (8, 2)
    assert drawn[0].tolist() == [0.0, 0.0]
    assert np.hypot(*np.diff(drawn, axis=0).T) == pytest.approx(LENGTHS_M, abs=1e-12)
    assert np.arctan2(drawn[1, 1], drawn[1, 0]) == pytest.approx(
        np.arctan2(np.sin(turned_rad), np.cos(turned_rad)), abs=1e-9
    )


def test_no_point_is_deeper_in_the_floor_than_the_contact_presses_it(shapes, stroke):
    deepest_m = (stroke.normal_N.max() / RIG.ground.stiffness_N_per_m1p5) ** (2 / 3)
    angles = np.linspace(stroke.shaft_angle_rad[0], stroke.shaft_angle_rad[-1], 500)
    lowest_m = max(shapes.at_shaft(HEIGHT_M, angle, SPEED_RAD_S)[:, 1].max() for angle in angles)
    assert HEIGHT_M < lowest_m + RIG.leg.link_radius_m <= HEIGHT_M + 1.01 * deepest_m


@pytest.mark.parametrize("turns", [-2, 1, 20])
def test_whole_turns_do_not_matter(shapes, turns):
    once = shapes.at_shaft(HEIGHT_M, 1.9, SPEED_RAD_S)
    assert shapes.at_shaft(HEIGHT_M, 1.9 + turns * 2.0 * np.pi, SPEED_RAD_S) == pytest.approx(
        once, abs=1e-9
    )


def test_where_no_stroke_passes_the_leg_hangs(shapes):
    above_rad = np.radians(300.0)
    assert (shapes.at_shaft(HEIGHT_M, above_rad, SPEED_RAD_S) == shapes.hanging(above_rad)).all()
    assert (shapes.at_shaft(HEIGHT_M, 1.9, 99.0) == shapes.hanging(1.9)).all()


def test_before_the_start_it_hangs_without_a_jump(shapes):
    before = shapes.at_shaft(HEIGHT_M, START_RAD - 1e-6, SPEED_RAD_S)
    assert before == pytest.approx(
        shapes.at_shaft(HEIGHT_M, START_RAD + 1e-6, SPEED_RAD_S), abs=1e-4
    )


def test_a_leg_in_the_air_sags_under_its_weight_and_hangs_straight_down_straight(shapes):
    level = shapes.hanging(0.0)
    assert 0.001 < level[-1, 1] < 0.02
    assert np.all(np.diff(level[:, 1]) >= 0.0)
    straight = shapes.hanging(np.pi / 2.0)
    assert straight == pytest.approx(
        np.column_stack([np.zeros(8), np.concatenate([[0.0], np.cumsum(LENGTHS_M)])]), abs=1e-9
    )


def test_hanging_between_whole_degrees_is_as_if_computed_there(shapes):
    stiffer = LegShapes(replace(RIG, leg=replace(RIG.leg, k0_Nm_per_rad=1e6)))
    angle = np.radians(33.4)
    assert stiffer.hanging(angle) == pytest.approx(
        leg_points(np.full(7, angle), LENGTHS_M), abs=1e-6
    )
    neighbours = [shapes.hanging(np.radians(degrees)) for degrees in (33.0, 34.0)]
    assert (
        min(p[-1, 1] for p in neighbours)
        < shapes.hanging(angle)[-1, 1]
        < max(p[-1, 1] for p in neighbours)
    )


def test_hinge_angles_of_a_photo_turn_each_link_against_the_one_before(shapes):
    assert shapes.from_hinge_angles(0.7, np.zeros(6)) == pytest.approx(
        leg_points(np.full(7, 0.7), LENGTHS_M)
    )
    bent = shapes.from_hinge_angles(0.0, np.array([0.0, 0.0, 90.0, 0.0, 0.0, -90.0]))
    assert bent[-1] == pytest.approx([LENGTHS_M[:3].sum() + LENGTHS_M[6], LENGTHS_M[3:6].sum()])


def test_the_shape_of_a_stroke_read_back_as_hinge_angles_is_the_same(shapes, stroke):
    q = stroke.q_rad[80]
    assert shapes.from_hinge_angles(q[0], np.degrees(np.diff(q))) == pytest.approx(
        leg_points(q, LENGTHS_M)
    )
