"""Speed of the parts that people wait for, as ratios within one run.

Run: python -m tests.benchmarks [--short] [--check | --record NAME]

Absolute times depend on the machine and are printed for orientation only. `history.csv` holds the
ratios of earlier versions, one row each: `--record` appends one. `--check` ends with exit code 1
where a ratio is worse than in each of the last rows by more than WORSE, in two measurements, one
right after the other. The rows show how far a ratio scatters on a shared machine: by half and more.
"""

import argparse
import csv
import gc
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from rfca_rig.campaign.opening import open_recordings
from rfca_rig.engine.run import run_plan
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.reports.strokes.page import write_report
from tests.engine.rigs import nothing, one_condition, recorder_on, twin_rig
from tests.model.legs import PAPER
from tests.model.scipy_stroke import ICE, solve_stroke

SMALL = Path(__file__).parents[1] / "data" / "small-campaign"
HISTORY = Path(__file__).with_name("history.csv")
# share of a ratio; rows of the history that count
WORSE = 0.15
LAST_ROWS = 5
FULL_ROUNDS = 11
STROKES = 20  # in one timed piece, so that it takes about as long as what it is compared with
T = np.arange(1, 1401) * 1e-3


def median_s(work: Callable[[], object], rounds: int) -> float:
    """Median wall time of `work`, after one round that does not count."""
    work()
    return statistics.median(_time_s(work) for _ in range(rounds))


def _time_s(work: Callable[[], object]) -> float:
    """Wall time of `work` without the garbage collector, as timeit measures.

    A full collection takes 0.1 s here, because it walks over everything that was ever imported, and
    falls into every third report of 0.34 s: whether the median of three has it is chance.
    """
    gc.collect()
    gc.disable()
    try:
        begin = time.perf_counter()
        work()
        return time.perf_counter() - begin
    finally:
        gc.enable()


def compare_s(
    work: Callable[[], object], reference: Callable[[], object], rounds: int
) -> tuple[float, float]:
    """Median wall time of `work`, and the median of its ratios to `reference`, which is timed right
    before and after each time.

    The speed of a shared machine changes by half within seconds: only neighbours in time can be
    compared.
    """
    work()
    reference()
    times = []
    ratios = []
    before = _time_s(reference)
    for _ in range(rounds):
        times.append(_time_s(work))
        after = _time_s(reference)
        ratios.append(times[-1] / (0.5 * (before + after)))
        before = after
    return statistics.median(times), statistics.median(ratios)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="fewer rounds")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--check", action="store_true", help="compare with the history")
    what.add_argument(
        "--record",
        metavar="NAME",
        help="append the ratios to the history, for example under a version",
    )
    asked = parser.parse_args()
    rounds = 3 if asked.short else FULL_ROUNDS
    ratios = measure(rounds)
    if asked.record:
        with HISTORY.open("a", encoding="utf-8", newline="") as file:
            csv.writer(file).writerow(
                [asked.record, *(f"{value:.4g}" for value in ratios.values())]
            )
    if asked.check:
        history = read_history()
        slower = find_slower(history, ratios)
        if slower:
            print(
                f"{', '.join(slower)}: more than {WORSE:.0%} worse than before; measured once more"
            )
            slower = sorted(set(slower) & set(find_slower(history, measure(FULL_ROUNDS))))
        for name in slower:
            print(
                f"{name}: more than {WORSE:.0%} worse than the history twice in a row; "
                "find the change, or state it with --record"
            )
        sys.exit(bool(slower))


def read_history() -> list[dict[str, float]]:
    """The ratios of earlier versions, oldest first."""
    history = []
    with HISTORY.open(encoding="utf-8", newline="") as file:
        for row in csv.DictReader(file):
            ratios = {name: float(value) for name, value in row.items() if name != "version"}
            history.append(ratios)
    return history


def find_slower(history: Sequence[Mapping[str, float]], ratios: Mapping[str, float]) -> list[str]:
    """Names of the ratios that are worse than in each of the last rows by more than WORSE;
    larger is worse.
    """
    worst = {
        name: max((row[name] for row in history[-LAST_ROWS:]), default=np.inf) for name in ratios
    }
    return sorted(name for name, value in ratios.items() if value > (1.0 + WORSE) * worst[name])


def measure(rounds: int) -> dict[str, float]:
    """The ratios, printed with the times that they come from; larger is worse."""

    def strokes(rig: RigModel = PAPER) -> None:
        for _ in range(STROKES):
            simulate_stroke_at_speed(rig, 0.215, 2.433, T)

    recordings = open_recordings([SMALL])
    with tempfile.TemporaryDirectory() as folder:
        report_s, report_ratio = compare_s(
            lambda: write_report(recordings, Path(folder)), strokes, rounds
        )
    run_s, run_ratio = compare_s(run_on_twin, strokes, rounds)
    ice_s, ice_ratio = compare_s(
        lambda: strokes(ICE), lambda: solve_stroke(ICE, 0.215, 2.433, T, 1e-5), 3 * rounds
    )
    stroke_s = median_s(strokes, 5 * rounds) / STROKES
    rig_s = run_on_twin()
    ratios = {
        "stroke_per_lsoda": ice_ratio / STROKES,
        "run_in_strokes": run_ratio * STROKES,
        "report_in_strokes": report_ratio * STROKES,
    }
    print(
        f"one simulated stroke, 1.4 s of motion      {1e3 * stroke_s:8.2f} ms   "
        f"{1.4 / stroke_s:8.0f} x real time"
    )
    print(
        f"the same without friction                  {1e3 * ice_s / STROKES:8.2f} ms   "
        f"{STROKES / ice_ratio:8.1f} times as fast as LSODA"
    )
    print(
        f"a run on the twin, {rig_s:.1f} s of rig time       {run_s:8.2f} s    "
        f"{ratios['run_in_strokes']:8.0f} strokes' worth"
    )
    print(
        f"a report over 4 recordings                 {report_s:8.2f} s    "
        f"{ratios['report_in_strokes']:8.0f} strokes' worth"
    )
    return ratios


def run_on_twin() -> float:
    """One stroke on the twin, recorded by a process of its own; returns the rig's time."""
    rig = twin_rig()
    with (
        tempfile.TemporaryDirectory() as folder,
        recorder_on(rig, Path(folder) / "run") as (bench, recorder, _),
    ):
        run_plan(one_condition(rig), bench, recorder, nothing)
        return bench.clock.now_s()


if __name__ == "__main__":
    main()
