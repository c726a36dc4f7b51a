"""Two further ways to bend a strip: a finite-element beam with stretch and shear, and the chain
of joints.
"""

import numpy as np
import pytest

from rfca_rig.model.paper.elastica import bend_cantilever
from rfca_rig.model.paper.strip import paper_strips, table_1_materials
from tests.model.exact_beam import Beam, chain_tip, strip_between_shells
from tests.model.legs import LENGTHS

CFSP = paper_strips(table_1_materials()[-1])
EI = CFSP.bending_stiffness_Nm2


@pytest.mark.parametrize("direction_deg", [60, 90, 135])
def test_a_beam_of_finite_elements_bends_as_the_elastica(direction_deg):
    force = 12.0 * np.array([np.cos(np.radians(direction_deg)), np.sin(np.radians(direction_deg))])
    each = np.ones(100)
    beam = Beam(0.00226 * each, EI * each, 5e6 * each, 1.5e6 * each)
    tip = beam.bent(force)[-1]
    bent = bend_cantilever(EI, 0.226, tuple(force))
    assert tip[2] > 0.5
    assert np.hypot(*(tip[:2] - bent.end_m)) < 1e-4 * 0.226
    assert tip[2] == pytest.approx(bent.theta_rad[-1], rel=1e-4)


@pytest.mark.parametrize(("free_m", "off"), [(0.0237, 0.003), (0.039, 0.008)])
def test_joints_of_stiffness_EI_over_the_free_length_end_where_a_strip_between_shells_does(
    free_m, off
):
    k = EI / free_m
    force = np.array([-14.0, 14.0])
    leg_m = sum(LENGTHS)
    tip = strip_between_shells(CFSP, LENGTHS, free_m, 3e-3).bent(force)[-1]
    joints, phi = chain_tip(LENGTHS, lambda phi: 0.5 * k * phi**2, lambda phi: k * phi, force, 8)
    assert np.degrees(tip[2]) > 75
    assert np.hypot(*(joints[:2] - tip[:2])) < off * leg_m
    assert joints[2] == pytest.approx(tip[2], abs=np.radians(0.3))
    softer, _ = chain_tip(
        LENGTHS, lambda phi: 0.45 * k * phi**2, lambda phi: 0.9 * k * phi, force, 8
    )
    assert np.hypot(*(softer[:2] - tip[:2])) > off * leg_m  # so that the bound says something
    assert phi.max() > 0.35
