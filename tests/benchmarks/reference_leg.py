"""How often a change since a reference is found on a leg whose model is wrong.

Run: python -m tests.benchmarks.reference_leg FOLDER [--pairs 60] [--seed 1] [--runs 2]
[--unchanged-elsewhere]

Each pair draws a leg of the exam's simulator, whose contact law and hinges differ from the model's.
Its nominal values are off by their standard uncertainty, its drive is late, and in half of the
pairs something acts that no effect of the catalogue describes. All of that is common to the
reference and the recordings. Both have the paper's four conditions, five strokes each, and static
stages; --runs says how often the reference was recorded. In one of four pairs the recordings are of
other heights and speeds.

Between them nothing changes, or one value or two: stiffness, dry friction of the hinges, the zero
of the shaft's angle, a lag of the sensor, friction of the floor, a mass at the tip. Sizes are 0.5
to 16 times DRAWN_LIMITS; the table counts them in detection limits that the unchanged pairs state.
With --unchanged-elsewhere nothing changes in any pair, and all have other heights and speeds.
Answers stay in FOLDER; the same command goes on.
"""

import argparse
import csv
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from rfca_rig.diagnosis.opening import open_problem
from rfca_rig.diagnosis.reference.problem import ReferenceProblem
from rfca_rig.exam.cases import MAX_DELAY_S, PAPER_CONDITIONS, Case, sample_unknown_fault
from rfca_rig.exam.hidden_laws import draw_law
from rfca_rig.exam.nominal_world import draw_nominal_errors, draw_structured_error
from rfca_rig.exam.simulate_campaign import write_campaign
from tests.benchmarks.changes import STDS_OF_90, MarkedPair, print_marks, print_misses
from tests.benchmarks.reference import plain_answer

NOTHING = "nothing"
TWO = "stiffness and dry friction"
KINDS = (
    NOTHING,
    "stiffness",
    "dry friction",
    "zero",
    NOTHING,
    "lag",
    "floor friction",
    TWO,
    NOTHING,
    "tip mass",
)
# Of each kind the effect that is right, its size, and about what can be seen, as the size's
# distance from no effect.
SIZES = {
    "stiffness": ("k0_change", "factor", 0.01),
    "dry friction": ("hinge_coulomb_friction", "torque_Nm", 0.0015),
    "zero": ("start_angle_change", "change_deg", 0.08),
    "lag": ("sensor_lag", "time_constant_s", 0.0006),
    "floor friction": ("friction_change", "change", 0.007),
    "tip mass": ("tip_mass", "mass_g", 1.5),
}
PARTS = {TWO: ("stiffness", "dry friction")}
EITHER_SIGN = ("zero", "floor friction")
LEAST_LIMITS = 0.5
MOST_LIMITS = 16.0
OTHER_MOTIONS = 4
OTHER_CONDITIONS = ((205.0, 2.2), (205.0, 2.8), (225.0, 2.2), (225.0, 3.0))
MODEL_ERROR = 0.01
# Outside of the catalogue, in every second pair, hardly above the usual model error.
STRANGERS = ("tendon", "sensor_curvature", "hose_at_the_shaft", "hinge_asymmetry")
STRANGER_STRENGTH = 0.3


@dataclass(frozen=True)
class LegPair:
    """What one pair records.

    Parameters
    ----------
    kind
        What has changed.
    is_other
        Whether the conditions are other ones.
    reference, changed
        The cases of the exam's simulator.
    sizes
        By kind of the change, as the distance from no effect.
    """

    kind: str
    is_other: bool
    reference: Case
    changed: Case
    sizes: dict


