"""What the benchmarks of simulated mechanisms share: pairs of recordings and reference, drawn,
recorded, diagnosed, kept and counted.
"""

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.campaign.experiment import read_experiment
from rfca_rig.diagnosis.mechanisms.problem import MechanismProblem
from rfca_rig.diagnosis.reference.problem import ReferenceProblem
from tests.benchmarks.changes import STDS_OF_90, MarkedPair, print_kinds
from tests.benchmarks.reference import plain_answer
from tests.benchmarks.servo import describe_answer

NOTHING = "nothing"
MOTIONS = 2
# Of each motion in the reference; the new recordings have each once.
REPEATS = 2
# What differs between two recordings of one motion, as a share: supply voltages and warm grease.
FRICTION_STD = 0.03
FORCE_STD = 0.003


@dataclass(frozen=True)
class Pair:
    """What one pair records: the mechanism as the user believes it, and before and after the
    change.
    """

    kind: str
    is_other: bool
    size: float
    nominal: Any
    before: Any
    after: Any


@dataclass(frozen=True)
class Recording:
    """Seeds of the motion and of the noise of one recording, and factors of friction and force in
    it.
    """

    motion: int
    noise: Sequence[int]
    friction: float
    force: float


@dataclass(frozen=True)
class Benchmark:
    """A mechanism whose changes are looked for.

    Parameters
    ----------
    name
        Begins the names of the files of answers.
    right
        The effects that are right, by kind of the change.
    two
        The kinds that change two things.
    draw
        The pair of a seed and a number.
    write
        Writes the recordings of a mechanism into a folder, as those of the pair's nominal one.
    find_truth
        Of a pair and an effect that is right: the name of its size, and the true value; None where
        the size is not compared.
    """

    name: str
    right: Mapping[str, frozenset[str]]
    two: frozenset[str]
    draw: Callable[[int, int], Pair]
    write: Callable[[Path, Any, Any, Sequence[Recording]], None]
    find_truth: Callable[[Pair, str], tuple[str, float] | None]


def draw_size(span, random):
    """A size, evenly on a log scale between two."""
    low, high = span
    return float(np.exp(random.uniform(np.log(low), np.log(high))))


def write_folders(benchmark, pair, own, seed, number):
    """The folders of reference and recordings."""
    motion_seed = 1000 * seed + 10 * number
    motions = [motion_seed + motion for motion in range(MOTIONS)]
    if not (own / "reference").is_dir():
        recordings = [
            draw_recording(motion, [number, motion, repeat])
            for motion in motions
            for repeat in range(REPEATS)
        ]
        benchmark.write(own / "reference", pair, pair.before, recordings)
    if not (own / "new").is_dir():
        later = 5 if pair.is_other else 0
        recordings = [draw_recording(motion + later, [number, motion, 9]) for motion in motions]
        benchmark.write(own / "new", pair, pair.after, recordings)


def draw_recording(motion, seeds):
    """A recording with friction and forces of its own."""
    random = np.random.default_rng(seeds)
    return Recording(
        motion=motion,
        noise=[*seeds, 1],
        friction=1.0 + FRICTION_STD * random.standard_normal(),
        force=1.0 + FORCE_STD * random.standard_normal(),
    )


def answer(benchmark, pair, seed, number, folder):
    """The answer about a pair, kept in a file."""
    path = folder / f"{benchmark.name}-{number:04d}.json"
    if path.exists():
        return json.loads(path.read_text(encoding="utf-8"))
    own = folder / f"pair-{number:04d}"
    own.mkdir(exist_ok=True)
    write_folders(benchmark, pair, own, seed, number)
    problem = ReferenceProblem(
        MechanismProblem(read_experiment(own / "new")),
        MechanismProblem(read_experiment(own / "reference")),
    )
    said = {"number": number, "kind": pair.kind, "is_other": pair.is_other, "size": pair.size}
    said |= plain_answer(problem)
    path.write_text(json.dumps(said, indent=1), encoding="utf-8")
    return said


def mark(benchmark, pair, said):
    """The pair as tables count it."""
    right = benchmark.right[pair.kind]
    errors = []
    for effect in sorted(right & said["effects"].keys()):
        truth = benchmark.find_truth(pair, effect)
        if truth is not None:
            name, true = truth
            value, std = said["effects"][effect]["parameters"][name]
            errors.append(((value - true) / true, abs(value - true) <= STDS_OF_90 * std))
    is_two = pair.kind in benchmark.two
    return MarkedPair(said, right, is_two, limits=0.0, size_errors=tuple(errors))


def run(benchmark, description):
    """Draws, records, diagnoses and counts."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--pairs", type=int, default=24)
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    marked = []
    # One after the other: a diagnosis uses all cores itself.
    for number in range(asked.pairs):
        pair = benchmark.draw(asked.seed, number)
        said = answer(benchmark, pair, asked.seed, number, asked.folder)
        marked.append(mark(benchmark, pair, said))
    print_kinds(marked, benchmark.right)
    for pair in marked:
        errors = ", ".join(f"{100.0 * error:+.0f} %" for error, _ in pair.size_errors)
        head = f"pair {pair.said['number']}, {pair.said['kind']} {pair.said['size']:.2f}"
        print(f"{head}: {pair.mark} {errors}; {describe_answer(pair.said)}")
    seconds = np.median([pair.said["cpu_s"] for pair in marked])
    print(f"median CPU seconds: {seconds:.0f}")
