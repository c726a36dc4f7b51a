"""The paper's recursion (11)-(13) against the compiled chain, which is derived in absolute
angles instead, and against closed forms.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.model.chain import make_chain
from rfca_rig.model.kernel.forces import assemble_once
from rfca_rig.model.kernel.stage import allocate_workspace
from rfca_rig.model.kernel.state import NO_LAWS, State
from rfca_rig.model.paper.dynamics import (
    EndLoads,
    joint_accelerations,
    joint_torques_Nm,
    link_chain_of,
    mass_matrix,
    no_loads,
    right_side_Nm,
)
from tests.model.legs import PAPER, pendulum


def relative(absolute):
    return np.diff(absolute, prepend=0.0)


def uneven_leg(random, links):
    leg = replace(
        PAPER.leg,
        link_lengths_m=tuple(random.uniform(0.03, 0.1, links)),
        link_masses_kg=tuple(random.uniform(0.01, 0.1, links)),
    )
    return replace(PAPER, leg=leg)


def compiled(rig, q, w, a, anchor):
    """(R, M, loads of the ground) of the compiled chain; the shaft at ground level, so that many
    ends are in the ground.
    """
    chain = make_chain(rig, 0.0)
    work = allocate_workspace(q.size, q.size)
    state = State(q, w, a, anchor, np.zeros((0, q.size, 4)))
    assemble_once(chain, NO_LAWS, state, 0.0, q, w, a, (1.0, 0.0, 0.0), work)
    normal, tangential = work.contact.copy()
    return (
        work.R.copy(),
        work.J.copy(),
        EndLoads(np.array([tangential, -normal]), -chain.radius * tangential),
    )


@pytest.mark.parametrize("links", [1, 2, 7, 20])
def test_inverse_dynamics_agree_with_the_compiled_chain(links):
    random = np.random.default_rng(links)
    touching = 0
    for _ in range(20):
        rig = uneven_leg(random, links)
        q = random.uniform(-3, 3, links)
        w = random.normal(0, 5, links)
        a = random.normal(0, 100, links)
        anchor = np.cumsum(np.array(rig.leg.link_lengths_m) * np.cos(q)) + 1e-5 * random.normal(
            size=links
        )
        R, _, loads = compiled(rig, q, w, a, anchor)
        touching += np.count_nonzero(loads.force_N[0])
        expected = np.cumsum(R[::-1])[::-1]
        torques = joint_torques_Nm(
            link_chain_of(rig.leg), relative(q), relative(w), relative(a), loads
        )
        assert torques == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())
    assert touching > 3


@pytest.mark.parametrize("links", [1, 2, 7, 20])
def test_the_mass_matrix_agrees_with_the_compiled_chain(links):
    random = np.random.default_rng(links)
    rig = uneven_leg(random, links)
    q = random.uniform(-3, 3, links)
    to_absolute = np.tril(np.ones((links, links)))
    M = compiled(rig, q, np.zeros(links), np.zeros(links), np.zeros(links))[1]
    ours = mass_matrix(link_chain_of(rig.leg), relative(q))
    assert ours == pytest.approx(to_absolute.T @ M @ to_absolute, rel=1e-9, abs=1e-15)
    assert np.all(np.linalg.eigvalsh(ours) > 0.0)


def test_two_links_obey_the_textbook_double_pendulum():
    chain = link_chain_of(pendulum(2, 0.3, 0.5).leg)
    phi = np.array([0.4, 0.7])
    dphi = np.array([1.1, -2.3])
    ddphi = np.array([5.0, -8.0])
    m = 0.5
    a = 0.3
    c = 0.15
    g = 9.81
    inertia = m * a**2 / 12
    h = m * a * c * np.sin(phi[1])
    M22 = inertia + m * c**2
    M12 = inertia + m * c**2 + m * a * c * np.cos(phi[1])
    M11 = 2 * inertia + m * (2 * c**2 + a**2 + 2 * a * c * np.cos(phi[1]))
    down_1 = g * (m * c + m * a) * np.cos(phi[0])
    down_2 = g * m * c * np.cos(phi.sum())
    expected = [
        M11 * ddphi[0]
        + M12 * ddphi[1]
        - h * (2 * dphi[0] * dphi[1] + dphi[1] ** 2)
        - down_1
        - down_2,
        M12 * ddphi[0] + M22 * ddphi[1] + h * dphi[0] ** 2 - down_2,
    ]
    assert joint_torques_Nm(chain, phi, dphi, ddphi, no_loads(2)) == pytest.approx(
        expected, rel=1e-12
    )


def test_a_passive_hinge_bent_by_its_spring_swings_back():
    chain = replace(link_chain_of(pendulum(2, 0.3, 0.5, k0=50.0).leg), gravity_m_s2=0.0)
    assert (
        joint_accelerations(chain, np.array([0.0, 0.2]), np.zeros(2), np.zeros(2), no_loads(2))[1]
        < 0.0
    )


def test_a_spring_is_at_rest_at_its_rest_angle():
    chain = replace(
        link_chain_of(pendulum(2, 0.3, 0.5, k0=50.0).leg),
        gravity_m_s2=0.0,
        phi_0=np.array([0.0, 0.2]),
    )
    assert joint_torques_Nm(
        chain, np.array([0.5, 0.2]), np.zeros(2), np.zeros(2), no_loads(2)
    ) == pytest.approx(0.0, abs=1e-12)


def test_accelerations_of_forward_dynamics_need_the_torques_they_came_from():
    random = np.random.default_rng(5)
    chain = link_chain_of(PAPER.leg)
    phi = random.normal(0, 0.5, 7)
    dphi = random.normal(0, 3, 7)
    tau = random.normal(0, 2, 7)
    loads = EndLoads(random.normal(0, 20, (2, 7)), random.normal(0, 0.1, 7))
    ddphi = joint_accelerations(chain, phi, dphi, tau, loads)
    assert joint_torques_Nm(chain, phi, dphi, ddphi, loads) == pytest.approx(tau, abs=1e-9)
    assert mass_matrix(chain, phi) @ ddphi == pytest.approx(
        right_side_Nm(chain, phi, dphi, tau, loads), abs=1e-9
    )
