"""A measured torque-rotation curve as the springs of the leg: the kernel, its energy, statics,
effects, and what is no curve.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import approx_fprime

from rfca_rig.errors import BadInput
from rfca_rig.model.chain import Tolerance, advance, allocate_samples, find_rest_state, make_chain
from rfca_rig.model.hinge_springs import (
    bending_stiffness_Nm_per_rad,
    bending_torque_Nm,
    knots_from,
    polynomial,
    polynomial_springs,
    slope_at_rest,
    springs_of,
    table_of,
)
from rfca_rig.model.kernel.forces import assemble_once, mechanical_energy_J, springs_J
from rfca_rig.model.kernel.stage import allocate_workspace
from rfca_rig.model.kernel.state import NO_LAWS, Shaft, State
from rfca_rig.model.paper.statics import (
    equilibrium_under_tip_force,
    imbalance_Nm,
    tangent_stiffness,
    tip_chain_of,
)
from rfca_rig.model.paper.strip import with_links
from rfca_rig.model.parameters import LawTable, PresentEffect, TorqueSpline
from rfca_rig.model.statics_contact import follow_static_path
from rfca_rig.model.stroke import simulate_stroke_at_speed
from tests.model.legs import NO_GROUND_M, PAPER

T = np.arange(-100, 1250) * 1e-3
TIGHT = Tolerance(1e-8, 3e-5)
K0 = PAPER.leg.k0_Nm_per_rad
K2 = PAPER.leg.k2_per_rad2
SOFTENING_NM = 2.4 * np.tanh(np.radians([3.0, 8.0, 14.0, 22.0, 30.0]) / 0.25)
SOFTENING = knots_from([3.0, 8.0, 14.0, 22.0, 30.0], SOFTENING_NM, "softening")
ONE_SIDED_WAY = knots_from(
    [-30.0, -12.0, -5.0, 0.0, 6.0, 14.0, 35.0],
    [-8.0, -2.4, -0.95, 0.0, 1.3, 3.4, 9.0],
    "asymmetric",
)


def with_curves(*curves, rig=PAPER):
    k0 = np.mean([slope_at_rest(TorqueSpline(*curve)) for curve in curves])
    splines = tuple(TorqueSpline(*curve).scaled(1.0, 1.0 / k0) for curve in curves)
    return replace(
        rig, leg=replace(rig.leg, k0_Nm_per_rad=float(k0), k2_per_rad2=0.0, torque_splines=splines)
    )


def cubic_curve(angles_deg):
    x = np.radians(angles_deg)
    return knots_from(angles_deg, K0 * (x + K2 * x**3), "cubic")


def test_the_cubic_law_is_one_of_the_curves():
    exact = with_curves(cubic_curve([5.0, 15.0, 25.0, 60.0]))
    x = np.linspace(-1.0, 1.0, 101)
    assert bending_torque_Nm(exact.leg, x) == pytest.approx(
        bending_torque_Nm(PAPER.leg, x), abs=1e-12
    )
    assert bending_stiffness_Nm_per_rad(exact.leg, x) == pytest.approx(
        bending_stiffness_Nm_per_rad(PAPER.leg, x), abs=1e-11
    )
    law, curve = (simulate_stroke_at_speed(rig, 0.215, 2.433, T, TIGHT) for rig in (PAPER, exact))
    assert np.abs(law.fz_N - curve.fz_N).max() < 1e-3  # rounding decides where a step ends
    assert np.abs(law.shaft_torque_Nm - curve.shaft_torque_Nm).max() < 1e-4


@pytest.mark.parametrize("curve", [SOFTENING, ONE_SIDED_WAY])
def test_the_curve_goes_through_its_knots_with_a_continuous_second_derivative_and_on_straight(
    curve,
):
    found = polynomial(curve[0], np.array(curve[1]))
    assert found(np.array(curve[0])) == pytest.approx(np.array(curve[1]), abs=1e-14)
    for knot in curve[0][1:-1]:
        assert found(knot - 1e-9, 2) == pytest.approx(found(knot + 1e-9, 2), abs=1e-5)
    last = curve[0][-1]
    assert found(last + 0.5) == pytest.approx(curve[1][-1] + 0.5 * found(last, 1))
    assert found(last + 0.5, 1) == pytest.approx(found(last - 1e-12, 1))


def test_a_curve_from_rest_on_is_odd_and_one_of_both_sides_is_not():
    odd, other = (table_of((TorqueSpline(*curve),), 2) for curve in (SOFTENING, ONE_SIDED_WAY))
    x = np.array([[0.0, 0.03], [0.0, 0.31], [0.0, 0.9]])
    assert odd.torque(-x)[:, 1] == pytest.approx(-odd.torque(x)[:, 1], abs=1e-14)
    assert (np.abs(other.torque(-x) + other.torque(x))[1:, 1] > 0.05).all()


@pytest.mark.parametrize("curve", [SOFTENING, ONE_SIDED_WAY])
@pytest.mark.parametrize("x", [-0.9, -0.3, -0.01, 0.02, 0.2, 0.8])
def test_the_energy_is_the_integral_of_the_torque(curve, x):
    rig = with_curves(curve)
    q = np.array([[0.3, *(0.3 + np.full(6, x))]])  # the first hinge bends, the others are straight
    torque = lambda angle: float(bending_torque_Nm(rig.leg, np.array(angle)))  # noqa: E731
    both_sides = [*curve[0], *(-angle for angle in curve[0])]
    knots = [angle for angle in both_sides if min(0.0, x) < angle < max(0.0, x)]
    expected = quad(torque, 0.0, x, points=knots or None, epsabs=1e-13)[0]
    assert springs_J(make_chain(rig, NO_GROUND_M), q)[0] == pytest.approx(expected, abs=1e-11)


@pytest.mark.slow
@pytest.mark.parametrize("curves", [[SOFTENING], [ONE_SIDED_WAY, *[SOFTENING] * 5]])
def test_a_free_leg_without_damping_keeps_its_energy(curves):
    rig = with_curves(*curves)
    chain = make_chain(
        replace(rig, leg=replace(rig.leg, hinge_damping_Nm_s_per_rad=0.0)), NO_GROUND_M
    )
    nothing = np.empty(0)
    n = 7
    free = Shaft(nothing, np.empty((0, 4)), nothing, True, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    state = State(
        np.linspace(0.0, 2.4, n), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((0, n, 4))
    )
    begin = mechanical_energy_J(chain, state.q[None], state.w[None])[0]
    samples = allocate_samples(np.linspace(0.01, 0.5, 50), n)
    advance(chain, free, state, (0.0, 0.5), 1e-5, Tolerance(1e-9, 3e-6), samples)
    assert np.abs(np.diff(samples.q, axis=1)).max() > 0.6  # beyond the last knot, too
    assert mechanical_energy_J(chain, samples.q, samples.w) == pytest.approx(begin, abs=2e-6)


def test_the_kernels_derivative_is_that_of_its_residual():
    chain = make_chain(with_curves(ONE_SIDED_WAY, *[SOFTENING] * 5), NO_GROUND_M)
    work = allocate_workspace(7, 7)
    zero = np.zeros(7)
    state = State(zero.copy(), zero.copy(), zero.copy(), zero.copy(), np.zeros((0, 7, 4)))
    q = np.cumsum([0.4, -0.7, 0.05, -0.1, 0.3, 0.6, -0.02])

    def residual(at):
        assemble_once(chain, NO_LAWS, state, 0.0, at, zero, zero, (0.0, 0.0, 1.0), work)
        return work.R.copy()

    residual(q)
    by_kernel = work.J.copy()
    assert by_kernel == pytest.approx(approx_fprime(q, residual, 1e-7), abs=2e-5)


def test_statics_and_kernel_share_the_curves_and_rest_angles():
    rest = (0.02, -0.03, 0.01, 0.0, 0.04, -0.02)
    rig = with_curves(ONE_SIDED_WAY, *[SOFTENING] * 5)
    rig = replace(rig, leg=replace(rig.leg, rest_angles_rad=rest))
    chain = tip_chain_of(rig.leg)
    found = equilibrium_under_tip_force(chain, 0.6, np.array([2.0, -4.0]))
    assert np.abs(imbalance_Nm(chain, found.phi, np.array([2.0, -4.0]))[1:]).max() < 1e-10
    slopes = approx_fprime(
        found.phi, lambda phi: imbalance_Nm(chain, phi, np.array([2.0, -4.0])), 1e-7
    )
    assert tangent_stiffness(chain, found.phi, np.array([2.0, -4.0])) == pytest.approx(
        slopes, abs=1e-5
    )
    hanging = equilibrium_under_tip_force(chain, 0.6, np.zeros(2)).phi
    assert np.diff(find_rest_state(make_chain(rig, NO_GROUND_M), 0.6).q) == pytest.approx(
        hanging[1:], abs=1e-9
    )


def test_a_softer_curve_lets_the_leg_bend_farther_on_the_ground():
    soft = with_curves(SOFTENING)
    at = [float(np.radians(120.0))]
    stiff_angles, soft_angles = (
        follow_static_path(rig, 0.215, at)[-1].hinge_angles_rad for rig in (PAPER, soft)
    )
    assert np.abs(soft_angles).max() > 1.1 * np.abs(stiff_angles).max()


def test_one_curve_that_is_softer_than_its_fellows_is_a_damaged_hinge():
    angles, torques = SOFTENING
    weak = (angles, tuple(0.8 * torque for torque in torques))
    by_curve = with_curves(SOFTENING, SOFTENING, weak, *[SOFTENING] * 3)
    effect = PresentEffect("damaged_hinge", (("hinge", 4.0), ("stiffness_factor", 0.8)))
    by_effect = replace(with_curves(SOFTENING), effects=(effect,))
    first, second, sound = (
        simulate_stroke_at_speed(rig, 0.215, 2.433, T, TIGHT)
        for rig in (by_curve, by_effect, with_curves(SOFTENING))
    )
    assert np.abs(first.fz_N - second.fz_N).max() < 1e-3
    assert np.abs(first.fz_N - sound.fz_N).max() > 0.1


def test_k0_scales_the_curve():
    rig = with_curves(SOFTENING)
    stiffer = replace(rig.leg, k0_Nm_per_rad=1.1 * rig.leg.k0_Nm_per_rad)
    x = np.linspace(-0.8, 0.8, 33)
    assert bending_torque_Nm(stiffer, x) == pytest.approx(1.1 * bending_torque_Nm(rig.leg, x))


def test_more_links_share_the_bending_of_the_same_strip():
    rig = with_curves(SOFTENING)
    finer = with_links(rig.leg, 13)
    x = np.linspace(-0.5, 0.5, 21)
    assert bending_torque_Nm(finer, 0.5 * x) == pytest.approx(bending_torque_Nm(rig.leg, x))
    with pytest.raises(BadInput, match="a curve for each hinge cannot be cut into other links"):
        with_links(with_curves(*[SOFTENING] * 6).leg, 13)


LAW = LawTable("hinges", "spring_torque_Nm", (0.0, 2.0), (0.0, 0.1))


@pytest.mark.parametrize(
    "effect",
    [
        PresentEffect("stiffness_hardening", (("k2_per_rad2", 3.0),)),
        PresentEffect("hinge_backlash", (("half_gap_deg", 0.5),)),
        PresentEffect("tabulated_law", table=LAW),
    ],
)
def test_laws_that_are_written_in_k2_are_refused_in_a_line(effect):
    with pytest.raises(
        BadInput, match=rf"{effect.id}: .* follow a measured curve \(leg.torque_rotation\)"
    ) as refusal:
        simulate_stroke_at_speed(
            replace(with_curves(SOFTENING), effects=(effect,)), 0.215, 2.433, T
        )
    assert "\n" not in str(refusal.value)


def test_programs_that_know_polynomials_only_are_given_no_curve():
    with pytest.raises(
        BadInput, match=r"leg.torque_rotation: MuJoCo takes springs k0 phi \+ k0 k2 phi\^3 only"
    ):
        polynomial_springs(with_curves(SOFTENING).leg, "MuJoCo")
    assert polynomial_springs(PAPER.leg, "MuJoCo") == (K0, 0.0, K0 * K2)


@pytest.mark.parametrize(
    ("angles_deg", "torques_Nm", "said"),
    [
        ([5.0, 10.0, 15.0], [1.0, 2.0], "3 angles, but 2 torques; give one torque per angle"),
        ([0.0, 10.0, 20.0], [0.0, 2.0, 4.0], "3 angles; give 3 to 200 beside 0"),
        (
            [5.0, 15.0, 10.0],
            [1.0, 2.0, 3.0],
            r"angle 3 \(10\) is not above the one before \(15\); sort them",
        ),
        ([5.0, 10.0, 15.0], [1.0, 2.0, 2.0], r"torque 3 \(2 N m\) is not above the one before"),
        ([5.0, 10.0, 150.0], [1.0, 2.0, 3.0], "angle 150 degrees; the limit is 120"),
        (
            [0.0, 5.0, 10.0, 15.0],
            [0.3, 1.0, 2.0, 3.0],
            r"0.3 N m at 0 degrees; angles count from where the hinge bears no torque",
        ),
        ([-5.0, 5.0, 10.0], [0.1, 1.0, 2.0], "0.1 N m at -5 degrees"),
        (
            [5.0, 6.0, 15.0, 16.0],
            [1.0, 1.01, 1.02, 3.0],
            "the spline through these torques falls at .* so the curve is not monotone",
        ),
    ],
)
def test_what_is_no_monotone_curve_through_rest_is_refused_in_a_line(angles_deg, torques_Nm, said):
    with pytest.raises(BadInput, match=f"^here: {said}") as refusal:
        knots_from(angles_deg, torques_Nm, "here")
    assert "\n" not in str(refusal.value)


def test_a_curve_given_for_one_sense_of_bending_holds_for_the_other():
    backwards = knots_from([-30.0, -22.0, -14.0, -8.0, -3.0], -SOFTENING_NM[::-1], "backwards")
    assert backwards[0] == pytest.approx(SOFTENING[0])
    assert backwards[1] == pytest.approx(SOFTENING[1])


def test_springs_of_a_leg_take_many_poses_at_once():
    springs = springs_of(with_curves(ONE_SIDED_WAY, *[SOFTENING] * 5).leg)
    poses = np.random.default_rng(0).uniform(-0.8, 0.8, (5, 4, 7))
    assert springs.torque_Nm(poses)[3, 2] == pytest.approx(springs.torque_Nm(poses[3, 2]))
