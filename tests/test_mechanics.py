"""The examples of docs/mechanics.md, and what they do not show: limits, and equations against
each other.
"""

import doctest
import inspect
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

from rfca_rig import mechanics
from rfca_rig.errors import BadInput
from rfca_rig.model.paper.dynamics import DrivenChain, KnownTorque
from rfca_rig.model.paper.rigid_floor import RigidFloor
from tests.model.legs import PAPER

PAGE = Path(__file__).parents[1] / "docs" / "mechanics.md"


def test_the_examples_of_the_page_run():
    found = doctest.testfile(
        str(PAGE), module_relative=False, optionflags=doctest.NORMALIZE_WHITESPACE
    )
    assert found.attempted > 40
    assert found.failed == 0


@pytest.mark.parametrize("number", range(1, 20))
def test_every_equation_has_a_function_and_an_example(number):
    assert any(
        number in equations_of(inspect.getdoc(getattr(mechanics, name)) or "")
        for name in mechanics.__all__
    )
    # Beside the headings, which name ranges
    assert f"({number})" in "\n".join(
        line for line in PAGE.read_text(encoding="utf-8").splitlines() if not line.startswith("#")
    )


def equations_of(docstring):
    """Numbers of equations that a docstring refers to, ranges as `(14) to (16)` filled in."""
    numbers = {int(number) for number in re.findall(r"\((\d+)\)", docstring)}
    for first, last in re.findall(r"\((\d+)\) to \((\d+)\)", docstring):
        numbers.update(range(int(first), int(last) + 1))
    return numbers


def test_the_small_slope_error_is_that_of_the_curvature():
    angle = 0.3
    y = np.tan(angle)
    rise = 5.0
    exact = mechanics.curvature_per_m(y, rise)
    assert mechanics.small_slope_error(angle) == pytest.approx((rise - exact) / exact)
    assert mechanics.small_slope_error(mechanics.small_slope_limit_rad(0.1)) == pytest.approx(0.1)
    assert 0.25 < mechanics.small_slope_limit_rad(0.1) < 0.27
    with pytest.raises(BadInput, match="above 0"):
        mechanics.small_slope_limit_rad(0.0)


def test_a_shape_under_a_tip_force_has_the_least_energy():
    """Springs, weight and the force's potential, minimised by scipy without the statics' own
    equations.
    """
    chain = mechanics.tip_chain_of(PAPER.leg)
    shaft = 0.4
    force = np.array([3.0, -25.0])
    found = mechanics.equilibrium_under_tip_force(chain, shaft, force)

    def potential(hinges):
        phi = np.append(shaft, hinges)
        angles = np.cumsum(phi)
        middles = np.cumsum(chain.L * np.sin(angles)) - 0.5 * chain.L * np.sin(angles)
        springs = (
            0.5
            * PAPER.leg.k0_Nm_per_rad
            * np.sum(hinges**2 + 0.5 * PAPER.leg.k2_per_rad2 * hinges**4)
        )
        end = np.array([np.sum(chain.L * np.cos(angles)), np.sum(chain.L * np.sin(angles))])
        end[1] += chain.tip_radius_m
        turned = (
            -chain.tip_radius_m * angles[-1]
        )  # the force acts on the lowest point of a round end
        return springs - 9.81 * chain.mass @ middles - force @ end - force[0] * turned

    least = minimize(potential, np.zeros(6), method="BFGS", options={"gtol": 1e-9})
    assert found.phi[1:] == pytest.approx(least.x, abs=2e-5)


def test_a_held_contact_is_that_of_the_rigid_floor():
    """(15) as printed, without friction, against the floor of the constrained stroke, whose
    shaft is free here.
    """
    links = mechanics.link_chain_of(PAPER.leg)
    floor = RigidFloor(DrivenChain(links, (KnownTorque(lambda _: 0.0),) * 7), 0.2, 0.0, 0.0)
    x = np.concatenate([np.linspace(0.4, 0.1, 7), np.zeros(7)])
    phi = x[:7]
    accelerations, normal = floor.touching(0.0, x, 0.0)
    drift = (
        -(300.0**2) * floor.depths(phi)[-1]
    )  # Baumgarte's term, which the equation does not have
    M = mechanics.mass_matrix(links, phi)
    F = mechanics.right_side_Nm(links, phi, np.zeros(7), np.zeros(7), mechanics.no_loads(7))
    mine, contact = mechanics.solve_held_contact(M, F, floor.J_y(phi), [-drift])
    assert mine == pytest.approx(accelerations, rel=1e-9)
    assert contact[0] == pytest.approx(normal, rel=1e-9)


@pytest.mark.parametrize("depth", [1e-5, 1e-4])
def test_the_pressure_carries_the_normal_force(depth):
    E = mechanics.effective_modulus_Pa(2.75e9, 0.38, 3.2e9, 0.37)
    R = mechanics.effective_radius_m(3e-3, 0.02)
    r = np.linspace(0.0, 2.0 * mechanics.contact_radius_m(R, depth), 40001)
    carried = np.trapezoid(2.0 * np.pi * r * mechanics.contact_pressure_Pa(r, E, R, depth), r)
    stiffness = mechanics.contact_stiffness_N_per_m1p5(E, R)
    assert carried == pytest.approx(mechanics.normal_force(stiffness, 0.0, depth, 0.0)[0], rel=1e-5)
    assert mechanics.contact_pressure_Pa(np.array([0.0]), E, R, 0.0)[0] == 0.0


def test_a_hollow_makes_the_contact_wider():
    assert mechanics.effective_radius_m(3e-3, -4e-3) == pytest.approx(12e-3)
    assert mechanics.effective_radius_m(3e-3) == 3e-3


@pytest.mark.parametrize(
    ("call", "named"),
    [
        (lambda: mechanics.effective_modulus_Pa(-2.75e9, 0.38, 3.2e9, 0.37), "E1_Pa"),
        (lambda: mechanics.effective_modulus_Pa(2.75e9, 0.38, float("nan"), 0.37), "E2_Pa"),
        (lambda: mechanics.effective_modulus_Pa(2.75e9, 0.38, 3.2e9, 0.7), "nu2"),
        (lambda: mechanics.effective_radius_m(0.0), "R1_m"),
        (lambda: mechanics.effective_radius_m(3e-3, -2e-3), "R2_m"),
        (lambda: mechanics.contact_radius_m(-3e-3, 1e-4), "radius_m"),
        (lambda: mechanics.contact_radius_m(3e-3, 4e-3), "depth_m"),
        (lambda: mechanics.contact_stiffness_N_per_m1p5(-1e9, 3e-3), "modulus_Pa"),
        (lambda: mechanics.contact_pressure_Pa(np.zeros(1), 1e9, 0.0, 1e-4), "radius_m"),
    ],
)
def test_a_contact_that_cannot_be_is_refused_by_the_name_of_the_value(call, named):
    with pytest.raises(BadInput, match=named):
        call()
