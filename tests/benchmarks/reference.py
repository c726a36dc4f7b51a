"""How often a change since a reference is found on a position servo whose model is wrong.

Run: python -m tests.benchmarks.reference FOLDER [--pairs 40] [--seed 1] [--alone]
[--leave-out joint_prior|covariance|matching]

Each pair draws a servo of `tests/mechanism/servo.py`, whose laws differ from the catalogue's, and
nominal values that are off by their standard uncertainty. Both are common to the reference and the
recordings:

1. the reference: each motion twice
2. the recordings: each motion once, after a change of weight, arm or friction, of two of them, or
   of nothing. In one of three pairs all motions are other ones than those of the reference.

Every recording has a supply voltage of its own. Sizes of changes are 0.5 to 16 times DRAWN_LIMITS;
the table counts them in detection limits that the unchanged pairs state.

With --alone each pair is diagnosed without its reference, too. With --leave-out the reference is
used without one of its parts. Answers stay in FOLDER; the same command goes on.
"""

import argparse
import json
import time
from collections import Counter
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.diagnose import diagnose
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.reference.conditions import ReferenceParts
from rfca_rig.diagnosis.reference.problem import ReferenceProblem
from rfca_rig.errors import RigError
from rfca_rig.progress import ignore_share
from tests.benchmarks.changes import STDS_OF_90, MarkedPair, print_marks, print_misses
from tests.benchmarks.servo import (
    BODY_EFFECTS,
    LARGEST_SUPPLY_ERROR,
    SUPPLY_STD,
    change_of_gravity,
    describe,
    draw_servo,
    implied_change,
    list_known_before,
    misjudge,
)
from tests.mechanism import servo as servos

NOTHING = "nothing"
WEIGHT = "weight"
ARM = "arm"
FRICTION = "friction"
TWO = "weight and friction"
KINDS = (NOTHING, WEIGHT, ARM, FRICTION, WEIGHT, NOTHING, TWO, ARM)
# One of three pairs has other motions than its reference, so that all kinds have some.
OTHER_MOTIONS = 3
MOTIONS = ("lift and lower", "sines", "steps")
SECONDS = 6.3
REPEATS = 2
# What the diagnosis chooses itself for nearly all pairs, at twice the price.
WINDOW_S = 2.0
# Of dry friction at rest: what the user writes down for a geared servo.
FRICTION_STD_OF_STALL = 0.03
# Shares of the weight's torque, and of dry friction, about as large as what can be seen.
DRAWN_LIMITS = {WEIGHT: 0.03, ARM: 0.03, FRICTION: 0.15}
LEAST_LIMITS = 0.5
MOST_LIMITS = 16.0
# Laws that describe dry friction of the simulated gear; its rise at rest and its bristle differ
# from each of them.
DRY_LAWS = frozenset(
    ("joint_friction", "joint_stribeck", "joint_hysteresis", "joint_load_friction")
)
RIGHT = {
    NOTHING: frozenset(),
    WEIGHT: BODY_EFFECTS,
    ARM: BODY_EFFECTS,
    FRICTION: DRY_LAWS,
    TWO: BODY_EFFECTS | DRY_LAWS,
}


@dataclass(frozen=True)
class Pair:
    """What one pair records.

    Parameters
    ----------
    kind
        What has changed.
    is_other
        Whether the motions are other ones.
    nominal, reference, changed
        The servo as the user believes it, in the reference, and in the recordings.
    drawn_limits
        The size of the change in DRAWN_LIMITS.
    """

    kind: str
    is_other: bool
    nominal: servos.Servo
    reference: servos.Servo
    changed: servos.Servo
    drawn_limits: float


def draw(seed, number):
    """Pair `number` of a seed, whatever the others are."""
    random = np.random.default_rng([seed, number])
    reference = draw_servo(random)
    nominal = misjudge(reference, random)
    kind = KINDS[number % len(KINDS)]
    limits = float(np.exp(random.uniform(np.log(LEAST_LIMITS), np.log(MOST_LIMITS))))
    sign = random.choice([-1.0, 1.0])
    is_other = number % OTHER_MOTIONS == OTHER_MOTIONS - 1
    changed = change(reference, kind, limits, sign)
    return Pair(kind, is_other, nominal, reference, changed, limits)


