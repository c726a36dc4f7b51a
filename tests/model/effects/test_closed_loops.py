"""No law gives back energy on random closed paths, whatever its values: of hinges, floor, links
and drive, each as a law alone.
"""

import numba
import numpy as np
import pytest

from rfca_rig.model.catalogue import catalogue, set_up
from rfca_rig.model.chain import make_chain
from rfca_rig.model.kernel.contact import carry_stretch, normal_force
from rfca_rig.model.kernel.laws import (
    HINGE,
    LINK,
    NORMAL,
    ROTOR,
    SLIP,
    address_of,
    address_of_advance,
    call_law,
)
from rfca_rig.model.kernel.stage import drive_torque
from rfca_rig.model.setup import add_drive
from tests.model.effects.rigs import having, held
from tests.model.legs import PAPER

STEPS = 4000  # of a lap
# Draws of a law's values, and paths of each.
FEW = (40, 20)
MANY = (100, 100)
NUMBERS = [pytest.param(*FEW, marks=pytest.mark.slow), pytest.param(*MANY, marks=pytest.mark.long)]
# of the work that goes through in a lap: the trapezoidal sum leaves 0.0022 of a stop, and 0.0003
# with a quarter of the step
SUM_ERR = 4e-3
HARMONICS = np.arange(1.0, 4.0)
# Largest of the harmonics of a path: a hinge turns by up to 20 degrees in each, and by as little as
# within its presliding.
LARGE_RAD = 0.35
SMALL_RAD = 1e-4


def soften_on_the_way_out(phi, rate, elapsed, k0, k2, memory, parameter):
    """A law that breaks the rule."""
    return (k0 * phi if phi * rate < 0.0 else 0.9 * k0 * phi), k0, 0.0


def stiffen_with_the_load(phi, rate, elapsed, k0, k2, memory, parameter):
    """Another one: its stiffness is that of a load that changes while it is bent."""
    memory[3] += elapsed
    return k0 * (1.5 + np.sin(parameter[0] * memory[3])) * phi, k0, 0.0


@numba.njit(error_model="numpy")
def work_of_laps(law, advance, parameter, phi, rate, acceleration, elapsed):
    """The work (3,) that a law takes in each of three laps of a path (k,), and the work that goes
    through in a lap.

    `law` and `advance` are addresses, as the chain calls them, so that this loop is compiled once
    for all laws; `advance` is 0 where there is no memory. The first lap settles the memory.
    """
    x = np.array([0.0, 0.0, elapsed, 11.0, 4.2, 0.0])
    memory = np.zeros(4)
    out = np.zeros(4)
    taken = np.zeros(3)
    through = 0.0
    last_T = 0.0
    for step in range(3 * phi.size + 1):
        last_phi = x[0]
        x[0] = phi[step % phi.size]
        x[1] = rate[step % phi.size]
        x[5] = acceleration[step % phi.size]
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


def draw_path(random, low, high, steps=STEPS):
    """A closed path (k,) of three harmonics, at 0.1 to 30 rad/s, with its rate, its second
    derivative and its step [s].

    The size of the harmonics is between `low` and `high`, evenly over its logarithm.
    """
    size = high * (low / high) ** random.uniform() * random.uniform(0.0, 1.0, 3)
    phase = random.uniform(0.0, 2.0 * np.pi, 3)
    turn_s = 2.0 * np.pi / 10.0 ** random.uniform(-1.0, 1.5)
    angle = 2.0 * np.pi * np.outer(HARMONICS, np.arange(steps)) / steps + phase[:, None]
    speed = HARMONICS * 2.0 * np.pi / turn_s
    return (
        size @ np.sin(angle),
        (size * speed) @ np.cos(angle),
        -(size * speed**2) @ np.sin(angle),
        turn_s / steps,
    )


def least_work(law, advance, parameter, paths, seed, steps=STEPS):
    """The least work that a lap takes, over the work that goes through in it, of many paths with
    the same values.
    """
    random = np.random.default_rng(seed)
    least = np.inf
    for path in range(paths):
        # Every other path is large, so that springs and stops act too.
        taken, through = work_of_laps(
            law,
            advance,
            parameter,
            *draw_path(random, (LARGE_RAD, SMALL_RAD)[path % 2], LARGE_RAD, steps),
        )
        if through > 0.0:
            least = min(least, *(taken[1:] / through))
    return least


