"""How often a change since a reference is found on a hopper whose model is wrong.

Run: python -m tests.benchmarks.reference_hopper FOLDER [--pairs 24] [--seed 1]

Each pair draws a hopper of `tests/mechanism/hopper.py`, simulated from its own equations. Rail and
leg have dry friction that rises at rest, which the model lacks, and the sole has other exponents
than Hunt and Crossley's, which the model states; in one of three pairs the model has MuJoCo's
contact. Masses, stiffness and damping of the sole are off by their standard uncertainties. All of
that is common to the reference and the recordings:

1. the reference: two motions of 2.6 s, each twice
2. the recordings: the same motions once, after a change of the trunk's mass, of dry friction of the
   leg, of the scale of the force, of the stiffness of the sole, or of nothing. In one of four pairs
   they are other motions.

In every recording friction differs by 3 % and the force by 0.3 %, and the zeros of reference and
recordings differ. Sizes are drawn evenly on a log scale between shares of what the hopper has.
Answers stay in FOLDER; the same command goes on.
"""

from dataclasses import dataclass, replace

import numpy as np

from tests.benchmarks.mechanisms import (
    HOPPER_KNOWN_TO,
    draw_powers,
    draw_zeros,
    misjudge_hopper,
)
from tests.benchmarks.reference_mechanism import NOTHING, Benchmark, Pair, draw_size, run
from tests.mechanism import hopper

MASS = "mass of the trunk"
FRICTION = "dry friction of the leg"
SCALE = "force scale"
SOLE = "softer sole"
KINDS = (NOTHING, MASS, NOTHING, FRICTION, SCALE, NOTHING, SOLE)
OTHER_MOTIONS = 4
MUJOCO_CONTACTS = 3
RIGHT = {
    NOTHING: frozenset(),
    MASS: frozenset(("added_mass",)),
    FRICTION: frozenset(
        ("joint_friction", "joint_friction_of_one", "joint_stribeck", "joint_hysteresis")
    ),
    SCALE: frozenset(("torque_scale", "torque_scale_of_one")),
    SOLE: frozenset(("contact_stiffness",)),
}
# Least and most, of the trunk's mass, of the friction, of the force and of the stiffness.
SIZES = {MASS: (0.02, 0.3), FRICTION: (0.1, 1.5), SCALE: (0.01, 0.15), SOLE: (0.1, 0.7)}
# Dry friction of rail and leg. The commanded force is about 18 N in rms.
LEAST_DRY_N = (0.3, 0.6)
MOST_DRY_N = (0.8, 1.6)
SECONDS = 2.6


@dataclass(frozen=True)
class HopperPair(Pair):
    """A pair whose model states Hunt and Crossley's sole, or has MuJoCo's contact."""

    own_contact: bool


def draw(seed, number):
    """Pair `number` of a seed, whatever the others are."""
    random = np.random.default_rng([seed, number])
    nominal = hopper.Hopper()
    before = replace(
        misjudge_hopper(nominal, random),
        other_powers=draw_powers(random),
        dry_N=tuple(random.uniform(LEAST_DRY_N, MOST_DRY_N)),
        rise=random.uniform(0.2, 0.4),
    )
    kind = KINDS[number % len(KINDS)]
    is_other = number % OTHER_MOTIONS == OTHER_MOTIONS - 1
    after = replace(before, zero_m=draw_zeros(random))
    size = 0.0
    if kind != NOTHING:
        size = draw_size(SIZES[kind], random)
    if kind == MASS:
        after = replace(after, trunk_kg=before.trunk_kg * (1.0 + size))
    if kind == FRICTION:
        rail_N, leg_N = before.dry_N
        after = replace(after, dry_N=(rail_N, leg_N * (1.0 + size)))
    if kind == SCALE:
        after = replace(after, force_factor=1.0 - size)
    if kind == SOLE:
        softer = before.stiffness_N_per_m1p5 * (1.0 - size)
        after = replace(after, stiffness_N_per_m1p5=softer)
    own_contact = number % MUJOCO_CONTACTS != 0
    return HopperPair(kind, is_other, size, nominal, before, after, own_contact)


def write(folder, pair, actual, recordings):
    """The recordings of a hopper, as those of the nominal one."""
    columns = [record(actual, recording) for recording in recordings]
    hopper.write_campaign(folder, pair.nominal, columns, HOPPER_KNOWN_TO, pair.own_contact)


def record(actual, recording):
    """The columns of one recording."""
    recorded = replace(
        actual,
        dry_N=tuple(recording.friction * np.array(actual.dry_N)),
        force_factor=recording.force * actual.force_factor,
    )
    return hopper.record(recorded, SECONDS, recording.motion, noise_seed=recording.noise)


def find_truth(pair, effect):
    """The added mass, the factor of the force, or that of the stiffness."""
    if effect == "added_mass":
        return "mass_kg", pair.after.trunk_kg - pair.before.trunk_kg
    if effect == "torque_scale":
        return "factor", 1.0 - pair.size
    if effect == "contact_stiffness":
        return "factor", 1.0 - pair.size
    return None


HOPPER = Benchmark(
    name="hopper",
    right=RIGHT,
    two=frozenset(),
    draw=draw,
    write=write,
    find_truth=find_truth,
)


if __name__ == "__main__":
    run(HOPPER, __doc__)
