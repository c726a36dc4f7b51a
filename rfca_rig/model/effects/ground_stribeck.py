"""Floor friction that falls with sliding speed."""

from typing import Any

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import SLIP, LawUse
from rfca_rig.model.setup import Setup, with_law

# Share of the speed scale. It keeps the slope finite at rest for exponents below one, and does not change an exponent of one.
ROUNDED = 1e-3


def factor(v: float, memory: Any, parameter: Any) -> tuple[float, float]:
    u, d = abs(v) / parameter[1] + ROUNDED, parameter[2]
    rise = parameter[0] * np.exp(ROUNDED**d - u**d)
    return 1.0 + rise, -np.sign(v) * rise * d * u ** (d - 1.0) / parameter[1]


def apply(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(SLIP, factor, (values["rise_relative"], values["speed_m_s"], values["exponent"])))


EFFECT = Effect(
    id="ground_stribeck",
    where="ground",
    left_out="friction that falls with sliding speed",
    law="mu (1 + rise exp(-(|v| / v_s)^d)), d = 1 unless given",
    source="Stribeck 1902; exponent as in Bo and Pavelescu 1982 (0.5 to 1) and Armstrong-Helouvry 1991 (2)",
    parameters=(
        Parameter("rise_relative", 0.05, 1.0),
        Parameter("speed_m_s", 0.005, 1.0, may_be_zero=False),
    ),
    apply=apply,
    # At a rise of 0.3 and 0.1 m/s, fz over a stroke (215 mm, 2.433 rad/s) changes by 0.50 N rms with exponent 0.4, by 0.08 N with 2.5.
    shape=(Parameter("exponent", 0.4, 2.5, may_be_zero=False, neutral=1.0),),
)