def change(servo, kind, limits, sign):
    """The servo after a change of this size. A weight is added; an arm grows or shrinks."""
    if kind in (WEIGHT, TWO):
        more = DRAWN_LIMITS[WEIGHT] * limits
        servo = replace(servo, weight_kg=servo.weight_kg * (1.0 + more))
    if kind == ARM:
        # At most half of the arm goes.
        longer = np.clip(sign * DRAWN_LIMITS[ARM] * limits, -0.4, 0.5)
        servo = replace(servo, arm_m=servo.arm_m * (1.0 + longer))
    if kind in (FRICTION, TWO):
        more = DRAWN_LIMITS[FRICTION] * limits
        dry_Nm = servo.friction.dry_Nm * (1.0 + more)
        servo = replace(servo, friction=replace(servo.friction, dry_Nm=dry_Nm))
    return servo


def record_all(servo, repeats, motion_seed, seeds):
    """Recordings of each motion; those of one motion seed follow the same commands."""
    random = np.random.default_rng(seeds)
    recordings = []
    for motion in MOTIONS:
        for _ in range(repeats):
            off = np.clip(
                SUPPLY_STD * random.standard_normal(), -LARGEST_SUPPLY_ERROR, LARGEST_SUPPLY_ERROR
            )
            recordings.append(servos.record(servo, motion, SECONDS, motion_seed, 1.0 + off))
    return recordings


def write_folders(pair, own, seed, number):
    """The folders of reference and recordings."""
    known_to = list_known_before(pair.nominal)
    known_to["joint_friction_Nm"] = FRICTION_STD_OF_STALL * pair.nominal.motor.stall_Nm
    model = servos.mjcf(pair.nominal)
    motion_seed = 1000 * seed + number
    if not (own / "reference").is_dir():
        recordings = record_all(pair.reference, REPEATS, motion_seed, [seed, number, 1])
        servos.write_campaign(own / "reference", model, recordings, known_to, "reference")
        finish_description(own / "reference" / "experiment.toml")
    if not (own / "new").is_dir():
        other_seed = motion_seed + 500 if pair.is_other else motion_seed
        recordings = record_all(pair.changed, 1, other_seed, [seed, number, 2])
        servos.write_campaign(own / "new", model, recordings, known_to, "new")
        finish_description(own / "new" / "experiment.toml")


def finish_description(path):
    """Repeats of a condition are numbered in experiment.toml, and windows have a length."""
    lines = []
    counts = Counter()
    for line in path.read_text(encoding="utf-8").splitlines():
        lines.append(line)
        if line.startswith("condition = "):
            counts[line] += 1
            lines.append(f"repeat = {counts[line]}")
    lines += ["", "[windows]", f"length_s = {WINDOW_S}"]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")


def plain_answer(problem):
    """The answer about a problem as plain values."""
    begun_s = time.process_time()
    try:
        result = diagnose(problem, ignore_share).diagnosis
    except RigError as error:
        return {
            "grade": "refused",
            "message": str(error),
            "effects": {},
            "family": None,
            "rivals": [],
            "not_seen": {},
            "settings": None,
            "cpu_s": 0.0,
        }
    effects = {}
    for effect in result.effects:
        values = {name: [v.value, v.std] for name, v in effect.parameters.items()}
        effects[effect.id] = {
            "probability": effect.probability,
            "parameters": values,
            "cannot_tell_from": list(effect.cannot_tell_from),
        }
    family = None
    if result.family is not None:
        family = {"id": result.family.id, "probability": result.family.probability}
    return {
        "grade": result.grade,
        "probability": result.probability,
        "sentence": result.sentence,
        "effects": effects,
        "family": family,
        "rivals": [[list(rival.ids), rival.probability] for rival in result.rivals[:6]],
        "not_seen": {
            effect.id: dict(effect.would_have_seen)
            for effect in result.not_seen
            if effect.would_have_seen is not None
        },
        "support": list(result.support),
        "settings": result.settings.get("reference"),
        "cpu_s": time.process_time() - begun_s,
    }


