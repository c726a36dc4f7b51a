"""What each constant of the diagnosis changes: python -m tests.benchmarks.sensitivity EXAM [--cases
NAME...] [--only NAME]...

EXAM is the folder of an exam whose truths are open. Its cases are diagnosed with one constant
halved, and half as large again, or with one step of the search left out. The answers are kept in
EXAM/sensitivity, so a run that is stopped goes on. Constants of the decision are changed on
finished searches. Only the answer about the forces counts, not that about the shaft's own motion.
"""

import argparse
import importlib
import itertools
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import cloudpickle

from rfca_rig.diagnosis import config
from rfca_rig.exam.answer import parse_truth
from rfca_rig.exam.sealing import open_all
from rfca_rig.executors.cores import ONE_THREAD, machine_cores

BASE = "as shipped"
FACTORS = (0.5, 1.5)
SEARCH = "rfca_rig.diagnosis.inference.model_selection"
# Steps of the search that can be left out: what the step would have returned.
STEPS: Mapping[str, Callable[..., Any]] = {
    "_exchange": lambda state, *_: state,
    "_fit_nested": lambda state: state,
    "_infer_history": lambda state, *_: state,
    "_pair_starts": lambda *_: [],
    "_partner_starts": lambda *_: [],
}
OF_THE_DECISION = frozenset(
    [
        "IDENTIFIED_PROBABILITY",
        "STATED_PROBABILITY",
        "DOMINANT_SHARE",
        "USUAL_MISFIT",
        "AS_GOOD_LOG_ODDS",
        "WORTH_ADDING",
        "LARGE_ERROR",
        "LAW_ERROR",
        "LAW_SIZE_ERROR",
        "LAW_SHAPE_ERROR",
        "LAW_MISFIT_SHARE",
        "OCCAM",
        "MOST_RIVALS",
        "PRIOR_UNKNOWN",
    ]
)


def changes() -> Iterator[str]:
    """Every change, as NAME=VALUE or as -STEP."""
    yield BASE
    for name, value in vars(config).items():
        if name.isupper() and isinstance(value, int | float | tuple):
            yield from (
                f"{name}={changed}"
                for factor in FACTORS
                if (changed := _scaled(value, factor)) != value
            )
    for field in fields(config.DEFAULT_SEARCH):
        value = getattr(config.DEFAULT_SEARCH, field.name)
        yield from (
            f"{field.name}={changed}"
            for factor in FACTORS
            if (changed := _scaled(value, factor)) != value
        )
    yield from (f"-{step}" for step in STEPS)


def _scaled(value: Any, factor: float) -> Any:
    if isinstance(value, tuple):
        return tuple(_scaled(one, factor) for one in value)
    if isinstance(value, int):
        return max(1, round(factor * value))
    return float(f"{factor * value:.4g}")


def apply_change(change: str) -> None:
    """One change in this process, before anything else of the diagnosis is imported."""
    if change.startswith("-"):
        setattr(importlib.import_module(SEARCH), change[1:], STEPS[change[1:]])
    elif change != BASE:
        name, _, text = change.partition("=")
        value = json.loads(text.replace("(", "[").replace(")", "]"))
        value = tuple(value) if isinstance(value, list) else value
        if hasattr(config, name):
            setattr(config, name, value)
        else:
            config.DEFAULT_SEARCH = config.SearchConfig(
                **(asdict(config.DEFAULT_SEARCH) | {name: value})
            )


def answer(exam: Path, change: str, cases: Sequence[str]) -> None:
    """The cases under one change, each a line of JSON in a file of its own."""
    apply_change(change)
    from rfca_rig.campaign.opening import open_with_nominal_model
    from rfca_rig.diagnosis.decision.decide import decide
    from rfca_rig.diagnosis.leg.problem import LegProblem
    from rfca_rig.diagnosis.leg.simulator import LegSimulator
    from rfca_rig.progress import ignore_share

    simulations = itertools.count()
    simulate = LegSimulator.simulate

    def count_and_simulate(self: LegSimulator, at: Any, condition: Any) -> Any:
        next(simulations)
        return simulate(self, at, condition)

    LegSimulator.simulate = count_and_simulate  # type: ignore[method-assign]

    on_saved = change.partition("=")[0] in OF_THE_DECISION
    for case in cases:
        path = _answers(exam, change) / f"{case}.json"
        saved = _answers(exam, BASE) / f"{case}.search"
        if path.exists():
            continue
        before = next(simulations)
        if on_saved:
            search = cloudpickle.loads(saved.read_bytes())
            found = decide(search)
        else:
            recordings = open_with_nominal_model([exam / "campaigns" / case])
            solution = LegProblem(tuple(recordings)).solve((), ignore_share)
            search = solution.findings.forces.search
            found = solution.findings.forces.decision
        simulated = next(simulations) - before - 1
        if change == BASE:
            saved.write_bytes(cloudpickle.dumps(search))
        sizes = {
            f"{e.id}.{name}": (value.value, value.std)
            for e in found.effects
            for name, value in e.parameters.items()
        }
        best = max((search.nothing, *search.named), key=lambda hypothesis: hypothesis.log_joint)
        said = {
            "grade": found.grade,
            "effects": sorted(effect.id for effect in found.effects),
            "family": found.family.id if found.family and not found.effects else "",
            "probability": found.probability,
            "sizes": sizes,
            "log_joint": best.log_joint,
            "simulations": simulated,
        }
        path.write_text(json.dumps(said), encoding="utf-8")


