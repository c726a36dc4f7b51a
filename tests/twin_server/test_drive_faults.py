"""The faults of drives other than a newer ODrive, and what their drivers say of them."""

import re
from contextlib import ExitStack
from typing import Any

import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.motor_rig import Rotor
from rfca_rig.devices.moteus.driver import MoteusMotor, MoteusSettings
from rfca_rig.devices.moteus.twin import FAULTS as MOTEUS_FAULTS
from rfca_rig.devices.moteus.twin import (
    MoteusDialect,
    MoteusTwin,
    MoteusTwinSettings,
    moteus_events,
)
from rfca_rig.devices.netft.twin import NetFtTwin, NetFtTwinSettings
from rfca_rig.devices.odrive.driver import OdriveMotor, OdriveSettings
from rfca_rig.devices.odrive.messages import OdriveFirmware
from rfca_rig.devices.odrive.twin import FAULTS as ODRIVE_FAULTS
from rfca_rig.devices.odrive.twin import (
    OdriveDialect,
    OdriveTwin,
    OdriveTwinSettings,
    odrive_events,
)
from rfca_rig.errors import DeviceError
from rfca_rig.twin_server.faults import CAN_FAULTS, FaultPanel, TamperedBus
from rfca_rig.twins.wires import can_wire, datagram_link
from rfca_rig.twins.world import TwinWorld

TICK_S = 2e-3
OLDER = {"dialect": OdriveFirmware.V0_5, "torque_constant_Nm_per_A": 0.5}

MOTEUS = {
    "can-silent": r"^no answer for 0\.\d+ s",
    "bus-off": r"^no answer for 0\.\d+ s",
    "can-short": r"^raises: moteus frame ends .* bytes too early",
    "own-frame-echo": r"^nothing$",
    "can-twice": r"^nothing$",  # the second of two answers to one question is none
    "encoder-jump": r"^position leapt by 6\.2[89] rad",
    "watchdog-trip": r"^mode 11 \(timeout",
    "over-temperature": r"^fault 38 \(over temperature",
    "factory-settings": r"^the drive restarted",
    "drive-restart": r"^the drive restarted, its millisecond counter began again",
    "drive-hot": r"^nothing$",
    "temperature-stuck": r"^nothing$",
    "encoder-frozen": r"^nothing$",
}
OLDER_ODRIVE = {
    "can-short": r"^raises: .* has 7 bytes, expected 8; does the drive speak CANSimple 0\.5",
    "heartbeat-silent": r"^no heartbeat for",
    "encoder-jump": r"^position leapt by 6\.2[89] rad",
    "drive-restart": r"^position leapt by -\d\.\d\d rad",
    "watchdog-trip": r"^error 0x00000800 \(WATCHDOG_TIMER_EXPIRED",
    "over-temperature": r"^error 0x00040000 \(OVER_TEMP",
    "idle-unasked": r"^left closed loop",
}


def noticed(name: str, older_odrive: bool = False) -> str:
    """What the driver says after half a second of the fault, on a shaft that turns."""
    with ExitStack() as stack:
        clock = TwinClock()
        panel = FaultPanel(
            (*CAN_FAULTS, *(ODRIVE_FAULTS if older_odrive else MOTEUS_FAULTS).faults)
        )
        here, there = stack.enter_context(can_wire())
        bus = TamperedBus(there, panel, OdriveDialect() if older_odrive else MoteusDialect())
        stack.callback(bus.shutdown)
        drive: Any = (
            OdriveTwin(bus, OdriveTwinSettings(**OLDER))
            if older_odrive
            else MoteusTwin(bus, MoteusTwinSettings())
        )
        if older_odrive:
            events = odrive_events(drive)
        else:
            events = moteus_events(drive)
        clock.carry(
            TwinWorld(
                Rotor(),
                drive,
                NetFtTwin(datagram_link()[1], NetFtTwinSettings(), np.random.default_rng(1)),
            ).process
        )
        motor: Any = (
            OdriveMotor(here, clock, OdriveSettings(0, **OLDER))
            if older_odrive
            else MoteusMotor(here, clock, MoteusSettings())
        )
        motor.enable()
        before_rad = _turned(motor, clock)
        panel.switch_on(name)
        if name in events:
            panel.switch_off(name)
            events[name]()
        try:
            jump_rad = float(np.abs(np.diff([*before_rad, *_turned(motor, clock)])).max())
        except DeviceError as error:
            return f"raises: {error}"
        return motor.status().fault or (
            f"angle jumps by {jump_rad:.2f} rad" if jump_rad > 0.1 else "nothing"
        )


def _turned(motor: Any, clock: TwinClock) -> list[float]:
    """The angles of half a second."""
    angles_rad: list[float] = []
    for _ in range(round(0.5 / TICK_S)):
        motor.command_speed(1.0)
        clock.wait_until(clock.now_s() + TICK_S)
        angles_rad += motor.read().angle_rad.tolist()
    return angles_rad


@pytest.mark.parametrize("name", MOTEUS)
def test_a_fault_of_a_moteus_is_noticed_as_what_it_is(name: str) -> None:
    assert re.search(MOTEUS[name], noticed(name)), noticed(name)


def test_the_list_of_a_moteus_is_whole() -> None:
    assert [fault.name for fault in (*CAN_FAULTS, *MOTEUS_FAULTS.faults)] == list(MOTEUS)


@pytest.mark.parametrize("name", OLDER_ODRIVE)
def test_a_fault_of_an_older_odrive_is_noticed_as_what_it_is(name: str) -> None:
    assert re.search(OLDER_ODRIVE[name], noticed(name, older_odrive=True)), noticed(
        name, older_odrive=True
    )
