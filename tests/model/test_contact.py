"""Friction of the floor: its derivatives, and that it never gives back more energy than it took."""

import numba
import numpy as np
import pytest

from rfca_rig.model.chain import make_chain
from rfca_rig.model.kernel.contact import carry_stretch, tangential_force
from tests.model.legs import PAPER

CHAIN = make_chain(PAPER, 0.2)
PATHS = 1000
STEPS = 600
PERIODS = 3


def force(stretch, slip, normal, begun, begun_limit):
    """(F, dF/d stretch, dF/d slip, dF/dN) with a friction coefficient that falls with slip and
    rises with the load.
    """
    mu = 0.4 - 0.1 * slip + 0.002 * normal
    mu_v = -0.1
    mu_N = 0.002
    return tangential_force(CHAIN, (mu, mu_v, mu_N), stretch, slip, normal, begun, begun_limit)


@pytest.mark.parametrize("seed", range(200))
def test_derivatives_of_friction_are_those_of_its_force(seed):
    random = np.random.default_rng(seed)
    stretch, begun = 1.5e-4 * random.uniform(-1.0, 1.0, 2)
    slip = random.uniform(-0.5, 0.5)
    normal = 10.0 ** random.uniform(-1.0, 1.5)
    begun_limit = 10.0 ** random.uniform(-1.5, 1.5)
    at = np.array([stretch, slip, normal])
    steps = np.array([1e-10, 1e-6, 1e-6 * normal])
    slopes = [
        (force(*(at + move), begun, begun_limit)[0] - force(*(at - move), begun, begun_limit)[0])
        / (2.0 * step)
        for move, step in zip(np.diag(steps), steps, strict=True)
    ]
    np.testing.assert_allclose(force(*at, begun, begun_limit)[1:], slopes, rtol=2e-4, atol=1e-4)


def test_drag_vanishes_with_the_normal_force():
    of_drag = [
        -tangential_force(CHAIN, (0.0, 0.0, 0.0), 0.0, 2.0, normal, 0.0, np.inf)[0]
        for normal in (0.0, 0.12, 1.0, 24.0)
    ]
    np.testing.assert_allclose(of_drag, 2.0 * CHAIN.drag * np.array([0.0, 0.12, 1.0, 1.0]))


@numba.njit
def given_back(presliding, mu, stretch, normal):
    """The most energy that a tie has given at any time along a path of its end (k,) under a
    normal force (k,), and what passed [J].
    """
    s = F = total = most = passed = 0.0
    for k in range(1, stretch.size):
        moved = stretch[k] - stretch[k - 1]
        limit = mu * normal[k]
        before = mu * normal[k - 1]
        if limit > 0.0:
            carried = carry_stretch(s + moved, limit, s, before)[0]
            s = min(max(carried / limit, -presliding), presliding)
        else:
            carried = 0.0
            s = 0.0
        after = -limit * s / presliding
        work = 0.5 * (F + after) * moved
        F = after
        total = total + work
        passed = passed + abs(work)
        most = max(most, total)
    return most, passed


def draw_paths(seed):
    """Closed paths of an end and of the force on it, which lifts off in some: sums of sines,
    gone through a few times.
    """
    random = np.random.default_rng(seed)
    t = np.linspace(0.0, PERIODS, STEPS * PERIODS + 1)
    waves = np.sin(
        2.0 * np.pi * np.arange(1, 5)[:, None] * t
        + random.uniform(0.0, 2.0 * np.pi, (PATHS, 2, 4, 1))
    )
    wave = (random.normal(size=(PATHS, 2, 4, 1)) / np.arange(1, 5)[:, None] * waves).sum(axis=2)
    ends = CHAIN.presliding * random.uniform(0.1, 3.0, (PATHS, 1)) * wave[:, 0]
    loads = np.maximum(0.0, 20.0 * (random.uniform(0.0, 2.0, (PATHS, 1)) + wave[:, 1]))
    return ends - ends[:, :1], loads


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_friction_gives_back_no_energy_on_random_closed_paths(seed):
    paths = zip(*draw_paths(seed), strict=True)
    most, passed = np.array(
        [given_back(CHAIN.presliding, CHAIN.mu, end, load) for end, load in paths]
    ).T
    assert passed.min() > 0.0
    assert (most / passed).max() < 1e-12