def _answers(exam: Path, change: str) -> Path:
    return exam / "sensitivity" / change.replace("/", "_").replace(" ", "")


def run_all(exam: Path, asked: Sequence[str], cases: Sequence[str]) -> None:
    """Every change in a process of its own, as many at once as there are cores; first the
    answers as shipped.
    """

    def run(change: str, some: Sequence[str]) -> None:
        _answers(exam, change).mkdir(parents=True, exist_ok=True)
        command = [
            sys.executable,
            "-m",
            "tests.benchmarks.sensitivity",
            str(exam),
            f"--change={change}",
            "--cases",
            *some,
        ]
        subprocess.run(
            command, env=os.environ | ONE_THREAD, check=False
        )  # a search that fails under a change is a finding

    with ThreadPoolExecutor(machine_cores()) as pool:
        list(pool.map(lambda case: run(BASE, [case]), cases))
        others = [change for change in asked if change != BASE]
        for change, _ in zip(others, pool.map(lambda one: run(one, cases), others), strict=True):
            print(describe(exam, change, cases), flush=True)


def describe(exam: Path, change: str, cases: Sequence[str]) -> str:
    """One line: answers that differ, how many of them became right or wrong, evidence lost, and
    simulations over those as shipped.
    """
    before, after = (_read(exam, one, cases) for one in (BASE, change))
    truths = {truth.case: set(truth.effects) for truth in map(parse_truth, open_all(exam))}
    both = [case for case in cases if case in before and case in after]
    if not both:
        return f"{change}: failed"
    differ = [case for case in both if _statement(before[case]) != _statement(after[case])]
    better, worse = (
        sum(
            set(new[case]["effects"]) == truths[case] != set(old[case]["effects"])
            for case in differ
        )
        for old, new in ((before, after), (after, before))
    )
    lost = max(before[case]["log_joint"] - after[case]["log_joint"] for case in both)
    cost = sum(after[case]["simulations"] for case in both) / max(
        sum(before[case]["simulations"] for case in both), 1
    )
    detail = "; ".join(
        f"{case[-2:]} {_words(before[case])} -> {_words(after[case])}" for case in differ
    )
    counted = (
        f"{len(differ)} of {len(both)} differ, {better} better, {worse} worse; evidence lost "
        f"{lost:.1f}; simulations {cost:.2f}"
    )
    return f"{change:32s} {counted}; {detail}"


def _statement(said: Mapping[str, Any]) -> tuple[Any, ...]:
    return said["grade"], tuple(said["effects"]), said["family"]


def _words(said: Mapping[str, Any]) -> str:
    return (
        f"{said['grade']} {'+'.join(said['effects']) or said['family']} {said['probability']:.2f}"
    )


def _read(exam: Path, change: str, cases: Sequence[str]) -> dict[str, Any]:
    paths = {case: _answers(exam, change) / f"{case}.json" for case in cases}
    return {
        case: json.loads(path.read_text(encoding="utf-8"))
        for case, path in paths.items()
        if path.exists()
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("exam", type=Path)
    parser.add_argument("--cases", nargs="+", default=[], help="names of cases; all if not given")
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        help="NAME of a constant, NAME=VALUE, or STEP; all if not given",
    )
    parser.add_argument("--change", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    cases = asked.cases or sorted(path.name for path in (asked.exam / "campaigns").iterdir())
    if asked.change:
        answer(asked.exam, asked.change, cases)
    else:
        given = [one for one in asked.only if "=" in one]
        chosen = [
            one
            for one in changes()
            if not asked.only or one.removeprefix("-").partition("=")[0] in asked.only
        ]
        run_all(asked.exam, [*given, *chosen], cases)


if __name__ == "__main__":
    main()
