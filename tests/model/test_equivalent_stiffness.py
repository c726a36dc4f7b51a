"""Equivalent hinge stiffness of the encased strip, (3) to (8), against a dense solution and by
hand.
"""

import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.model.paper.equivalent_stiffness import (
    EncasedStrip,
    at_pins,
    at_pins_mean,
    by_a_length,
    by_its_middle,
    centre_lay,
)
from rfca_rig.model.paper.strip import paper_strips, table_1_materials
from tests.model.legs import LENGTHS

CFSP = paper_strips(table_1_materials()[-1])
EI = CFSP.bending_stiffness_Nm2
PITCH_M = 0.039333
LAY = centre_lay(LENGTHS, CFSP.length_m)
READINGS = {
    "middle": by_its_middle(LAY),
    "length": by_a_length(LAY, 0.0237),
    "pins": at_pins(LAY),
    "mean": at_pins_mean(LAY),
}
BENT = np.array([0.42, 0.35, -0.1, 0.2, 0.6, 0.05])


def dense_stiffness(holding, elements=300):
    """Second derivatives of (7) with the stations' angles eliminated from a dense matrix; nodes
    and springs put up again.
    """
    even = np.linspace(0.0, LAY.length_m, elements + 1)
    apart = np.abs(even[:, None] - holding.stations_m).min(axis=1) > 1e-6
    s = np.sort(np.concatenate((even[apart], holding.stations_m)))
    springs = EI / np.diff(s)
    whole = np.zeros((s.size, s.size))
    for e, k in enumerate(springs):
        whole[e : e + 2, e : e + 2] += k * np.array([[1.0, -1.0], [-1.0, 1.0]])
    held = np.abs(s[:, None] - holding.stations_m).min(axis=1) < 1e-12
    inner = whole[np.ix_(~held, ~held)]
    condensed = whole[np.ix_(held, held)] - whole[np.ix_(held, ~held)] @ np.linalg.solve(
        inner, whole[np.ix_(~held, held)]
    )
    return holding.share.T @ condensed @ holding.share


def test_table_1_gives_the_bending_stiffness_and_mass_of_the_paper():
    names = [material.name for material in table_1_materials()]
    assert names == ["VMQ", "PA12", "CFRP", "CFSP"]
    assert pytest.approx(0.260, abs=5e-4) == EI
    assert CFSP.mass_kg == pytest.approx(2 * 0.007, abs=5e-4)
    printed = [
        0.0061,
        2.43,
        78.41,
        77.42,
    ]  # GPa / (g/cm3); the paper prints 0.00061 for VMQ, a tenth of what its own modulus gives
    assert [
        material.specific_modulus_m2_s2 / 1e6 for material in table_1_materials()
    ] == pytest.approx(printed, rel=6e-3)


def test_strain_and_moment_of_a_strip_bent_round_a_drum():
    assert CFSP.stress_at_Pa(1 / 0.1) == pytest.approx(120e9 * 0.0004 / 0.1)
    assert CFSP.stress_at_Pa(CFSP.breaking_curvature_per_m) == pytest.approx(651e6)
    assert CFSP.breaking_moment_Nm == pytest.approx(
        651e6 * 2 * 0.0254 * 0.0008**2 / 6
    )  # strength times section modulus


@pytest.mark.slow
@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("phi", [np.zeros(6), BENT], ids=["straight", "bent"])
def test_stiffness_by_perturbation_is_that_of_a_dense_solution(reading, phi):
    strip = EncasedStrip(EI, LAY, READINGS[reading])
    dense = dense_stiffness(READINGS[reading])
    assert strip.difference_stiffness(phi) == pytest.approx(np.diag(dense), rel=1e-6)
    assert strip.difference_stiffness_matrix(phi) == pytest.approx(dense, rel=1e-6, abs=1e-6)
    assert strip.stiffness_matrix(phi) == pytest.approx(dense, rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("reading", READINGS)
def test_directions_alone_make_a_spring_that_does_not_harden(reading):
    strip = EncasedStrip(EI, LAY, READINGS[reading])
    matrix = strip.stiffness_matrix(np.zeros(6))
    assert strip.torque_Nm(BENT) == pytest.approx(matrix @ BENT, rel=1e-9, abs=1e-9)
    assert strip.energy_J(3.0 * BENT) == pytest.approx(9.0 * strip.energy_J(BENT), rel=1e-10)


def test_each_hinge_is_as_stiff_as_the_strip_between_its_stations():
    middle = EncasedStrip(EI, LAY, READINGS["middle"]).difference_stiffness(BENT)
    reach = 0.5 * (0.226 - 5 * PITCH_M)
    ends = EI / (0.5 * reach + 0.5 * PITCH_M)
    assert middle == pytest.approx([ends, *[EI / PITCH_M] * 4, ends], rel=1e-6)
    assert EncasedStrip(EI, LAY, READINGS["length"]).difference_stiffness(BENT) == pytest.approx(
        EI / 0.0237, rel=1e-6
    )


def test_held_halfway_at_the_pins_hinges_turned_to_and_fro_feel_only_the_ends():
    strip = EncasedStrip(EI, LAY, READINGS["mean"])
    alternating = np.array([1.0, -1.0] * 3) * 0.1
    ends_only = 2 * 0.5 * EI / (0.5 * (0.226 - 5 * PITCH_M)) * 0.05**2
    assert strip.energy_J(alternating) == pytest.approx(ends_only, rel=1e-9)
    assert strip.stiffness_matrix(BENT)[2, 1:4] == pytest.approx(
        EI / PITCH_M * np.array([0.25, 0.5, 0.25]), rel=1e-8
    )


def test_the_strip_reaches_equally_far_beyond_both_end_hinges():
    assert LAY.pins_m[0] == pytest.approx(LAY.length_m - LAY.pins_m[-1])
    assert LENGTHS[0] - LAY.pins_m[0] == pytest.approx(0.0393325)


@pytest.mark.parametrize("length_m", [0.19, 0.29])
def test_a_strip_that_does_not_fit_the_leg_is_refused(length_m):
    with pytest.raises(BadInput, match="change its length"):
        centre_lay(LENGTHS, length_m)


@pytest.mark.parametrize("free_m", [0.0, 0.0394, float("nan")])
def test_a_free_length_that_leaves_nothing_held_is_refused(free_m):
    with pytest.raises(BadInput, match="free length"):
        by_a_length(LAY, free_m)
