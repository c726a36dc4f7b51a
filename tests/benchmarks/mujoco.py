"""Accuracy and speed beside MuJoCo and LSODA: python -m tests.benchmarks.mujoco [--short]

Peaks are the touchdown's spike of contact force, the valley of fz and the whip of fz after
lift-off, on the same 1 kHz grid for all. A step length passes when each is within 1 % of what the
same code gives at its finest step. Times are medians of rounds in which the contestants take turns;
MuJoCo with its own contact is timed stepping alone, without taking samples, in two calls a stroke.
"""

import argparse
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from rfca_rig.analysis.crosscheck import (
    TIGHT_TOLERANCE,
    CheckedCondition,
    check_own_contact,
    difference_pct,
)
from rfca_rig.analysis.mujoco_leg import (
    FLYWHEEL_KG_M2,
    MujocoStroke,
    leg_on_springs,
    settle_at_rest,
    stroke_in_mujoco,
    stroke_on_springs,
)
from rfca_rig.analysis.phases import find_valley
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.protocol.experiments import PlannedCondition
from tests.benchmarks.convergence import factored
from tests.model.legs import PAPER
from tests.model.scipy_stroke import ICE, solve_stroke

CONDITIONS = (
    PlannedCondition(0.215, 2.433),
    PlannedCondition(0.215, 3.249),
    PlannedCondition(0.235, 2.478),
    PlannedCondition(0.235, 3.276),
)
SHARES_OF_1_MS = (1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 25, 32, 40, 50, 64, 80, 100)
SPRING_N_PER_M = 9.2e3  # Hertz's force over indentation at the valley of the nominal ground
FINEST_S = 5e-6


@dataclass(frozen=True)
class Contestant:
    """A way to compute the stroke at a step length, and the bare work that is timed."""

    name: str
    stroke: Callable[[PlannedCondition, float], MujocoStroke]
    work: Callable[[PlannedCondition, float], object]


def times_s(condition: PlannedCondition) -> np.ndarray:
    return np.arange(int(1e3 * (np.radians(200.0) / condition.speed_rad_s + 0.025)) + 1) * 1e-3


def peaks(t_s: np.ndarray, contact_N: np.ndarray, fz_N: np.ndarray) -> np.ndarray:
    """Spike, valley, whip; NaN where the stroke fell apart."""
    if not np.isfinite(fz_N).all() or not contact_N.any():
        return np.full(3, np.nan)
    touch_s = t_s[contact_N > 0.0][0]
    valley = find_valley(t_s, fz_N)
    spike = contact_N[(t_s >= touch_s) & (t_s < touch_s + 0.030)].max()
    return np.array([spike, getattr(valley, "fz_N", np.nan), fz_N[t_s > touch_s].max()])


def ours(condition: PlannedCondition, tolerance=None):
    return simulate_stroke_at_speed(
        PAPER, condition.height_m, condition.speed_rad_s, times_s(condition), tolerance
    )


def outer_forces(integrator: str) -> Contestant:
    def stroke(condition: PlannedCondition, step_s: float) -> MujocoStroke:
        return stroke_in_mujoco(
            PAPER, condition.height_m, condition.speed_rad_s, times_s(condition), step_s, integrator
        )

    return Contestant(f"MuJoCo {integrator}, believed ground through callback", stroke, stroke)


def own_springs() -> Contestant:
    def stroke(condition: PlannedCondition, step_s: float) -> MujocoStroke:
        return stroke_on_springs(
            PAPER,
            condition.height_m,
            condition.speed_rad_s,
            times_s(condition),
            SPRING_N_PER_M,
            step_s,
        )

    def prepare_and_step(condition: PlannedCondition, step_s: float) -> None:
        leg = leg_on_springs(PAPER, condition.height_m, SPRING_N_PER_M)
        settle_at_rest(leg, PAPER.leg.start_angle_rad)
        began = time.perf_counter()
        leg.model.opt.timestep = step_s
        for until_s, torque in (
            (PAPER.drive.ramp_s, FLYWHEEL_KG_M2 * condition.speed_rad_s / PAPER.drive.ramp_s),
            (times_s(condition)[-1], 0),
        ):
            leg.data.qfrc_applied[0] = torque
            leg.mujoco.mj_step(leg.model, leg.data, round((until_s - leg.data.time) / step_s))
        return time.perf_counter() - began

    return Contestant(
        "MuJoCo implicitfast, own contact as springs, C alone", stroke, prepare_and_step
    )