def laws_of(id_, values, place):
    """The laws at this place that an effect with these values has."""
    setup = set_up(having(PAPER, **{id_: values}), 0.215, held(0.2))
    uses = (*setup.laws, *(law(setup.chain()) for law in setup.laws_of_chain))
    return [use for use in uses if use.place == place]


def drawn(effect, random):
    """Values of sizes and shapes, evenly over their ranges, or over the logarithms of them."""
    return {p.name: draw_value(p, random) for p in (*effect.parameters, *effect.shape)}


def draw_value(parameter, random):
    if parameter.whole:
        return float(random.integers(int(parameter.low), int(parameter.high) + 1))
    if parameter.low > 0.0:
        return float(np.exp(random.uniform(*np.log([parameter.low, parameter.high]))))
    return float(random.uniform(parameter.low, parameter.high))


def largest(effect):
    return {p.name: p.high for p in (*effect.parameters, *effect.shape)}


OF_CHAINS = list(catalogue().values())


def acts_at(effect, *places):
    return any(laws_of(effect.id, largest(effect), place) for place in places)


OF_HINGES = [effect for effect in OF_CHAINS if acts_at(effect, HINGE, ROTOR)]
OF_FLOOR = [effect for effect in OF_CHAINS if acts_at(effect, NORMAL)]


def test_every_law_of_the_catalogue_has_its_closed_paths_here():
    hinges = {
        "hinge_coulomb_friction",
        "hinge_quadratic_damping",
        "hinge_backlash",
        "hinge_stop",
        "spring_hysteresis",
        "spring_relaxation",
    }
    assert {effect.id for effect in OF_HINGES} == hinges
    assert {effect.id for effect in OF_FLOOR} == {
        "ground_compliance",
        "ground_exponent",
        "ground_adhesion",
    }
    assert {e.id for e in OF_CHAINS if laws_of(e.id, largest(e), SLIP)} == {"ground_stribeck"}
    assert {e.id for e in OF_CHAINS if laws_of(e.id, largest(e), LINK)} == {"fluid_drag"}
    assert {
        e.id
        for e in OF_CHAINS
        if set_up(having(PAPER, **{e.id: largest(e)}), 0.215, held(0.2)).drive
    } == set(DRIVES)


@pytest.mark.slow
def test_a_law_that_is_softer_on_the_way_out_or_stiffens_with_a_load_would_be_seen():
    assert least_work(address_of(soften_on_the_way_out, HINGE), 0, np.zeros(8), 10, 1) < -0.01
    assert least_work(address_of(stiffen_with_the_load, HINGE), 0, np.full(8, 3.0), 10, 1) < -0.01


def least_of_hinges(effect, values, paths, steps=STEPS):
    random = np.random.default_rng(1)
    least = np.inf
    for seed in range(values):
        named = drawn(effect, random)
        use = next(use for place in (HINGE, ROTOR) for use in laws_of(effect.id, named, place))
        law = address_of(use.law, use.place)
        advance = address_of_advance(use.advance) if use.advance else 0
        least = min(
            least,
            least_work(
                law, advance, np.resize(np.array(use.parameters, float), 8), paths, seed, steps
            ),
        )
    return least


@pytest.mark.parametrize(("values", "paths"), NUMBERS)
@pytest.mark.parametrize("effect", OF_HINGES, ids=lambda effect: effect.id)
def test_closed_paths_of_a_hinge_give_back_no_energy(effect, values, paths):
    assert least_of_hinges(effect, values, paths) > -SUM_ERR


def sum_work(force, way):
    """The work that a force (k,) takes on a closed path (k,), and the work that goes through, by
    the trapezoidal rule.
    """
    work = 0.5 * (force + np.roll(force, 1)) * (way - np.roll(way, 1))
    return work.sum(), np.abs(work).sum()


