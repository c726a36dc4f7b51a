"""No effect that changes the leg itself creates energy on random closed motions of the whole leg,
its floor and its frame.

The forces that move a leg on a closed path do the work that it dissipates: none without damping and
friction, whatever its masses, springs, floor and direction of gravity are. Laws with a memory, and
those that act alone, are in `test_closed_loops`.
"""

from dataclasses import replace

import numba
import numpy as np
import pytest

from rfca_rig.model.catalogue import catalogue, set_up
from rfca_rig.model.kernel.forces import assemble_once
from rfca_rig.model.kernel.stage import allocate_workspace
from rfca_rig.model.kernel.state import State
from tests.model.effects.rigs import having, held
from tests.model.effects.test_closed_loops import (
    DRIVES,
    OF_FLOOR,
    OF_HINGES,
    drawn,
)
from tests.model.legs import PAPER

STEPS = 400  # of a motion
NUMBERS = [
    pytest.param(20, 10, marks=pytest.mark.slow),
    pytest.param(100, 100, marks=pytest.mark.long),
]
SUM_ERR = 1e-4  # of the work that goes through
# of an end in a level floor: in a narrow bump, a point far below has no single nearest one
DEEPEST_M = 5e-3
HEIGHT_M = 0.215
LOSSLESS = replace(
    PAPER,
    leg=replace(PAPER.leg, hinge_damping_Nm_s_per_rad=0.0),
    ground=replace(PAPER.ground, damping_s_per_m=0.0, friction_coefficient=0.0, drag_N_s_per_m=0.0),
)

CONSERVATIVE = (
    *(
        "damaged_hinge",
        "stiffness_hardening",
        "stiffness_fading",
        "hinge_rest_angle",
        "hinge_rest_angle_of_one",
    ),
    *(
        "tip_mass",
        "heavier_link",
        "gravity_tilt",
        "ground_tilt",
        "ground_bump",
        "height_offset",
    ),
)
DISSIPATIVE = ("hinge_viscous_damping", "shaft_friction", "frame_compliance")
# This does work on purpose, or none: the motion of the shaft is prescribed.
DRIVEN = ("motor_speed_ripple",)
OTHERS = ("ground_stribeck", "fluid_drag")  # in `test_closed_loops` too


def test_every_effect_that_acts_on_a_leg_is_in_one_of_the_tests_of_energy():
    alone = {effect.id for effect in (*OF_HINGES, *OF_FLOOR)} | {*DRIVES, *OTHERS}
    of_sensor = {id_ for id_, effect in catalogue().items() if effect.where == "sensor"}
    assert alone | {*CONSERVATIVE, *DISSIPATIVE, *DRIVEN} | of_sensor == set(catalogue())


@numba.njit(error_model="numpy")
def work_of_motion(chain, laws, state, work, q, w, a):
    """The work that a closed motion (k, c) of all coordinates needs, and the work that goes
    through.
    """
    steps, coordinates = q.shape
    taken = through = 0.0
    last = np.zeros(coordinates)
    for step in range(steps + 1):
        k = step % steps
        assemble_once(chain, laws, state, 0.0, q[k], w[k], a[k], None, work)
        if step > 0:
            for i in range(coordinates):
                done = 0.5 * (work.R[i] + last[i]) * (q[k, i] - q[step - 1, i])
                taken = taken + done
                through = through + abs(done)
        last[:] = work.R
    return taken, through


def draw_motion(random, coordinates, links, steps):
    """Angles and speeds and accelerations (k, c) of a leg that swings and bends about a pose; a
    frame moves by millimetres.
    """
    harmonics = np.arange(1.0, 4.0)
    turn = 2.0 * np.pi * np.arange(steps) / steps
    rate = 10.0 ** random.uniform(-1.0, 1.5)
    size = random.uniform(0.0, 0.1, (3, coordinates))
    size[:, links:] *= 0.02
    angle = harmonics[:, None, None] * turn[:, None] + random.uniform(
        0.0, 2.0 * np.pi, (3, 1, coordinates)
    )
    speed = harmonics[:, None, None] * rate
    q, w, a = (
        (factor * wave).sum(axis=0)
        for factor, wave in (
            (size[:, None], np.sin(angle)),
            (size[:, None] * speed, np.cos(angle)),
            (-size[:, None] * speed**2, np.sin(angle)),
        )
    )
    # Hinge angles add up along the leg.
    q, w, a = (np.hstack([np.cumsum(x[:, :links], axis=1), x[:, links:]]) for x in (q, w, a))
    q[:, :links] += random.uniform(0.3, 2.2)
    return q, w, a


def find_extremes(id_, values, motions, steps=STEPS):
    """The least and the most work that closed motions need, over the work that goes through."""
    random = np.random.default_rng(7)
    shares = []
    for _ in range(values):
        rig = having(LOSSLESS, **({id_: drawn(catalogue()[id_], random)} if id_ else {}))
        setup = set_up(rig, HEIGHT_M, held(0.2), (20,))
        chain = setup.chain()
        laws = setup.compile_laws(chain)
        links = chain.length.size
        coordinates = links + (chain.frame_mass > 0.0)
        none = np.zeros(coordinates)
        at_ends = np.zeros(links)
        state = State(
            none, none.copy(), none.copy(), at_ends, np.zeros((laws.place.size, links, 4))
        )
        work = allocate_workspace(coordinates, links)
        for _ in range(motions):
            q, w, a = draw_motion(random, coordinates, links, steps)
            lowest_m = np.cumsum(chain.length * np.sin(q[:, :links]), axis=1).max() + chain.radius
            touching = chain._replace(ground_depth=float(lowest_m - random.uniform(0.0, DEEPEST_M)))
            taken, through = work_of_motion(touching, laws, state, work, q, w, a)
            shares.append(taken / through)
    return min(shares), max(shares)


@pytest.mark.parametrize(("values", "motions"), NUMBERS)
@pytest.mark.parametrize("id_", [None, *CONSERVATIVE])
def test_closed_motions_without_loss_need_no_work_and_give_none(id_, values, motions):
    least, most = find_extremes(id_, values, motions)
    assert least > -SUM_ERR and most < SUM_ERR


@pytest.mark.parametrize(("values", "motions"), NUMBERS)
@pytest.mark.parametrize("id_", DISSIPATIVE)
def test_closed_motions_with_a_loss_need_work(id_, values, motions):
    least, most = find_extremes(id_, values, motions)
    assert least > -SUM_ERR and most > SUM_ERR


@pytest.mark.slow
@pytest.mark.parametrize("id_", [None, "ground_bump"])
def test_what_a_sum_leaves_falls_with_its_step(id_):
    wide, narrow = (max(map(abs, find_extremes(id_, 10, 10, steps))) for steps in (200, 800))
    assert narrow < 0.5 * wide
