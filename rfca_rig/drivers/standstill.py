"""Standstill check before energising: a shaft that still swings looks like a drive that runs away."""

from collections.abc import Callable

from rfca_rig.clock import Clock
from rfca_rig.errors import DeviceError

MAX_SPEED_RAD_S = 0.3
# Longer than a swinging leg stays slow at its turning point.
STANDSTILL_S = 0.05
WAIT_S = 3.0


def await_standstill(clock: Clock, speed_rad_s: Callable[[], float]) -> None:
    """Waits until the shaft has been at rest for 50 ms.

    `speed_rad_s` waits one poll interval and returns the shaft speed after it. Raises DeviceError if the shaft still turns after 3 s.
    """
    began_s = swung_s = clock.now_s()
    while (now_s := clock.now_s()) - swung_s < STANDSTILL_S:
        now_rad_s = speed_rad_s()
        if abs(now_rad_s) > MAX_SPEED_RAD_S:
            swung_s = clock.now_s()
        if now_s - began_s > WAIT_S:
            raise DeviceError(
                f"drive not enabled: without torque the shaft turns at {now_rad_s:.2g} rad/s, and does not come to rest within "
                f"{WAIT_S:g} s (limit {MAX_SPEED_RAD_S:g} rad/s); steady the leg, and start anew"
            )
