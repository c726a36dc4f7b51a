import numpy as np
import pytest

from rfca_rig.analysis.compare import (
    ComparedCondition,
    ComparedRepeat,
    Table2,
    compare_condition,
    make_table2_row,
)
from rfca_rig.analysis.matched_simulation import MatchedSimulation, simulate_matching
from rfca_rig.analysis.phases import StrokePhases, Undetermined, Valley, find_valley
from rfca_rig.analysis.repeats import Condition
from rfca_rig.model.stroke import simulate_stroke_at_speed
from tests.analysis import traces
from tests.model.legs import PAPER

PAPERS_ROWS = [
    (0.215, 2.433, (1.10, -54.97), (1.05, -53.32)),
    (0.215, 3.249, (0.80, -52.41), (0.78, -51.54)),
    (0.235, 2.478, (0.97, -41.18), (0.97, -42.34)),
    (0.235, 3.276, (0.69, -39.19), (0.73, -40.46)),
]
NOTHING = np.empty(0)
T = traces.even(1000.0)


def compared(height_m, speed_rad_s, measured, simulated):
    repeats = tuple(
        ComparedRepeat(i, NOTHING, NOTHING, NOTHING, valley, StrokePhases())
        for i, valley in enumerate(measured, start=1)
    )
    condition = Condition(height_m, speed_rad_s, ())
    return ComparedCondition(
        condition, repeats, (MatchedSimulation(speed_rad_s, "command", None, simulated),)
    )


def test_the_papers_values_give_the_papers_errors():
    rows = tuple(
        make_table2_row(compared(h, w, [Valley(*m)], Valley(*s)), "paper")
        for h, w, m, s in PAPERS_ROWS
    )
    assert [round(row.time_error_pct, 1) for row in rows] == [4.5, 2.5, 0.0, 5.8]
    assert [round(row.force_error_pct, 1) for row in rows] == [3.0, 1.7, 2.8, 3.2]
    table = Table2(rows)
    assert (round(table.average_time_error_pct, 1), round(table.average_force_error_pct, 1)) == (
        3.2,
        2.7,
    )
    assert rows[0].signed_time_error_pct < 0 < rows[0].signed_force_error_pct, (
        "too early, and pressing less"
    )


def test_a_refused_stroke_is_told_and_the_others_are_used():
    row = make_table2_row(
        compared(
            0.215,
            2.433,
            [Valley(1.0, -50.0), Undetermined("no contact"), Valley(1.2, -54.0)],
            Valley(1.1, -52.0),
        ),
        "x",
    )
    assert (row.repeats, row.time.mean, row.fz.std) == (
        2,
        pytest.approx(1.1),
        pytest.approx(np.sqrt(8.0)),
    )
    assert row.refused == ("repeat 2: no contact",)


def test_a_row_without_any_valley_stays_in_the_table_and_out_of_the_average():
    empty = make_table2_row(
        compared(0.215, 2.433, [Undetermined("no contact")], Undetermined("at the end")), "x"
    )
    good = make_table2_row(compared(0.235, 2.433, [Valley(1.0, -50.0)], Valley(1.01, -50.5)), "x")
    table = Table2((empty, good))
    assert (empty.repeats, empty.time_error_pct, empty.refused) == (
        0,
        None,
        ("repeat 1: no contact", "simulated: at the end"),
    )
    assert (table.average_time_error_pct, table.average_force_error_pct) == (
        pytest.approx(1.0),
        pytest.approx(1.0),
    )


def measured_stroke(speed_rad_s, repeat=1, commanded_rad_s=2.433):
    simulated = simulate_stroke_at_speed(PAPER, 0.215, speed_rad_s, T)
    return traces.stroke(
        T,
        simulated.fz_N,
        repeat=repeat,
        speed_rad_s=commanded_rad_s,
        shaft_angle_rad=simulated.shaft_angle_rad,
    )


