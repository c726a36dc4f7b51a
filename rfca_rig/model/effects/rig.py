"""Effects of what surrounds the leg: the frame, the direction of gravity, and the fluid."""

from dataclasses import replace
from typing import Any

import numpy as np

from rfca_rig.model.declarations import rig as declared
from rfca_rig.model.effect import Parameter, Values
from rfca_rig.model.kernel.laws import LINK, LawUse
from rfca_rig.model.kernel.state import Chain, State
from rfca_rig.model.parameters import GRAVITY_M_S2
from rfca_rig.model.setup import SensorOutput, Setup, with_begin, with_chain, with_law, with_sensor

# A compliant frame under the shaft: one mode of vibration along one line.


def apply_frame_compliance(setup: Setup, values: Values) -> Setup:
    mass = values["moving_mass_kg"]
    rate = 2.0 * np.pi * values["frequency_Hz"]
    lean = np.radians(values["lean_deg"])

    def yielding(chain: Chain) -> Chain:
        return chain._replace(
            frame_mass=mass,
            frame_stiffness=mass * rate * rate,
            frame_damping=2.0 * values["damping_ratio"] * mass * rate,
            frame_on_sensor=values["mass_on_sensor_share"],
            frame_down=float(np.cos(lean)),
            frame_aside=float(np.sin(lean)),
        )

    # Sag: static deflection of the frame under the leg's weight, the natural unit of its initial
    # oscillation.
    def ringing(chain: Chain, state: State) -> None:
        sag = chain.total_mass * GRAVITY_M_S2 / chain.frame_stiffness
        state.q[-1] += values["swing_sags"] * sag
        state.w[-1] += values["swing_sags_per_s"] * sag

    return with_begin(with_chain(setup, yielding), ringing)


FRAME_COMPLIANCE = declared.FRAME_COMPLIANCE.make_effect(
    parameters=(
        # It oscillates, and a start whose frequency is off by a tenth is soon out of phase.
        Parameter(
            "frequency_Hz",
            5.0,
            100.0,
            may_be_zero=False,
            starts=tuple(6.0 * 1.09**n for n in range(26)),
        ),
        Parameter("moving_mass_kg", 0.5, 50.0, may_be_zero=False, starts=(2.5,)),
        Parameter("damping_ratio", 0.005, 0.5, starts=(0.03,)),
    ),
    apply=apply_frame_compliance,
    # The position of the sensor decides what it measures: the leg alone (0), or the spring under
    # the moving mass (1). With 3 kg at 20 Hz the share changes fz by 2.0 N rms in the first 0.3 s
    # of contact at 215 mm, 2.433 rad/s. A frame that sways sideways instead of sinking moves along
    # another line, at its own frequency.
    shape=(
        Parameter("mass_on_sensor_share", 0.0, 1.0, starts=(0.05, 0.95)),
        Parameter("lean_deg", -100.0, 100.0, starts=(0.0, 80.0)),
    ),
    # A leg that was released makes the frame oscillate, by more than its static deflection under
    # the weight.
    begins=(Parameter("swing_sags", -4.0, 4.0), Parameter("swing_sags_per_s", -400.0, 400.0)),
)


# A rig that is not plumb: gravity has a part along the floor.


def apply_gravity_tilt(setup: Setup, values: Values) -> Setup:
    """A positive angle makes gravity pull towards +y, where the leg starts.

    Shaft, floor and sensor lean together: in their axes only gravity turns. A sensor that was
    zeroed without the leg reads the part of the weight along y, -m g sin(angle); one that was
    zeroed otherwise reads an additional constant force along y.
    """

    def lean(chain: Chain) -> Chain:
        g = chain.gravity
        return chain._replace(
            gravity=g * float(np.cos(values["angle_rad"])),
            gravity_along=g * float(np.sin(values["angle_rad"])),
        )

    leaning = with_chain(setup, lean)
    weights = values["zero_shift_weights"]
    if weights == 0.0:
        return leaning
    shift_N = (
        weights
        * sum(setup.rig.leg.link_masses_kg)
        * GRAVITY_M_S2
        * float(np.sin(values["angle_rad"]))
    )
    below_m = setup.rig.sensor.below_shaft_m

    def shift_zero(felt: SensorOutput) -> SensorOutput:
        return replace(felt, fy_N=felt.fy_N - shift_N, tx_Nm=felt.tx_Nm - below_m * shift_N)

    return with_sensor(leaning, shift_zero)


GRAVITY_TILT = declared.GRAVITY_TILT.make_effect(
    parameters=(Parameter("angle_rad", -0.2, 0.2),),
    apply=apply_gravity_tilt,
    # In weights of the leg: 0 for a sensor zeroed without the leg on the leaning rig, -1 for one
    # zeroed with the leg on it, -2 for one that reads this part of the weight with the other sign;
    # other values where it was zeroed at another lean and carries a mount. From 0 alone, a fit does
    # not come to -2: fy at rest then asks for the other sign of the angle. At 0.05 rad, fy changes
    # by 0.4 N all along a stroke at -2.5 and 2.5
    shape=(Parameter("zero_shift_weights", -2.5, 2.5, starts=(-2.0, 0.0)),),
)


# Quadratic drag of the surrounding fluid, normal to the links.


def fluid_drag_force(v: float, length: float, memory: Any, parameter: Any) -> tuple[float, float]:
    return -parameter[0] * length * v * abs(v), -2.0 * parameter[0] * length * abs(v)


def apply_fluid_drag(setup: Setup, values: Values) -> Setup:
    return with_law(setup, LawUse(LINK, fluid_drag_force, (values["coefficient_N_s2_per_m3"],)))


FLUID_DRAG = declared.FLUID_DRAG.make_effect(
    parameters=(Parameter("coefficient_N_s2_per_m3", 0.05, 50.0),),
    apply=apply_fluid_drag,
)


EFFECTS = (
    FRAME_COMPLIANCE,
    GRAVITY_TILT,
    FLUID_DRAG,
)
