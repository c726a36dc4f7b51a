"""Effects of the floor: its compliance, friction, adhesion and shape."""

from dataclasses import replace
from typing import Any

import numpy as np

from rfca_rig.model.declarations import ground as declared
from rfca_rig.model.effect import Parameter, Values
from rfca_rig.model.kernel.laws import NORMAL, SLIP, LawUse
from rfca_rig.model.kernel.state import Chain
from rfca_rig.model.setup import Setup, with_chain, with_law

# A compliant floor in series with the nominal contact.

AS_THE_GROUND = 1.5
# Force at which the depth of the soft floor does not depend on its exponent: about the contact
# force in mid-stroke.
REFERENCE_N = 20.0
ROUNDS = 8  # of Newton's iteration at most, in logarithms: to rounding for exponents from 0.5 to 3
CONVERGED = 1e-7  # of log N: the error after the next iteration, its square, is below rounding


def ground_compliance_force(
    depth: float, rate: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    """Force of the two springs in series beyond that with the ground's exponent, and its
    derivatives.

    parameter = (stiffness of the ground, of the soft floor, of both with the ground's exponent,
    exponent of the soft floor, damping of an end that enters, of one that leaves).
    """
    hard = parameter[0]
    both = parameter[2]
    exponent = parameter[3]
    reference_m = (REFERENCE_N / parameter[1]) ** (2.0 / 3.0)
    damping = parameter[4] if rate > 0.0 else parameter[5]
    grow = 1.0 + damping * rate
    if grow <= 0.0 or depth <= 0.0:
        return 0.0, 0.0, 0.0
    plain = both * depth**1.5
    # Newton's iteration for the N at which both depths add up to the given one. In logarithms N
    # stays positive.
    log_N = np.log(plain)
    softness = depth
    for _ in range(ROUNDS):
        first = np.exp((log_N - np.log(hard)) * 2.0 / 3.0)
        second = reference_m * np.exp((log_N - np.log(REFERENCE_N)) / exponent)
        softness = first * 2.0 / 3.0 + second / exponent
        step = np.log((first + second) / depth) * (first + second) / softness
        log_N -= step
        if abs(step) < CONVERGED:
            break
    N = np.exp(log_N)
    N_depth = N / softness
    return (N - plain) * grow, (N_depth - 1.5 * plain / depth) * grow, (N - plain) * damping


def apply_ground_compliance(setup: Setup, values: Values) -> Setup:
    """Two springs in series: depths add, so k^(-2/3) adds where both are Hertz's."""
    rig = setup.rig
    ground = setup.rig.ground
    stiffness = values["stiffness_N_per_m1p5"]
    hard, added = (k ** (-2.0 / 3.0) for k in (ground.stiffness_N_per_m1p5, stiffness))
    both = (hard + added) ** -1.5
    softer = replace(setup, rig=replace(rig, ground=replace(ground, stiffness_N_per_m1p5=both)))
    # With equal exponents the series is one Hertz contact, and no law is needed.
    if values["exponent"] == AS_THE_GROUND:
        return softer
    leaving = ground.damping_s_per_m * ground.leaving_damping_share
    shape = (
        ground.stiffness_N_per_m1p5,
        stiffness,
        both,
        values["exponent"],
        ground.damping_s_per_m,
        leaving,
    )
    return with_law(softer, LawUse(NORMAL, ground_compliance_force, shape))


GROUND_COMPLIANCE = declared.GROUND_COMPLIANCE.make_effect(
    parameters=(Parameter("stiffness_N_per_m1p5", 5000.0, 1000000.0, may_be_zero=False),),
    apply=apply_ground_compliance,
    # At 2e5 N/m^1.5, fz over a stroke (215 mm, 2.433 rad/s) changes by 6.3 N rms with an exponent
    # of 1, and by 2.2 N with 2.
    shape=(Parameter("exponent", 1.0, 2.0, may_be_zero=False, neutral=AS_THE_GROUND),),
)


# A contact whose force grows with another power of the depth: 1 for a line contact, 1.5 for a
# sphere.

# Force at which the depth equals that of the nominal contact: about the contact force in
# mid-stroke.
EXPONENT_REFERENCE_N = 20.0


def ground_exponent_force(
    depth: float, rate: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    """Force beyond that of the nominal contact, and its derivatives.

    parameter = (stiffness of the nominal contact, exponent, damping of an end that enters, of one
    that leaves).
    """
    stiffness = parameter[0]
    exponent = parameter[1]
    damping = parameter[2] if rate > 0.0 else parameter[3]
    grow = 1.0 + damping * rate
    if grow <= 0.0 or depth <= 0.0:
        return 0.0, 0.0, 0.0
    reference_m = (EXPONENT_REFERENCE_N / stiffness) ** (2.0 / 3.0)
    pushed = EXPONENT_REFERENCE_N * (depth / reference_m) ** exponent
    plain = stiffness * depth**1.5
    more = pushed - plain
    return more * grow, (exponent * pushed - 1.5 * plain) / depth * grow, more * damping


def apply_ground_exponent(setup: Setup, values: Values) -> Setup:
    """Replaces the contact of the finished chain, which may include a compliant floor."""

    # Built from the finished chain, since another effect may still change its stiffness and
    # damping.
    def law(chain: Chain) -> LawUse:
        return LawUse(
            NORMAL,
            ground_exponent_force,
            (
                chain.contact_stiffness,
                values["exponent"],
                chain.contact_damping,
                chain.leaving_damping,
            ),
        )

    return replace(setup, laws_of_chain=(*setup.laws_of_chain, law))


GROUND_EXPONENT = declared.GROUND_EXPONENT.make_effect(
    parameters=(Parameter("exponent", 1.0, 2.0, may_be_zero=False, starts=(1.0, 1.25, 2.0)),),
    apply=apply_ground_exponent,
)


# Floor friction that falls with sliding speed.

# Share of the speed scale. It keeps the slope finite at rest for exponents below one, and does not
# change an exponent of one.
ROUNDED = 1e-3


def ground_stribeck_factor(v: float, memory: Any, parameter: Any) -> tuple[float, float]:
    u = abs(v) / parameter[1] + ROUNDED
    d = parameter[2]
    rise = parameter[0] * np.exp(ROUNDED**d - u**d)
    return 1.0 + rise, -np.sign(v) * rise * d * u ** (d - 1.0) / parameter[1]


def apply_ground_stribeck(setup: Setup, values: Values) -> Setup:
    return with_law(
        setup,
        LawUse(
            SLIP,
            ground_stribeck_factor,
            (values["rise_relative"], values["speed_m_s"], values["exponent"]),
        ),
    )


GROUND_STRIBECK = declared.GROUND_STRIBECK.make_effect(
    parameters=(
        Parameter("rise_relative", 0.05, 1.0),
        Parameter("speed_m_s", 0.005, 1.0, may_be_zero=False),
    ),
    apply=apply_ground_stribeck,
    # At a rise of 0.3 and 0.1 m/s, fz over a stroke (215 mm, 2.433 rad/s) changes by 0.50 N rms
    # with exponent 0.4, by 0.08 N with 2.5.
    shape=(Parameter("exponent", 0.4, 2.5, may_be_zero=False, neutral=1.0),),
)


# Adhesion of the floor, which holds the leg back at lift-off.


def ground_adhesion_force(
    depth: float, rate: float, memory: Any, parameter: Any
) -> tuple[float, float, float]:
    # The force builds up over a reach: a constant force would jump where the tip touches.
    left = np.exp(-depth / parameter[1])
    return -parameter[0] * (1.0 - left), -parameter[0] * left / parameter[1], 0.0


def apply_ground_adhesion(setup: Setup, values: Values) -> Setup:
    return with_law(
        setup, LawUse(NORMAL, ground_adhesion_force, (values["force_N"], 1e-3 * values["reach_mm"]))
    )


GROUND_ADHESION = declared.GROUND_ADHESION.make_effect(
    parameters=(Parameter("force_N", 0.1, 20.0),),
    apply=apply_ground_adhesion,
    # Depth over which adhesion builds up. The force depends on depth alone, so it creates no energy
    # for any shape. At 2 N, fy over a stroke (215 mm, 2.433 rad/s) changes by 0.001 N rms at 0.01
    # mm and 0.03 N at 1 mm
    shape=(Parameter("reach_mm", 0.01, 1.0, may_be_zero=False, neutral=0.05),),
)


# A floor that is not level.


def apply_ground_tilt(setup: Setup, values: Values) -> Setup:
    """A positive slope rises towards +y, where the leg starts."""
    angle = np.arctan(values["slope"])

    def tilt(chain: Chain) -> Chain:
        return chain._replace(floor_cos=float(np.cos(angle)), floor_sin=-float(np.sin(angle)))

    return with_chain(setup, tilt)


GROUND_TILT = declared.GROUND_TILT.make_effect(
    parameters=(Parameter("slope", -0.1, 0.1),),
    apply=apply_ground_tilt,
)


# A plate with a bump, or a hollow, where the tip slides.


def apply_ground_bump(setup: Setup, values: Values) -> Setup:
    height, at, width = (1e-3 * values[name] for name in ("height_mm", "at_mm", "width_mm"))

    def raise_floor(chain: Chain) -> Chain:
        return chain._replace(bump_height=height, bump_at=at, bump_width=width)

    return with_chain(setup, raise_floor)


GROUND_BUMP = declared.GROUND_BUMP.make_effect(
    # The paper's tip touches at +174 to +217 mm and leaves at -126 to -156 mm (racks of 195 to 235
    # mm, 2 to 3.3 rad/s), with the valley of fz at -27 to -54 mm. A wider bump acts like a wrong
    # height of the rack: a fitted height leaves 45 to 94 % of the effect of a bump of 50 mm, and 4
    # to 26 % of that of 200 mm.
    parameters=(
        Parameter("height_mm", -5.0, 5.0, starts=(-1.5, 1.5)),
        Parameter("at_mm", -130.0, 190.0, starts=tuple(float(at) for at in range(-120, 181, 10))),
        Parameter("width_mm", 8.0, 50.0, may_be_zero=False, starts=(12.0, 30.0)),
    ),
    apply=apply_ground_bump,
)


# A rack that is higher or lower than stated.


def apply_height_offset(setup: Setup, values: Values) -> Setup:
    return replace(setup, height_m=setup.height_m + 1e-3 * values["offset_mm"])


HEIGHT_OFFSET = declared.HEIGHT_OFFSET.make_effect(
    parameters=(Parameter("offset_mm", -10.0, 10.0),),
    apply=apply_height_offset,
)


EFFECTS = (
    GROUND_COMPLIANCE,
    GROUND_EXPONENT,
    GROUND_STRIBECK,
    GROUND_ADHESION,
    GROUND_TILT,
    GROUND_BUMP,
    HEIGHT_OFFSET,
)
