"""What the document on speed at equal error says: its table, and that other codes agree."""

from pathlib import Path

import numpy as np
import pytest

from tests.benchmarks.equal_error import (
    CONDITIONS,
    TABLE,
    Point,
    find_cheapest,
    format_table,
    grid_s,
    measure_error,
    read_points,
    solve_here,
    solve_in_exudyn,
    solve_in_scipy,
)
from tests.benchmarks.pendulum_a01 import swing

DOCUMENT = Path(__file__).parents[2] / "docs" / "speed-at-equal-error.md"


def test_the_document_has_the_table_of_the_measurement():
    text = DOCUMENT.read_text(encoding="utf-8")
    assert format_table(read_points(TABLE)) in text
    machine = TABLE.read_text(encoding="utf-8").splitlines()[0].removeprefix("# ")
    assert machine.partition(";")[2].strip() in " ".join(text.split())


def test_a_setting_counts_where_all_finer_ones_keep_the_error():
    ladder = [
        Point("solver", "step (s)", value, error, time_ms, 1, "steps")
        for value, error, time_ms in ((4.0, 1e-3, 1.0), (2.0, 1e-1, 2.0), (1.0, 1e-3, 3.0))
    ]
    assert find_cheapest(ladder, 1e-2).value == 1.0
    assert find_cheapest(ladder, 1.0).value == 4.0
    assert find_cheapest(ladder, 1e-4) is None


def test_radau_solves_the_same_stroke():
    condition = CONDITIONS[0]
    true = solve_here(condition, 1e-2)
    assert measure_error(solve_in_scipy("Radau", condition, 1e-5), true, grid_s(condition)) < 1e-5


@pytest.mark.slow
def test_exudyn_converges_to_the_same_stroke():
    """With the square of its step, from mechanics of its own in other coordinates."""
    pytest.importorskip("exudyn")
    condition = CONDITIONS[-1]
    true = solve_here(condition, 1e-2)
    errors = [
        measure_error(solve_in_exudyn(condition, step_s), true, grid_s(condition))
        for step_s in (5e-4, 2.5e-4)
    ]
    assert errors[1] < 1e-4
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.1)


def test_a_pendulum_swings_as_its_elliptic_function():
    accuracy, _ = swing(np.linspace(0.01, 10.0, 1000), 1.0)
    assert accuracy.error < 1e-3
    assert accuracy.energy_J < 1e-4
