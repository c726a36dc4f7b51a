"""What is stated where anything has changed: legs whose change is drawn from all effects of the
exam, and from faults that the catalogue lacks.

Run: python -m tests.benchmarks.reference_any FOLDER [--pairs 60] [--seed 1]

References are those of `reference_leg`: laws that differ from the catalogue's, nominal values that
are off, in every second pair a fault that both recordings share. Every second change is outside the
catalogue. The conditions are the same. Strengths are those of the exam, from 0 to 1, drawn evenly
on a log scale from LEAST_STRENGTH on. Answers stay in FOLDER; the same command goes on.
"""

import argparse
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from rfca_rig.diagnosis.opening import open_problem
from rfca_rig.diagnosis.reference.problem import ReferenceProblem
from rfca_rig.exam.cases import (
    SIZE_RANGES,
    UNKNOWN_FAULT_RANGES,
    sample_unknown_fault,
    sample_values,
)
from rfca_rig.exam.claims import STRANGERS
from rfca_rig.exam.hidden_laws import draw_law
from rfca_rig.exam.simulate_campaign import write_campaign
from rfca_rig.model.catalogue import list_related, members_of
from tests.benchmarks.reference import plain_answer
from tests.benchmarks.reference_leg import draw as draw_leg

RUNS = 2
LISTED = "listed"
UNLISTED = "unlisted"
MARKS = ("right", "family", "wrong", "silent")
# What changes in a month is small.
LEAST_STRENGTH = 0.02
# References have the seeds of `reference_leg` from this one on, so that no pair is counted twice.
FIRST_SEED = 1000


def draw(seed, number):
    """Kind, name and strength of a change, and the cases before and after it."""
    reference = draw_leg(FIRST_SEED + seed, number, True).reference
    random = np.random.default_rng([seed, number, 5])
    strength = float(np.exp(random.uniform(np.log(LEAST_STRENGTH), 0.0)))
    if number % 2:
        kind = UNLISTED
        known = [name for name in UNKNOWN_FAULT_RANGES if name not in reference.strangers]
        name = str(random.choice(known))
        values = sample_unknown_fault(name, strength, random)
        changed = replace(reference, strangers={**reference.strangers, name: values})
    else:
        kind = LISTED
        name = str(random.choice(list(SIZE_RANGES)))
        values = sample_values(name, strength, random)
        changed = replace(reference, effects={name: values}, law=draw_law(random))
    changed = replace(changed, seed=int(random.integers(2**31)))
    return kind, name, strength, reference, changed


def answer(seed, number, folder):
    """Truth and answer of a pair, kept in a file."""
    path = folder / f"with-{number:04d}.json"
    if path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    kind, name, strength, reference, changed = draw(seed, number)
    own = folder / f"pair-{number:04d}"
    own.mkdir(exist_ok=True)
    references = [own / f"reference-{run}" for run in range(1, RUNS + 1)]
    for run, place in enumerate(references):
        if not place.is_dir():
            write_campaign(replace(reference, seed=reference.seed + run), place)
    if not (own / "new").is_dir():
        write_campaign(changed, own / "new")
    problem = ReferenceProblem(open_problem([own / "new"]), open_problem(references))
    said = {"number": number, "kind": kind, "name": name, "strength": strength}
    said |= plain_answer(problem)
    path.write_text(json.dumps(said, indent=1), encoding="utf-8")
    return said


def mark(said):
    """right, family, wrong or silent.

    A fault outside the catalogue belongs to the families that the exam accepts for it; an effect of
    one of them counts as the family.
    """
    if said["kind"] == LISTED:
        related = list_related({said["name"]})
    else:
        families = STRANGERS.get(said["name"], ((), ""))[0]
        related = frozenset().union(*(members_of(family) for family in families))
    effects = set(said["effects"])
    if effects:
        if effects == {said["name"]}:
            return "right"
        return "family" if effects <= related else "wrong"
    family = said["family"]
    if family is None:
        return "silent"
    return "family" if members_of(family["id"]) & related else "wrong"


def main():
    """Draws, records, diagnoses and counts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    words = parser.parse_args()
    words.folder.mkdir(parents=True, exist_ok=True)
    counts = {LISTED: Counter(), UNLISTED: Counter()}
    for number in range(words.pairs):
        said = answer(words.seed, number, words.folder)
        counts[said["kind"]][mark(said)] += 1
        head = f"{number} {said['kind']} {said['name']} {said['strength']:.2f}"
        print(f"{head}: {said['grade']}, {mark(said)}; {', '.join(said['effects'])}", flush=True)
    print(f"{'change':<10}" + "".join(f"{word:>8}" for word in MARKS))
    for kind, marks in counts.items():
        print(f"{kind:<10}" + "".join(f"{marks[word]:>8}" for word in MARKS))


if __name__ == "__main__":
    main()
