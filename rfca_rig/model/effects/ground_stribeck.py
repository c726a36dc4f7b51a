"""Floor friction that falls with sliding speed."""

from typing import Any

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import SLIP, LawUse
from rfca_rig.model.setup import Setup, with_law


def factor(v: float, memory: Any, parameter: Any) -> tuple[float, float]:
    rise = parameter[0] * np.exp(-abs(v) / parameter[1])
    return 1.0 + rise, -np.sign(v) * rise / parameter[1]


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(SLIP, factor, (values["rise_relative"], values["speed_m_s"])))


EFFECT = Effect(
    id="ground_stribeck",
    where="ground",
    left_out="friction that falls with sliding speed",
    law="mu (1 + rise exp(-|v| / v_s))",
    source="Stribeck 1902, exponential form",
    parameters=(
        Parameter("rise_relative", 0.05, 1.0),
        Parameter("speed_m_s", 0.005, 1.0, may_be_zero=False),
    ),
    apply=apply,
)