def answer(seed, number, folder, way, parts):
    """Truth and answer of a pair, kept in a file; `way` names the file and says what is used."""
    path = folder / f"{way}-{number:04d}.json"
    if path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    pair = draw(seed, number)
    own = folder / f"pair-{number:04d}"
    own.mkdir(exist_ok=True)
    write_folders(pair, own, seed, number)
    new = MechanismProblem(read_experiment(own / "new"))
    if way == "alone":
        problem = new
    else:
        problem = ReferenceProblem(new, MechanismProblem(read_experiment(own / "reference")), parts)
    said = {
        "number": number,
        "kind": pair.kind,
        "is_other": pair.is_other,
        "drawn_limits": pair.drawn_limits,
        "truth": {
            "before": describe(pair.reference),
            "after": describe(pair.changed),
            "friction_before": asdict(pair.reference.friction),
            "friction_after": asdict(pair.changed.friction),
        },
        "nominal": describe(pair.nominal),
    }
    said |= plain_answer(problem)
    path.write_text(json.dumps(said, indent=1), encoding="utf-8")
    return said


def size_error(said):
    """Implied over true change of the weight's torque, less 1, and whether the 90 % interval holds
    the truth; None where no change of a body is stated, or none is there.
    """
    if said["kind"] not in (WEIGHT, ARM, TWO):
        return None
    implied = implied_change(said)
    if implied is None:
        return None
    true_Nm = change_of_gravity(said)
    value_Nm, std_Nm = implied
    return value_Nm / true_Nm - 1.0, abs(value_Nm - true_Nm) <= STDS_OF_90 * std_Nm


def find_limits(answers):
    """Detection limits that the unchanged pairs with the same motions state, as shares of the
    weight's torque and of dry friction.
    """
    shares = {WEIGHT: [], FRICTION: []}
    for said in answers:
        if said["kind"] != NOTHING or said["is_other"]:
            continue
        mass = said["not_seen"].get("added_mass")
        if mass is not None:
            shares[WEIGHT].append(mass["mass_kg"] / said["nominal"]["mass_kg"])
        torque = said["not_seen"].get("joint_friction")
        if torque is not None:
            dry_Nm = said["truth"]["friction_before"]["dry_Nm"]
            shares[FRICTION].append(torque["torque_Nm"] / dry_Nm)
    limits = {
        kind: float(np.median(values)) if values else DRAWN_LIMITS[kind]
        for kind, values in shares.items()
    }
    return {**limits, ARM: limits[WEIGHT]}


def size_in_limits(said, limits):
    """The change in detection limits; of two the smaller one."""
    sizes = []
    before = said["truth"]["before"]["gravity_Nm"]
    if said["kind"] in (WEIGHT, ARM, TWO):
        sizes.append(abs(change_of_gravity(said)) / before / limits[WEIGHT])
    if said["kind"] in (FRICTION, TWO):
        dry_Nm = said["truth"]["friction_before"]["dry_Nm"]
        more_Nm = said["truth"]["friction_after"]["dry_Nm"] - dry_Nm
        sizes.append(more_Nm / dry_Nm / limits[FRICTION])
    return min(sizes)


def mark(said, limits):
    """The pair as the tables count it."""
    is_changed = said["kind"] != NOTHING
    error = size_error(said)
    return MarkedPair(
        said,
        right=RIGHT[said["kind"]],
        is_two=said["kind"] == TWO,
        limits=size_in_limits(said, limits) if is_changed else 0.0,
        size_errors=() if error is None else (error,),
    )


def main():
    """Draws, records, diagnoses and counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, default=40)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--alone", action="store_true")
    parser.add_argument("--leave-out", choices=tuple(asdict(ReferenceParts())))
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    way = "with"
    parts = ReferenceParts()
    if asked.leave_out:
        way = f"without-{asked.leave_out}"
        parts = replace(parts, **{asked.leave_out: False})
    numbers = range(asked.pairs)
    # One after the other: a diagnosis uses all cores itself.
    answers = [answer(asked.seed, number, asked.folder, way, parts) for number in numbers]
    limits = find_limits(answers)
    of_weight = 100.0 * limits[WEIGHT]
    of_friction = 100.0 * limits[FRICTION]
    print(f"limits: {of_weight:.1f} % of the weight, {of_friction:.0f} % of dry friction")
    pairs = [mark(said, limits) for said in answers]
    print(f"\n{way.replace('-', ' ')}")
    print_marks(pairs, "motions")
    print_misses(pairs, "motions")
    if asked.alone:
        alone = [answer(asked.seed, number, asked.folder, "alone", parts) for number in numbers]
        print("\nwithout a reference")
        print_marks([mark(said, limits) for said in alone], "motions")
    print(f"median CPU seconds: {np.median([said['cpu_s'] for said in answers]):.0f}")


if __name__ == "__main__":
    main()
