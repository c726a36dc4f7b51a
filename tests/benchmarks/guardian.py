"""What a guardian costs, and how soon it lets go.

Run: python -m tests.benchmarks.guardian [--frames 500]

A serial CAN adapter (slcan) on a pseudo terminal, of which this program plays the far end: the time
from `send` until the frame is there, and from a frame there until `recv` gives it, with the bus
opened here and with a guardian that holds it; 2 ms apart, as the control loop sends them. Then the
time beyond the agreed silence until the last word is on the wire.
"""

import argparse
import os
import pty
import select
import tty
from collections.abc import Callable
from typing import TypeVar

import can
import numpy as np

from rfca_rig.clock import WallClock
from rfca_rig.devices.cubemars.driver import MitSettings, MitTorqueOffFrames
from rfca_rig.drivers.can_frames import CanBusSettings
from rfca_rig.guardian.guarded_bus import GuardedBus

LAST_WORD = MitTorqueOffFrames(MitSettings(1, "AK80-9"))
COMMAND = can.Message(arbitration_id=1, data=bytes(8), is_extended_id=False)
REPLY = b"t00080102030405060708\r"
SILENCE_S = 0.05
PATIENT_S = 1.0  # where it is not the silence that is measured
CLOCK = WallClock()
Bus = TypeVar("Bus", bound=can.BusABC)


class FarEnd:
    """The adapter's side of the pseudo terminal."""

    def __init__(self) -> None:
        self._master, slave = pty.openpty()
        tty.setraw(self._master)
        self.path = os.ttyname(slave)

    def drain(self) -> None:
        while select.select([self._master], [], [], 0.0)[0]:
            os.read(self._master, 4096)

    def await_frame(self) -> float:
        """When a whole line was there."""
        line = b""
        while not line.endswith(b"\r"):
            line += os.read(self._master, 4096)
        return CLOCK.now_s()

    def say(self, line: bytes) -> None:
        os.write(self._master, line)


def pause(seconds: float) -> None:
    CLOCK.wait_until(CLOCK.now_s() + seconds)


def out_and_back(bus: can.BusABC, far: FarEnd, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Seconds each way, (frames,)."""
    out_s = np.empty(frames)
    back_s = np.empty(frames)
    for at in range(frames):
        pause(1e-3)
        began_s = CLOCK.now_s()
        bus.send(COMMAND)
        out_s[at] = far.await_frame() - began_s
        pause(1e-3)
        began_s = CLOCK.now_s()
        far.say(REPLY)
        assert bus.recv(timeout=1.0) is not None
        back_s[at] = CLOCK.now_s() - began_s
    return out_s, back_s


def beyond_silence(bus: GuardedBus, far: FarEnd, times: int) -> np.ndarray:
    """Seconds from the end of the agreed silence to the last word, (times,)."""
    late_s = np.empty(times)
    for at in range(times):
        bus.arm()
        bus.send(COMMAND)
        far.await_frame()
        began_s = CLOCK.now_s()
        late_s[at] = far.await_frame() - began_s - SILENCE_S
        bus.await_let_go(1.0)
        far.drain()
    return late_s


def shown(name: str, values_s: np.ndarray) -> None:
    p50, p99 = np.percentile(values_s, [50, 99])
    print(
        f"{name:42} p50 {1e3 * p50:7.3f} ms   p99 {1e3 * p99:7.3f} ms   worst "
        f"{1e3 * values_s.max():7.3f} ms"
    )


def both_ways(how: str, measured_s: tuple[np.ndarray, np.ndarray]) -> None:
    for way, values_s in zip(("to", "from"), measured_s, strict=True):
        shown(f"{way} the wire, bus {how}", values_s)


def opened(far: FarEnd, open_bus: Callable[[], Bus]) -> Bus:
    """Opening waits for what the adapter says, which here is nothing."""
    bus = open_bus()
    far.drain()
    return bus


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=500)
    frames = parser.parse_args().frames
    far = FarEnd()
    settings = CanBusSettings("slcan", far.path, 1_000_000)
    with opened(far, settings.open) as bus:
        both_ways("opened here", out_and_back(bus, far, frames))
    with opened(far, lambda: GuardedBus(settings, LAST_WORD, PATIENT_S, CLOCK)) as bus:
        bus.arm()
        both_ways("held by a guardian", out_and_back(bus, far, frames))
    with opened(far, lambda: GuardedBus(settings, LAST_WORD, SILENCE_S, CLOCK)) as bus:
        shown(f"let go, beyond {1e3 * SILENCE_S:g} ms of silence", beyond_silence(bus, far, 20))


if __name__ == "__main__":
    main()
