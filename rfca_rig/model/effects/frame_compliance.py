"""A compliant frame under the shaft: one mode of vibration along one line."""

import numpy as np

from rfca_rig.model.effect import Effect, Parameter, Values
from rfca_rig.model.parameters import GRAVITY_M_S2
from rfca_rig.model.setup import Setup, with_begin, with_chain
from rfca_rig.model.state import Chain, State


def apply(setup: Setup, values: Values) -> Setup:
    mass, rate, lean = values["moving_mass_kg"], 2.0 * np.pi * values["frequency_Hz"], np.radians(values["lean_deg"])

    def yielding(chain: Chain) -> Chain:
        return chain._replace(
            frame_mass=mass,
            frame_stiffness=mass * rate * rate,
            frame_damping=2.0 * values["damping_ratio"] * mass * rate,
            frame_on_sensor=values["mass_on_sensor_share"],
            frame_down=float(np.cos(lean)),
            frame_aside=float(np.sin(lean)),
        )

    # Sag: static deflection of the frame under the leg's weight, the natural unit of its initial oscillation.
    def ringing(chain: Chain, state: State) -> None:
        sag = chain.total_mass * GRAVITY_M_S2 / chain.frame_stiffness
        state.q[-1] += values["swing_sags"] * sag
        state.w[-1] += values["swing_sags_per_s"] * sag

    return with_begin(with_chain(setup, yielding), ringing)


EFFECT = Effect(
    id="frame_compliance",
    where="rig",
    left_out="frame and sensor yield",
    law="m x'' + 2 d m w x' + m w^2 x = fz cos(lean) - fy sin(lean), x along a line that leans from down towards y",
    source="one mode of vibration: Ewins, Modal Testing, 2000",
    parameters=(
        # It oscillates, and a start whose frequency is off by a tenth is soon out of phase.
        Parameter("frequency_Hz", 5.0, 100.0, may_be_zero=False, starts=tuple(6.0 * 1.09**n for n in range(26))),
        Parameter("moving_mass_kg", 0.5, 50.0, may_be_zero=False, starts=(2.5,)),
        Parameter("damping_ratio", 0.005, 0.5, starts=(0.03,)),
    ),
    apply=apply,
    # The position of the sensor decides what it measures: the leg alone (0), or the spring under the moving mass (1). With 3 kg at 20 Hz
    # the share changes fz by 2.0 N rms in the first 0.3 s of contact at 215 mm, 2.433 rad/s.
    # A frame that sways sideways instead of sinking moves along another line, at its own frequency.
    shape=(
        Parameter("mass_on_sensor_share", 0.0, 1.0, starts=(0.05, 0.95)),
        Parameter("lean_deg", -100.0, 100.0, starts=(0.0, 80.0)),
    ),
    # A leg that was released makes the frame oscillate, by more than its static deflection under the weight.
    begins=(Parameter("swing_sags", -4.0, 4.0), Parameter("swing_sags_per_s", -400.0, 400.0)),
)
