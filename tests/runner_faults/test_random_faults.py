"""Whatever comes together, whenever: no run ends with motion, with a lost acknowledged stage, or
with an error nobody can read.
"""

import tempfile
from dataclasses import dataclass
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from tests.runner_faults.causes import CAUSES
from tests.runner_faults.outcome import WATCHDOG_S, begin_now, run_to_its_end
from tests.runner_faults.rig import CHEAP, faulty_rig

RUN_S = 2.6  # of the plan's undisturbed run, from enabling to the end
MEMORY = Path("/dev/shm")
FAULTS = sorted(
    name for name, cause in CAUSES.items() if not cause.by_press and not cause.at_arming
)
PRESSES = sorted(name for name, cause in CAUSES.items() if cause.by_press)


@dataclass(frozen=True)
class Mishap:
    """A cause by its name, and when in the run it begins."""

    name: str
    at_s: float


def mishaps(names: list[str], most: int) -> st.SearchStrategy[list[Mishap]]:
    moment = st.floats(0.0, RUN_S).map(lambda t_s: round(t_s, 3))
    return st.lists(st.builds(Mishap, st.sampled_from(names), moment), max_size=most)


COMBINATIONS = st.tuples(mishaps(FAULTS, 3), mishaps(PRESSES, 2)).map(
    lambda both: [*both[0], *both[1]]
)


def holds(together: list[Mishap]) -> None:
    """The motor may outlive a run only by the drive's watchdog, and only where nobody could tell
    it.
    """
    with (
        tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as folder,
        faulty_rig(Path(folder) / "run", CHEAP) as rig,
    ):
        for mishap in together:
            rig.agenda.at(mishap.at_s, lambda cause=CAUSES[mishap.name]: begin_now(rig, cause))
        outcome = run_to_its_end(rig, rig.recorder)
    assert outcome.not_disabled or outcome.obeyed_s <= WATCHDOG_S, outcome
    assert outcome.energised_s <= WATCHDOG_S, outcome
    assert outcome.motion_frames == 0, outcome
    assert outcome.lost == 0, outcome


@pytest.mark.slow
@pytest.mark.timeout(1200)
@settings(max_examples=100, suppress_health_check=list(HealthCheck), derandomize=True)
@given(COMBINATIONS)
def test_no_combination_leaves_the_motor_on_or_loses_a_stage(together: list[Mishap]) -> None:
    holds(together)


@pytest.mark.long
@pytest.mark.timeout(0)
@pytest.mark.parametrize("thousand", range(10))
def test_none_of_ten_thousand_does(thousand: int) -> None:
    @seed(thousand)
    @settings(max_examples=1000, suppress_health_check=list(HealthCheck), database=None)
    @given(COMBINATIONS)
    def all_hold(together: list[Mishap]) -> None:
        holds(together)

    all_hold()
