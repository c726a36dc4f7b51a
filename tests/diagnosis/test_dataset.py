"""The model's answer to all that was recorded."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.diagnosis.data import Label
from rfca_rig.diagnosis.leg.simulator import MOVES, make_leg_dataset, select_tables
from rfca_rig.diagnosis.leg.stages import make_stage_tables
from rfca_rig.diagnosis.result_builder import group_by_recording
from rfca_rig.diagnosis.simulator import make_dataset
from rfca_rig.model.parameters import Swing
from tests.diagnosis.by_hand import RIG, flaps_of, present, read_at_rest, recorded
from tests.diagnosis.oscillator import Oscillator, OscillatorSimulator, Shaking
from tests.diagnosis.oscillator import recorded as shaken

STIFF = ModelPoint(replace(RIG, leg=replace(RIG.leg, k0_Nm_per_rad=1.1 * RIG.leg.k0_Nm_per_rad)))
IN_THE_FLOOR = ModelPoint(RIG, height_offset_m=-0.4)


@pytest.fixture(scope="module")
def dataset():
    """Two strokes and a table."""
    strokes = recorded(RIG, [(205.0, 2.433), (220.0, 3.249)], with_shaft=False)
    tables = make_stage_tables(
        read_at_rest(ModelPoint(RIG), MOVES[0], (60.0, 90.0, 120.0)), {}, MOVES[0]
    )
    return make_leg_dataset([*flaps_of(strokes), *tables])


def test_the_answer_to_one_question_has_the_conditions_in_their_order(dataset):
    """Each condition's rows are its own, whichever is ready first."""
    below_each_other = np.concatenate([part.simulated(STIFF) for part in dataset.parts])
    assert np.array_equal(dataset.predicted(STIFF), below_each_other)
    assert [
        np.array_equal(rows, below_each_other)
        for rows in dataset.predict_all([ModelPoint(RIG), STIFF])
    ] == [False, True]


def test_where_one_condition_has_no_answer_there_is_none(dataset):
    assert dataset.predicted(IN_THE_FLOOR) is None
    assert [rows is None for rows in dataset.predict_all([IN_THE_FLOOR, STIFF])] == [True, False]


@pytest.mark.parametrize(
    "changed", [Swing(0.5, 0.3, 1.0), present("sensor_lag", time_constant_s=0.02)]
)
def test_a_table_answers_alike_to_what_only_a_stroke_shows(dataset, changed):
    if isinstance(changed, Swing):
        rig = replace(RIG, swing=changed)
    else:
        rig = replace(RIG, effects=(changed,))
    same = [
        np.array_equal(part.simulated(ModelPoint(rig)), part.simulated(ModelPoint(RIG)))
        for part in dataset.parts
    ]
    assert same == [False, False, True]


def test_a_table_that_was_asked_before_answers_to_what_is_asked_now(dataset):
    (table,) = select_tables(dataset.parts)
    asked = (
        ModelPoint(RIG),
        STIFF,
        ModelPoint(RIG, height_offset_m=1e-3),
        ModelPoint(RIG, turn_offset_rad=1e-3),
    )
    answers = [table.simulated(supposed) for supposed in (*asked, *asked)]
    assert all(
        np.array_equal(first, again) for first, again in zip(answers[:4], answers[4:], strict=True)
    )
    others = (
        replace(table, moves=MOVES[2]),
        replace(table, height_m=table.height_m + 0.002),
        replace(table, stages=table.stages[:2]),
    )
    answers = [*answers[:4], *(other.simulated(ModelPoint(RIG)) for other in others)]
    assert len({answer.tobytes() for answer in answers}) == len(answers)


def test_parts_of_a_recording_are_one_curve_in_order_of_time_and_stages_keep_theirs():
    parts = [
        Label("motions", f"run 1, part {k}", "angle_rad", recording="run 1", starts_s=(2.0 * k,))
        for k in (1, 0)
    ]
    table = Label("static", "215 mm", "angle_rad")
    # The second part was cut first; the stages are loaded and unloaded, so their shaft angle goes
    # up and down.
    rows = SimpleNamespace(
        labels=(*parts, table),
        label=np.array([0, 0, 1, 1, 2, 2, 2]),
        t_s=np.array([2.0, 3.0, 0.0, 1.0, 60.0, 90.0, 70.0]),
    )
    groups = group_by_recording(rows)
    assert list(groups) == [("run 1", "angle_rad"), ("215 mm", "angle_rad")]
    assert [here.tolist() for _, here in groups.values()] == [[2, 3, 0, 1], [4, 5, 6]]
    assert groups["run 1", "angle_rad"][0] == parts
    assert list(group_by_recording(rows, "static")) == [("215 mm", "angle_rad")]


@pytest.mark.parametrize("value", [1e12, np.inf, np.nan])
def test_a_simulation_that_diverges_is_no_answer(value):
    """Squares of such rows overflow, and a covariance of them is singular."""

    class Diverging(OscillatorSimulator):
        def simulate(self, at, condition):
            rows = super().simulate(at, condition)
            return np.where(at.mass_kg < 1.0, value, 1.0) * rows

    recorded_part = shaken(Shaking(2.0, 4.0), lambda _: 0.0, 1)
    oscillating = make_dataset([recorded_part], Diverging())
    sound = Oscillator()
    diverging = Oscillator(mass_kg=0.5)
    rows = oscillating.predicted(sound)
    assert oscillating.predicted(diverging) is None
    assert oscillating.predict_all([diverging, sound])[0] is None
    assert oscillating.predict_changes(sound, rows, [diverging]) == [None]
