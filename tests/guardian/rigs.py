"""An AK drive's twin behind a socketcand, and what a program needs to turn it."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import can

from rfca_rig.clock import WallClock
from rfca_rig.devices.cubemars.driver import MitTorqueOffFrames, ServoTorqueOffFrames
from rfca_rig.devices.cubemars.driver.mit import CubemarsMitMotor, MitSettings
from rfca_rig.devices.cubemars.driver.servo import CubemarsServoMotor, ServoSettings
from rfca_rig.drivers.can_frames import CanBusSettings
from rfca_rig.drivers.guard import TorqueOffFrames
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.guardian.guarded_bus import GuardedBus
from tests.twin_server.server import Server, serving

SILENCE_S = 0.1
CALIBRATION = Path(__file__).parents[2] / "calibration"
BUS = CanBusSettings("socketcand", "can0", 1_000_000)
MIT = MitSettings(3, "AK10-9", -1, 0.5)
SERVO = ServoSettings(104, 9.0, 21, 0.198, -1, 20.0)
LAST_WORDS: dict[str, TorqueOffFrames] = {
    "mit": MitTorqueOffFrames(MIT),
    "servo": ServoTorqueOffFrames(SERVO),
}
SECTIONS = {
    "mit": (
        'device = "cubemars-mit"\ndrive_id = 3\nmodel = "AK10-9"\ndirection = -1\nzero_rad = 0.5\n'
    ),
    "servo": 'device = "cubemars-servo"\ndrive_id = 104\ngear_ratio = 9.0\npole_pairs = '
    "21\ntorque_constant_Nm_per_A = 0.198\n"
    "direction = -1\nzero_deg = 20.0\nstatus_period_ms = 2.0\n",
}


def open_guarded(kind: str, clock: WallClock) -> GuardedBus:
    """The bus that python-can's own configuration leads to, held by a guardian."""
    return GuardedBus(BUS, LAST_WORDS[kind], SILENCE_S, clock)


def motor_on(bus: GuardedBus, kind: str, clock: WallClock) -> ShaftMotor:
    if kind == "mit":
        return CubemarsMitMotor(bus, clock, MIT, bus)
    return CubemarsServoMotor(bus, clock, SERVO, bus)


@dataclass(frozen=True)
class ServedDrive:
    """`environment` tells python-can where the server's bus is."""

    kind: str
    server: Server

    @property
    def can_config(self) -> str:
        return json.dumps({"host": self.server.host, "port": self.server.ports["can_port"]})

    @property
    def environment(self) -> dict[str, str]:
        return {**os.environ, "CAN_CONFIG": self.can_config}

    def observer(self) -> can.BusABC:
        return can.Bus(**self.server.can)


@contextmanager
def far_end(kind: str) -> Iterator[ServedDrive]:
    """The drive's twin alone, in a process that needs little of the machine."""
    command = [sys.executable, "-m", "tests.guardian.far_end", kind]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield ServedDrive(kind, Server(process, json.loads(process.stdout.readline())))
        finally:
            process.kill()


@contextmanager
def served_rig(folder: Path, kind: str) -> Iterator[ServedDrive]:
    """The whole twin rig with that drive, as `rfca-rig twin serve` serves it."""
    file = folder / f"{kind}.toml"
    before, rest = (CALIBRATION / "twin.toml").read_text().split("[motor]\n")
    file.write_text(f"{before}[motor]\n{SECTIONS[kind]}\n{rest[rest.index('[force_sensor]') :]}")
    with serving("--rig", str(file)) as server:
        yield ServedDrive(kind, server)
