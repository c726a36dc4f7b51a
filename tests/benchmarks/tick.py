"""What one tick of the control loop costs: python -m tests.benchmarks.tick [--against FOLDER]

The loop as in a run: the driver of an ODrive with two reports of angle and torque per tick, a force
sensor of 14 records, all limits, a helper process that is watched. The devices' samples are ready,
and the clock does not wait, so only the loop's own work is timed. With --against, another tree of
this project is timed right before and after each time: the median of the ratios is printed.
"""

import argparse
import os
import socket
import statistics
import subprocess
import sys
import time
from datetime import UTC, datetime
from multiprocessing.connection import Connection
from pathlib import Path

import can
import numpy as np

from rfca_rig import subprocesses
from rfca_rig.devices.odrive import codec
from rfca_rig.devices.odrive.driver import OdriveMotor, OdriveSettings
from rfca_rig.devices.odrive.messages import AxisState, Heartbeat
from rfca_rig.drivers.roles import ForceSamples, SensorScale
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.loop import Loop
from tests.engine.rigs import twin_rig

TICK_S = 0.002
TICKS = 2000
RECORDS = 14
ROUNDS = 15


class StepClock:
    """Is always in time."""

    def __init__(self) -> None:
        self.t_s = 0.0

    def now_s(self) -> float:
        return self.t_s

    def wait_until(self, t_s: float) -> None:
        self.t_s = max(self.t_s, t_s)

    def start_time(self) -> datetime:
        return datetime.now(UTC)

    wall_time = start_time


class ReadyBus(can.BusABC):
    """Has the same frames at every read, and takes everything."""

    def __init__(self) -> None:
        super().__init__(channel="ready")
        self.channel_info = "ready"
        frames = [codec.torques(0, 0.0, 0.5), codec.encoder_estimates(0, 0.0, 0.0)] * 2
        frames.append(
            codec.heartbeat(0, Heartbeat(0, AxisState.CLOSED_LOOP, 0, trajectory_done=True))
        )
        self._frames = [
            can.Message(arbitration_id=number, data=data, is_extended_id=False)
            for number, data in frames
        ]
        self._place = 0

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Nothing listens."""

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # noqa: ARG002
        self._place = (self._place + 1) % (len(self._frames) + 1)
        return (self._frames[self._place - 1] if self._place else None), False


class ReadySensor:
    def __init__(self, clock: StepClock) -> None:
        self._clock = clock
        self._records = 0
        self._noise = np.random.default_rng(1).integers(-50, 50, (64, RECORDS, 6)).astype(np.int32)

    def read(self) -> ForceSamples:
        numbers = self._records + np.arange(RECORDS)
        self._records += RECORDS
        counts = self._noise[self._records // RECORDS % 64]
        return ForceSamples(
            np.full(RECORDS, self._clock.t_s),
            numbers / 7000.0,
            numbers,
            np.zeros(RECORDS, np.uint32),
            counts,
        )

    def scale(self) -> SensorScale:
        return SensorScale(1e4, 1e6, 7000.0)


class NoRack:
    def set_height(self, height_m: float) -> None:
        """Stands where it is."""


def make_loop() -> Loop:
    clock = StepClock()
    motor = OdriveMotor(ReadyBus(), clock, OdriveSettings(0, encoder_period_s=1e-3))
    bench = Bench(motor, ReadySensor(clock), NoRack(), clock, is_real=False)
    limits = twin_rig().facts().limits
    if not hasattr(subprocesses, "HelperWatch"):
        return Loop(bench, limits)
    helpers = subprocesses.HelperWatch()
    here, there = socket.socketpair()
    # The other end stays open for as long as this process lives.
    helpers.add(Connection(here.detach()), "ended")
    there.detach()
    return Loop(bench, limits, helpers=helpers)


def tick_us() -> float:
    """Mean processor time of one tick in microseconds."""
    loop = make_loop()
    loop.begin()
    loop.target_rad = loop.angle_rad
    # Processor time: the loop never waits here, and other programs may run.
    begin_s = time.thread_time()
    for _ in range(TICKS):
        loop.step_to_angle(loop.target_rad, 0.0, TICK_S)
    return 1e6 * (time.thread_time() - begin_s) / TICKS


def tick_of_us(folder: Path) -> float:
    """The same of the tree in that folder, by this very file, in a process of its own."""
    command = [sys.executable, __file__, "--once"]
    run = subprocess.run(
        command,
        env={**os.environ, "PYTHONPATH": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    )
    return float(run.stdout)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--against", type=Path, metavar="FOLDER", help="another tree of this project"
    )
    parser.add_argument("--once", action="store_true", help="print one number")
    arguments = parser.parse_args()
    if arguments.once:
        print(min(tick_us() for _ in range(8)))
        return
    if arguments.against is None:
        print(f"one tick: {statistics.median(tick_us() for _ in range(ROUNDS)):.1f} us")
        return
    here = Path(__file__).parents[2]
    times_us = []
    ratios = []
    before_us = tick_of_us(arguments.against)
    for _ in range(ROUNDS):
        times_us.append(tick_of_us(here))
        after_us = tick_of_us(arguments.against)
        ratios.append(times_us[-1] / (0.5 * (before_us + after_us)))
        before_us = after_us
    print(
        f"one tick: {statistics.median(times_us):.1f} us, {statistics.median(ratios):.3f} "
        f"times that of {arguments.against} "
        f"({min(ratios):.3f} to {max(ratios):.3f} in {ROUNDS} pairs)"
    )


if __name__ == "__main__":
    main()