def coarsest_step_s(contestant: Contestant, truth: Sequence[np.ndarray], which: slice) -> float:
    """The longest step at which the peaks `which` are right to 1 % under all four conditions,
    and stay so at the next finer one.
    """
    passing: list[float] = []
    for share in SHARES_OF_1_MS:
        step_s = 1e-3 / share
        right = all(
            _within_1_pct(contestant, one, step_s, true, which)
            for one, true in zip(CONDITIONS, truth, strict=True)
        )
        passing = [*passing, step_s] if right else []
        if len(passing) == 2:
            return passing[0]
    raise SystemExit(
        f"{contestant.name}: no step down to {1e3 / SHARES_OF_1_MS[-1]:g} us gets every "
        "peak within 1 %"
    )


def _peaks_of(stroke: MujocoStroke) -> np.ndarray:
    return peaks(stroke.t_s, stroke.normal_N, stroke.fz_N)


def _within_1_pct(
    contestant: Contestant,
    condition: PlannedCondition,
    step_s: float,
    true: np.ndarray,
    which: slice,
) -> bool:
    try:
        return bool(
            (
                np.abs(_peaks_of(contestant.stroke(condition, step_s)) / true - 1.0)[which] < 0.01
            ).all()
        )
    except SimulationFailed:
        return False


def taking_turns_s(works: Sequence[Callable[[], object]], rounds: int) -> list[float]:
    """Median seconds of each, one after the other within a round. A work that returns seconds
    has timed itself.
    """
    taken: list[list[float]] = [[] for _ in works]
    for _ in range(rounds + 1):
        for work, times in zip(works, taken, strict=True):
            began = time.perf_counter()
            told = work()
            times.append(told if isinstance(told, float) else time.perf_counter() - began)
    return [statistics.median(times[1:]) for times in taken]


def agreement() -> None:
    print(
        "contact force, difference from MuJoCo in percent: whole stroke, loading; at the "
        "default and at a tight tolerance"
    )
    for one in CONDITIONS:
        theirs = stroke_in_mujoco(PAPER, one.height_m, one.speed_rad_s, times_s(one))
        plain, tight = (
            CheckedCondition(one, ours(one, tolerance), theirs)
            for tolerance in (None, TIGHT_TOLERANCE)
        )
        halved = stroke_in_mujoco(PAPER, one.height_m, one.speed_rad_s, times_s(one), 1e-5)
        stiff = check_own_contact(PAPER, one, 200.0)
        print(
            f"  {plain.label:<22} {plain.stroke_pct:8.4f} {plain.loading_pct:8.4f}   "
            f"{tight.stroke_pct:8.5f} {tight.loading_pct:8.5f}"
            f"   MuJoCo at half the step {difference_pct(theirs.normal_N, halved.normal_N):8.5f}"
            f"   own contact, stiff ground {stiff.stroke_pct:6.3f} {stiff.loading_pct:6.3f}"
        )


