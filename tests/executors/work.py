"""Work that processes can be handed: a simulated stroke, pieces that are slow, and such as end
their process.
"""

import hashlib
import os
import signal
import time
from pathlib import Path

import numpy as np

from rfca_rig.executors.cores import cores
from rfca_rig.executors.environment import collect_facts
from rfca_rig.model.stroke import simulate_stroke_at_speed
from tests.model.legs import PAPER

T_S = np.arange(1, 301) * 1e-3


def stroke(seed: int) -> bytes:
    """Every bit of a stroke whose speed and noise follow from the seed, and of some linear
    algebra on it.
    """
    random = np.random.default_rng(seed)
    fz_N = simulate_stroke_at_speed(
        PAPER, 0.215, random.uniform(2.0, 3.0), T_S
    ).fz_N + random.normal(size=len(T_S))
    table = fz_N.reshape(30, 10)
    return fz_N.tobytes() + np.linalg.solve(table.T @ table, table.T[:, 0]).tobytes()


def digest(results: dict[int, bytes]) -> str:
    return hashlib.sha256(b"".join(results[seed] for seed in sorted(results))).hexdigest()


def fails_at_three(number: int) -> int:
    if number == 3:
        raise ZeroDivisionError("three")
    return 10 * number


def kills_at_three(number: int) -> int:
    """The fourth piece ends its process, whoever does it."""
    if number == 3:
        os.kill(os.getpid(), signal.SIGKILL)
    return 10 * number


def slow(job: tuple[Path, int]) -> int:
    """Tells in a file of its own, a line each time, that it was begun, and by which process."""
    folder, number = job
    with (folder / f"{number}").open("a") as begun:
        begun.write(f"{os.getpid()}\n")
    time.sleep(0.5)
    return 10 * number


def waits_to_be_killed_at_two(job: tuple[Path, int]) -> int:
    """The third piece waits for the end of its process, but only the first time."""
    folder, number = job
    if number == 2 and not (folder / "2").exists():
        with (folder / "2").open("a") as begun:
            begun.write(f"{os.getpid()}\n")
        time.sleep(60.0)
        raise AssertionError("it was not killed")
    return slow(job)


def returns_what_cannot_travel(number: int) -> object:
    return (lambda: number) if number == 3 else number


def threads(number: int) -> tuple[int, str | None]:
    return cores(), os.environ.get("OPENBLAS_NUM_THREADS")


def facts() -> dict[str, str]:
    """Without the source, which somebody may be editing."""
    return {name: told for name, told in collect_facts().items() if name != "source"}
