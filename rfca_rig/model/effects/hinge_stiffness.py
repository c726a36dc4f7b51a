"""Effects on the torque of the hinges over their angle."""

from dataclasses import replace
from typing import Any

import numpy as np

from rfca_rig.model.declarations import hinges as declared
from rfca_rig.model.effect import Parameter, Values
from rfca_rig.model.kernel.laws import HINGE, LawUse
from rfca_rig.model.kernel.state import Chain
from rfca_rig.model.setup import Setup, link_of_hinge, with_chain, with_law

# One hinge that is softer (or stiffer) than the others.


def apply_damaged_hinge(setup: Setup, values: Values) -> Setup:
    link = link_of_hinge(setup, declared.DAMAGED_HINGE.id, values["hinge"])

    # k0 scales the whole torque curve, with its hardening or its spline.
    def soften(chain: Chain) -> Chain:
        k0 = chain.k0.copy()
        k0[link] *= values["stiffness_factor"]
        return chain._replace(k0=k0)

    return with_chain(setup, soften)


DAMAGED_HINGE = declared.DAMAGED_HINGE.make_effect(
    parameters=(
        Parameter("hinge", 2.0, 7.0, whole=True),
        Parameter("stiffness_factor", 0.2, 0.95),
    ),
    apply=apply_damaged_hinge,
)


# Play in the hinges: the spring engages only beyond half the gap.


def hinge_backlash_torque(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    # The chain has added the nominal spring already: the law is the spring with play less the
    # spring without.
    bent = max(abs(phi) - parameter[0], 0.0)
    engaged = np.sign(phi) * k0 * bent * (1.0 + k2 * bent * bent)
    if bent > 0.0:
        slope = k0 * (1.0 + 3.0 * k2 * bent * bent)
    else:
        slope = 0.0
    return (
        engaged - k0 * phi * (1.0 + k2 * phi * phi),
        slope - k0 * (1.0 + 3.0 * k2 * phi * phi),
        0.0,
    )


def apply_hinge_backlash(setup: Setup, values: Values) -> Setup:
    return with_law(
        setup, LawUse(HINGE, hinge_backlash_torque, (np.radians(values["half_gap_deg"]),))
    )


HINGE_BACKLASH = declared.HINGE_BACKLASH.make_effect(
    parameters=(Parameter("half_gap_deg", 0.05, 4.0),),
    apply=apply_hinge_backlash,
)


# Shell segments that meet: stiff beyond an angle, either way.

# Forces determine the angle of a stop to a quarter of a degree: a start that is off by half a
# degree shows no improvement.
ANGLES_DEG = (6.0, 8.0, 10.0, 12.0, *(14.0 + 0.4 * n for n in range(51)), 36.0)


# Rotation into the stop at which its torque does not depend on the exponent, about 3 degrees.
REFERENCE_RAD = 0.05
# Share of the reference: keeps the slope finite at the stop's beginning for exponents below one.
ROUNDED = 0.01


def hinge_stop_torque(
    phi: float, rate: float, elapsed: float, k0: float, k2: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    beyond = abs(phi) - parameter[0]
    if beyond <= 0.0:
        return 0.0, 0.0, 0.0
    # Without the rounding, so that the neutral exponent is exactly a linear spring.
    if parameter[2] == 1.0:
        return np.sign(phi) * parameter[1] * beyond, parameter[1], 0.0
    u = beyond / REFERENCE_RAD + ROUNDED
    n = parameter[2]
    return (
        np.sign(phi) * parameter[1] * REFERENCE_RAD * (u**n - ROUNDED**n),
        parameter[1] * n * u ** (n - 1.0),
        0.0,
    )


def apply_hinge_stop(setup: Setup, values: Values) -> Setup:
    return with_law(
        setup,
        LawUse(
            HINGE,
            hinge_stop_torque,
            (np.radians(values["angle_deg"]), values["stiffness_Nm_per_rad"], values["exponent"]),
        ),
    )


HINGE_STOP = declared.HINGE_STOP.make_effect(
    parameters=(
        Parameter("angle_deg", 5.0, 45.0, starts=ANGLES_DEG),
        Parameter("stiffness_Nm_per_rad", 10.0, 1000.0, starts=(13.0, 40.0)),
    ),
    apply=apply_hinge_stop,
    # At 18 degrees and 40 N m/rad, fz over a stroke (215 mm, 2.433 rad/s) changes by 0.39 N rms
    # with an exponent of 0.8, 1.64 N with 2.5.
    shape=(Parameter("exponent", 0.8, 2.5, may_be_zero=False, neutral=1.0),),
)


# Hinges that have taken a set: without load the leg is bent.


def shift_rest(setup: Setup, angle_deg: float, hinges: slice) -> Setup:
    """Adds to the rest angle of these hinges, counted as the chain's links."""

    def shift(chain: Chain) -> Chain:
        rest = chain.rest.copy()
        rest[hinges] += np.radians(angle_deg)
        return chain._replace(rest=rest)

    return with_chain(setup, shift)


def apply_hinge_rest_angle(setup: Setup, values: Values) -> Setup:
    return shift_rest(setup, values["angle_deg"], slice(1, None))


HINGE_REST_ANGLE = declared.HINGE_REST_ANGLE.make_effect(
    parameters=(Parameter("angle_deg", -6.0, 6.0),),
    apply=apply_hinge_rest_angle,
)


# One hinge that has taken a set.


def apply_hinge_rest_angle_of_one(setup: Setup, values: Values) -> Setup:
    link = link_of_hinge(setup, declared.HINGE_REST_ANGLE_OF_ONE.id, values["hinge"])
    return shift_rest(setup, values["angle_deg"], slice(link, link + 1))


HINGE_REST_ANGLE_OF_ONE = declared.HINGE_REST_ANGLE_OF_ONE.make_effect(
    parameters=(Parameter("hinge", 2.0, 7.0, whole=True), Parameter("angle_deg", -6.0, 6.0)),
    apply=apply_hinge_rest_angle_of_one,
)


# Another hardening k2 of the hinges' torque curve than the nominal one.


def apply_stiffness_hardening(setup: Setup, values: Values) -> Setup:
    return replace(
        setup, rig=replace(setup.rig, leg=replace(setup.rig.leg, k2_per_rad2=values["k2_per_rad2"]))
    )


STIFFNESS_HARDENING = declared.STIFFNESS_HARDENING.make_effect(
    parameters=(Parameter("k2_per_rad2", 0.0, 15.0),),
    apply=apply_stiffness_hardening,
)


# Hinges that lose stiffness with every stroke.


def apply_stiffness_fading(setup: Setup, values: Values) -> Setup:
    """The mean factor over the strokes whose mean is simulated; that of the first stroke where
    they were not counted.
    """
    decades = np.log10(1.0 + np.array(setup.strokes_before or (0,)))
    factor = float(np.mean((1.0 - values["loss_per_decade_relative"]) ** decades))

    def soften(chain: Chain) -> Chain:
        return chain._replace(k0=factor * chain.k0)

    return with_chain(setup, soften)


STIFFNESS_FADING = declared.STIFFNESS_FADING.make_effect(
    parameters=(Parameter("loss_per_decade_relative", 0.005, 0.2, below=1.0),),
    apply=apply_stiffness_fading,
)


EFFECTS = (
    DAMAGED_HINGE,
    HINGE_BACKLASH,
    HINGE_STOP,
    HINGE_REST_ANGLE,
    HINGE_REST_ANGLE_OF_ONE,
    STIFFNESS_HARDENING,
    STIFFNESS_FADING,
)
