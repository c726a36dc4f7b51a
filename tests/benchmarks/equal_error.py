"""Time over error of a stroke, for this model and other people's solvers on the same equations.

Run: python -m tests.benchmarks.equal_error --out DIR [--rounds 5]

The paper's four conditions on a floor without friction, so that all of them solve one ordinary
differential equation, with forces on one grid of 1 kHz. A solver runs through its tolerances or
steps. The error of a setting is the largest of the relative L2 error of the contact force and the
relative error of the valley of fz, over the four conditions. Its time is the mean over these of the
median of rounds, on one core, including what the solver needs to begin and to take samples.

The truth is this model at a tolerance 10,000 times tighter than usual. At their own finest settings
the others must agree with it, which is printed: otherwise all errors would mean nothing.

- SciPy's solvers call the compiled equations of this model from Python; the number of evaluations
  is counted too.
- MuJoCo has its own mechanics, with the ground as forces from outside, through Python.
- Exudyn has its own mechanics, springs and contact, without Python (`exudyn_leg`).

Writes equal-error.csv, from which the other two are made, equal-error.png, and prints the table of
docs/speed-at-equal-error.md. About ten minutes; nothing else may run.
"""

import argparse
import csv
import platform
import statistics
import time
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields
from functools import partial
from importlib.metadata import version
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure

from rfca_rig.analysis.mujoco_leg import stroke_in_mujoco
from rfca_rig.analysis.phases import find_valley
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.protocol.experiments import PlannedCondition
from rfca_rig.reports.style import FAINT, STYLE
from tests.benchmarks.convergence import factored
from tests.benchmarks.mujoco import CONDITIONS, times_s
from tests.model.scipy_stroke import ICE, solve_stroke

TABLE = Path(__file__).with_name("equal_error.csv")
THIS_MODEL = "this model"
TRUTH_FACTOR = 1e-4
# Errors for which the table states the time of the cheapest setting.
STATED_ERRORS = (1e-2, 1e-3, 1e-4)
PACKAGES = ("rfca-rig", "numba", "scipy", "mujoco", "exudyn")


@dataclass(frozen=True)
class Forces:
    """Contact force and fz (m,) on the grid of a condition; what was counted; seconds that count,
    where it is not the whole call.
    """

    normal_N: np.ndarray
    fz_N: np.ndarray
    count: int
    taken_s: float | None = None


@dataclass(frozen=True)
class Solver:
    """A way to compute a stroke at a setting, from coarse to fine.

    Parameters
    ----------
    setting
        What is set: a tolerance, or a step in s.
    counted
        What `Forces.count` counts.
    """

    name: str
    setting: str
    counted: str
    settings: tuple[float, ...]
    solve: Callable[[PlannedCondition, float], Forces]


@dataclass(frozen=True)
class Point:
    """A row of the table: a solver at a setting, over the four conditions."""

    solver: str
    setting: str
    value: float
    error: float
    time_ms: float
    count: int
    counted: str


def grid_s(condition: PlannedCondition) -> np.ndarray:
    """Sample times (m,) after the start; not the end of the ramp, where fz has two values."""
    t_s = times_s(condition)[1:]
    return t_s[t_s != ICE.drive.ramp_s]


def solve_here(condition: PlannedCondition, factor: float) -> Forces:
    """This model at its usual tolerance times a factor."""
    stroke = simulate_stroke_at_speed(
        ICE, condition.height_m, condition.speed_rad_s, grid_s(condition), factored(factor)
    )
    return Forces(stroke.normal_N.sum(axis=1), stroke.fz_N, stroke.steps + stroke.rejected_steps)


def solve_in_scipy(method: str, condition: PlannedCondition, rtol: float) -> Forces:
    """A solver of SciPy at a relative tolerance."""
    stroke = solve_stroke(
        ICE, condition.height_m, condition.speed_rad_s, grid_s(condition), rtol, method
    )
    return Forces(stroke.normal_N, stroke.fz_N, stroke.evaluations)


def solve_in_mujoco(integrator: str, condition: PlannedCondition, step_s: float) -> Forces:
    """MuJoCo with one of its integrators."""
    stroke = stroke_in_mujoco(
        ICE, condition.height_m, condition.speed_rad_s, grid_s(condition), step_s, integrator
    )
    return Forces(stroke.normal_N, stroke.fz_N, stroke.steps)


