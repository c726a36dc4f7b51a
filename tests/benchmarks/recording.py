"""What recording costs the control loop, in real time.

Run: python -m tests.benchmarks.recording [--strokes 4]

A motor and a sensor that exist in memory only are run through a flapping plan by the engine, at 500
Hz, with 7000 and 15 000 records/s. Shown are the gaps between commands to the motor, with nothing
recorded, with each stroke written by the loop itself when it is done, with a thread that records,
and with the recorder process. Half the drive's watchdog, 50 ms, is the limit.
"""

import argparse
import queue
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from rfca_rig.bench.recorder import Recorder, stroke_of
from rfca_rig.clock import WallClock
from rfca_rig.drivers.roles import ForceSamples, MotorStatus, SensorScale, ShaftSamples
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.run import run_plan
from rfca_rig.engine.stopping import RecordedSamples, Sink
from rfca_rig.protocol.plan import Flap
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import InProcessRecorder, RecorderClient
from rfca_rig.recording.model import Recording
from rfca_rig.recording.store import write_recording
from tests.engine.rigs import nothing, one_condition, twin_rig

SCALE = SensorScale(1e6, 1e6, 7000.0)
HEADER = Recording("benchmark", "REAL", {}, {}, (), ())


class MemoryMotor:
    """Stands wherever it is told to, and notes when."""

    def __init__(self, clock: WallClock) -> None:
        self._clock = clock
        self._angle_rad = 0.0
        self._speed_rad_s = 0.0
        self._read_s = clock.now_s()
        self.commanded_s: list[float] = []

    def command_angle(self, angle_rad: float, _speed_rad_s: float = 0.0) -> None:
        self.commanded_s.append(self._clock.now_s())
        self._angle_rad = angle_rad
        self._speed_rad_s = 0.0

    def command_speed(self, speed_rad_s: float) -> None:
        self.commanded_s.append(self._clock.now_s())
        self._speed_rad_s = speed_rad_s

    def read(self) -> ShaftSamples:
        now_s = self._clock.now_s()
        self._angle_rad += self._speed_rad_s * (now_s - self._read_s)
        self._read_s = now_s
        one = np.array([now_s])
        return ShaftSamples(
            one, one, np.array([self._angle_rad]), np.array([self._speed_rad_s]), np.zeros(1)
        )

    def status(self) -> MotorStatus:
        return MotorStatus("closed loop", None, 0.0)

    def enable(self) -> None: ...

    def disable(self) -> None: ...


class MemorySensor:
    """As many records as the time that went by asks for, of noise."""

    def __init__(self, clock: WallClock, rate_Hz: float) -> None:
        self._clock = clock
        self._rate_Hz = rate_Hz
        self._counts = np.random.default_rng(1).normal(0.0, 2e5, (1 << 16, 6)).astype(np.int32)
        self._sent = 0

    def read(self) -> ForceSamples:
        due = int(self._clock.now_s() * self._rate_Hz)
        numbers = np.arange(self._sent, due)
        self._sent = due
        device_s = numbers / self._rate_Hz
        at = numbers % len(self._counts)
        return ForceSamples(
            device_s, device_s, numbers, np.zeros(len(numbers), np.uint32), self._counts[at]
        )

    def scale(self) -> SensorScale:
        return SCALE

    def start(self) -> None:
        self._sent = int(self._clock.now_s() * self._rate_Hz)

    def stop(self) -> None: ...


class FixedRack:
    def set_height(self, height_m: float) -> None: ...


class WrittenByTheLoop(Sink):
    """Each stroke in a file of its own, before the loop goes on."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def flap(self, stage: Flap, recorded: RecordedSamples) -> None:
        stroke = stroke_of(stage, recorded, SCALE)
        write_recording(replace(HEADER, strokes=(stroke,)), self._folder / f"{stage.repeat}.h5")


class ThreadKeeper:
    """The recorder process's work, done by a thread."""

    def __init__(self, folder: Path) -> None:
        self._keeper = InProcessRecorder(folder)
        self._queue: queue.SimpleQueue = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work)
        self._thread.start()

    def _work(self) -> None:
        while (block := self._queue.get()) is not None:
            self._keeper.give(block)

    def give(self, block) -> None:
        self._queue.put(block)

    def finish(self, why: str) -> None:
        self._queue.put(None)
        self._thread.join()
        self._keeper.finish(why)


def gaps_ms(make_sink, rate_Hz: float, strokes: int) -> np.ndarray:
    """Between commands, over a plan of so many strokes."""
    clock = WallClock()
    rig = twin_rig()
    motor = MemoryMotor(clock)
    bench = Bench(motor, MemorySensor(clock, rate_Hz), FixedRack(), clock, True)
    sink, finish = make_sink(clock)
    plan = one_condition(rig, strokes)
    # this machine may be busy with other work: late ticks are measured here, not tripped on
    run_plan(
        replace(plan, limits=replace(plan.limits, following_error_rad=10.0, sensor_silent_s=10.0)),
        bench,
        sink,
        nothing,
    )
    finish()
    return 1e3 * np.diff(motor.commanded_s)


def ways(folder: Path):
    def recorder(keeper_of, name):
        def make(clock):
            run_folder.create(folder / name, HEADER)
            keeper = keeper_of(folder / name)
            return Recorder(keeper, SCALE, clock), lambda: keeper.finish("done")

        return make

    class Nothing(Sink):
        """Takes all and keeps none."""

    yield "nothing recorded", lambda _clock: (Nothing(), lambda: None)
    yield "by the loop itself", lambda _clock: (WrittenByTheLoop(folder), lambda: None)
    yield "by a thread", recorder(ThreadKeeper, "thread")
    yield (
        "by the recorder process",
        recorder(lambda place: RecorderClient(place, patient=False), "process"),
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--strokes", type=int, default=4)
    strokes = parser.parse_args().strokes
    for rate_Hz in (7000.0, 15000.0):
        with tempfile.TemporaryDirectory() as folder:
            for name, make_sink in ways(Path(folder)):
                cpu_s = time.process_time()
                found = gaps_ms(make_sink, rate_Hz, strokes)
                cpu = time.process_time() - cpu_s
                print(
                    f"{rate_Hz:6.0f} records/s, {name:24s}: median "
                    f"{np.median(found):.2f}, p99 {np.percentile(found, 99):.2f}, "
                    f"worst five {' '.join(f'{gap:.1f}' for gap in np.sort(found)[:-6:-1])} ms; "
                    f"loop's process {cpu:.1f} s",
                    flush=True,
                )


if __name__ == "__main__":
    main()
