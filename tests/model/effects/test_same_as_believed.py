"""Effects that do what a nominal value does where it is wrong: not nearly, but to the last digit
that counts.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.fitting.parameters import PARAMETERS, ModelPoint
from rfca_rig.model.catalogue import catalogue
from rfca_rig.model.stroke import simulate_stroke_at_speed
from tests.model.effects.rigs import having
from tests.model.legs import PAPER

T = np.arange(0, 1100) * 1e-3
IN_SERIES = (1e5 ** (-2.0 / 3.0) + 2e4 ** (-2.0 / 3.0)) ** -1.5
HARD = replace(PAPER, ground=replace(PAPER.ground, stiffness_N_per_m1p5=1e5))
VALUES = {
    "ground_compliance": ({"stiffness_N_per_m1p5": 2e4}, IN_SERIES),
    "height_offset": ({"offset_mm": 1.5}, 1.5),
    "hinge_viscous_damping": (
        {"coefficient_Nm_s_per_rad": 0.05},
        PAPER.leg.hinge_damping_Nm_s_per_rad + 0.05,
    ),
}


def test_every_effect_that_says_so_is_looked_at_here():
    assert {effect.id for effect in catalogue().values() if effect.same_as} == set(VALUES)


@pytest.mark.parametrize("effect", VALUES)
def test_it_does_what_the_believed_value_does(effect):
    values, value = VALUES[effect]
    supposed = PARAMETERS[catalogue()[effect].same_as].write(ModelPoint(HARD), value)
    by_effect = simulate_stroke_at_speed(having(HARD, **{effect: values}), 0.215, 2.433, T)
    by_value = simulate_stroke_at_speed(supposed.rig, 0.215 + supposed.height_offset_m, 2.433, T)
    plain = simulate_stroke_at_speed(HARD, 0.215, 2.433, T)
    for force in ("fy_N", "fz_N", "shaft_torque_Nm"):
        ours, theirs, without = (getattr(stroke, force) for stroke in (by_effect, by_value, plain))
        assert np.abs(ours - theirs).max() < 2e-3 * np.abs(without - theirs).max()
