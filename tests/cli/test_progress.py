"""Progress is told where a person watches or follows a log; it counts what is done."""

import re
from threading import Event

import pytest
from rich.progress import Progress

from rfca_rig.cli import progress as progress_module
from rfca_rig.cli.progress import (
    LOG_EVERY_S,
    ProgressLines,
    ProgressLog,
    print_at_intervals,
    progress,
    progress_bar,
)
from rfca_rig.progress import iterate_with_progress


@pytest.fixture
def terminal(monkeypatch):
    """What rich takes for a terminal of 80 columns, without control codes for colours."""
    for name, value in (
        ("TTY_COMPATIBLE", "1"),
        ("TERM", "xterm"),
        ("COLUMNS", "80"),
        ("NO_COLOR", "1"),
    ):
        monkeypatch.setenv(name, value)


def shown(err: str) -> list[str]:
    return [
        line.strip()
        for line in re.split(r"[\r\n]+", re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", err))
        if line.strip()
    ]


def test_items_are_counted_and_what_remains_is_told(terminal, capsys):
    with progress(quiet=False) as bars:
        for item in iterate_with_progress(list("abcd"), bars.counting("letters")):
            assert item in "abcd"
    lines = shown(capsys.readouterr().err)
    assert lines
    assert "letters" in lines[-1]
    assert "4 of 4" in lines[-1]
    assert lines[-1].endswith("left")
    assert max(map(len, lines)) <= 80


def test_of_work_without_a_known_end_its_own_words_and_the_time_so_far_until_something_is_counted(
    terminal, capsys
):
    with progress(quiet=False) as bars:
        bars.show_unbounded("compiling", lambda: "7 functions")
        bars.report("strips", 0, 8)
    lines = shown(capsys.readouterr().err)
    assert re.search(
        r"compiling .* 7 functions 00:0\d$", next(line for line in lines if "compiling" in line)
    )
    with progress(quiet=False) as bars:
        bars.show_unbounded("compiling", lambda: "7 functions")
        bars.report("strips", 1, 8)
    assert "compiling" not in shown(capsys.readouterr().err)[-1]


def test_parts_that_follow_each_other_share_a_line(terminal, capsys):
    with progress(quiet=False) as bars:
        bars.share("reading", 0.0)
        bars.share("a part with a name that is longer than there is room for", 0.5)
    last = shown(capsys.readouterr().err)[-1]
    assert "50 %" in last
    assert "a part with a name that is longe.." in last
    assert len(last) <= 80


class Now:
    """A clock for the bars that the test sets."""

    def __init__(self) -> None:
        self.s = 100.0

    def __call__(self) -> float:
        return self.s


@pytest.fixture
def log():
    """(clock, lines of progress, the log of them)"""
    now = Now()
    bars = Progress(disable=True, get_time=now, speed_estimate_period=1e4)
    return now, ProgressLines(bars), ProgressLog(bars)


def test_a_log_has_what_is_done_what_remains_and_the_time_so_far(log):
    now, lines, described = log
    lines.report("campaigns diagnosed", 0, 4)
    now.s += 720.0
    assert described.describe() == "campaigns diagnosed 0 of 4; 12:00 so far"
    lines.report("campaigns diagnosed", 1, 4)
    now.s += 720.0
    lines.report("campaigns diagnosed", 2, 4)
    assert described.describe() == "campaigns diagnosed 2 of 4, 24:00 left; 24:00 so far"
    lines.report("campaigns diagnosed", 4, 4)
    lines.share("writing", 0.25)
    assert described.describe() == "writing 25 %; 24:00 so far"


def test_a_log_has_work_without_a_known_end_and_work_before_it_is_counted(log):
    now, lines, described = log
    now.s += 25.0
    assert described.describe() == "00:25 so far"
    lines.show_unbounded("compiling", lambda: "7 functions")
    now.s += 3600.0
    assert described.describe() == "compiling 7 functions; 1:00:25 so far"


def test_a_log_gets_a_line_at_least_every_half_minute_until_the_work_ends():
    assert LOG_EVERY_S < 30.0
    waited_s = []
    said = []

    def wait(seconds: float) -> bool:
        waited_s.append(seconds)
        return len(waited_s) == 4

    print_at_intervals(lambda: f"line {len(said)}", said.append, wait)
    assert said == ["line 0", "line 1", "line 2"]
    assert waited_s == [LOG_EVERY_S] * 4


@pytest.fixture
def impatient(monkeypatch):
    """A log whose first line is due at once; returns a function that waits until it is printed."""
    printed = Event()

    def print_once(describe, say, wait):
        say(describe())
        printed.set()
        wait(None)

    monkeypatch.setattr(progress_module, "print_at_intervals", print_once)

    def wait_until_printed():
        assert printed.wait(60.0)

    return wait_until_printed


def test_without_a_terminal_progress_is_logged_on_the_error_stream(impatient, capsys):
    with progress(quiet=False):
        impatient()
    said = capsys.readouterr()
    assert said.out == ""
    assert re.fullmatch(r"00:0\d so far\n", said.err)


def test_without_a_terminal_a_run_logs_its_share_with_its_mark(impatient, capsys):
    with progress_bar("SIM", 60.0, quiet=False) as (advance, _):
        impatient()
        advance("stroke 1", 15.0)
    assert re.fullmatch(r"SIM ( 0 %; )?00:0\d so far\n", capsys.readouterr().err)


def test_on_a_terminal_and_where_json_is_printed_nothing_is_logged(terminal, capsys, monkeypatch):
    monkeypatch.setattr(progress_module, "print_at_intervals", pytest.fail)
    with progress(quiet=False):
        pass
    with progress(quiet=True):
        pass


@pytest.mark.parametrize("quiet", [True, False])
def test_short_work_says_nothing_where_nobody_watches(quiet, capsys, monkeypatch):
    if quiet:
        monkeypatch.setenv("TTY_COMPATIBLE", "1")
    with progress(quiet=quiet) as bars:
        bars.report("letters", 1, 2)
        bars.share("part", 0.5)
        bars.show_unbounded("more", lambda: "")
    said = capsys.readouterr()
    assert (said.out, said.err) == ("", "")


def test_results_go_to_standard_output_while_a_bar_is_there(terminal, capsys):
    with progress(quiet=False) as bars:
        bars.report("letters", 1, 2)
        print("a result")
    said = capsys.readouterr()
    assert said.out == "a result\n"
    assert "a result" not in said.err


def test_counting_tells_before_each_and_behind_the_last():
    said = []
    assert list(iterate_with_progress("abc", lambda done, of: said.append((done, of)))) == list(
        "abc"
    )
    assert said == [(0, 3), (1, 3), (2, 3), (3, 3)]
    assert list(iterate_with_progress([], lambda *_: pytest.fail("nothing to count"))) == []
