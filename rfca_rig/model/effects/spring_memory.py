"""Effects of a spring that remembers how it was bent: hysteresis and relaxation."""

from typing import Any

import numpy as np
from numba import njit

from rfca_rig.model.declarations import hinges as declared
from rfca_rig.model.effect import EqualLimit, Parameter, Values
from rfca_rig.model.kernel.compiled import jit_internal
from rfca_rig.model.kernel.laws import HINGE, LawUse
from rfca_rig.model.setup import Setup, with_law

# Rate-independent hysteresis in parallel to the hinge spring (Bouc-Wen).

# Longest step of Runge-Kutta, in saturations. Its error is 2e-4 of the loop rms and 3e-3 at most,
# for exponents from 0.5 to 3.
LONGEST = 0.3
# A travel below SHORT, and below NEAR of the distance to z = 0, is one Taylor step, with an error
# of 5e-6 of the loop at most. |z|^n is not smooth at 0.
SHORT = 0.03
NEAR = 0.1
SATURATED = 20.0  # travel in saturations after which the loop is saturated to rounding
PRESLIDING_AT_MOST_DEG = 1.5  # of hinge_coulomb_friction


@jit_internal
def loop_slope(along: float, exponent: float) -> float:
    """dz/du, with u the turn over the saturation and both counted along the direction of
    turning.
    """
    if exponent == 1.0:
        return 1.0 - along
    return 1.0 - np.sign(along) * abs(along) ** exponent  # type: ignore[no-any-return]


@jit_internal
def follow_loop(along: float, travel: float, exponent: float) -> tuple[float, float]:
    """z and dz/du after turning on by `travel` in one direction; exact for an exponent of one.

    Most travels of a simulation are short. They need a single power, as z' = 1 - s |z|^n gives all
    further derivatives.
    """
    if exponent == 1.0:
        along = 1.0 - (1.0 - along) * np.exp(-travel)
        return along, 1.0 - along
    if travel > SATURATED:
        return 1.0, 0.0
    if travel < SHORT and travel < NEAR * abs(along):
        power = abs(along) ** exponent
        first = 1.0 - np.sign(along) * power
        bend = -exponent * power / abs(along)
        second = bend * first
        third = bend * ((exponent - 1.0) / along * first * first + second)
        z = along + travel * (first + travel * (second / 2.0 + travel * third / 6.0))
        return z, first + travel * (second + travel * third / 2.0)
    # The classical Runge-Kutta scheme of fourth order.
    steps = int(travel / LONGEST) + 1
    h = travel / steps
    for _ in range(steps):
        first = loop_slope(along, exponent)
        second = loop_slope(along + 0.5 * h * first, exponent)
        third = loop_slope(along + 0.5 * h * second, exponent)
        along += (
            h / 6.0 * (first + 2.0 * (second + third) + loop_slope(along + h * third, exponent))
        )
    return along, loop_slope(along, exponent)


def spring_hysteresis_torque(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    """Torque of the loop; memory = (z, phi) at the last step, parameter = (strength, saturation
    angle, exponent).
    """
    side = 1.0 if phi >= memory[1] else -1.0
    along, slope = follow_loop(side * memory[0], abs(phi - memory[1]) / parameter[1], parameter[2])
    full = parameter[0] * k0 * parameter[1]
    return full * side * along, full * slope / parameter[1], 0.0


def spring_hysteresis_advance(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> None:
    side = 1.0 if phi >= memory[1] else -1.0
    memory[0] = (
        side * follow_loop(side * memory[0], abs(phi - memory[1]) / parameter[1], parameter[2])[0]
    )
    memory[1] = phi


def apply_spring_hysteresis(setup: Setup, values: Values) -> Setup:
    shape = (values["strength_relative"], np.radians(values["saturation_deg"]), values["exponent"])
    return with_law(
        setup, LawUse(HINGE, spring_hysteresis_torque, shape, spring_hysteresis_advance)
    )


def saturates_as_a_pin_slips(values: Values) -> bool:
    """Whether the loop saturates within the presliding of a pin."""
    return values["saturation_deg"] <= PRESLIDING_AT_MOST_DEG


SPRING_HYSTERESIS = declared.SPRING_HYSTERESIS.make_effect(
    parameters=(
        Parameter("strength_relative", 0.02, 1.0),
        Parameter("saturation_deg", 0.5, 20.0, may_be_zero=False),
    ),
    apply=apply_spring_hysteresis,
    # At a strength of 0.2 and 4 degrees, fz over a stroke (215 mm, 2.433 rad/s) changes by 0.13 N
    # rms with exponent 0.5, 0.12 N with 3.
    shape=(Parameter("exponent", 0.5, 3.0, may_be_zero=False, neutral=1.0),),
    # fy, fz and tx of two strokes up to lift-off, strength 0.3: fitted friction leaves 2 to 7 % of
    # the effect at 0.5 degrees, 7 to 19 % at 1.5
    equal_limits=(
        EqualLimit(
            declared.HINGE_COULOMB_FRICTION.id,
            "saturation within what a pin yields before it slips",
            saturates_as_a_pin_slips,
        ),
    ),
)


# A viscoelastic arm in parallel to the hinge spring: a spring in series with a dashpot (Maxwell).
#
# It models the creep in strokes and in static stages, where the relaxation continues from stage to
# stage.


def slack(phi: float, elapsed: float, memory: Any, tau: float) -> tuple[float, float]:
    """Dashpot angle x and dx/dphi after `elapsed` [s], exact for a phi that moves linearly;
    memory = (x, phi) at the last step.
    """
    if elapsed <= 0.0:
        return memory[0], 0.0
    left = np.exp(-elapsed / tau)
    share = tau / elapsed
    gained = phi - memory[1]
    return phi - gained * share * (1.0 - left) + (memory[0] - memory[1]) * left, 1.0 - share * (
        1.0 - left
    )


slack = njit(slack, error_model="numpy")


def spring_relaxation_torque(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    x, x_phi = slack(phi, elapsed, memory, parameter[1])
    return parameter[0] * k0 * (phi - x), parameter[0] * k0 * (1.0 - x_phi), 0.0


def spring_relaxation_advance(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> None:
    memory[0] = slack(phi, elapsed, memory, parameter[1])[0]
    memory[1] = phi


def apply_spring_relaxation(setup: Setup, values: Values) -> Setup:
    return with_law(
        setup,
        LawUse(
            HINGE,
            spring_relaxation_torque,
            (values["strength_relative"], values["time_constant_s"]),
            spring_relaxation_advance,
        ),
    )


SPRING_RELAXATION = declared.SPRING_RELAXATION.make_effect(
    # Creep with log time, 4 % per decade from 10 ms to 100 s: one arm beside k0 leaves 3 % of its
    # effect in strokes, 7 % in static stages held for 1 s, and 5 % in both, with time constants of
    # 0.3 to 2 s. An arm slower than 1 s acts as a stiffer, less hardening spring in a stroke:
    # another k0 and k2 leave 8 % of it; in static stages they leave 49 % at 1 s, 20 % at 10 s, 8 %
    # at 30 s.
    parameters=(
        Parameter("strength_relative", 0.02, 1.0),
        Parameter("time_constant_s", 0.01, 10.0, may_be_zero=False),
    ),
    apply=apply_spring_relaxation,
)


EFFECTS = (
    SPRING_HYSTERESIS,
    SPRING_RELAXATION,
)
