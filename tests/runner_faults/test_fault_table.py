"""Every cause ends as it should: motor off, nothing commanded afterwards, nothing lost; and the
printed table knows them all.
"""

import json
import re
import statistics
from pathlib import Path

import pytest

from tests.benchmarks.stop_times import BEGINNINGS, NOT_MEASURED, compare, simulated_ms
from tests.runner_faults import test_signals
from tests.runner_faults.cause import GOES_ON, Cause
from tests.runner_faults.causes import CAUSES
from tests.runner_faults.endings import ENDINGS
from tests.runner_faults.outcome import caused
from tests.runner_faults.rig import FaultyRig
from tests.runner_faults.table import STOP_TIMES, foot, over_the_wire
from tests.trip_pages import form, page_of

TABLE = Path(__file__).parents[2] / "docs" / "fault-table.md"


@pytest.mark.parametrize("cause", CAUSES.values(), ids=CAUSES)
def test_a_cause_ends_as_it_should(cause: Cause, tmp_path: Path) -> None:
    outcome = caused(cause, tmp_path / "run")
    assert outcome.ended == cause.ends, outcome.message
    assert outcome.is_safe, outcome
    if (
        re.fullmatch(r"[A-Z]-\d\d", cause.ends)
        and (page := page_of(cause.ends)).fault == cause.name
    ):
        assert form(outcome.message) == form(page.line)
    if cause.ends == GOES_ON:
        fewest_stages = 2
    elif cause.at_arming or cause.in_hold:
        fewest_stages = 0
    else:
        fewest_stages = 1
    assert outcome.acknowledged >= fewest_stages
    if cause.ends != GOES_ON and not cause.at_arming:
        assert outcome.stop.torque_ms <= cause.within_ms


def test_a_mistake_in_the_program_itself_takes_the_torque_away_too(tmp_path: Path) -> None:
    seen: list[FaultyRig] = []

    def divide_by_zero(rig: FaultyRig) -> None:
        seen.append(rig)
        raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        caused(Cause("mistake", "computer", "", "", divide_by_zero), tmp_path / "run")
    assert seen[0].bus.told_to_let_go_s() is not None
    assert seen[0].bus.motion_after_stop() == 0
    assert not seen[0].truth.moments[-1].powered


def test_the_causes_are_many_and_of_every_kind() -> None:
    assert len(CAUSES) >= 30
    assert {cause.family for cause in CAUSES.values()} == {
        "sensor",
        "drive",
        "bus",
        "computer",
        "operator",
    }


def _faults() -> str:
    return TABLE.read_text(encoding="utf-8").removesuffix(f"{foot()}\n")


def test_every_ending_of_the_process_has_its_test_and_is_in_the_documents() -> None:
    assert TABLE.read_text(encoding="utf-8").endswith(f"{foot()}\n")
    for ending in ENDINGS:
        assert callable(getattr(test_signals, ending.test))


def test_the_table_in_the_documents_is_that_of_the_causes_in_code() -> None:
    told = re.findall(r"^\| (\S.*?) \| (.*?) \| (.*?) \|", _faults(), re.MULTILINE)[1:]
    assert [(name, what, ends) for name, what, ends in told] == [
        (cause.name, cause.what, cause.ends) for cause in CAUSES.values()
    ]


def test_the_table_in_the_documents_has_the_kept_times_over_the_wire() -> None:
    told = re.findall(r"^\| (\S.*?) \| .*? \| .*? \| (.*?) \|", _faults(), re.MULTILINE)[1:]
    assert told == [(cause.name, over_the_wire(cause)) for cause in CAUSES.values()]
    assert "not measured" in dict(told).values()


def test_every_cause_is_measured_over_the_wire_or_says_why_not() -> None:
    assert sorted([*BEGINNINGS, *NOT_MEASURED]) == sorted(CAUSES)
    kept = json.loads(STOP_TIMES.read_text(encoding="utf-8"))
    assert len(kept) >= 40
    for reason_name in NOT_MEASURED:
        assert f"(`{reason_name}`" in _faults() or f"`{reason_name}`)" in _faults()


def test_times_over_the_wire_are_those_of_simulated_time() -> None:
    simulated = simulated_ms()
    kept = json.loads(STOP_TIMES.read_text(encoding="utf-8"))
    compared = 0
    for name, states in kept.items():
        if name in simulated and states["idle"]["times_ms"]:
            assert (
                compare(name, statistics.median(states["idle"]["times_ms"]), simulated[name])
                is None
            ), name
            compared += 1
    assert compared >= 40


def test_a_comparison_sees_what_is_apart() -> None:
    assert compare("jam", 188.0, 188.0) is None
    assert compare("jam", 8.0, 2.0) is None
    assert compare("jam", 11.0, 2.0) is not None
    assert compare("jam", 90.0, 188.0) is not None
    assert compare("heartbeat-silent", 600.0, 250.0) is None
    assert compare("drive-hot", 500.0, 62.0) is None


def test_what_was_measured_over_the_wire_ended_as_the_table_says() -> None:
    """Most tries: a busy machine may end one for its own reason."""
    for name, states in json.loads(STOP_TIMES.read_text(encoding="utf-8")).items():
        ends = [*states["idle"]["ends"], *states["busy"]["ends"]]
        assert 2 * ends.count(CAUSES[name].ends) >= len(ends), name


def test_the_table_in_the_documents_shows_no_motor_that_went_on() -> None:
    lines = [line for line in _faults().splitlines() if line.startswith("| ")][1:]
    for line in lines:
        _, _, energised, frames, lost = line.strip("| ").split(" | ")[-5:]
        assert energised == "never" or re.fullmatch(
            r"\d\d ms, until the drive's watchdog", energised
        )
        assert (frames, lost) == ("0", "0")
