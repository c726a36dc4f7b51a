"""How often a change since a reference is found on an arm of three joints whose model is wrong.

Run: python -m tests.benchmarks.reference_arm FOLDER [--pairs 24] [--seed 1]

Each pair draws an arm of `tests/mechanism/arm.py`, simulated from its own equations, with friction
of LuGre's law in all joints, which the model lacks. The masses of the model are off by their
standard uncertainty. Both are common to the reference and the recordings:

1. the reference: two motions of 8 s, each twice
2. the recordings: the same motions once, after a change of the last link's mass, of dry friction,
   of the scale of the torques, of mass and friction, or of nothing. In one of four pairs they are
   other motions.

In every recording friction differs by 3 % and the torques by 0.3 %. Sizes are drawn evenly on a log
scale between shares of what the arm has. Answers stay in FOLDER; the same command goes on.
"""

from dataclasses import replace

import numpy as np

from tests.benchmarks.reference_mechanism import NOTHING, Benchmark, Pair, draw_size, run
from tests.mechanism import arm

MASS = "mass of the last link"
FRICTION = "dry friction"
SCALE = "torque scale"
TWO = "mass and dry friction"
KINDS = (NOTHING, MASS, FRICTION, SCALE, NOTHING, TWO)
OTHER_MOTIONS = 4
DRY = frozenset(("joint_friction", "joint_stribeck", "joint_hysteresis", "joint_load_friction"))
BODY = frozenset(("added_mass", "centre_of_mass"))
RIGHT = {
    NOTHING: frozenset(),
    MASS: BODY,
    FRICTION: DRY,
    SCALE: frozenset(("torque_scale", "torque_scale_of_one")),
    TWO: BODY | DRY,
}
# Least and most, of the link's mass, of the friction and of the torque.
SIZES = {MASS: (0.05, 0.6), FRICTION: (0.1, 1.5), SCALE: (0.01, 0.15), TWO: (0.1, 0.8)}
SECONDS = 8.0
MASS_RELATIVE = 0.02
USUAL_Nm = np.array([6.0, 2.5, 0.7])


def draw(seed, number):
    """Pair `number` of a seed, whatever the others are."""
    random = np.random.default_rng([seed, number])
    nominal = arm.Arm()
    dry_Nm = random.uniform(0.03, 0.08, 3) * USUAL_Nm
    before = replace(
        nominal,
        mass_kg=tuple(
            np.array(nominal.mass_kg) * (1.0 + MASS_RELATIVE * random.standard_normal(3))
        ),
        friction=arm.Friction(tuple(dry_Nm), random.uniform(0.2, 0.4), 0.3),
    )
    kind = KINDS[number % len(KINDS)]
    is_other = number // len(KINDS) % OTHER_MOTIONS == OTHER_MOTIONS - 1
    if kind == NOTHING:
        return Pair(kind, is_other, 0.0, nominal, before, before)
    size = draw_size(SIZES[kind], random)
    after = before
    if kind in (MASS, TWO):
        *first, last = before.mass_kg
        after = replace(after, mass_kg=(*first, last * (1.0 + size)))
    if kind in (FRICTION, TWO):
        more = tuple(value * (1.0 + size) for value in before.friction.coulomb_Nm)
        after = replace(after, friction=replace(before.friction, coulomb_Nm=more))
    if kind == SCALE:
        after = replace(after, torque_factor=1.0 - size)
    return Pair(kind, is_other, size, nominal, before, after)


def write(folder, pair, actual, recordings):
    """The recordings of an arm, as those of the nominal one."""
    columns = [record(actual, recording) for recording in recordings]
    known_to = {"mass_relative": MASS_RELATIVE, "zero_offset_rad": 0.002}
    arm.write_campaign(folder, pair.nominal, columns, known_to)


def record(actual, recording):
    """The columns of one recording."""
    coulomb_Nm = tuple(recording.friction * np.array(actual.friction.coulomb_Nm))
    recorded = replace(
        actual,
        friction=replace(actual.friction, coulomb_Nm=coulomb_Nm),
        torque_factor=recording.force * actual.torque_factor,
    )
    return arm.record(recorded, SECONDS, recording.motion, noise_seed=recording.noise)


def find_truth(pair, effect):
    """The added mass."""
    if effect == "added_mass":
        return "mass_kg", pair.after.mass_kg[-1] - pair.before.mass_kg[-1]
    return None


ARM = Benchmark(
    name="arm",
    right=RIGHT,
    two=frozenset((TWO,)),
    draw=draw,
    write=write,
    find_truth=find_truth,
)


if __name__ == "__main__":
    run(ARM, __doc__)
