"""A program that turns the shaft for ever, for others to stop.

Run: python -m tests.guardian.driving mit|servo [silent]

Says `turning` and the guardian's process id once the shaft turns; with `silent` it stops commanding
a little later and goes on running.
"""

import sys
import threading

from rfca_rig.clock import WallClock
from tests.guardian.rigs import motor_on, open_guarded

TICK_S = 4e-3
SPEED_RAD_S = 2.0


def main() -> None:
    clock = WallClock()
    with open_guarded(sys.argv[1], clock) as bus:
        motor = motor_on(bus, sys.argv[1], clock)
        motor.enable()
        for tick in range(1_000_000):
            motor.command_speed(SPEED_RAD_S)
            motor.read()
            clock.wait_until(clock.now_s() + TICK_S)
            if tick == 50:
                print("turning", bus.process_id, flush=True)
            if tick == 300 and "silent" in sys.argv:
                threading.Event().wait()


if __name__ == "__main__":
    main()
