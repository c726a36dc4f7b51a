"""Torque over angle of one hinge: strip sliding, fixed, or loose in its grooves."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear, minimize_scalar

from rfca_rig.errors import BadInput
from rfca_rig.model.paper.elastica import Holds, bend, even_mesh
from rfca_rig.model.paper.hinge_curve import (
    HeldHinge,
    LooseGroove,
    compute_fixed_curve,
    compute_sliding_curve,
    fit_hardening,
)
from rfca_rig.model.paper.strip import paper_strips, table_1_materials

EI = 0.26
FREE_M = 0.0237
PHI = np.radians(np.arange(1.0, 46.0))


def derivative(curve):
    return np.gradient(curve.energy_J, curve.phi_rad)[1:-1]


@pytest.mark.parametrize("offset_m", [0.0, 0.004, -0.004])
def test_a_sliding_strip_takes_the_length_that_costs_least(offset_m):
    hinge = HeldHinge(EI, FREE_M, offset_m)
    phi = 0.7

    def energy(length_m):
        holds = Holds(
            np.array([0, 200]), np.array([-0.5, 0.5]) * phi, (float(hinge.chord_m(phi)), 0.0)
        )
        return bend(
            even_mesh(EI, length_m, 200), holds, np.zeros(2), np.linspace(-0.5, 0.5, 201) * phi
        ).energy_J

    chord = float(hinge.chord_m(phi))
    best = minimize_scalar(energy, bounds=(1.003 * chord, 1.1 * chord), method="bounded")
    assert 1.004 * chord < best.x < 1.099 * chord
    assert compute_sliding_curve(hinge, np.array([phi])).energy_J[0] == pytest.approx(
        best.fun, rel=1e-5
    )


@pytest.mark.parametrize("offset_m", [0.0, 0.003, -0.003])
def test_torque_of_a_sliding_strip_is_the_slope_of_its_energy(offset_m):
    fine = np.radians(np.linspace(20.0, 21.0, 101))
    curve = compute_sliding_curve(HeldHinge(EI, FREE_M, offset_m), fine)
    assert curve.torque_Nm[1:-1] == pytest.approx(derivative(curve), rel=1e-6)


def test_a_sliding_strip_on_the_pin_hardens_by_a_sixth():
    small = np.radians(np.linspace(0.5, 6.0, 12))
    fit = fit_hardening(small, compute_sliding_curve(HeldHinge(EI, FREE_M), small).torque_Nm)
    assert fit.k0_Nm_per_rad == pytest.approx(EI / FREE_M, rel=1e-5)
    assert fit.k2_per_rad2 == pytest.approx(1.0 / 6.0, rel=0.02)


def test_a_fixed_strip_is_upset_and_stiff_but_hardly_hardens():
    curve = compute_fixed_curve(HeldHinge(EI, FREE_M), PHI)
    assert curve.torque_Nm[1:-1] == pytest.approx(derivative(curve), rel=1e-4)
    ka = 0.5 * 4.493409457909064  # tan x = x
    assert curve.torque_Nm[0] / PHI[0] == pytest.approx(
        (ka / np.tan(ka)) ** 2 * EI / FREE_M, rel=2e-4
    )
    assert fit_hardening(PHI, curve.torque_Nm).k2_per_rad2 < 0.05


def test_a_fixed_strip_off_the_pin_is_stiffest_at_the_beginning():
    curve = compute_fixed_curve(HeldHinge(EI, FREE_M, 0.002), PHI)
    assert curve.torque_Nm[10:-1] == pytest.approx(derivative(curve)[9:], rel=2e-3)
    assert fit_hardening(PHI, curve.torque_Nm).k2_per_rad2 < 0.0


def test_a_fixed_strip_does_not_stretch():
    with pytest.raises(BadInput, match="cannot stretch"):
        compute_fixed_curve(HeldHinge(EI, FREE_M, -0.001), PHI)


def test_grooves_that_meet_are_refused():
    with pytest.raises(BadInput, match="grooves would meet"):
        compute_sliding_curve(HeldHinge(EI, 0.004, 0.006), PHI)


def torque_by_bounds(groove, phi, nodes=96):
    """The loose strip as a quadratic programme: deflections of nodes, bounded by the walls up to
    the mouth.
    """
    h = 0.5 * groove.pitch_m / nodes
    second = (
        np.diag(np.full(nodes + 1, -2.0)) + np.diag(np.ones(nodes), 1) + np.diag(np.ones(nodes), -1)
    )
    second[0, 1] = second[-1, -2] = 2.0
    slope = np.zeros(nodes + 1)
    slope[-1] = h * phi
    weight = np.sqrt(np.concatenate(([0.5], np.ones(nodes - 1), [0.5])))
    inside = np.arange(nodes + 1) * h <= groove.reach_m + 1e-9
    bounds = np.where(inside, 0.0, -np.inf), np.where(inside, groove.play_m, np.inf)
    solved = lsq_linear(
        weight[:, None] * second / h, -weight * slope / h, bounds, method="bvls", max_iter=5000
    )
    return groove.EI_Nm2 * (second @ solved.x + slope)[-1] / h**2


@pytest.mark.parametrize("phi_deg", [5, 8, 12, 20, 30])
def test_a_loose_strip_bends_as_far_as_the_walls_let_it(phi_deg):
    groove = LooseGroove(EI, 0.0384, 0.004, 0.0004)
    phi = np.radians(phi_deg)
    assert groove.touches_rad < np.radians(8) < np.radians(12) < groove.flat_rad
    assert groove.torque_Nm(np.array([phi]))[0] == pytest.approx(
        torque_by_bounds(groove, phi), rel=1e-2
    )


def test_a_loose_strip_hardens_from_the_whole_pitch_to_the_mouths():
    groove = LooseGroove(EI, 0.0393, 0.002, 0.0002)
    phi = np.linspace(0.0, 50.0, 200_001)[1:]
    secant = groove.torque_Nm(phi) / phi
    assert secant[0] == pytest.approx(EI / 0.0393)
    assert (np.diff(secant) > -1e-9).all()
    assert np.abs(np.diff(groove.torque_Nm(phi))).max() < 0.1  # no jump between the three parts
    assert EI / 0.0046 < secant[-1] < EI / 0.004


def test_a_third_of_a_millimetre_of_play_gives_the_fitted_curve_but_overloads_the_strips():
    strips = paper_strips(table_1_materials()[-1])
    phi = np.radians(np.linspace(0.5, 23.5, 47))  # as far as a hinge turns in the paper's stroke
    torque = LooseGroove(strips.bending_stiffness_Nm2, 0.039333, 0.003, 0.00032).torque_Nm(phi)
    fit = fit_hardening(phi, torque)
    assert fit.k0_Nm_per_rad == pytest.approx(10.98, rel=0.02)
    assert fit.k2_per_rad2 == pytest.approx(4.56, rel=0.05)
    assert torque[-1] > 2.0 * strips.breaking_moment_Nm


def test_a_groove_without_play_is_refused():
    with pytest.raises(BadInput, match="play must be above zero"):
        LooseGroove(EI, 0.0393, 0.002, 0.0)