@numba.njit(error_model="numpy")
def forces_of_floor(law, parameter, stiffness, damping, leaving, depth, rate):
    """The forces (k,) of floor and law against an end at this depth (k,)."""
    x = np.zeros(6)
    out = np.zeros(4)
    normal = np.zeros(depth.size)
    for k in range(depth.size):
        if depth[k] > 0.0:
            normal[k] = normal_force(
                stiffness, damping if rate[k] > 0.0 else leaving, depth[k], rate[k]
            )[0]
            if law != 0:
                x[0] = depth[k]
                x[1] = rate[k]
                call_law(law, x, x, parameter, out)
                normal[k] += out[0]
    return normal


def least_on_floor(effect, values, paths, steps=STEPS):
    """As `least_work`, of an end that dips into the floor and leaves it."""
    random = np.random.default_rng(3)
    least = np.inf
    for _ in range(values):
        if effect:
            use = next((use for use in laws_of(effect.id, drawn(effect, random), NORMAL)), None)
        else:
            use = None
        chain = set_up(
            having(PAPER, **({effect.id: drawn(effect, random)} if effect else {})),
            0.215,
            held(0.2),
        ).chain()
        if use:
            law = address_of(use.law, NORMAL)
            parameter = np.resize(np.array(use.parameters, float), 8)
        else:
            law = 0
            parameter = np.zeros(8)
        # A law that replaces the plain force knows its stiffness and damping.
        known = {"ground_exponent": (0, 2, 3), "ground_compliance": (2, 4, 5)}.get(
            effect.id if effect else ""
        )
        damping = random.uniform(0.0, 1.5)
        if known:
            plain = tuple(parameter[list(known)])
        else:
            plain = (chain.contact_stiffness, damping, damping * random.uniform(0.0, 1.0))
        for _ in range(paths):
            depth, rate, _, _ = draw_path(random, 1e-5, 4e-3, steps)
            depth = depth + random.uniform(-0.5, 1.0) * np.ptp(depth)
            taken, through = sum_work(forces_of_floor(law, parameter, *plain, depth, rate), depth)
            if through > 0.0:
                least = min(least, taken / through)
    return least


@pytest.mark.parametrize(("values", "paths"), NUMBERS)
@pytest.mark.parametrize(
    "effect", [None, *OF_FLOOR], ids=lambda effect: effect.id if effect else "plain"
)
def test_an_end_that_dips_into_the_floor_gets_no_energy_from_it(effect, values, paths):
    assert least_on_floor(effect, values, paths) > -SUM_ERR


@numba.njit(error_model="numpy")
def work_of_tie(law, parameter, mu, presliding, drag, moved, slip, normal):
    """The most energy that a sliding end has been given at any time along a path (k,), and what
    passed.

    The end moves by `moved`, at the speed `slip`, under the force `normal`. Its friction falls with
    speed by the law.
    """
    x = np.zeros(6)
    out = np.zeros(4)
    s = 0.0
    F = 0.0
    total = 0.0
    most = 0.0
    passed = 0.0
    before = 0.0
    for k in range(moved.size):
        x[0] = slip[k]
        call_law(law, x, x, parameter, out)
        limit = mu * out[0] * normal[k]
        if limit > 0.0:
            carried = carry_stretch(s + moved[k], limit, s, before)[0]
            s = min(max(carried / limit, -presliding), presliding)
        else:
            carried = 0.0
            s = 0.0
        after = -limit * s / presliding
        before = limit
        work = 0.5 * (F + after) * moved[k] - drag * min(normal[k], 1.0) * slip[k] * moved[k]
        F = after
        total = total + work
        passed = passed + abs(work)
        most = max(most, total)
    return most, passed