def draw(seed, number, is_unchanged_elsewhere=False):
    """Pair `number` of a seed, whatever the others are."""
    random = np.random.default_rng([seed, number])
    reference = Case(
        id="",
        kind="model error",
        seed=int(random.integers(2**31)),
        design=PAPER_CONDITIONS,
        off=draw_nominal_errors(random),
        late_s=float(random.uniform(0.0, MAX_DELAY_S)),
        model_error=MODEL_ERROR,
        structured=draw_structured_error(MODEL_ERROR, random),
    )
    if number % 2:
        stranger = STRANGERS[number // 2 % len(STRANGERS)]
        values = sample_unknown_fault(stranger, STRANGER_STRENGTH, random)
        reference = replace(reference, strangers={stranger: values})
    kind = NOTHING if is_unchanged_elsewhere else KINDS[number % len(KINDS)]
    sizes = {}
    for part in PARTS.get(kind, (kind,)):
        if part == NOTHING:
            continue
        limits = float(np.exp(random.uniform(np.log(LEAST_LIMITS), np.log(MOST_LIMITS))))
        sign = random.choice([-1.0, 1.0]) if part in EITHER_SIGN else 1.0
        sizes[part] = sign * limits * SIZES[part][2]
    is_other = is_unchanged_elsewhere or number // len(KINDS) % OTHER_MOTIONS == OTHER_MOTIONS - 1
    changed = change(reference, sizes, draw_law(random))
    changed = replace(changed, seed=int(random.integers(2**31)))
    if is_other:
        changed = replace(changed, design=replace(changed.design, conditions=OTHER_CONDITIONS))
    return LegPair(kind, is_other, reference, changed, sizes)


def change(case, sizes, law):
    """The case with these changes; the zero of the angle is changed in the files. Hinges become
    softer, never harder.
    """
    off = case.off
    effects = {}
    if "stiffness" in sizes:
        off = replace(off, k0_factor=off.k0_factor * (1.0 - sizes["stiffness"]))
    if "floor friction" in sizes:
        friction = off.friction_coefficient + sizes["floor friction"]
        off = replace(off, friction_coefficient=friction)
    for part in ("dry friction", "lag", "tip mass"):
        if part in sizes:
            effect, parameter, _ = SIZES[part]
            effects[effect] = {parameter: sizes[part]}
    return replace(case, off=off, effects=effects, law=law if effects else None)


def write_folders(pair, own, runs):
    """The folders of the reference's runs and of the recordings."""
    references = [own / f"reference-{run}" for run in range(1, runs + 1)]
    for run, folder in enumerate(references):
        if not folder.is_dir():
            write_campaign(replace(pair.reference, seed=pair.reference.seed + run), folder)
    if not (own / "new").is_dir():
        write_campaign(pair.changed, own / "new")
        # The leg hangs as before, and the encoder reads more: the true zero is that much lower.
        shift_angle(own / "new" / "runs", -np.radians(pair.sizes.get("zero", 0.0)))
    return references


def shift_angle(folder, by_rad):
    """Add to the angle of the shaft in all tables of a folder."""
    for path in folder.glob("*.csv"):
        with path.open(newline="", encoding="utf-8") as file:
            header, *rows = list(csv.reader(file))
        column = header.index("shaft_angle_rad")
        for row in rows:
            row[column] = f"{float(row[column]) + by_rad:.5f}"
        with path.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerows([header, *rows])


def answer(seed, number, folder, runs, is_unchanged_elsewhere):
    """Truth and answer of a pair, kept in a file."""
    path = folder / f"with-{runs}-{number:04d}.json"
    if path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    pair = draw(seed, number, is_unchanged_elsewhere)
    own = folder / f"pair-{number:04d}"
    own.mkdir(exist_ok=True)
    references = write_folders(pair, own, runs)
    problem = ReferenceProblem(open_problem([own / "new"]), open_problem(references))
    said = {
        "number": number,
        "kind": pair.kind,
        "is_other": pair.is_other,
        "sizes": pair.sizes,
        "strangers": list(pair.reference.strangers),
        "changed": asdict(pair.changed),
    }
    said |= plain_answer(problem)
    path.write_text(json.dumps(said, indent=1), encoding="utf-8")
    return said


def list_size_errors(said):
    """Of each right effect stated: stated over true size, less 1, and whether the 90 % interval
    holds the truth.
    """
    errors = []
    for part, true in said["sizes"].items():
        effect, parameter, _ = SIZES[part]
        if effect not in said["effects"]:
            continue
        value, std = said["effects"][effect]["parameters"][parameter]
        distance = 1.0 - value if parameter == "factor" else value
        is_held = abs(distance - true) <= STDS_OF_90 * std
        errors.append((distance / true - 1.0, is_held))
    return errors


def find_limits(answers):
    """Median detection limits that the unchanged pairs with the same conditions state."""
    limits = {}
    for kind, (effect, parameter, drawn) in SIZES.items():
        stated = []
        for said in answers:
            if said["kind"] == NOTHING and not said["is_other"] and effect in said["not_seen"]:
                value = said["not_seen"][effect][parameter]
                stated.append(abs(1.0 - value) if parameter == "factor" else abs(value))
        limits[kind] = float(np.median(stated)) if stated else drawn
    return limits


def mark(said, limits):
    """The pair as the tables count it."""
    sizes = said["sizes"]
    in_limits = [abs(size) / limits[part] for part, size in sizes.items()]
    return MarkedPair(
        said,
        right=frozenset(SIZES[part][0] for part in sizes),
        is_two=said["kind"] == TWO,
        limits=min(in_limits, default=0.0),
        size_errors=tuple(list_size_errors(said)),
    )


def main():
    """Draws, records, diagnoses and counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int, default=2)
    parser.add_argument("--unchanged-elsewhere", action="store_true")
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    # One after the other: a diagnosis uses all cores itself.
    answers = [
        answer(asked.seed, number, asked.folder, asked.runs, asked.unchanged_elsewhere)
        for number in range(asked.pairs)
    ]
    limits = find_limits(answers)
    print("limits: " + ", ".join(f"{kind} {limit:.3g}" for kind, limit in limits.items()))
    pairs = [mark(said, limits) for said in answers]
    print_marks(pairs, "conditions")
    print_misses(pairs, "conditions")
    two = [pair for pair in pairs if pair.is_two]
    both = sum(pair.right == set(pair.said["effects"]) for pair in two)
    print(f"two changes: {both} of {len(two)} name both")
    print(f"median CPU seconds: {np.median([said['cpu_s'] for said in answers]):.0f}")


if __name__ == "__main__":
    main()
