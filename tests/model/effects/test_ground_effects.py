"""Effects of the ground against geometry and closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.model.catalogue import set_up
from rfca_rig.model.chain import advance, allocate_samples, find_rest_state
from rfca_rig.model.kernel.bump import elevation, find_nearest
from rfca_rig.model.kernel.forces import mechanical_energy_J
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import Ground
from rfca_rig.model.stroke import simulate_stroke
from tests.model.effects.rigs import TIGHT, T, Tolerance, having, held, paper_stroke, through
from tests.model.legs import PAPER, pendulum

STIFF = replace(
    pendulum(1, 0.3, 0.2), ground=Ground(1e5, 0.0, 0.0, 3e4, 0.0)
)  # one rigid link: the shaft says where its end is
FINE = Tolerance(1e-6, 3e-3)


def stroke_of(rig, height_m, start_rad):
    return simulate_stroke(
        rig, height_m, ramp_to_speed(start_rad, 2.433, 0.05, float(T[-1])), T, FINE
    )


@pytest.mark.parametrize("slope", [0.1, -0.07])
def test_a_tilted_floor_is_a_tilted_gravity_seen_from_the_floor(slope):
    """Turned by the slope's angle, the same stroke: less height along the normal, gravity aside,
    shaft angles shifted.
    """
    angle = np.arctan(slope)
    start = PAPER.leg.start_angle_rad
    tilted = stroke_of(having(PAPER, ground_tilt={"slope": slope}), 0.215, start)
    turned = stroke_of(
        having(PAPER, gravity_tilt={"angle_rad": -angle}), 0.215 * np.cos(angle), start + angle
    )
    falling = T < 0.8
    assert tilted.q_rad[falling] == pytest.approx(turned.q_rad[falling] - angle, abs=3e-6)
    assert tilted.normal_N[falling] == pytest.approx(turned.normal_N[falling], abs=5e-3)
    c = np.cos(angle)
    s = np.sin(angle)
    assert tilted.fz_N[falling] == pytest.approx(
        (c * turned.fz_N + s * turned.fy_N)[falling], abs=5e-3
    )
    assert tilted.fy_N[falling] == pytest.approx(
        (c * turned.fy_N - s * turned.fz_N)[falling], abs=5e-3
    )


@pytest.mark.parametrize("slope", [0.1, -0.1])
def test_a_rigid_link_rests_in_a_sloping_floor_as_geometry_says_pushed_along_the_normal(
    slope,
):
    angle = 0.8
    c = 1 / np.hypot(1, slope)
    s = slope / np.hypot(1, slope)
    height = (
        0.3 * np.sin(angle) + slope * 0.3 * np.cos(angle)
    ) - 1e-3 / c  # the end 1 mm in, across a floor at -height + slope y
    stroke = simulate_stroke(
        having(STIFF, ground_tilt={"slope": slope}), height, held(angle), np.array([-0.1, 0.0, 0.1])
    )
    normal = 1e5 * 1e-3**1.5
    assert stroke.normal_N[:, 0] == pytest.approx(normal, rel=1e-9)
    assert stroke.fz_N == pytest.approx(0.2 * 9.81 - normal * c, rel=1e-9)
    assert stroke.fy_N == pytest.approx(
        normal * s, rel=1e-9
    )  # the floor pushes the leg towards -y where it rises towards +y


def test_a_soft_floor_yields_besides_the_contact():
    angle = 0.8
    depth = 3e-3
    soft = having(STIFF, ground_compliance={"stiffness_N_per_m1p5": 2e4})
    N = simulate_stroke(
        soft, 0.3 * np.sin(angle) - depth, held(angle), np.array([0.0, 0.1])
    ).normal_N[:, 0]
    assert pytest.approx(depth, rel=1e-9) == (N / 1e5) ** (2 / 3) + (N / 2e4) ** (2 / 3)


@pytest.mark.parametrize("exponent", [1.0, 2.0])
def test_a_contact_of_another_exponent_presses_as_before_at_20_N_and_by_its_power_elsewhere(
    exponent,
):
    angle = 0.8
    reference = (20.0 / 1e5) ** (2 / 3)
    for depth in (0.3 * reference, reference, 1.5 * reference):
        rig = having(STIFF, ground_exponent={"exponent": exponent})
        N = simulate_stroke(
            rig, 0.3 * np.sin(angle) - depth, held(angle), np.array([0.0, 0.1])
        ).normal_N[:, 0]
        assert pytest.approx(20.0 * (depth / reference) ** exponent, rel=1e-6) == N


@pytest.mark.parametrize(
    "order", [("ground_compliance", "ground_exponent"), ("ground_exponent", "ground_compliance")]
)
def test_the_exponent_acts_on_the_contact_that_the_other_effects_leave(order):
    values = {
        "ground_compliance": {"stiffness_N_per_m1p5": 2e4},
        "ground_exponent": {"exponent": 1.0},
    }
    angle = 0.8
    reference = (20.0 / 1e5) ** (2 / 3) + (20.0 / 2e4) ** (2 / 3)
    rig = having(STIFF, **{name: values[name] for name in order})
    N = simulate_stroke(
        rig, 0.3 * np.sin(angle) - 0.5 * reference, held(angle), np.array([0.0, 0.1])
    ).normal_N[:, 0]
    assert pytest.approx(10.0, rel=1e-6) == N


@pytest.mark.parametrize(("damping", "leaving_share"), [(0.0, 1.0), (1.0, 1.0), (1.0, 0.4)])
def test_a_contact_of_another_exponent_gives_back_no_more_than_it_took(damping, leaving_share):
    rig = replace(
        STIFF,
        ground=replace(STIFF.ground, damping_s_per_m=damping, leaving_damping_share=leaving_share),
    )
    rig = having(rig, ground_exponent={"exponent": 1.0})
    t = np.linspace(0.0, 0.2, 4001)
    stroke = simulate_stroke(
        rig, 0.3 * np.sin(0.8), through([0.0, 0.1, 0.2], [0.75, 0.85, 0.75]), t
    )
    depth = np.maximum(0.3 * (np.sin(stroke.q_rad[:, 0]) - np.sin(0.8)), 0.0)
    work = float(np.sum(0.5 * (stroke.normal_N[1:, 0] + stroke.normal_N[:-1, 0]) * np.diff(depth)))
    stored = 0.5 * 20.0 / (20.0 / 1e5) ** (2 / 3) * depth.max() ** 2
    taken = (
        stored * damping * (1.0 + leaving_share) * 0.3 * np.cos(0.825)
    )  # sinks and rises at about that speed
    assert work == pytest.approx(taken, abs=2e-2 * stored)


def test_an_end_that_leaves_is_damped_by_the_share_of_what_one_that_enters_is():
    """One rigid link dips into the floor and comes out again, at 1 rad/s: at one depth twice,
    once each way.
    """
    damped = replace(
        STIFF, ground=replace(STIFF.ground, damping_s_per_m=1.0, leaving_damping_share=0.4)
    )
    angles = [0.75, 0.85, 0.75]
    t = np.array([0.07, 0.13])
    N = simulate_stroke(damped, 0.3 * np.sin(0.8), through([0.0, 0.1, 0.2], angles), t).normal_N[
        :, 0
    ]
    q = np.array([0.82, 0.82])
    depth = 0.3 * (np.sin(q) - np.sin(0.8))
    rate = 0.3 * np.cos(q)
    assert pytest.approx(1e5 * depth**1.5 * (1.0 + np.array([1.0, -0.4]) * rate), rel=1e-6) == N


def test_at_lift_off_an_adhesive_floor_pulls_the_leg_down_with_its_force_and_then_lets_go():
    force = 2.0
    down = 0.8
    up = 0.7
    height = 0.3 * np.sin(0.75)
    t = np.linspace(0.0, 10.0, 10001)
    sticky = having(STIFF, ground_adhesion={"force_N": force})
    stroke = simulate_stroke(sticky, height, through([0.0, 10.0], [down, up]), t)
    depth = np.linspace(0.0, 1e-3, 100001)
    most = (1e5 * depth**1.5 - force * (1 - np.exp(-depth / 5e-5))).min()
    assert -force < most < -0.5 * force
    assert stroke.normal_N.min() == pytest.approx(most, rel=5e-3)
    assert stroke.fz_N.max() == pytest.approx(0.2 * 9.81 - most, rel=5e-3)
    assert stroke.fz_N[-1] == pytest.approx(0.2 * 9.81, abs=1e-3)


def test_friction_falls_with_sliding_speed_as_the_law_says():
    stroke = paper_stroke(FINE, ground_stribeck={"rise_relative": 0.3, "speed_m_s": 0.4})
    w = np.gradient(stroke.q_rad, T, axis=0)
    slip = (-np.array(PAPER.leg.link_lengths_m) * np.sin(stroke.q_rad) * w).sum(axis=1) - 0.003 * w[
        :, -1
    ]
    sliding = (T > 0.6) & (T < 0.95)
    mu = 0.41 * (1 + 0.3 * np.exp(-np.abs(slip) / 0.4))
    assert stroke.tangential_N[sliding, -1] == pytest.approx(
        (mu * stroke.normal_N[:, -1] - 2.0 * slip)[sliding], abs=0.02
    )
    assert np.ptp(mu[sliding]) > 0.005


def chain_on_bump(rig, height_m, **values):
    return set_up(having(rig, ground_bump=values), height_m, held(0.0)).chain()


@pytest.mark.parametrize("height_mm", [4.0, -4.0])
def test_an_end_is_as_far_from_a_bump_as_its_nearest_point_and_the_normal_is_that_slope(
    height_mm,
):
    chain = chain_on_bump(PAPER, 0.2, height_mm=height_mm, at_mm=80.0, width_mm=12.0)
    floor = np.linspace(0.03, 0.13, 200001)
    profile = 1e-3 * height_mm * np.exp(-(((floor - 0.08) / 0.012) ** 2))
    for y, over in [(0.08, 1e-3), (0.075, 2e-3), (0.088, -1e-3), (0.1, 1e-3)]:
        up = elevation(chain, y)[0] + over
        distance, slope, turn = find_nearest(chain, y, up)
        assert abs(distance) == pytest.approx(np.hypot(floor - y, profile - up).min(), abs=1e-9)
        assert np.sign(distance) == np.sign(over)
        cos = 1.0 / np.hypot(1.0, slope)
        step = 1e-7
        along = find_nearest(chain, y + step, up)
        higher = find_nearest(chain, y, up + step)
        assert ((along[0] - distance) / step, (higher[0] - distance) / step) == pytest.approx(
            (-slope * cos, cos), abs=1e-4
        )
        on_normal = find_nearest(chain, y + step * cos, up + step * cos * slope)
        assert (np.arctan(on_normal[1]) - np.arctan(slope)) / step == pytest.approx(
            turn, rel=1e-3, abs=1e-3
        )


def test_a_rigid_link_on_the_flank_of_a_bump_is_pushed_along_its_normal():
    angle = 0.8
    values = {"height_mm": 3.0, "at_mm": 200.0, "width_mm": 15.0}
    y = 0.3 * np.cos(angle)
    up = 1.5e-3
    height = 0.3 * np.sin(angle) + up
    distance, slope, _ = find_nearest(chain_on_bump(STIFF, height, **values), y, up)
    stroke = simulate_stroke(
        having(STIFF, ground_bump=values), height, held(angle), np.array([-0.1, 0.0, 0.1])
    )
    normal = 1e5 * (STIFF.leg.link_radius_m - distance) ** 1.5
    assert abs(slope) > 0.1 and normal > 1.0
    assert stroke.normal_N[:, 0] == pytest.approx(normal, rel=1e-9)
    assert stroke.fz_N == pytest.approx(0.2 * 9.81 - normal / np.hypot(1.0, slope), rel=1e-9)
    assert stroke.fy_N == pytest.approx(normal * slope / np.hypot(1.0, slope), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "height_mm"), [(0.0, 4.0), (0.0, -4.0), (0.1, 4.0)])
def test_a_leg_that_bounces_on_a_bump_keeps_its_energy_and_loses_some_by_friction(
    friction, height_mm
):
    """The leg falls from straight onto the flank, where its tip goes to and fro; all that damps
    is taken out.
    """
    leg = replace(PAPER.leg, hinge_damping_Nm_s_per_rad=0.0)
    rig = replace(PAPER, leg=leg, ground=Ground(2e4, 0.0, friction, 1e-4, 0.0))
    setup = set_up(
        having(rig, ground_bump={"height_mm": height_mm, "at_mm": 160.0, "width_mm": 10.0}),
        0.235,
        held(1.1),
    )
    chain = setup.chain()
    t = np.linspace(0.01, 1.0, 100)
    laws = setup.compile_laws(chain)
    state = find_rest_state(chain._replace(ground_depth=1.0), 1.1, laws)
    state.q[:] = 1.1 - np.linspace(0.0, 0.3, 7)
    begin = mechanical_energy_J(chain, state.q[None], state.w[None])[0]
    samples = allocate_samples(t, 7)
    advance(chain, setup.motion.shaft(), state, (0.0, 1.0), 1e-6, TIGHT, samples, laws)
    y = np.cumsum(chain.length * np.cos(samples.q), axis=1)[:, -1]
    touching = samples.contact[:, 0, -1] > 0.0
    assert touching.sum() > 5 and np.ptp(y[touching]) > 2e-3
    energy = mechanical_energy_J(chain, samples.q, samples.w) - begin
    if friction == 0.0:
        assert np.abs(energy).max() < 2e-5
    else:  # what a stretched tie holds is not counted: friction over half its reach
        held_J = 0.5 * friction * samples.contact[:, 0, -1].max() * 1e-4
        assert energy[-1] < -1e-3 and np.diff(energy).max() < held_J


def test_a_bump_much_wider_than_the_way_is_a_lower_rack():
    wide = paper_stroke(FINE, ground_bump={"height_mm": 2.0, "at_mm": 0.0, "width_mm": 1e5})
    lower = paper_stroke(FINE, height_offset={"offset_mm": -2.0})
    assert wide.fz_N == pytest.approx(lower.fz_N, abs=5e-3)


def test_a_rack_that_stands_higher_is_the_stroke_from_there():
    offset = paper_stroke(height_offset={"offset_mm": 4.0})
    higher = having(PAPER)
    there = simulate_stroke(
        higher, 0.219, ramp_to_speed(PAPER.leg.start_angle_rad, 2.433, 0.05, float(T[-1])), T
    )
    assert offset.fz_N == pytest.approx(there.fz_N, abs=1e-9)


def test_adhesion_s_slope_is_its_derivative_where_it_takes_hold():
    (law,) = set_up(having(STIFF, ground_adhesion={"force_N": 2.0}), 0.2, held(0.1)).laws
    low, middle, high = (
        law.law(depth, 0.0, [0.0] * 4, law.parameters) for depth in (3e-5 - 1e-9, 3e-5, 3e-5 + 1e-9)
    )
    assert (high[0] - low[0]) / 2e-9 == pytest.approx(middle[1], rel=1e-5)
