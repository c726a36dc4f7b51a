"""Static stages as rows of evidence."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.diagnosis.leg.stages import stage_tables
from rfca_rig.model.static_stages import StageMoves
from rfca_rig.recording.form import StaticStage

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
    return stage_tables(STAGES, {}, StageMoves(1.0, 0.05))[0]


def test_a_shaft_that_stops_as_told_leaves_nothing_loose(table):
    assert not table.rows().jolt.any()


def test_friction_of_a_shaft_that_does_not_is_foretold_to_three_tenths_of_the_usual_and_angles_as_before(table):
    rows = replace(table, stopped_as_told=False).rows()
    loose_N = 0.3 * np.sqrt((3.0**2 + 6.0**2) / 2.0)
    for signal, expected in (("fy_N", loose_N), ("fz_N", loose_N), ("tx_Nm", 0.2 * loose_N), ("hinge2_deg", 0.0)):
        assert 0.01 * rows.jolt[rows.signal == signal] == pytest.approx(expected)
