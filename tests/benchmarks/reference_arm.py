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

import argparse
import json
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.reference.problem import ReferenceProblem
from tests.benchmarks.changes import MARKS, STDS_OF_90, MarkedPair
from tests.benchmarks.reference import plain_answer
from tests.benchmarks.servo import describe_answer
from tests.mechanism import arm

NOTHING = "nothing"
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
MOTIONS = 2
MASS_RELATIVE = 0.02
FRICTION_STD = 0.03
TORQUE_STD = 0.003
USUAL_Nm = np.array([6.0, 2.5, 0.7])


@dataclass(frozen=True)
class Pair:
    """What one pair records: the arm as the user believes it, and before and after the change."""

    kind: str
    is_other: bool
    size: float
    nominal: arm.Arm
    before: arm.Arm
    after: arm.Arm


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
    low, high = SIZES[kind]
    size = float(np.exp(random.uniform(np.log(low), np.log(high))))
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


def write_folders(pair, own, seed, number):
    """The folders of reference and recordings."""
    known_to = {"mass_relative": MASS_RELATIVE, "zero_offset_rad": 0.002}
    motion_seed = 1000 * seed + 10 * number
    motions = [motion_seed + motion for motion in range(MOTIONS)]
    if not (own / "reference").is_dir():
        recordings = [
            record(pair.before, motion, [number, motion, repeat])
            for motion in motions
            for repeat in range(2)
        ]
        arm.write_campaign(own / "reference", pair.nominal, recordings, known_to)
    if not (own / "new").is_dir():
        later = 5 if pair.is_other else 0
        recordings = [record(pair.after, motion + later, [number, motion, 9]) for motion in motions]
        arm.write_campaign(own / "new", pair.nominal, recordings, known_to)


def record(of_arm, motion, seeds):
    """One recording, with friction and torques of its own."""
    random = np.random.default_rng(seeds)
    rubs = 1.0 + FRICTION_STD * random.standard_normal()
    pulls = 1.0 + TORQUE_STD * random.standard_normal()
    coulomb_Nm = tuple(rubs * np.array(of_arm.friction.coulomb_Nm))
    recorded = replace(
        of_arm,
        friction=replace(of_arm.friction, coulomb_Nm=coulomb_Nm),
        torque_factor=pulls * of_arm.torque_factor,
    )
    return arm.record(recorded, SECONDS, motion, noise_seed=[*seeds, 1])


def answer(seed, number, folder):
    """Truth and answer of a pair, kept in a file."""
    path = folder / f"arm-{number:04d}.json"
    if path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    pair = draw(seed, number)
    own = folder / f"pair-{number:04d}"
    own.mkdir(exist_ok=True)
    write_folders(pair, own, seed, number)
    problem = ReferenceProblem(
        MechanismProblem(read_experiment(own / "new")),
        MechanismProblem(read_experiment(own / "reference")),
    )
    said = {
        "number": number,
        "kind": pair.kind,
        "is_other": pair.is_other,
        "size": pair.size,
        "more_kg": pair.after.mass_kg[-1] - pair.before.mass_kg[-1],
    }
    said |= plain_answer(problem)
    path.write_text(json.dumps(said, indent=1), encoding="utf-8")
    return said


def read_size_error(said):
    """Error of the added mass as a share, and whether its 90 % interval holds it; None where no
    mass is stated.
    """
    effect = said["effects"].get("added_mass")
    if effect is None or said["more_kg"] == 0.0:
        return None
    value, std = effect["parameters"]["mass_kg"]
    error = value - said["more_kg"]
    return error / said["more_kg"], abs(error) <= STDS_OF_90 * std


def mark(said):
    """The pair as tables count it."""
    error = read_size_error(said)
    is_two = said["kind"] == TWO
    size_errors = () if error is None else (error,)
    return MarkedPair(said, RIGHT[said["kind"]], is_two, limits=0.0, size_errors=size_errors)


def main():
    """Draws, records, diagnoses and counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    pairs = [mark(answer(asked.seed, number, asked.folder)) for number in range(asked.pairs)]
    for is_other in (False, True):
        print("other motions" if is_other else "the same motions")
        print(f"  {'changed':<24}" + "".join(f"{word:>8}" for word in MARKS))
        for kind in dict.fromkeys(KINDS):
            row = [p for p in pairs if p.said["kind"] == kind and p.said["is_other"] == is_other]
            counts = Counter(pair.mark for pair in row)
            print(f"  {kind:<24}" + "".join(f"{counts[word]:>8}" for word in MARKS))
    for pair in pairs:
        errors = ", ".join(f"{100.0 * error:+.0f} %" for error, _ in pair.size_errors)
        head = f"pair {pair.said['number']}, {pair.said['kind']} {pair.said['size']:.2f}"
        print(f"{head}: {pair.mark} {errors}; {describe_answer(pair.said)}")


if __name__ == "__main__":
    main()
