"""One hinge that is softer (or stiffer) than the others."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, link_of_hinge, with_chain
from rfca_rig.model.state import Chain


def apply(setup: Setup, values: Values) -> Setup:
    link = link_of_hinge(setup, "damaged_hinge", values["hinge"])

    # k0 scales the whole torque curve, with its hardening or its spline.
    def soften(chain: Chain) -> Chain:
        k0 = chain.k0.copy()
        k0[link] *= values["stiffness_factor"]
        return chain._replace(k0=k0)

    return with_chain(setup, soften)


EFFECT = Effect(
    id="damaged_hinge",
    where="one hinge",
    left_out="one hinge softer than its fellows",
    law="k0 of that hinge times a factor",
    source="-",
    parameters=(
        Parameter("hinge", 2.0, 7.0, whole=True),
        Parameter("stiffness_factor", 0.2, 0.95),
    ),
    apply=apply,
)
