"""How fast the integrator converges and what it loses of the energy.

Run: python -m tests.benchmarks.convergence --out DIR

Writes convergence.csv with all numbers, and convergence.svg and .png, into DIR. About fifteen
seconds.
"""

import argparse
import csv
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

from rfca_rig.analysis.phases import Valley, find_valley
from rfca_rig.model.chain import LONGEST_STEP_S, Tolerance, allocate_samples, make_chain
from rfca_rig.model.kernel.integrator import DONE, FIRST_STEP_S, integrate
from rfca_rig.model.kernel.stage import allocate_workspace
from rfca_rig.model.kernel.state import NO_LAWS, Chain, Samples
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.reports.style import FAINT, MEASURED, STYLE
from tests.model.legs import NO_GROUND_M, PAPER, pendulum
from tests.model.test_equations_of_motion import energy_J, free_shaft, released, vector_mechanics

SWING_S = 0.2
SWING_FROM = np.linspace(0.0, 0.9, 7)
HELD_S = tuple(1e-3 / 2**k for k in range(7))
# a held step h has this times h^3 for tolerance: binds while the release rings only, yet keeps
# Newton going
SPEED_TOLERANCE_PER_S3 = 2e10
FACTORS = tuple(10.0 ** (-k / 2) for k in range(-3, 9))
VALLEY_FACTORS = tuple(10.0 ** (-k / 2) for k in range(-3, 5))
VALLEY_AT = (0.215, 2.433)
REFERENCE_FACTOR = 1e-4
CHAIN = pendulum(3, 0.2, 0.1, k0=2.0)
CHAIN_FROM = (0.3, 0.6, 1.0)
CHAIN_S = 2.0


@dataclass(frozen=True)
class Curve:
    """Errors over what was turned down to get them: step lengths in s, or tolerances as a factor
    of the default one.
    """

    name: str
    short: str
    unit: str
    over: str
    x: tuple[float, ...]
    error: tuple[float, ...]

    @property
    def order(self) -> float:
        """Slope in the double logarithm, of the lower half of the points."""
        half = len(self.x) // 2
        return float(np.polyfit(np.log(self.x[half:]), np.log(self.error[half:]), 1)[0])


def factored(factor: float) -> Tolerance:
    """The usual tolerance times a factor."""
    return Tolerance(factor * Tolerance().angle_rad, factor * Tolerance().speed_rad_s)


def free_motion(
    chain: Chain,
    start: Sequence[float],
    t_s: np.ndarray,
    tolerance: Tolerance,
    first_s: float,
    longest_s: float,
) -> tuple[Samples, float]:
    """Samples of a chain let go, and the mean step."""
    samples = allocate_samples(t_s, len(start))
    bounds = np.array([tolerance.angle_rad, tolerance.speed_rad_s])
    end_s = float(t_s[-1])
    work = allocate_workspace(len(start), len(start))
    status, _, accepted, _ = integrate(
        chain,
        NO_LAWS,
        free_shaft(),
        released(start),
        0.0,
        end_s,
        first_s,
        longest_s,
        10**9,
        bounds,
        work,
        samples,
    )
    if status != DONE:
        raise SystemExit(f"the free chain stopped after {accepted} steps")
    return samples, end_s / accepted


def swing_curves() -> list[Curve]:
    """The paper's leg let go bent, without ground, against DOP853 on equations of its own:
    angles at the end.
    """
    chain = make_chain(PAPER, NO_GROUND_M)
    end = np.array([SWING_S])
    start = np.concatenate([SWING_FROM, np.zeros(7)])
    true = solve_ivp(
        vector_mechanics(PAPER), (0.0, SWING_S), start, "DOP853", rtol=1e-12, atol=1e-13
    ).y[:7, -1]

    def error(tolerance: Tolerance, first_s: float, longest_s: float) -> tuple[float, float]:
        samples, mean_s = free_motion(chain, SWING_FROM, end, tolerance, first_s, longest_s)
        return mean_s, float(np.abs(samples.q[-1] - true).max())

    held_s, held = zip(
        *(error(Tolerance(1e9, SPEED_TOLERANCE_PER_S3 * h**3), h, h) for h in HELD_S), strict=True
    )
    mean_s, by_factor = zip(
        *(error(factored(f), FIRST_STEP_S, LONGEST_STEP_S) for f in FACTORS), strict=True
    )
    return [
        Curve(
            "free swing, held step", "held step", "error of angle (rad)", "step (s)", held_s, held
        ),
        Curve(
            "free swing, chosen step",
            "chosen step",
            "error of angle (rad)",
            "step (s)",
            mean_s,
            by_factor,
        ),
        Curve(
            "free swing",
            "chosen step",
            "error of angle (rad)",
            "tolerance / default",
            FACTORS,
            by_factor,
        ),
    ]


