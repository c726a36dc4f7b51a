"""A rig that is not plumb: gravity has a part along the floor."""

from dataclasses import replace

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.parameters import GRAVITY_M_S2
from rfca_rig.model.setup import SensorOutput, Setup, with_chain, with_sensor
from rfca_rig.model.state import Chain


def apply(setup: Setup, values: Values) -> Setup:
    """A positive angle makes gravity pull towards +y, where the leg starts.

    Shaft, floor and sensor lean together: in their axes only gravity turns. A sensor that was zeroed without the leg reads the part of
    the weight along y, -m g sin(angle); one that was zeroed otherwise reads an additional constant force along y.
    """

    def lean(chain: Chain) -> Chain:
        g = chain.gravity
        return chain._replace(gravity=g * float(np.cos(values["angle_rad"])), gravity_along=g * float(np.sin(values["angle_rad"])))

    leaning = with_chain(setup, lean)
    weights = values["zero_shift_weights"]
    if weights == 0.0:
        return leaning
    shift_N = weights * sum(setup.rig.leg.link_masses_kg) * GRAVITY_M_S2 * float(np.sin(values["angle_rad"]))
    below_m = setup.rig.sensor.below_shaft_m

    def shift_zero(felt: SensorOutput) -> SensorOutput:
        return replace(felt, fy_N=felt.fy_N - shift_N, tx_Nm=felt.tx_Nm - below_m * shift_N)

    return with_sensor(leaning, shift_zero)


EFFECT = Effect(
    id="gravity_tilt",
    where="rig",
    left_out="rig not plumb",
    law="gravity = g (sin, cos) of the angle, along y and down; fy - s m g sin(angle), s = 0 unless given",
    source="-",
    parameters=(Parameter("angle_rad", -0.2, 0.2),),
    apply=apply,
    # In weights of the leg: 0 for a sensor zeroed without the leg on the leaning rig, -1 for one zeroed with the leg on it, -2 for one
    # that reads this part of the weight with the other sign; other values where it was zeroed at another lean and carries a mount.
    # From 0 alone, a fit does not come to -2: fy at rest then asks for the other sign of the angle.
    # At 0.05 rad, fy changes by 0.4 N all along a stroke at -2.5 and 2.5
    shape=(Parameter("zero_shift_weights", -2.5, 2.5, starts=(-2.0, 0.0)),),
)
