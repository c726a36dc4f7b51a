"""The faults of an AK drive in both of its modes, and what the drivers say of them."""

import re

import numpy as np
import pytest

from rfca_rig.contracts.motor_rig import motor_rig
from rfca_rig.devices.cubemars.driver.mit import CubemarsMitMotor, MitSettings
from rfca_rig.devices.cubemars.driver.servo import CubemarsServoMotor, ServoSettings
from rfca_rig.devices.cubemars.twin import (
    FAULTS,
    CubemarsMitTwin,
    CubemarsServoTwin,
    MitTwinSettings,
    ServoTwinSettings,
)
from rfca_rig.errors import DeviceError
from rfca_rig.twin_server.faults import CAN_FAULTS, DriveDialect, FaultPanel, TamperedBus

SERVO = {"gear_ratio": 9.0, "pole_pairs": 21, "torque_constant_Nm_per_A": 0.115}
MODES = {
    "MIT": (
        lambda bus, clock: CubemarsMitMotor(bus, clock, MitSettings(1, "AK80-9")),
        lambda bus: CubemarsMitTwin(bus, MitTwinSettings()),
    ),
    "servo": (
        lambda bus, clock: CubemarsServoMotor(bus, clock, ServoSettings(1, **SERVO)),
        lambda bus: CubemarsServoTwin(bus, ServoTwinSettings(**SERVO)),
    ),
}
SAID = {
    "can-silent": r"^no (reply|status)",
    "bus-off": r"^no (reply|status)",
    "can-short": r"^raises: .* 7 bytes|^replies lost their bytes for temperature and error",
    "own-frame-echo": r"^nothing$",
    # in MIT mode each belongs to a question
    "can-twice": r"^nothing$|^the speed that the drive reports is 2 times that of its angle",
    "encoder-jump": r"^position leapt by .* its encoder slipped",
    "over-temperature": r"^error 1 \(motor too hot",
    "encoder-lost": r"^error 5 \(encoder fault",
    "stalled": r"^error 7 \(motor stalled",
    "refuses": r"^nothing$|^error 1 \(motor too hot",  # in MIT mode not while the drive is enabled
    "drive-restart": r"^position leapt by",
    "drive-hot": r"^nothing$",
    "temperature-stuck": r"^nothing$",
    "encoder-frozen": r"^the speed that the drive reports|^nothing$",
}


def noticed(mode: str, name: str) -> str:
    """What the driver says after half a second of the fault, on a shaft that turns."""
    driver, twin = MODES[mode]
    panel = FaultPanel((*CAN_FAULTS, *FAULTS.faults))
    with motor_rig(driver, lambda bus: twin(TamperedBus(bus, panel, DriveDialect()))) as rig:
        rig.motor.enable()
        rig.run(0.4, speed_rad_s=1.0)
        events = FAULTS.events(rig.twin)
        if name in events:
            events[name]()
        else:
            panel.switch_on(name)
        try:
            angle_rad = rig.run(0.5, speed_rad_s=1.0).angle_rad
        except DeviceError as error:
            return f"raises: {error}"
        jump_rad = float(np.abs(np.diff(angle_rad)).max(initial=0.0))
        return rig.motor.status().fault or (
            f"angle jumps by {jump_rad:.2f} rad" if jump_rad > 0.1 else "nothing"
        )


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", SAID)
def test_a_fault_is_noticed_as_what_it_is(mode: str, name: str) -> None:
    said = noticed(mode, name)
    assert re.search(SAID[name], said), said


def test_the_list_is_whole() -> None:
    assert [fault.name for fault in (*CAN_FAULTS, *FAULTS.faults)] == list(SAID)


@pytest.mark.parametrize("mode", MODES)
def test_a_drive_that_refuses_is_told_apart_when_it_is_enabled_again(mode: str) -> None:
    driver, twin = MODES[mode]
    with motor_rig(driver, twin) as rig:
        rig.motor.enable()
        rig.motor.disable()
        FAULTS.events(rig.twin)["refuses"]()
        with pytest.raises(DeviceError, match=r"refuses with error 1 \(motor too hot"):
            rig.motor.enable()