def solve_in_exudyn(condition: PlannedCondition, step_s: float) -> Forces:
    """Exudyn; building its model is not counted, although the others' times include theirs."""
    from tests.benchmarks.exudyn_leg import ExudynLeg

    t_s = grid_s(condition)
    leg = ExudynLeg(ICE, condition.height_m, condition.speed_rad_s)
    stroke = leg.simulate(float(t_s[-1]), step_s, 1e-3)
    normal_N = np.interp(t_s, stroke.t_s, stroke.normal_N)
    fz_N = np.interp(t_s, stroke.t_s, stroke.fz_N)
    return Forces(normal_N, fz_N, round(t_s[-1] / step_s), stroke.taken_s)


def list_solvers() -> list[Solver]:
    """All contestants; those whose package is missing are named and left out."""
    tolerances = tuple(10.0 ** (-k / 2.0) for k in range(-4, 8))
    rtols = tuple(10.0**-k for k in range(2, 9))
    steps_s = tuple(1e-3 / share for share in (1, 2, 4, 8, 16, 32, 64))
    longer_s = (1e-2, 5e-3, 2e-3)
    solvers = [Solver(THIS_MODEL, "tolerance / usual", "steps", tolerances, solve_here)]
    for method in ("LSODA", "Radau", "BDF", "DOP853"):
        solve = partial(solve_in_scipy, method)
        solvers.append(Solver(f"SciPy {method}", "relative tolerance", "evaluations", rtols, solve))
    for integrator in ("implicitfast", "RK4"):
        solve = partial(solve_in_mujoco, integrator)
        solvers.append(Solver(f"MuJoCo {integrator}", "step (s)", "steps", steps_s, solve))
    try:
        import exudyn  # noqa: F401
    except ImportError:
        print('Exudyn is not installed, and left out: pip install "rfca-rig[comparison]"')
    else:
        every_s = longer_s + steps_s[:5]
        solvers.append(Solver("Exudyn", "step (s)", "steps", every_s, solve_in_exudyn))
    return solvers


def measure_error(forces: Forces, true: Forces, t_s: np.ndarray) -> float:
    """The larger of both errors; inf where the stroke fell apart."""
    if not (np.isfinite(forces.normal_N).all() and np.isfinite(forces.fz_N).all()):
        return float("inf")
    difference = np.linalg.norm(forces.normal_N - true.normal_N)
    of_contact = float(difference / np.linalg.norm(true.normal_N))
    valley = getattr(find_valley(t_s, forces.fz_N), "fz_N", np.inf)
    of_valley = abs(valley / find_valley(t_s, true.fz_N).fz_N - 1.0)
    return max(of_contact, of_valley)


def measure(solver: Solver, value: float, truths: Sequence[Forces], rounds: int) -> Point:
    """Error and time of a setting over the four conditions."""
    errors = []
    times = []
    counts = []
    for condition, true in zip(CONDITIONS, truths, strict=True):
        taken = []
        for _ in range(rounds):
            began = time.perf_counter()
            try:
                forces = solver.solve(condition, value)
            except SimulationFailed:
                return Point(solver.name, solver.setting, value, np.inf, np.nan, 0, solver.counted)
            whole_s = time.perf_counter() - began
            taken.append(whole_s if forces.taken_s is None else forces.taken_s)
        errors.append(measure_error(forces, true, grid_s(condition)))
        times.append(1e3 * statistics.median(taken))
        counts.append(forces.count)
    return Point(
        solver.name,
        solver.setting,
        value,
        max(errors),
        statistics.mean(times),
        round(statistics.mean(counts)),
        solver.counted,
    )


def find_cheapest(points: Sequence[Point], error: float) -> Point | None:
    """The fastest setting with at most this error, of those from which on all finer settings keep
    it, too.
    """
    kept = []
    for point in reversed(points):
        if not point.error <= error:
            break
        kept.append(point)
    return min(kept, key=lambda point: point.time_ms, default=None)


def group(points: Sequence[Point]) -> dict[str, list[Point]]:
    """The settings of each solver, from coarse to fine."""
    groups: dict[str, list[Point]] = {}
    for point in points:
        groups.setdefault(point.solver, []).append(point)
    return groups


