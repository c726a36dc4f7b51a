"""No law of a hinge gives back energy on random closed paths of its angle, whatever its values."""

import numba
import numpy as np
import pytest

from rfca_rig.model.catalogue import catalogue, set_up
from rfca_rig.model.kernel.laws import HINGE, address_of, address_of_advance, call_law
from tests.model.effects.rigs import having, held
from tests.model.legs import PAPER

STEPS = 4000  # of a lap
# Draws of a law's values, and paths of each.
FEW, MANY = (40, 20), (100, 100)
SUM_ERR = 4e-3  # of the work that goes through in a lap: the trapezoidal sum leaves 0.0022 of a stop, and 0.0003 with a quarter of the step


def soften_on_the_way_out(phi, rate, elapsed, k0, k2, memory, parameter):
    """A law that breaks the rule."""
    return (k0 * phi if phi * rate < 0.0 else 0.9 * k0 * phi), k0, 0.0


@numba.njit(error_model="numpy")
def work_of_laps(law, advance, parameter, phi, rate, elapsed):
    """The work (3,) that a law takes in each of three laps of a path (k,), and the work that goes through in a lap.

    `law` and `advance` are addresses, as the chain calls them, so that this loop is compiled once for all laws; `advance` is 0 where
    there is no memory. The first lap settles the memory.
    """
    x, memory, out = np.array([0.0, 0.0, elapsed, 11.0, 4.2, 0.0]), np.zeros(4), np.zeros(4)
    taken, through, last_T = np.zeros(3), 0.0, 0.0
    for step in range(3 * phi.size + 1):
        last_phi = x[0]
        x[0], x[1] = phi[step % phi.size], rate[step % phi.size]
        call_law(law, x, memory, parameter, out)
        T = out[0]
        if advance != 0:
            call_law(advance, x, memory, parameter, out)
        if step > 0:
            work = 0.5 * (T + last_T) * (x[0] - last_phi)
            taken[(step - 1) // phi.size] += work
            through += abs(work) / 3.0
        last_T = T
    return taken, through


def least_work(law, advance, parameter, paths, seed):
    """The least work that a lap takes, over the work that goes through in it, of many paths with the same values.

    A path is a sum of three harmonics of up to 20 degrees each, at 0.1 to 30 rad/s.
    """
    random, least = np.random.default_rng(seed), np.inf
    harmonics = np.arange(1.0, 4.0)
    turned = 2.0 * np.pi * np.outer(harmonics, np.arange(STEPS)) / STEPS
    for _ in range(paths):
        size, phase = random.uniform(0.0, 0.35, 3), random.uniform(0.0, 2.0 * np.pi, 3)
        turn_s = 2.0 * np.pi / 10.0 ** random.uniform(-1.0, 1.5)
        angle = turned + phase[:, None]
        phi, rate = size @ np.sin(angle), (size * harmonics * 2.0 * np.pi / turn_s) @ np.cos(angle)
        taken, through = work_of_laps(law, advance, parameter, phi, rate, turn_s / STEPS)
        if through > 0.0:
            least = min(least, *(taken[1:] / through))
    return least


def law_of(id_, values):
    """The law of the hinges that an effect with these values has; None where it is none."""
    uses = set_up(having(PAPER, **{id_: values}), 0.215, held(0.2)).laws
    return next((use for use in uses if use.place == HINGE and not use.reads_torque), None)


def drawn(effect, random):
    """Values of sizes and shapes, evenly over the logarithms of their ranges."""
    return {p.name: float(np.exp(random.uniform(*np.log([p.low, p.high])))) for p in (*effect.parameters, *effect.shape)}


OF_HINGES = [e for e in catalogue().values() if e.where == "hinges" and law_of(e.id, {p.name: p.high for p in e.parameters})]


def test_the_laws_of_hinges_are_found():
    laws = {"hinge_coulomb_friction", "hinge_quadratic_damping", "hinge_backlash", "hinge_stop", "spring_hysteresis", "spring_relaxation"}
    assert {effect.id for effect in OF_HINGES} == laws


@pytest.mark.slow
def test_a_law_that_is_softer_on_the_way_out_would_be_seen():
    assert least_work(address_of(soften_on_the_way_out, HINGE), 0, np.zeros(8), 10, 1) < -0.01


@pytest.mark.parametrize(("values", "paths"), [pytest.param(*FEW, marks=pytest.mark.slow), pytest.param(*MANY, marks=pytest.mark.long)])
@pytest.mark.parametrize("effect", OF_HINGES, ids=lambda effect: effect.id)
def test_closed_paths_give_back_no_energy(effect, values, paths):
    random, least = np.random.default_rng(1), np.inf
    for seed in range(values):
        use = law_of(effect.id, drawn(effect, random))
        law, advance = address_of(use.law, HINGE), address_of_advance(use.advance) if use.advance else 0
        least = min(least, least_work(law, advance, np.resize(np.array(use.parameters, float), 8), paths, seed))
    assert least > -SUM_ERR
