import numpy as np
import pytest

from rfca_rig.analysis.compare import compare_condition
from rfca_rig.analysis.peak_force import PeakForce, find_peak, make_peak_row, stroke_peak
from rfca_rig.analysis.phases import Undetermined
from rfca_rig.analysis.repeats import Condition
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.recording.model import Column, Stream, Stroke
from tests.analysis import traces
from tests.model.legs import PAPER

T = np.arange(-0.1, 0.5, 1e-3)


def bump(t_s, at_s, size_N):
    return size_N * np.exp(-(((t_s - at_s) / 0.01) ** 2))


def test_fy_and_fz_are_those_of_one_instant():
    # fy is largest at 0.1 s, fz at 0.3 s, |F| at 0.2 s where neither is: extremes taken apart would
    # give (250, 260) and 361 N.
    fy_N = bump(T, 0.1, 250.0) + bump(T, 0.2, 188.0)
    fz_N = -bump(T, 0.2, 232.0) + bump(T, 0.3, 260.0)
    peak = find_peak(T, fy_N, fz_N)
    assert (peak.fy_N, peak.fz_N, peak.time_s) == (
        pytest.approx(188.0, abs=0.1),
        pytest.approx(-232.0, abs=0.1),
        pytest.approx(0.2),
    )
    assert peak.force_N == pytest.approx(np.hypot(188.0, 232.0), abs=0.1)


def test_what_comes_before_the_start_or_is_not_a_number_is_no_peak():
    fz_N = bump(T, -0.05, 500.0) + bump(T, 0.2, 100.0)
    fz_N[T > 0.4] = np.nan
    assert find_peak(T, np.zeros(len(T)), fz_N).time_s == pytest.approx(0.2)
    assert find_peak(T[T < 0.0], T[T < 0.0], T[T < 0.0]) == Undetermined(
        "no sample of fy and fz after the start"
    )


@pytest.mark.parametrize(
    ("streams", "reason"),
    [
        ({"force": ("fz_N",)}, "fy not recorded"),
        ({"shaft": ("shaft_angle_rad",)}, "fy and fz not recorded"),
        ({"one": ("fy_N",), "other": ("fz_N",)}, "fy and fz have different time bases"),
    ],
)
def test_a_stroke_without_both_forces_at_one_time_is_refused(streams, reason):
    columns = {
        name: Stream(T, {each: Column(T, "") for each in names}) for name, names in streams.items()
    }
    assert stroke_peak(Stroke(0.155, 15.0, 1, columns)) == Undetermined(reason)


def impact(repeat, factor, end_s=0.25):
    """A stroke of the impact test by the model, its forces times `factor`."""
    t_s = traces.even(2000.0, end_s)
    simulated = simulate_stroke_at_speed(PAPER, 0.155, 15.0, t_s)
    return traces.stroke(
        t_s,
        factor * simulated.fz_N,
        height_m=0.155,
        speed_rad_s=15.0,
        repeat=repeat,
        fy_N=factor * simulated.fy_N,
    )


def test_the_row_holds_the_scatter_of_the_repeats_beside_the_model():
    factors = (0.9, 1.0, 1.2)
    strokes = tuple(impact(repeat, factor) for repeat, factor in enumerate(factors, start=1))
    row = make_peak_row(compare_condition(PAPER, Condition(0.155, 15.0, strokes), "commanded"), "x")
    fy = row.simulated.fy_N.mean
    fz = row.simulated.fz_N.mean
    assert (row.repeats, row.refused) == (3, ())
    assert row.measured.force_N.mean == pytest.approx(np.mean(factors) * row.simulated.force_N.mean)
    # The sample standard deviation of 0.9, 1.0, 1.2 is 0.1528; with n in place of n - 1 it would be
    # 0.1247.
    for spread, value in (
        (row.measured.force_N, np.hypot(fy, fz)),
        (row.measured.fy_N, fy),
        (row.measured.fz_N, fz),
    ):
        assert spread.std == pytest.approx(0.152753 * abs(value), rel=1e-4)
    assert row.measured.time_s.mean == pytest.approx(row.simulated.time_s.mean, abs=1e-9)
    assert row.measured.time_s.std == pytest.approx(0.0, abs=1e-9)


def test_the_model_is_judged_for_no_longer_than_the_recording():
    # The largest force, the pull of the leg after lift-off, comes at 0.246 s; a recording that ends
    # before it holds the push alone.
    long, short = (
        make_peak_row(
            compare_condition(PAPER, Condition(0.155, 15.0, (impact(1, 1.0, end_s),)), "commanded"),
            "x",
        )
        for end_s in (0.26, 0.20)
    )
    assert long.simulated_touching is False and short.simulated_touching is True
    assert (
        short.simulated.time_s.mean == pytest.approx(short.measured.time_s.mean, abs=1e-9)
        and short.simulated.time_s.mean < 0.20
    )
    assert long.simulated.fz_N.mean > 0.0 > short.simulated.fz_N.mean


def test_a_repeat_without_fy_is_told_and_the_others_are_used():
    t_s = traces.even(1000.0, 0.25)
    silent = traces.stroke(t_s, np.zeros(len(t_s)), height_m=0.155, speed_rad_s=15.0, repeat=2)
    row = make_peak_row(
        compare_condition(PAPER, Condition(0.155, 15.0, (impact(1, 1.0), silent)), "commanded"), "x"
    )
    assert (row.repeats, row.measured.force_N.std, row.refused) == (
        1,
        None,
        ("repeat 2: fy not recorded",),
    )
    assert isinstance(stroke_peak(impact(1, 1.0)), PeakForce)