def format_table(points: Sequence[Point]) -> str:
    """The table of the document: milliseconds and counts at the stated errors."""
    heads = " | ".join(f"{100.0 * error:g} %" for error in STATED_ERRORS)
    lines = [f"| solver | {heads} | finest, error |", "|---" * (len(STATED_ERRORS) + 2) + "|"]
    for name, ladder in group(points).items():
        cells = [format_cell(find_cheapest(ladder, error)) for error in STATED_ERRORS]
        finest = f"{format_ms(ladder[-1].time_ms)}, {ladder[-1].error:.0e}"
        lines.append(f"| {name} | {' | '.join(cells)} | {finest} |")
    return "\n".join(lines)


def format_cell(point: Point | None) -> str:
    """Time and count of a setting."""
    if point is None:
        return "not reached"
    return f"{format_ms(point.time_ms)}, {point.count:,} {point.counted}"


def format_ms(time_ms: float) -> str:
    """A time with two digits at least."""
    return f"{time_ms:,.0f} ms" if time_ms >= 10.0 else f"{time_ms:.1f} ms"


def write_points(points: Sequence[Point], path: Path) -> None:
    """All settings as a table, behind lines that state hardware and versions."""
    with path.open("w", newline="", encoding="utf-8") as file:
        file.write(f"# {describe_machine()}\n")
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(field.name for field in fields(Point))
        for point in points:
            rows.writerow(format_number(cell) for cell in astuple(point))


def format_number(cell: str | float) -> str | float:
    """A cell of the table: four digits of a measured value, anything else as it is."""
    return f"{cell:.4g}" if isinstance(cell, float) else cell


def read_points(path: Path) -> list[Point]:
    """What `write_points` wrote."""
    lines = path.read_text(encoding="utf-8").splitlines()
    rows = csv.DictReader(line for line in lines if not line.startswith("#"))
    types = [field.type for field in fields(Point)]
    points = []
    for row in rows:
        cells = zip(types, row.values(), strict=True)
        points.append(Point(*(convert(cell) for convert, cell in cells)))
    return points


def describe_machine() -> str:
    """Processor, Python and packages in a line."""
    cpu = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        names = [line for line in cpuinfo.read_text().splitlines() if line.startswith("model name")]
        if names:
            cpu = names[0].partition(": ")[2]
    packages = []
    for package in PACKAGES:
        try:
            packages.append(f"{package} {version(package)}")
        except ModuleNotFoundError:
            packages.append(f"without {package}")
    return f"{cpu}; Python {platform.python_version()}; {', '.join(packages)}"


def draw(points: Sequence[Point], path: Path) -> None:
    """Time over error, a line for each solver."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(STYLE)
        figure = Figure(figsize=(7.6, 4.4), layout="constrained")
        axes = figure.subplots()
        for number, (name, ladder) in enumerate(group(points).items()):
            shown = [point for point in ladder if point.error < 1.0]
            is_ours = name == THIS_MODEL
            axes.loglog(
                [point.error for point in shown],
                [point.time_ms for point in shown],
                "o-" if is_ours else "s--",
                color="black" if is_ours else f"C{number}",
                lw=1.8 if is_ours else 1.0,
                ms=4.0 if is_ours else 3.0,
                label=name,
            )
        axes.axvline(0.01, color=FAINT, lw=0.8, zorder=0)
        axes.invert_xaxis()
        axes.set_xlabel("error of contact force and valley (the vertical line is 1 %)")
        axes.set_ylabel("time of a stroke (ms)")
        figure.legend(loc="outside right upper", frameon=False, fontsize=8.5)
        figure.savefig(path, dpi=150, metadata={"Software": None})


def main() -> None:
    """Measures, writes, draws and prints."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for table and picture")
    parser.add_argument("--rounds", type=int, default=5, help="of which the median counts")
    parser.add_argument("--drawn", type=Path, help="draw and print this table, measure nothing")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    if asked.drawn:
        points = read_points(asked.drawn)
    else:
        solvers = list_solvers()
        truths = [solve_here(condition, TRUTH_FACTOR) for condition in CONDITIONS]
        points = []
        for solver in solvers:
            for value in solver.settings:
                points.append(measure(solver, value, truths, asked.rounds))
                print(points[-1], flush=True)
        write_points(points, asked.out / TABLE.name)
    draw(points, asked.out / "equal-error.png")
    print(format_table(points))


if __name__ == "__main__":
    main()
