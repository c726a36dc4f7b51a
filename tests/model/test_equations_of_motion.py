"""The equations of motion against independent mechanics: closed forms, vectors in the plane,
energy.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.special import ellipk

from rfca_rig.model.chain import Tolerance, advance, allocate_samples, find_rest_state, make_chain
from rfca_rig.model.kernel.forces import assemble_once
from rfca_rig.model.kernel.stage import allocate_workspace
from rfca_rig.model.kernel.state import NO_LAWS, Shaft, State
from tests.model.legs import NO_GROUND_M, PAPER, pendulum

TIGHT = Tolerance(1e-9, 3e-6)


def free_shaft() -> Shaft:
    nothing = np.empty(0)
    return Shaft(nothing, np.empty((0, 4)), nothing, True, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def released(q):
    n = len(q)
    return State(
        np.array(q, dtype=float), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros((0, n, 4))
    )


def swing(chain, state, t_s, tolerance=TIGHT):
    samples = allocate_samples(t_s, state.q.size)
    advance(chain, free_shaft(), state, (0.0, float(t_s[-1])), 1e-5, tolerance, samples)
    return samples


def test_a_rod_swings_with_the_period_of_the_elliptic_integral():
    length = 0.5
    amplitude = 1.2
    chain = make_chain(pendulum(1, length), NO_GROUND_M)
    period = 4.0 * ellipk(np.sin(amplitude / 2) ** 2) / np.sqrt(9.81 * 1.5 / length)
    t = np.linspace(1e-3, 1.1 * period, 4000)
    q = swing(chain, released([np.pi / 2 + amplitude]), t).q[:, 0] - np.pi / 2
    crossings = t[:-1][(q[:-1] > 0) != (q[1:] > 0)]
    assert 2.0 * (crossings[1] - crossings[0]) == pytest.approx(period, rel=2e-3)
    assert np.interp(period, t, q) == pytest.approx(amplitude, abs=1e-5)


def vector_mechanics(rig):
    """d/dt (q, w) of the chain from places and velocities of the link centres, sharing no
    formula with the package.
    """
    lengths = np.array(rig.leg.link_lengths_m)
    masses = np.array(rig.leg.link_masses_kg)
    n = len(lengths)
    reach = np.zeros((n, n))
    for k in range(n):
        reach[k, :k] = lengths[:k]
        reach[k, k] = lengths[k] / 2

    def rhs(_, x):
        q = x[:n]
        w = x[n:]
        # y and depth (2) of centre k (n) per unit of angle i (n): d/dt and d2/dt2 of a place at
        # (cos q, sin q).
        along = np.array([-np.sin(q), np.cos(q)])[:, None, :] * reach
        centripetal = (np.array([-np.cos(q), -np.sin(q)])[:, None, :] * reach) @ w**2
        weighed = masses[:, None] * along
        mass = np.diag(masses * lengths**2 / 12) + np.einsum("xki,xkj->ij", weighed, along)
        force = np.einsum("xki,xk->i", weighed, np.array([[0.0], [9.81]]) - centripetal)
        for i in range(1, n):
            phi = q[i] - q[i - 1]
            torque = rig.leg.k0_Nm_per_rad * (
                phi + rig.leg.k2_per_rad2 * phi**3
            ) + rig.leg.hinge_damping_Nm_s_per_rad * (w[i] - w[i - 1])
            force[i] -= torque
            force[i - 1] += torque
        return np.concatenate([w, np.linalg.solve(mass, force)])

    return rhs


@pytest.mark.slow
def test_the_paper_leg_falls_as_an_independent_integrator_has_it():
    chain = make_chain(PAPER, NO_GROUND_M)
    start = np.linspace(0.0, 0.9, 7)
    t = np.linspace(0.01, 0.6, 60)
    ours = swing(chain, released(start), t).q
    other = solve_ivp(
        vector_mechanics(PAPER),
        (0.0, 0.6),
        np.concatenate([start, np.zeros(7)]),
        "DOP853",
        t,
        rtol=1e-10,
        atol=1e-11,
    )
    assert np.abs(ours - other.y[:7].T).max() < 2e-5


def test_a_free_chain_without_damping_keeps_its_energy():
    rig = pendulum(3, 0.2, 0.1, k0=2.0)
    chain = make_chain(rig, NO_GROUND_M)
    q = [0.3, 0.6, 1.0]
    samples = swing(chain, released(q), np.linspace(0.01, 2.0, 200), Tolerance(1e-10, 3e-7))
    energy = np.array([energy_J(chain, q, w) for q, w in zip(samples.q, samples.w, strict=True)])
    assert np.ptp(energy) < 3e-4 * np.ptp(
        [-9.81 * chain.first_moment @ np.sin(q) for q in samples.q]
    )


def energy_J(chain, q, w):
    couple = chain.moment * np.cos(q[:, None] - q[None, :])
    phi = np.diff(q)
    spring = 0.5 * chain.k0[1:] * phi**2 + 0.25 * chain.k0[1:] * chain.k2[1:] * phi**4
    return 0.5 * w @ couple @ w - 9.81 * chain.first_moment @ np.sin(q) + spring.sum()


def test_the_jacobian_is_the_derivative_of_the_residual():
    random = np.random.default_rng(7)
    chain = make_chain(PAPER, 0.2)._replace(
        drag=200.0, lever=-0.02
    )  # large, so that a wrong sign of them shows
    q = np.linspace(1.0, 1.6, 7)
    w = random.normal(0, 2, 7)
    a = random.normal(0, 50, 7)
    anchor = np.cumsum(chain.length * np.cos(q)) + 0.02 * q + 1e-5 * random.normal(size=7)
    weights = (0.7, 0.02, 3e-3)
    exact = residual(chain, q, w, a, anchor, weights)[1]
    for j in range(7):
        step = np.eye(7)[j] * 1e-6
        plus, minus = (
            residual(
                chain,
                q + s * weights[2] * step,
                w + s * weights[1] * step,
                a + s * weights[0] * step,
                anchor,
                weights,
            )[0]
            for s in (1, -1)
        )
        assert (plus - minus) / 2e-6 == pytest.approx(exact[:, j], rel=2e-5, abs=1e-4)


def residual(chain, q, w, a, anchor, weights, laws=NO_LAWS):
    work = allocate_workspace(q.size, 7)
    memory = np.zeros((laws.place.size, 7, 4))
    state = State(q, w, a, anchor, memory)
    assemble_once(chain, laws, state, 1e-3, q, w, a, weights, work)
    assert (work.contact[0] > 0).sum() >= 2  # several ends in the ground, or the test proves little
    return work.R, work.J


def test_at_rest_each_hinge_carries_the_weight_beyond_it():
    chain = make_chain(PAPER, NO_GROUND_M)
    state = find_rest_state(chain, 0.3)
    places = np.cumsum(chain.length * np.cos(state.q))
    centres = places - 0.5 * chain.length * np.cos(state.q)
    masses = np.array(PAPER.leg.link_masses_kg)
    for hinge in range(1, 7):
        phi = state.q[hinge] - state.q[hinge - 1]
        moment = (9.81 * masses[hinge:] * (centres[hinge:] - places[hinge - 1])).sum()
        assert 10.98 * (phi + 4.56 * phi**3) == pytest.approx(moment, abs=1e-9)
