"""A small sweep, a clock that makes shards of it, and a process that is stopped in the midst of
it.
"""

import sys
import time
from pathlib import Path

from rfca_rig.clock import WallClock
from rfca_rig.executors.mapping import InProcessExecutor
from rfca_rig.sweep.carrying_out import run_sweep
from rfca_rig.sweep.plan import SweepPlan
from rfca_rig.sweep.sweep_file import plan_from_options
from tests.model.legs import PAPER

FILES = ("plan.json", "sweep.csv", "sweep.h5")


class Slow(WallClock):
    """Each look at it takes 0.2 s: cases seem so slow that a shard holds a few of them only."""

    def __init__(self) -> None:
        super().__init__()
        self._looks = 0

    def now_s(self) -> float:
        self._looks += 1
        return 0.2 * self._looks


def small_plan() -> SweepPlan:
    """12 cases, one of which has no valley, and two that cannot be computed at all."""
    vary = ["height_mm=215,235,400", "strip.thickness_mm=0.02,0.8", "speed_rad_s=2,3"]
    return plan_from_options(
        PAPER, vary, ["turn_deg=190"], "valley_fz_N,energy_J", None, "sobol", 0
    )


def content(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in FILES}


def dawdling(what: str, done: int, of: int) -> None:
    """Leaves time to be stopped."""
    del what, of
    if done >= 4:
        time.sleep(60.0)


if __name__ == "__main__":
    run_sweep(small_plan(), Path(sys.argv[1]), InProcessExecutor(), Slow, dawdling)
