"""The floor as a constraint, eqs. (14)-(15), against the compliant floor as that gets stiffer."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.paper.dynamics import KnownMotion
from rfca_rig.model.paper.rigid_floor import EndReason, simulate_on_rigid_floor
from rfca_rig.model.parameters import Ground
from rfca_rig.model.stroke import simulate_stroke
from tests.model.legs import pendulum

HEIGHT_M = 0.19
START_RAD = 0.5
ACCELERATION = 8.0
T = np.linspace(0.0, 0.46, 185)
BARE = pendulum(3, 0.09, 0.1, hinge_damping=0.06, k0=8.0)
SHORT_LEG = replace(BARE, leg=replace(BARE.leg, link_radius_m=0.004))
SHAFT = KnownMotion(
    lambda t: START_RAD + 0.5 * ACCELERATION * t**2,
    lambda t: ACCELERATION * t,
    lambda _: ACCELERATION,
)
RATTLE_S = 0.06


@pytest.fixture(scope="module")
def on_ice():
    return simulate_on_rigid_floor(SHORT_LEG, HEIGHT_M, SHAFT, T)


@pytest.fixture(scope="module")
def sliding():
    return simulate_on_rigid_floor(SHORT_LEG, HEIGHT_M, SHAFT, T, friction_coefficient=0.2)


def compliant(stiffness, mu):
    rig = replace(SHORT_LEG, ground=Ground(stiffness, 5.0, mu, 1e-5, 0.0))
    motion = ShaftMotion(
        np.array([0.0, T[-1]]), np.array([[START_RAD, 0.0, 0.5 * ACCELERATION, 0.0]]), np.zeros(1)
    )
    return simulate_stroke(rig, HEIGHT_M, motion, T, Tolerance(1e-6, 3e-3))


def distances(rigid, mu):
    """Largest difference of normal force [N] in the loading, for floors that get ten times
    stiffer each.
    """
    loading = rigid.touchdowns_s[0] + RATTLE_S < T
    return [
        np.abs(compliant(k, mu).normal_N.sum(axis=1) - rigid.lambda_N)[loading].max()
        for k in (1e5, 1e6, 1e7)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(("stroke", "mu"), [("on_ice", 0.0), ("sliding", 0.2)])
def test_a_stiffer_floor_comes_to_the_constraint_as_fast_as_its_depth_vanishes(stroke, mu, request):
    """Depth under a given force goes with stiffness^(-2/3): a factor 4.64 for each power of ten."""
    rigid = request.getfixturevalue(stroke)
    soft, stiffer, stiffest = distances(rigid, mu)
    assert stiffest < 4e-3 * rigid.lambda_N.max()
    assert soft / stiffer == pytest.approx(4.64, rel=0.15)
    assert stiffer / stiffest == pytest.approx(4.64, rel=0.25)


def test_shape_and_torque_are_those_of_a_stiff_floor(on_ice):
    stiff = compliant(1e8, 0.0)
    loading = on_ice.touchdowns_s[0] + RATTLE_S < T
    assert on_ice.ended is EndReason.TIME
    assert np.abs(np.cumsum(on_ice.phi, axis=1) - stiff.q_rad)[loading].max() < 1e-3
    assert np.abs(on_ice.shaft_torque_Nm - stiff.shaft_torque_Nm)[loading].max() < 1e-3 * np.ptp(
        on_ice.shaft_torque_Nm
    )


def test_the_tip_stays_on_the_floor_and_is_never_pulled(on_ice, sliding):
    for rigid in (on_ice, sliding):
        assert len(rigid.touchdowns_s) == 1
        held = rigid.touchdowns_s[0] < T
        assert np.abs(rigid.tip_depth_m[held]).max() < 1e-7
        assert rigid.lambda_N.min() >= 0.0
        assert rigid.lambda_N.max() > 10.0


def test_friction_of_a_sliding_tip_takes_more_torque(on_ice, sliding):
    assert np.abs(on_ice.shaft_torque_Nm).max() < 0.95 * np.abs(sliding.shaft_torque_Nm).max()


DIP = KnownMotion(
    lambda t: 0.5 + 0.4 * np.sin(4 * t) ** 2,
    lambda t: 1.6 * np.sin(8 * t),
    lambda t: 12.8 * np.cos(8 * t),
)


@pytest.mark.slow
def test_the_constraint_comes_and_goes_with_the_sign_of_lambda():
    rigid = simulate_on_rigid_floor(SHORT_LEG, HEIGHT_M, DIP, np.linspace(0.0, 0.75, 301))
    assert rigid.ended is EndReason.TIME
    assert len(rigid.touchdowns_s) == len(rigid.releases_s) > 0
    before = np.searchsorted(rigid.t_s, rigid.releases_s[-1]) - 1
    assert 0.0 < rigid.lambda_N[before] < 0.1 * rigid.lambda_N.max()
    assert rigid.lambda_N[-1] == 0.0
    assert rigid.tip_depth_m[-1] < -1e-3


@pytest.mark.slow
def test_a_run_ends_where_the_tip_stops_sliding():
    rigid = simulate_on_rigid_floor(
        SHORT_LEG, HEIGHT_M, DIP, np.linspace(0.0, 0.75, 301), friction_coefficient=0.2
    )
    assert rigid.ended is EndReason.SLIDING
    assert 0.3 < rigid.t_s[-1] < 0.5


def test_a_run_ends_where_another_link_end_comes_down():
    shaft = replace(SHAFT, angle=lambda t: SHAFT.angle(t) - 0.4)
    low = simulate_on_rigid_floor(SHORT_LEG, 0.08, shaft, np.linspace(0.0, 0.6, 241))
    assert low.ended is EndReason.OTHER_END
    assert low.t_s[-1] - low.touchdowns_s[0] > 0.02
    ends = np.cumsum(0.09 * np.sin(np.cumsum(low.phi[-1])))
    assert 0.073 < ends[:-1].max() < 0.0761


def test_a_leg_that_begins_in_the_floor_is_bad_input():
    with pytest.raises(BadInput, match=r"begins \d+\.\d mm deep in it"):
        simulate_on_rigid_floor(SHORT_LEG, 0.08, SHAFT, T)
