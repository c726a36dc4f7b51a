"""Progress is told where a person watches, and nowhere else; it counts what is done."""

import re

import pytest

from rfca_rig.cli.progress import progress
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


@pytest.mark.parametrize("quiet", [True, False])
def test_nothing_is_said_where_nobody_watches(quiet, capsys, monkeypatch):
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
