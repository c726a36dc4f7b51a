"""The simple pendulum (A01) of the IFToMM benchmark library, by this model's integrator.

Run: python -m tests.benchmarks.pendulum_a01

A point mass of 1 kg on a massless bar of 1 m starts at rest from the horizontal; g = 9.81 m/s^2.
The solution is an elliptic function. The library's first definition simulates 2,000 s and compares
4,000 places with a threshold of 1e-3: low precision is an error of 1e-1, high precision 1e-3. Later
users simulate 10 s. The error here is the rms over all times and both coordinates of the relative
error, where the coordinate counts as 1e-3 m at least.

Beside it stand the largest error of a coordinate and the largest change of energy.

References
----------
M. Gonzalez, F. Gonzalez, A. Luaces, J. Cuadrado, "A collaborative benchmarking framework for
multibody system dynamics", Engineering with Computers 26 (2010).
"""

import statistics
import time
from dataclasses import dataclass

import numpy as np
from scipy.special import ellipj, ellipk

from rfca_rig.model.chain import LONGEST_STEP_S, make_chain
from rfca_rig.model.kernel.integrator import FIRST_STEP_S
from rfca_rig.model.kernel.state import Chain
from rfca_rig.model.parameters import GRAVITY_M_S2
from tests.benchmarks.convergence import factored, free_motion
from tests.benchmarks.equal_error import describe_machine
from tests.model.legs import NO_GROUND_M, pendulum

LENGTH_M = 1.0
MASS_KG = 1.0
LEAST_COORDINATE_M = 1e-3
LOW_PRECISION = 1e-1
HIGH_PRECISION = 1e-3
TASKS = ((10.0, 1000), (2000.0, 4000))  # seconds, and times at which errors count
FACTORS = tuple(10.0**-k for k in range(8))  # of the usual tolerance
ROUNDS = 5


@dataclass(frozen=True)
class Accuracy:
    """The library's error, the largest error of x and y, and the largest change of energy."""

    error: float
    farthest_m: float
    energy_J: float


def make_pendulum() -> Chain:
    """One link whose mass is at its end."""
    chain = make_chain(pendulum(1, LENGTH_M, MASS_KG), NO_GROUND_M)
    return chain._replace(
        first_moment=np.array([MASS_KG * LENGTH_M]), moment=np.array([[MASS_KG * LENGTH_M**2]])
    )


def solve_exactly(t_s: np.ndarray) -> np.ndarray:
    """x and y (m, 2) of the mass, which starts at x = 1 m."""
    modulus = np.sin(0.25 * np.pi) ** 2  # half of the amplitude, 90 degrees
    eigenfrequency = np.sqrt(GRAVITY_M_S2 / LENGTH_M)
    sine, _, _, _ = ellipj(ellipk(modulus) - eigenfrequency * t_s, modulus)
    angle = 2.0 * np.arcsin(np.sqrt(modulus) * sine)
    return LENGTH_M * np.column_stack([np.sin(angle), -np.cos(angle)])


def swing(t_s: np.ndarray, factor: float) -> tuple[Accuracy, float]:
    """Accuracy at times (m,), and the mean step in s."""
    samples, step_s = free_motion(
        make_pendulum(), [0.0], t_s, factored(factor), FIRST_STEP_S, LONGEST_STEP_S
    )
    below = samples.q[:, 0]  # the angle from the horizontal
    place = LENGTH_M * np.column_stack([np.cos(below), -np.sin(below)])
    exact = solve_exactly(t_s)
    off = np.abs(place - exact)
    share = off / np.maximum(np.abs(exact), LEAST_COORDINATE_M)
    energy = (
        0.5 * MASS_KG * (LENGTH_M * samples.w[:, 0]) ** 2 + MASS_KG * GRAVITY_M_S2 * place[:, 1]
    )
    accuracy = Accuracy(
        float(np.sqrt(np.mean(share**2))), float(off.max()), float(np.abs(energy).max())
    )
    return accuracy, step_s


def time_swing_s(t_s: np.ndarray, factor: float) -> float:
    """Median processor time of some rounds, after a first one that may compile."""
    taken = []
    for _ in range(ROUNDS + 1):
        began = time.process_time()
        swing(t_s, factor)
        taken.append(time.process_time() - began)
    return statistics.median(taken[1:])


def main() -> None:
    """Prints a table for each task, up to the first setting of high precision."""
    print(describe_machine())
    for end_s, count in TASKS:
        t_s = np.linspace(end_s / count, end_s, count)
        print(
            f"\n| {end_s:,.0f} s, tolerance / usual | mean step | error | farthest | energy | CPU |"
        )
        print("|---|---|---|---|---|---|")
        for factor in FACTORS:
            accuracy, step_s = swing(t_s, factor)
            print(
                f"| {factor:.0e} | {1e3 * step_s:.2f} ms | {accuracy.error:.1e} "
                f"| {1e3 * accuracy.farthest_m:.1e} mm | {accuracy.energy_J:.1e} J "
                f"| {1e3 * time_swing_s(t_s, factor):,.1f} ms |"
            )
            if accuracy.error <= HIGH_PRECISION:
                break


if __name__ == "__main__":
    main()
