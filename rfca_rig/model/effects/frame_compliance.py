"""A frame that yields under the leg, along one line."""

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
        # it rings, and a start a tenth off is soon out of step
        Parameter("frequency_Hz", 5.0, 100.0, may_be_zero=False, starts=tuple(6.0 * 1.09**n for n in range(26))),
        Parameter("moving_mass_kg", 0.5, 50.0, may_be_zero=False, starts=(2.5,)),
        Parameter("damping_ratio", 0.005, 0.5, starts=(0.03,)),
    ),
    apply=apply,
    # Where the sensor sits decides what it feels: the leg alone (0), or the spring under the moving mass (1). With 3 kg on 20 Hz the share
    # changes fz by 2.0 N rms in the first 0.3 s of contact at 215 mm, 2.433 rad/s.
    # A frame that sways instead of sinking is another line of motion, at its own frequency.
    shape=(
        Parameter("mass_on_sensor_share", 0.0, 1.0, starts=(0.05, 0.95)),
        Parameter("lean_deg", -100.0, 100.0, starts=(0.0, 80.0)),
    ),
    # a leg that was let go rings the frame, by more than its weight would press it down
    begins=(Parameter("swing_sags", -4.0, 4.0), Parameter("swing_sags_per_s", -400.0, 400.0)),
)
