"""The same leg cut into other links: what is kept, springs in series, and the beam that many
links become.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.model.paper.elastica import cantilever_tip
from rfca_rig.model.paper.statics import equilibrium_under_tip_force, tip_chain_of, tip_place_m
from rfca_rig.model.paper.strip import cell_m, with_first_link, with_links
from rfca_rig.model.parameters import Leg
from tests.model.legs import PAPER

LEG = PAPER.leg
UNEVEN = replace(
    LEG,
    link_lengths_m=(0.06, 0.03, 0.05, 0.02, 0.04),
    link_masses_kg=(0.09, 0.02, 0.08, 0.01, 0.03),
)


def places(leg: Leg) -> np.ndarray:
    return np.cumsum((0.0, *leg.link_lengths_m))


def mass_up_to(leg: Leg, s: np.ndarray) -> np.ndarray:
    return np.interp(s, places(leg), np.cumsum((0.0, *leg.link_masses_kg)))


@pytest.mark.parametrize("leg", [LEG, UNEVEN], ids=["paper", "uneven"])
@pytest.mark.parametrize("count", [2, 4, 9, 30])
def test_length_and_mass_stay_and_compliance_is_shared_out(leg, count):
    other = with_links(leg, count)
    assert len(other.link_lengths_m) == len(other.link_masses_kg) == count
    assert sum(other.link_lengths_m) == pytest.approx(sum(leg.link_lengths_m), rel=1e-12)
    assert np.cumsum(other.link_masses_kg) == pytest.approx(
        mass_up_to(leg, places(other)[1:]), rel=1e-12
    )
    hinges = len(leg.link_lengths_m) - 1
    others = count - 1
    assert others / other.k0_Nm_per_rad == pytest.approx(hinges / leg.k0_Nm_per_rad)


def test_the_leg_s_own_number_of_links_is_the_leg_itself():
    assert with_links(LEG, 7) is LEG
    assert with_first_link(LEG, LEG.link_lengths_m[0]) is LEG


def test_springs_in_series_carry_one_torque_and_share_the_angle():
    """Under the same moment in every hinge the whole leg bends by the same angle, however it is
    cut, hardening and damping included.
    """
    other = with_links(LEG, 13)
    m = 12 / 6
    phi = np.linspace(-0.6, 0.6, 7)
    for leg, angle in ((LEG, phi), (other, phi / m)):
        torque = leg.k0_Nm_per_rad * angle * (1.0 + leg.k2_per_rad2 * angle**2)
        assert torque == pytest.approx(
            LEG.k0_Nm_per_rad * phi * (1.0 + LEG.k2_per_rad2 * phi**2), rel=1e-12
        )
    assert other.hinge_damping_Nm_s_per_rad * (1.0 / m) == pytest.approx(
        LEG.hinge_damping_Nm_s_per_rad
    )


def test_cut_and_cut_back_is_the_leg_again():
    back = with_links(with_links(LEG, 25), 7)
    assert back.link_lengths_m == pytest.approx(LEG.link_lengths_m, rel=1e-9)
    assert back.link_masses_kg == pytest.approx(LEG.link_masses_kg, rel=1e-9)
    assert (back.k0_Nm_per_rad, back.k2_per_rad2) == pytest.approx(
        (LEG.k0_Nm_per_rad, LEG.k2_per_rad2), rel=1e-9
    )


def test_a_little_load_on_the_tip_bends_many_links_as_a_beam_with_rigid_ends():
    """delta = F ((L - a)^3 - (L - b)^3) / 3 EI for a beam that bends from a to b only; what
    differs falls with the square of the pitch.
    """
    a = 0.054 - 0.039333 / 2
    b = 0.29 - 0.039333 / 2
    L = sum(LEG.link_lengths_m)
    EI = LEG.k0_Nm_per_rad * 0.039333
    F = 1e-3
    beam = F * ((L - a) ** 3 - (L - b) ** 3) / (3.0 * EI)
    errors = []
    for count in (7, 13, 25, 49):
        leg = with_links(LEG, count)
        pins = places(leg)[1:-1]
        chain = replace(tip_chain_of(replace(leg, link_radius_m=1e-9)), gravity_m_s2=0.0)
        tip = tip_place_m(chain, equilibrium_under_tip_force(chain, 0.0, np.array([0.0, F])).phi)[1]
        assert tip == pytest.approx(F * np.sum((L - pins) ** 2) / leg.k0_Nm_per_rad, rel=1e-4)
        errors.append(tip / beam - 1.0)
    assert abs(errors[0]) < 0.01 and abs(errors[-1]) < 2e-4
    assert np.array(errors[:-1]) / np.array(errors[1:]) == pytest.approx([4.0] * 3, rel=0.15)


def test_under_any_load_many_links_become_the_elastica():
    """A leg that bends from end to end, without hardening, against the clamped strip of
    `elastica`, by 56 degrees at its tip.
    """
    p = 0.03
    hinges = 8
    lengths = (p / 2, *[p] * (hinges - 1), p / 2)
    leg = Leg(lengths, tuple(length / 0.24 for length in lengths), 1e-9, 10.0, 0.0, 0.0, 0.0)
    force = (-3.0, 12.0)
    strip = cantilever_tip(10.0 * p, hinges * p, force)
    errors = []
    for count in (9, 17, 33):
        chain = replace(tip_chain_of(with_links(leg, count)), gravity_m_s2=0.0)
        errors.append(
            tip_place_m(chain, equilibrium_under_tip_force(chain, 0.0, np.array(force)).phi)
            - (strip.x_m, strip.y_m)
        )
    assert strip.slope_rad > 0.95
    assert np.abs(errors[-1]).max() < 1e-4
    assert np.array(errors[:-1]) / np.array(errors[1:]) == pytest.approx(
        np.full((2, 2), 4.0), rel=0.1
    )


def test_a_longer_first_link_leaves_less_of_the_strip_to_bend():
    other = with_first_link(LEG, 0.1)
    assert other.link_lengths_m[1:] == pytest.approx([0.19 / 6] * 6, rel=1e-4)
    assert other.k0_Nm_per_rad * cell_m(other) == pytest.approx(LEG.k0_Nm_per_rad * cell_m(LEG))
    assert other.k2_per_rad2 * cell_m(other) ** 2 == pytest.approx(
        LEG.k2_per_rad2 * cell_m(LEG) ** 2
    )


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: with_links(LEG, 1), "a leg of 1 links: it takes 2 to 60"),
        (lambda: with_links(with_links(LEG, 2), 5), "does not tell over what length"),
        (lambda: with_first_link(LEG, 0.3), "above 0 and below the leg's length"),
    ],
)
def test_what_cannot_be_is_refused(make, said):
    with pytest.raises(BadInput, match=said):
        make()
