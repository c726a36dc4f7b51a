"""A plate with a bump, or a hollow, where the tip slides."""

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.setup import Setup, with_chain
from rfca_rig.model.state import Chain


def apply(setup: Setup, values: Values) -> Setup:
    height, at, width = (1e-3 * values[name] for name in ("height_mm", "at_mm", "width_mm"))

    def raise_floor(chain: Chain) -> Chain:
        return chain._replace(bump_height=height, bump_at=at, bump_width=width)

    return with_chain(setup, raise_floor)


EFFECT = Effect(
    id="ground_bump",
    where="ground",
    left_out="a bump or hollow of the floor",
    law="floor at -height + B exp(-((y - y_0) / b)^2), y from below the shaft to where the leg starts; depth along its normal",
    source="signed distance to a smooth profile: the nearest point carries the contact",
    # The paper's tip touches at +174 to +217 mm and leaves at -126 to -156 mm (racks of 195 to 235 mm, 2 to 3.3 rad/s), with the
    # valley of fz at -27 to -54 mm. A wider bump acts like a wrong height of the rack: a fitted height leaves 45 to 94 % of the effect of
    # a bump of 50 mm, and 4 to 26 % of that of 200 mm.
    parameters=(
        Parameter("height_mm", -5.0, 5.0, starts=(-1.5, 1.5)),
        Parameter("at_mm", -130.0, 190.0, starts=tuple(float(at) for at in range(-120, 181, 10))),
        Parameter("width_mm", 8.0, 50.0, may_be_zero=False, starts=(12.0, 30.0)),
    ),
    apply=apply,
)
