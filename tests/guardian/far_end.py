"""An AK drive's twin on a loaded shaft behind a socketcand, light enough for a busy machine.

Run: python -m tests.guardian.far_end mit|servo

The same bus is there as a serial adapter. Prints where, as JSON. Without torque the shaft creeps;
turned as `driving` does it takes several N m.
"""

import json
import sys

import numpy as np

from rfca_rig.bench.served import RealTimeLoop
from rfca_rig.clock import WallClock
from rfca_rig.contracts.motor_rig import Rotor
from rfca_rig.devices.cubemars.twin import (
    CubemarsMitTwin,
    CubemarsServoTwin,
    MitTwinSettings,
    ServoTwinSettings,
)
from rfca_rig.devices.netft.twin import NetFtTwin, NetFtTwinSettings
from rfca_rig.twin_server.can_ports import SharedWire, SlcanPort, SocketcandPort
from rfca_rig.twins.wires import datagram_link
from rfca_rig.twins.world import TwinWorld
from tests.guardian.rigs import MIT, SERVO

WEIGHT_Nm = 0.6
FRICTION_Nm_S_PER_RAD = 3.0


class Burdened(Rotor):
    """A weight on a drum, in oil."""

    def advance(self, to_s, drive, force_times_s):
        self.load_Nm = WEIGHT_Nm - FRICTION_Nm_S_PER_RAD * self.speed_rad_s
        self.drives.clear()
        return super().advance(to_s, drive, force_times_s)


def main() -> None:
    clock = WallClock()
    wire = SharedWire("far end")
    port = SocketcandPort(wire, "127.0.0.1", 0, clock.start_time().timestamp())
    serial = SlcanPort(wire)
    bus = wire.join()
    if sys.argv[1] == "mit":
        drive = CubemarsMitTwin(
            bus, MitTwinSettings(MIT.drive_id, MIT.model, MIT.direction, MIT.zero_rad)
        )
    else:
        motor = (
            SERVO.drive_id,
            SERVO.gear_ratio,
            SERVO.pole_pairs,
            SERVO.torque_constant_Nm_per_A,
            SERVO.direction,
            SERVO.zero_deg,
        )
        drive = CubemarsServoTwin(bus, ServoTwinSettings(*motor))
    sensor = NetFtTwin(datagram_link()[1], NetFtTwinSettings(), np.random.default_rng(1))
    print(
        json.dumps({"host": "127.0.0.1", "can_port": port.port, "slcan": serial.path}), flush=True
    )
    RealTimeLoop(TwinWorld(Burdened(), drive, sensor).process, clock).run(
        [port, serial], lambda _: None, float("inf")
    )


if __name__ == "__main__":
    main()
