"""The history of ratios: what is found slower, and that the file can be read."""

from tests.benchmarks import __main__ as benchmarks
from tests.benchmarks.__main__ import find_slower, read_history

HISTORY = [{"run": 1.0, "report": 4.0}, {"run": 1.1, "report": 4.0}, {"run": 0.9, "report": 4.1}]


def test_only_what_is_worse_than_every_row_by_more_than_15_percent_is_slower():
    assert find_slower(HISTORY, {"run": 1.26, "report": 4.8}) == ["report"]
    assert find_slower(HISTORY, {"run": 0.2, "report": 4.0}) == []


def test_only_the_last_rows_count():
    old = [{"run": 10.0}] * 7
    assert find_slower([*old, *[{"run": 1.0}] * benchmarks.LAST_ROWS], {"run": 1.2}) == ["run"]
    assert find_slower(old, {"run": 1.2}) == []


def test_the_history_has_rows_with_every_ratio():
    rows = read_history()
    assert rows
    assert all(
        set(row) == {"stroke_per_lsoda", "run_in_strokes", "report_in_strokes"}
        and min(row.values()) > 0.0
        for row in rows
    )
