"""A drive is energised on a shaft that stands: one that still swings looks like a drive that bolts."""

from collections.abc import Callable

from rfca_rig.clock import Clock
from rfca_rig.errors import DeviceError

SWINGS_RAD_S = 0.3
STOOD_S = 0.05  # longer than a swinging leg is slow where it turns back
WAIT_S = 3.0


def await_standing(clock: Clock, speed_rad_s: Callable[[], float]) -> None:
    """Returns when the shaft has stood for 50 ms.

    `speed_rad_s` waits a moment, and says how fast the shaft then is. Raises DeviceError where it still turns after 3 s.
    """
    began_s = swung_s = clock.now_s()
    while (now_s := clock.now_s()) - swung_s < STOOD_S:
        now_rad_s = speed_rad_s()
        if abs(now_rad_s) > SWINGS_RAD_S:
            swung_s = clock.now_s()
        if now_s - began_s > WAIT_S:
            raise DeviceError(
                f"drive not enabled: without torque the shaft turns at {now_rad_s:.2g} rad/s, and does not come to rest within "
                f"{WAIT_S:g} s (limit {SWINGS_RAD_S:g} rad/s); steady the leg, and start anew"
            )