def beside_lsoda(rounds: int) -> None:
    print(
        "on ice, fz against scipy's LSODA at 1e-9, on the same right-hand side, in "
        "percent; at the default and at a tight tolerance"
    )
    for one in CONDITIONS:
        t_s = times_s(one)[1:]
        t_s = t_s[t_s != ICE.drive.ramp_s]  # where the ramp ends, the force has two values
        other = solve_stroke(ICE, one.height_m, one.speed_rad_s, t_s, 1e-9).fz_N
        plain, tight = (
            simulate_stroke_at_speed(ICE, one.height_m, one.speed_rad_s, t_s, tolerance).fz_N
            for tolerance in (None, TIGHT_TOLERANCE)
        )
        label = f"{1e3 * one.height_m:g} mm, {one.speed_rad_s:g} rad/s"
        print(
            f"  {label:<22} {difference_pct(plain, other):8.4f}   "
            f"{difference_pct(tight, other):8.5f}"
        )
    one = CONDITIONS[0]
    mine, slow = taking_turns_s(
        [
            lambda: simulate_stroke_at_speed(ICE, one.height_m, one.speed_rad_s, times_s(one)[1:]),
            lambda: solve_stroke(ICE, one.height_m, one.speed_rad_s, times_s(one)[1:], 1e-5),
        ],
        rounds,
    )
    print(
        f"  {1e3 * mine:.2f} ms against {1e3 * slow:.0f} ms of LSODA at 1e-5: "
        f"{slow / mine:.0f} times as fast"
    )


def speed(rounds: int) -> None:
    worst = max(
        np.abs(_our_peaks(one, None) / _our_peaks(one, TIGHT_TOLERANCE) - 1.0).max()
        for one in CONDITIONS
    )
    print(
        "time of one stroke, one core, mean of the four conditions; this model's worst "
        f"peak is off by {100 * worst:.2f} %"
    )
    contestants = [own_springs(), outer_forces("implicitfast"), outer_forces("RK4")]
    truths = [
        [_peaks_of(one.stroke(condition, FINEST_S)) for condition in CONDITIONS]
        for one in contestants
    ]
    for which, said in (
        (slice(None), "all three peaks within 1 %"),
        (slice(1, 2), "the valley alone within 1 %"),
    ):
        steps_s = [
            coarsest_step_s(one, truth, which)
            for one, truth in zip(contestants, truths, strict=True)
        ]
        factor = loosest_factor(which)
        mine, loosest, *others = _mean_times_s(contestants, steps_s, factored(factor), rounds)
        print(
            f"{said}; this model at its default tolerance {1e3 * mine:.2f} ms, {factor} "
            f"times looser passes too, {1e3 * loosest:.2f} ms"
        )
        for one, step_s, taken in zip(contestants, steps_s, others, strict=True):
            print(
                f"  {one.name:<54} {1e6 * step_s:6.1f} us {1e3 * taken:9.2f} ms   "
                f"{taken / mine:7.1f} times as long"
            )


def _mean_times_s(
    contestants: Sequence[Contestant], steps_s: Sequence[float], loose: Tolerance, rounds: int
) -> np.ndarray:
    """Ours first, at the default tolerance and at `loose`."""
    totals = np.zeros(2 + len(contestants))
    for condition in CONDITIONS:
        works = [lambda c=condition: ours(c), lambda c=condition: ours(c, loose)]
        works += [
            lambda c=condition, k=k, s=s: k.work(c, s)
            for k, s in zip(contestants, steps_s, strict=True)
        ]
        totals += taking_turns_s(works, rounds)
    return totals / len(CONDITIONS)


def loosest_factor(which: slice) -> int:
    """How many times its default tolerance this model may have until the peaks `which` are off
    by 1 %.
    """
    truth = [_our_peaks(one, TIGHT_TOLERANCE) for one in CONDITIONS]
    passing = 1
    for factor in (1, 2, 3, 5, 10, 20, 30, 50, 100):
        if any(
            (np.abs(_our_peaks(one, factored(factor)) / true - 1.0)[which] >= 0.01).any()
            for one, true in zip(CONDITIONS, truth, strict=True)
        ):
            break
        passing = factor
    return passing


def _our_peaks(condition: PlannedCondition, tolerance) -> np.ndarray:
    stroke = ours(condition, tolerance)
    return peaks(stroke.t_s, stroke.normal_N.sum(axis=1), stroke.fz_N)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="fewer rounds")
    rounds = 3 if parser.parse_args().short else 9
    agreement()
    beside_lsoda(rounds)
    speed(rounds)


if __name__ == "__main__":
    main()