@pytest.mark.parametrize(("values", "paths"), NUMBERS)
def test_friction_that_falls_with_speed_gives_back_no_energy_under_a_changing_load(values, paths):
    random = np.random.default_rng(4)
    chain = make_chain(PAPER, 0.2)
    worst = 0.0
    for _ in range(values):
        use = laws_of("ground_stribeck", drawn(catalogue()["ground_stribeck"], random), SLIP)[0]
        law = address_of(use.law, SLIP)
        parameter = np.resize(np.array(use.parameters, float), 8)
        for _ in range(paths):
            way, _, _, step_s = draw_path(random, 0.1 * chain.presliding, 0.1)
            load = np.maximum(
                0.0, 20.0 * (random.uniform(0.0, 2.0) + draw_path(random, 1.0, 1.0)[0])
            )
            moved = np.diff(np.append(way, way[0]))
            most, passed = work_of_tie(
                law, parameter, chain.mu, chain.presliding, chain.drag, moved, moved / step_s, load
            )
            worst = max(worst, most / passed)
    assert worst < 1e-12


@numba.njit(error_model="numpy")
def work_of_drag(law, parameter, length, v, step_s):
    """The most power that a link is given along a path (k,) of its speed, and the work of the
    whole path.
    """
    x = np.zeros(6)
    out = np.zeros(4)
    most = -np.inf
    total = 0.0
    for k in range(v.size):
        x[0] = v[k]
        x[1] = length
        call_law(law, x, x, parameter, out)
        most = max(most, out[0] * v[k])
        total = total + out[0] * v[k] * step_s
    return most, total


@pytest.mark.parametrize(("values", "paths"), NUMBERS)
def test_drag_of_a_fluid_never_drives_a_link(values, paths):
    random = np.random.default_rng(5)
    for _ in range(values):
        use = laws_of("fluid_drag", drawn(catalogue()["fluid_drag"], random), LINK)[0]
        law = address_of(use.law, LINK)
        parameter = np.resize(np.array(use.parameters, float), 8)
        for _ in range(paths):
            _, v, _, step_s = draw_path(random, 1e-4, 0.5)
            most, total = work_of_drag(law, parameter, random.uniform(0.01, 0.5), v, step_s)
            assert most <= 0.0 and total < 0.0


DRIVES = (
    "motor_speed_droop",
    "motor_torque_limit",
    "motor_cogging",
    "shaft_compliance",
    "shaft_play",
)


@numba.njit(error_model="numpy")
def torques_of_drive(shaft, angle, speed):
    """The torques (k,) of a drive with a standing command against a leg that turns its shaft by
    these angles (k,).
    """
    torque = np.zeros(angle.size)
    for k in range(angle.size):
        torque[k] = -drive_torque(shaft, -angle[k], -speed[k], angle[k])[0]
    return torque


def least_of_drive(id_, values, paths, steps=STEPS):
    """As `least_work`, of a shaft on its drive; the command stands, or the drive would do work."""
    random = np.random.default_rng(6)
    least = np.inf
    effect = catalogue()[id_]
    for _ in range(values):
        setup = set_up(having(PAPER, **{id_: drawn(effect, random)}), 0.215, held(0.0))
        shaft = add_drive(held(0.0).shaft(), setup.drive, 0.0)
        for _ in range(paths):
            angle, speed, _, _ = draw_path(random, 1e-3, LARGE_RAD, steps)
            taken, through = sum_work(torques_of_drive(shaft, angle, speed), angle)
            if through > 0.0:
                least = min(least, taken / through)
    return least


@pytest.mark.parametrize(("values", "paths"), NUMBERS)
@pytest.mark.parametrize("id_", DRIVES)
def test_a_drive_that_stands_gives_a_leg_no_energy(id_, values, paths):
    assert least_of_drive(id_, values, paths) > -SUM_ERR


LEAST = {
    **{effect.id: (least_of_hinges, effect) for effect in OF_HINGES},
    **{effect.id: (least_on_floor, effect) for effect in OF_FLOOR},
    **{id_: (least_of_drive, id_) for id_ in DRIVES},
}


@pytest.mark.slow
@pytest.mark.parametrize("id_", LEAST)
def test_what_a_sum_seems_to_give_back_vanishes_with_its_step(id_):
    """A law that created energy would give it back at any step; the error of the sum falls at
    least in proportion to it.
    """
    least, what = LEAST[id_]
    wide, narrow = (max(0.0, -least(what, 20, 10, steps)) for steps in (1000, 4000))
    assert narrow <= max(0.3 * wide, 1e-9)
