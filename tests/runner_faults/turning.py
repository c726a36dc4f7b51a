"""A program that turns the shaft for ever, for others to kill.

Run: python -m tests.runner_faults.turning

Where the bus is it takes from python-can's own environment. Says `turning` once the shaft turns.
"""

import can

from rfca_rig.clock import WallClock
from rfca_rig.devices.odrive.driver import OdriveMotor, OdriveSettings

TICK_S = 5e-3
SPEED_RAD_S = 2.0


def main() -> None:
    clock = WallClock()
    with can.Bus(interface="socketcand", channel="can0") as bus:
        motor = OdriveMotor(
            bus,
            clock,
            OdriveSettings(0, gear_ratio=9.0, encoder_period_s=2e-3, enable_timeout_s=20.0),
        )
        motor.enable()
        for tick in range(1_000_000):
            motor.command_speed(SPEED_RAD_S)
            motor.read()
            clock.wait_until(clock.now_s() + TICK_S)
            if tick == 40:
                print("turning", flush=True)


if __name__ == "__main__":
    main()
