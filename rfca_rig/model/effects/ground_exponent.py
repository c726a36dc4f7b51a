"""A contact whose force grows with another power of the depth: 1 for a line contact, 1.5 for a sphere."""

from dataclasses import replace
from typing import Any

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.laws import NORMAL, LawUse
from rfca_rig.model.setup import Setup
from rfca_rig.model.state import Chain

# Force at which the depth equals that of the nominal contact: about the contact force in mid-stroke.
REFERENCE_N = 20.0


def force(depth: float, rate: float, memory: Any, parameter: Any) -> tuple[float, float, float]:
    """Force beyond that of the nominal contact, and its derivatives.

    parameter = (stiffness of the nominal contact, exponent, damping of an end that enters, of one that leaves).
    """
    stiffness, exponent = parameter[0], parameter[1]
    damping = parameter[2] if rate > 0.0 else parameter[3]
    grow = 1.0 + damping * rate
    if grow <= 0.0 or depth <= 0.0:
        return 0.0, 0.0, 0.0
    reference_m = (REFERENCE_N / stiffness) ** (2.0 / 3.0)
    pushed, plain = REFERENCE_N * (depth / reference_m) ** exponent, stiffness * depth**1.5
    more = pushed - plain
    return more * grow, (exponent * pushed - 1.5 * plain) / depth * grow, more * damping


def apply(setup: Setup, values: Values) -> Setup:
    """Replaces the contact of the finished chain, which may include a compliant floor."""

    # Built from the finished chain, since another effect may still change its stiffness and damping.
    def law(chain: Chain) -> LawUse:
        return LawUse(NORMAL, force, (chain.contact_stiffness, values["exponent"], chain.contact_damping, chain.leaving_damping))

    return replace(setup, laws_of_chain=(*setup.laws_of_chain, law))


EFFECT = Effect(
    id="ground_exponent",
    where="ground",
    left_out="contact of another shape, as along a line",
    law="N = F (depth / b)^p (1 + c rate), F = 20 N, b where the nominal contact presses with F",
    source="exponent 1 for a line contact (Johnson 1985, ch. 4) or a bed of springs, 1.5 after Hertz, 2 for a cone (Sneddon 1965)",
    parameters=(Parameter("exponent", 1.0, 2.0, may_be_zero=False, starts=(1.0, 1.25, 2.0)),),
    apply=apply,
)
