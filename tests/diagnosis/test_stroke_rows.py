"""Strokes as rows of short means: every row has samples behind it, wherever the recording ends."""

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.phases import Valley, stroke_valley
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke_at_speed
from rfca_rig.recording.model import Column, Stream, Stroke
from tests.diagnosis.by_hand import NOISE, RIG, flaps_of, recorded


@pytest.fixture(scope="module")
def whole() -> Stroke:
    return recorded(RIG, [(215.0, 2.433)], with_shaft=False)[0]


def taken(stroke: Stroke, rows: slice | np.ndarray) -> Stroke:
    """Only these samples of it."""
    table = stroke.streams["table"]
    columns = {
        name: Column(column.data[rows], column.unit) for name, column in table.columns.items()
    }
    return Stroke(
        stroke.height_m,
        stroke.speed_rad_s,
        stroke.repeat,
        {"table": Stream(table.t_s[rows], columns)},
    )


def valley_s(stroke: Stroke) -> float:
    valley = stroke_valley(stroke)
    assert isinstance(valley, Valley)
    return valley.time_s


def check_rows(*strokes: Stroke) -> None:
    (flap,) = flaps_of(strokes)
    rows = flap.rows()
    signals = len(NOISE)
    assert flap.counts.min() >= 1
    assert np.all(
        np.isfinite(
            [rows.measured, rows.noise, rows.scale, rows.transient_scale, rows.progress, rows.t_s]
        )
    )
    assert len(rows.measured) == signals * len(flap.first)
    t_s = flap.t_s
    stroke = strokes[0].streams["table"]
    for name, part in zip(NOISE, rows.measured.reshape(signals, -1), strict=True):
        values = stroke.columns[name].values[np.isin(stroke.t_s, t_s)]
        assert part == pytest.approx(
            [
                values[i:j].mean()
                for i, j in zip(flap.first, [*flap.first[1:], len(t_s)], strict=True)
            ]
        )


@pytest.mark.parametrize("after_s", [0.04, 0.047, 0.06, 0.3])
def test_a_recording_that_ends_soon_after_the_valley(whole, after_s):
    check_rows(taken(whole, whole.streams["table"].t_s < valley_s(whole) + after_s))


def test_the_shortest_of_several_says_where_the_rows_begin_and_end(whole):
    t_s = whole.streams["table"].t_s
    short = taken(whole, (t_s > -0.05) & (t_s < valley_s(whole) + 0.04))
    (alone,) = flaps_of([short])
    (both,) = flaps_of([whole, short])
    assert np.array_equal(both.first, alone.first)
    assert np.array_equal(both.t_s, alone.t_s)
    assert both.repeats[0] == pytest.approx(both.repeats[1])


def test_a_fast_sensor_is_simulated_at_fewer_times_and_predicted_the_same():
    slow, fast = (
        flaps_of(
            [drawn_from(simulate_stroke_at_speed(RIG, 0.215, 2.433, np.arange(-0.1, 1.4, step_s)))]
        )[0]
        for step_s in (1e-3, 1e-3 / 7)
    )
    assert fast.samples.sum() > 6.5 * slow.samples.sum() and len(fast.t_s) < 2.5 * len(slow.t_s)
    assert np.array_equal(slow.samples, slow.counts)
    rows = fast.rows()
    predicted = fast.simulated(ModelPoint(RIG))
    for measured, simulated in zip(
        rows.measured.reshape(len(NOISE), -1), predicted.reshape(len(NOISE), -1), strict=True
    ):
        assert np.abs(measured - simulated).max() < 1e-4 * np.ptp(measured)
    # Noise averages over the recorded samples, not over the simulated times.
    assert np.median(rows.noise) == pytest.approx(
        np.median(slow.rows().noise) / np.sqrt(7.0), rel=0.02
    )


def drawn_from(simulated: SimulatedStroke) -> Stroke:
    """A recording of a simulated stroke, without noise."""
    columns = {name: Column(getattr(simulated, name), "") for name in (*NOISE, "shaft_angle_rad")}
    return Stroke(0.215, 2.433, 1, {"table": Stream(simulated.t_s, columns)})