def valley_curves() -> list[Curve]:
    """The valley of a stroke against that of a far tighter run, relative."""
    t_s = np.arange(1, 1401) * 1e-3

    def valley(factor: float) -> Valley:
        found = find_valley(
            t_s, simulate_stroke_at_speed(PAPER, *VALLEY_AT, t_s, factored(factor)).fz_N
        )
        if not isinstance(found, Valley):
            raise SystemExit(f"no valley at {factor:g} of the default tolerance: {found.reason}")
        return found

    true = valley(REFERENCE_FACTOR)
    found = [valley(f) for f in VALLEY_FACTORS]
    force = tuple(abs(v.fz_N / true.fz_N - 1.0) for v in found)
    time = tuple(abs(v.time_s / true.time_s - 1.0) for v in found)
    return [
        Curve(
            "valley of a stroke, force",
            "force",
            "relative error",
            "tolerance / default",
            VALLEY_FACTORS,
            force,
        ),
        Curve(
            "valley of a stroke, time",
            "time",
            "relative error",
            "tolerance / default",
            VALLEY_FACTORS,
            time,
        ),
    ]


def energy_curve() -> Curve:
    """Three links on springs, let go, no damping: change of energy within two seconds over the
    most that weight gave.
    """
    chain = make_chain(CHAIN, NO_GROUND_M)
    t_s = np.linspace(0.01, CHAIN_S, 200)
    lost = []
    for factor in FACTORS:
        samples, _ = free_motion(
            chain, CHAIN_FROM, t_s, factored(factor), FIRST_STEP_S, LONGEST_STEP_S
        )
        energy = np.array(
            [energy_J(chain, q, w) for q, w in zip(samples.q, samples.w, strict=True)]
        )
        lost.append(
            abs(energy[-1] - energy[0]) / np.ptp(-9.81 * np.sin(samples.q) @ chain.first_moment)
        )
    return Curve(
        "energy of a free chain",
        "three links, 2 s",
        "relative change",
        "tolerance / default",
        FACTORS,
        tuple(lost),
    )


def draw(curves: Sequence[Curve], out: Path) -> None:
    """The swing over its step, then swing, valley and energy over the tolerance; the upright
    line is the default.
    """
    swing = curves[:2]
    swing_tolerance = curves[2:3]
    valley = curves[3:5]
    energy = curves[5:]
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update({**STYLE, "svg.hashsalt": "convergence", "svg.fonttype": "none"})
        figure = Figure(figsize=(13.2, 3.2), layout="constrained")
        panels = figure.subplots(1, 4)
        titles = (
            "free swing over step",
            "free swing over tolerance",
            "valley over tolerance",
            "energy over tolerance",
        )
        for axes, group, title in zip(
            panels, (swing, swing_tolerance, valley, energy), titles, strict=True
        ):
            _panel(axes, group, title)
        figure.savefig(out / "convergence.svg", metadata={"Date": None})
        figure.savefig(out / "convergence.png", dpi=150)


def _panel(axes: Axes, group: Sequence[Curve], title: str) -> None:
    for curve, line in zip(group, ("o-", "s--"), strict=False):
        axes.loglog(
            curve.x,
            curve.error,
            line,
            color=MEASURED,
            ms=3.5,
            lw=1.0,
            label=f"{curve.short}, slope {curve.order:.2f}",
        )
    x = np.array(group[0].x)
    if group[0].over == "step (s)":
        axes.loglog(x, group[0].error[-1] * (x / x[-1]) ** 3, color=FAINT, lw=0.8, label="order 3")
    else:
        axes.axvline(1.0, color=FAINT, lw=0.8, zorder=0)
    low, high = axes.get_ylim()
    axes.set_ylim(low, high * (high / low) ** 0.3)  # room for the legend
    axes.set_title(title, fontsize=9.2)
    axes.set_xlabel(group[0].over)
    axes.set_ylabel(group[0].unit)
    axes.legend(frameon=False, fontsize=8.2, loc="upper left")


def write(curves: Sequence[Curve], out: Path) -> None:
    with (out / "convergence.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(("curve", "over", "x", "error", "unit"))
        for curve in curves:
            rows.writerows(
                (curve.name, curve.over, f"{x:.6g}", f"{e:.4g}", curve.unit)
                for x, e in zip(curve.x, curve.error, strict=True)
            )


def all_curves(
    parts: Sequence[Callable[[], list[Curve]]] = (
        swing_curves,
        valley_curves,
        lambda: [energy_curve()],
    ),
) -> list[Curve]:
    return [curve for part in parts for curve in part()]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for table and pictures")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    curves = all_curves()
    for curve in curves:
        if "tol" in curve.over:
            at_default = (
                f", {np.interp(0.0, np.log(curve.x[::-1]), curve.error[::-1]):.1e} at the default"
            )
        else:
            at_default = ""
        print(
            f"{curve.name:26} {curve.unit:20} slope {curve.order:5.2f} over "
            f"{curve.over}{at_default}"
        )
    write(curves, out)
    draw(curves, out)


if __name__ == "__main__":
    main()
