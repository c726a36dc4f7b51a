"""No law of a hinge gives back energy on random closed paths of its angle, whatever its values."""

import numba
import numpy as np
import pytest

from rfca_rig.model.catalogue import catalogue, set_up
from rfca_rig.model.kernel.laws import HINGE
from tests.model.effects.rigs import having, held
from tests.model.legs import PAPER

VALUES, PATHS, MANY_PATHS, STEPS = 100, 20, 100, 4000  # draws of a law's values, paths of each, steps of a lap
SUM_ERR = 4e-3  # of the work that goes through in a lap: the trapezoidal sum leaves 0.0022 of a stop, and 0.0003 with a quarter of the step


def soften_on_the_way_out(phi, rate, elapsed, k0, k2, memory, parameter):
    """A law that breaks the rule."""
    return (k0 * phi if phi * rate < 0.0 else 0.9 * k0 * phi), k0, 0.0


@numba.njit
def forget(phi, rate, elapsed, k0, k2, memory, parameter):
    """The advance of a law without memory."""


def least_work_of(law, advance):
    """A compiled function: the least work that a lap takes, over the work that goes through in it, of many paths with the same values.

    A path is a sum of three harmonics of up to 20 degrees each, at 0.1 to 30 rad/s. In the first of three laps the memory settles.
    """

    @numba.njit(error_model="numpy")
    def least_work(parameter, paths, steps, seed):
        np.random.seed(seed)
        turned = 2.0 * np.pi * np.outer(np.arange(steps), np.arange(1.0, 4.0)) / steps
        sine, cosine = np.sin(turned), np.cos(turned)
        least = np.inf
        for _ in range(paths):
            size, phase = np.random.uniform(0.0, 0.35, 3), np.random.uniform(0.0, 2.0 * np.pi, 3)
            turn_s = 2.0 * np.pi / 10.0 ** np.random.uniform(-1.0, 1.5)
            a, b = size * np.cos(phase), size * np.sin(phase)
            memory, taken, through = np.zeros(4), np.zeros(3), 0.0
            last_T, last_phi = 0.0, 0.0
            for step in range(3 * steps + 1):
                at, phi, rate = step % steps, 0.0, 0.0
                for k in range(3):
                    phi += a[k] * sine[at, k] + b[k] * cosine[at, k]
                    rate += (k + 1) * 2.0 * np.pi / turn_s * (a[k] * cosine[at, k] - b[k] * sine[at, k])
                T = law(phi, rate, turn_s / steps, 11.0, 4.2, memory, parameter)[0]
                advance(phi, rate, turn_s / steps, 11.0, 4.2, memory, parameter)
                if step > 0:
                    work = 0.5 * (T + last_T) * (phi - last_phi)
                    taken[(step - 1) // steps] += work
                    through += abs(work) / 3.0
                last_T, last_phi = T, phi
            if through > 0.0:
                least = min(least, taken[1] / through, taken[2] / through)
        return least

    return least_work


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
    assert least_work_of(numba.njit(soften_on_the_way_out), forget)(np.zeros(8), 10, STEPS, 1) < -0.01


@pytest.mark.parametrize("paths", [pytest.param(PATHS, marks=pytest.mark.slow), pytest.param(MANY_PATHS, marks=pytest.mark.long)])
@pytest.mark.parametrize("effect", OF_HINGES, ids=lambda effect: effect.id)
def test_closed_paths_give_back_no_energy(effect, paths):
    random, least, run = np.random.default_rng(1), np.inf, None
    for seed in range(VALUES):
        use = law_of(effect.id, drawn(effect, random))
        run = run or least_work_of(numba.njit(use.law), numba.njit(use.advance) if use.advance else forget)
        least = min(least, run(np.resize(np.array(use.parameters, float), 8), paths, STEPS, seed))
    assert least > -SUM_ERR
