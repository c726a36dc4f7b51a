"""One thing that goes wrong, and what is to become of the run."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from tests.runner_faults.rig import FaultyRig

Family = Literal["sensor", "drive", "bus", "computer", "operator"]
GOES_ON = "goes on"


@dataclass(frozen=True)
class Cause:
    """`begin` makes it so, at a moment of the run. `ends` is the code, or the name of the error,
    that ends the run.

    `in_hold` is for what shows only while the shaft is held, `at_arming` for what is there before
    anything moves; all else begins in the middle of the stroke. `by_press` are keys and signals,
    which may come on top of anything. The torque is gone `within_ms`. The stroke is done at
    `speed_rad_s`, the shaft held for `hold_s`.
    """

    name: str
    family: Family
    what: str
    ends: str
    begin: Callable[[FaultyRig], None]
    in_hold: bool = False
    by_press: bool = False
    at_arming: bool = False
    within_ms: float = 20.0
    speed_rad_s: float = 5.0
    hold_s: float = 0.1


def catalogued(name: str, family: Family, what: str, ends: str, within_ms: float = 20.0) -> Cause:
    """A fault that the twin server has, too, under the same name."""
    return Cause(name, family, what, ends, lambda rig: rig.event(name), within_ms=within_ms)
