"""Static stages as rows of evidence."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.diagnosis.leg.stages import make_stage_tables
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.static_stages import StageMoves
from rfca_rig.recording.model import StaticStage
from tests.diagnosis.by_hand import RIG

STAGES = [
    StaticStage(
        stage=number,
        height_m=0.2,
        shaft_angle_rad=0.5 + 0.1 * number,
        direction="loading",
        fy_N=-3.0 * number,
        fz_N=-10.0 * number,
        tx_Nm=float(number),
        hinge_deg=(1.0,) * 6,
    )
    for number in (1, 2)
]


@pytest.fixture
def table():
    return make_stage_tables(STAGES, {}, StageMoves(1.0, 0.05))[0]


def test_a_table_creeps_for_as_long_as_it_says_that_its_stages_were_held(table):
    arm = PresentEffect("spring_relaxation", (("strength_relative", 0.3), ("time_constant_s", 2.0)))
    creeping = ModelPoint(replace(RIG, effects=(arm,)))
    pressed = tuple(
        replace(stage, shaft_angle_rad=stage.shaft_angle_rad + 1.2) for stage in table.stages
    )
    table = replace(table, stages=pressed)
    held = replace(table, stages=tuple(replace(stage, held_s=4.0) for stage in pressed))
    assert held.simulated(creeping) == pytest.approx(
        replace(table, moves=replace(table.moves, hold_s=4.0)).simulated(creeping)
    )
    assert np.abs(held.simulated(creeping) - table.simulated(creeping)).max() > 0.5
    partly = replace(table, stages=(held.stages[0], *table.stages[1:]))
    assert partly.simulated(creeping) == pytest.approx(table.simulated(creeping))


def test_a_shaft_that_stops_as_told_leaves_nothing_loose(table):
    assert not table.rows().transient_scale.any()


def test_predicted_friction_of_another_shaft_is_off_by_three_tenths_of_the_usual_error(
    table,
):
    rows = replace(table, stopped_as_commanded=False).rows()
    loose_N = 0.3 * np.sqrt((3.0**2 + 6.0**2) / 2.0)
    for signal, expected in (
        ("fy_N", loose_N),
        ("fz_N", loose_N),
        ("tx_Nm", 0.2 * loose_N),
        ("hinge2_deg", 0.0),
    ):
        assert 0.01 * rows.transient_scale[rows.signal == signal] == pytest.approx(expected)