def test_the_average_speed_explains_a_drive_that_turns_slower_than_told():
    condition = Condition(0.215, 2.433, (measured_stroke(2.30),))
    average, commanded = (
        make_table2_row(compare_condition(PAPER, condition, shaft), "x")
        for shaft in ("average", "commanded")
    )
    assert average.shaft_speed_rad_s == pytest.approx(2.30, abs=1e-3)
    assert average.time_error_pct < 0.1 and average.force_error_pct < 0.1
    assert commanded.shaft_speed_rad_s == 2.433
    assert commanded.time_error_pct > 3.0


def test_recorded_motion_is_followed_stroke_by_stroke():
    strokes = (measured_stroke(2.30, 1), measured_stroke(2.60, 2))
    found = simulate_matching(PAPER, Condition(0.215, 2.433, strokes), "recorded")
    for stroke, model in zip(strokes, found, strict=True):
        assert model.valley.time_s == pytest.approx(
            find_valley(*stroke.channel("fz_N")).time_s, abs=2e-3
        )


def test_a_recorded_speed_serves_where_the_angle_is_missing():
    shaft_speed = np.clip(T / 0.05, 0.0, 1.0) * 2.3
    stroke = traces.stroke(
        T, simulate_stroke_at_speed(PAPER, 0.215, 2.3, T).fz_N, shaft_speed_rad_s=shaft_speed
    )
    (model,) = simulate_matching(PAPER, Condition(0.215, 2.433, (stroke,)), "recorded")
    assert model.valley.time_s == pytest.approx(
        find_valley(*stroke.channel("fz_N")).time_s, abs=2e-3
    )


def test_the_residual_of_the_models_own_stroke_is_its_noise():
    exact = measured_stroke(2.433)
    noisy = exact.streams["table"].columns["fz_N"].data + np.random.default_rng(0).normal(
        0.0, 0.15, len(T)
    )
    stroke = traces.stroke(T, noisy, shaft_angle_rad=exact.channel("shaft_angle_rad")[1])
    rms = compare_condition(PAPER, Condition(0.215, 2.433, (stroke,)), "commanded").rms_N()
    assert list(rms) == ["rest", "free", "touchdown", "loading", "release", "rebound"]
    assert rms["loading"] == pytest.approx(0.15, abs=0.02)


def test_the_residual_is_measured_minus_simulated():
    exact = measured_stroke(2.433)
    higher = traces.stroke(T, exact.channel("fz_N")[1] + 2.0)
    (repeat,) = compare_condition(PAPER, Condition(0.215, 2.433, (higher,)), "commanded").repeats
    assert np.median(repeat.residual_N) == pytest.approx(2.0, abs=0.01)


def test_a_stroke_without_force_is_compared_as_refused():
    silent = traces.stroke(T, None, shaft_angle_rad=np.zeros(len(T)) + 0.25)
    done = compare_condition(PAPER, Condition(0.215, 2.433, (silent,)), "commanded")
    assert make_table2_row(done, "x").refused == ("repeat 1: fz was not recorded",)
    assert done.rms_N() == {}


def test_the_borders_of_the_phases_are_the_mean_over_the_repeats_that_reached_them():
    each = (StrokePhases(0.3, 1.0, 1.05), StrokePhases(0.4, 1.2), StrokePhases())
    repeats = tuple(
        ComparedRepeat(i, NOTHING, NOTHING, NOTHING, Undetermined("x"), phases)
        for i, phases in enumerate(each, start=1)
    )
    done = ComparedCondition(Condition(0.215, 2.433, ()), repeats, ())
    assert done.contact_is_measured
    assert done.mean_phases() == StrokePhases(
        pytest.approx(0.35), pytest.approx(1.1), pytest.approx(1.05)
    )


def test_where_no_repeat_shows_its_contact_the_model_gives_the_borders():
    silent = traces.stroke(T, None, shaft_angle_rad=np.zeros(len(T)) + 0.25)
    done = compare_condition(PAPER, Condition(0.215, 2.433, (silent,)), "commanded")
    measured = compare_condition(
        PAPER, Condition(0.215, 2.433, (measured_stroke(2.433),)), "commanded"
    ).mean_phases()
    assert not done.contact_is_measured
    for name in ("touchdown_s", "valley_s", "lift_off_s"):
        assert getattr(done.mean_phases(), name) == pytest.approx(getattr(measured, name), abs=0.01)
