"""A drive that watches whether the shaft moves when energised takes a leg that still swings for
what it is.
"""

import math
from collections.abc import Callable
from contextlib import AbstractContextManager

import pytest

from rfca_rig.contracts.motor_rig import MotorRig, Rotor, motor_rig
from rfca_rig.devices.cubemars.driver.mit import CubemarsMitMotor, MitSettings
from rfca_rig.devices.cubemars.driver.servo import CubemarsServoMotor, ServoSettings
from rfca_rig.devices.cubemars.twin import (
    CubemarsMitTwin,
    CubemarsServoTwin,
    MitTwinSettings,
    ServoTwinSettings,
)
from rfca_rig.errors import DeviceError
from rfca_rig.twins.world import ShaftDrive

SERVO = {"gear_ratio": 9.0, "pole_pairs": 21, "torque_constant_Nm_per_A": 0.1}
SWINGS_PER_S = 2.5
HANGS_RAD = 0.9


class SwingingLeg(Rotor):
    """Hangs from the shaft: without torque it swings with an amplitude that falls as exp(-fading
    t).
    """

    fading_per_s = 0.0

    def _step(self, drive: ShaftDrive, h: float) -> None:
        pull_per_s2 = (2.0 * math.pi * SWINGS_PER_S) ** 2 * (self.angle_rad - HANGS_RAD)
        self.load_Nm = -self.inertia_kg_m2 * (
            pull_per_s2 + 2.0 * self.fading_per_s * self.speed_rad_s
        )
        super()._step(drive, h)


def leg(fading_per_s: float) -> SwingingLeg:
    swinging = SwingingLeg()
    swinging.fading_per_s = fading_per_s
    return swinging


def mit(rotor: Rotor) -> AbstractContextManager[MotorRig]:
    return motor_rig(
        lambda bus, clock: CubemarsMitMotor(bus, clock, MitSettings(1, "AK80-9")),
        lambda bus: CubemarsMitTwin(bus, MitTwinSettings()),
        rotor,
    )


def servo(rotor: Rotor) -> AbstractContextManager[MotorRig]:
    return motor_rig(
        lambda bus, clock: CubemarsServoMotor(bus, clock, ServoSettings(1, **SERVO)),
        lambda bus: CubemarsServoTwin(bus, ServoTwinSettings(**SERVO)),
        rotor,
    )


@pytest.mark.parametrize("rig", [mit, servo])
@pytest.mark.parametrize("swung_s", [0.0, 0.06, 0.1, 0.16])
def test_it_is_energised_where_the_leg_came_to_rest(
    rig: Callable[..., AbstractContextManager[MotorRig]], swung_s: float
) -> None:
    with rig(leg(fading_per_s=4.0)) as r:
        r.clock.wait_until(swung_s)
        r.motor.enable()
        r.run(0.1, angle_rad=HANGS_RAD)
        assert r.rotor.angle_rad == pytest.approx(HANGS_RAD, abs=0.02)


@pytest.mark.parametrize("rig", [mit, servo])
def test_a_leg_that_swings_on_is_refused_without_torque(
    rig: Callable[..., AbstractContextManager[MotorRig]],
) -> None:
    with rig(leg(fading_per_s=0.0)) as r:
        with pytest.raises(
            DeviceError,
            match=(
                r"without torque the shaft turns at .* rad/s, and does not come to rest "
                r"within 3 s"
            ),
        ):
            r.motor.enable()
        r.tick()
        assert all(law.torque_Nm(1.0, 1.0) == 0.0 for _, law in r.rotor.drives)
