"""A torque in the hinges that is a sum of plain terms in angle and rate, as one law of the compiled chain."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.residual_force.force_inputs import ForceInput
from rfca_rig.diagnosis.residual_force.spline_force import Change
from rfca_rig.model.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law

Floats = NDArray[np.float64]

SERIES = ("1", "angle", "|angle|", "angle^3", "sign(rate)", "rate", "rate |rate|", "|angle| sign(rate)")
SURE_OF_SIGN_RAD_S = 0.05  # the sign of a rate fades below, or no step of the integrator would converge


def series(  # a law takes what its place offers, needed or not
    phi: float,
    rate: float,
    elapsed: float,  # noqa: ARG001
    k0: float,  # noqa: ARG001
    k2: float,  # noqa: ARG001
    memory: Any,  # noqa: ARG001
    parameter: Any,
) -> tuple[float, float, float]:
    sign = np.tanh(rate / SURE_OF_SIGN_RAD_S)
    turn = (1.0 - sign * sign) / SURE_OF_SIGN_RAD_S
    side = 1.0 if phi >= 0.0 else -1.0
    even = parameter[0] + parameter[1] * phi + parameter[2] * abs(phi) + parameter[3] * phi * phi * phi
    odd = parameter[4] * sign + parameter[5] * rate + parameter[6] * rate * abs(rate) + parameter[7] * abs(phi) * sign
    by_angle = parameter[1] + parameter[2] * side + 3.0 * parameter[3] * phi * phi + parameter[7] * side * sign
    by_rate = parameter[4] * turn + parameter[5] + 2.0 * parameter[6] * abs(rate) + parameter[7] * abs(phi) * turn
    return even + odd, by_angle, by_rate


def series_in(place: ForceInput, terms: Sequence[str], coefficients: Floats) -> Change:
    """The law at a place in the hinges. `terms` are of SERIES."""
    row = [0.0] * len(SERIES)
    for term, coefficient in zip(terms, coefficients, strict=True):
        row[SERIES.index(term)] = float(coefficient)
    only = -1 if place.id == "hinges" else int(place.id.removeprefix("hinge")) - 1

    def change(setup: Setup) -> Setup:
        return with_law(setup, LawUse(HINGE, series, tuple(row), None, only))

    return change
