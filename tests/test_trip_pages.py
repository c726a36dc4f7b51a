"""A page for each code that stops a run, which shows what the program says."""

import re
from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.run import RampUp, run_plan
from rfca_rig.errors import Trip, Tripped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Approach
from rfca_rig.recording.backend import RecorderClient
from rfca_rig.recording.journal import event_block
from rfca_rig.recording.model import Recording
from rfca_rig.recording.run_folder import create
from tests.cli.typed import typed
from tests.engine.obedient import Motor, Nowhere, Sensor
from tests.engine.rigs import one_condition, twin_rig
from tests.runner_faults.causes import CAUSES
from tests.trip_pages import DOCS, form, page_of

CODES = [str(code) for code in Trip]
BY_HAND = {"L-05", "C-02", "S-07"}


def test_there_is_a_page_for_each_code_and_none_besides():
    assert sorted(file.stem for file in (DOCS / "trips").glob("*.md")) == sorted(CODES)


@pytest.mark.parametrize("code", CODES)
def test_a_page_is_short_and_the_index_leads_to_it(code):
    page = page_of(code)
    assert page.text.startswith(f"# {code}: ")
    assert len(page.text.splitlines()) < 40
    assert f"[{code}](trips/{code}.md)" in (DOCS / "trips.md").read_text()
    assert page.line.startswith(f"TRIP {code}: ")


@pytest.mark.parametrize("code", sorted(set(CODES) - BY_HAND))
def test_an_example_is_made_by_a_fault_that_ends_so(code):
    """That the line is what the program says then, `runner_faults.test_fault_table` sees, which
    runs every fault.
    """
    assert CAUSES[page_of(code).fault].ends == code


def said_of_full_speed(tmp_path):
    limits = twin_rig().facts().limits
    approach = Approach(0.215, 3.0, 4.0, 0.05, 3.5)
    approaches = RampUp(limits, {})
    approaches.take(replace(approach, speed_rad_s=2.0), Load(110.0, 1.0))
    approaches.take(approach, Load(210.0, 1.0))


def said_of_a_slow_disk(tmp_path):
    create(tmp_path / "run", Recording("a run", "SIM", twin_rig().nominal(), {}, (), ()))
    keeper = RecorderClient(tmp_path / "run", patient=False, queue_bytes=4096)
    try:
        for _ in range(10_000):
            keeper.give(event_block({"event": "x" * 1000}))
    finally:
        keeper.finish("done")


class LosingItsMind(Sensor):
    """A lab's own sensor whose driver hands out floats."""

    def read(self):
        told = super().read()
        return replace(told, counts=np.full((1, 6), np.nan))


def said_of_a_sensor_without_numbers(_tmp_path):
    clock = TwinClock()
    motor = Motor(clock)
    plan = one_condition(twin_rig())
    run_plan(
        plan,
        Bench(motor, LosingItsMind(clock), motor, clock, is_real=False),
        Nowhere(),
        lambda _: None,
    )


OTHERS = [
    ("L-05", said_of_full_speed),
    ("C-02", said_of_a_slow_disk),
    ("S-07", said_of_a_sensor_without_numbers),
]


@pytest.mark.parametrize(("code", "act"), OTHERS)
def test_the_other_examples_are_what_the_program_says(code, act, tmp_path):
    with pytest.raises(Tripped) as tripped:
        act(tmp_path)
    said, shown = (
        re.sub(r"under \S+ is", "under FOLDER is", text)
        for text in (str(tripped.value), page_of(code).line)
    )
    assert form(said) == form(shown)


def test_the_keys_that_a_page_names_are_keys_of_a_rig_file():
    limits = set(twin_rig().limits.model_dump())
    for code in CODES:
        named = set(
            re.findall(r"`(\w+_(?:N|Nm|ms|deg|degC|rad_s|s_per_rad))\b", page_of(code).text)
        )
        others = {
            "tx_Nm",
            "encoder_msg_rate_ms",
            "torques_msg_rate_ms",
            "encoder_period_ms",
            "status_period_ms",
            "report_period_ms",
            "worst_loop_gap_ms",
        }
        assert named <= limits | others | {"counts_per_N", "zero_deg"}, code


def test_the_command_prints_a_page_within_80_columns_and_knows_all_codes(monkeypatch, capsys):
    said = typed(monkeypatch, capsys, "trip", "f-02")
    assert said.exit_code == 0
    assert said.out.startswith("# F-02: following error\n\n")
    assert max(map(len, said.out.splitlines())) <= 80
    assert not re.search(r"```|\*\*|\]\(", said.out)
    assert "\n1. Something holds the shaft: the last angles stand still." in said.out
    assert [line[:4] for line in typed(monkeypatch, capsys, "trip").out.splitlines()] == CODES
    assert typed(monkeypatch, capsys, "trip", "F-9").exit_code == 2
