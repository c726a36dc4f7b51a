"""The control loop: one tick reads the devices, checks the limits, and only then commands the
drive.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from types import TracebackType

import numpy as np

from rfca_rig.drivers.reading_check import describe_bad
from rfca_rig.drivers.roles import ForceSamples, MotorStatus, ShaftSamples, concatenate_blocks
from rfca_rig.engine.interfaces import NULL_OBSERVER, Bench, RunObserver, StopRequest, Tick
from rfca_rig.engine.limit_monitor import LimitMonitor, Tracking
from rfca_rig.engine.loop_gaps import GapCounter
from rfca_rig.engine.sample_check import SampleCheck, StatusCheck, sum_force, sum_shaft
from rfca_rig.errors import BadReading, DeviceError, Trip, Tripped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Limits
from rfca_rig.subprocesses import HelperWatch

# No report of the shaft within this time: the drive's cyclic encoder message is probably off.
FIRST_REPORT_S = 1.0
FIRST_POLL_S = 0.005


Listener = Callable[[ShaftSamples, ForceSamples], None]


class SampleCollector:
    """Keeps every block of a stage as it came, and passes it to a listener."""

    def __init__(self, listener: Listener) -> None:
        self._listener = listener
        self._shaft: list[ShaftSamples] = []
        self._force: list[ForceSamples] = []

    def take(self, shaft: ShaftSamples, force: ForceSamples) -> None:
        self._shaft.append(shaft)
        self._force.append(force)
        self._listener(shaft, force)

    def shaft(self) -> ShaftSamples:
        return concatenate_blocks(self._shaft)

    def force(self) -> ForceSamples:
        return concatenate_blocks(self._force)


class Loop:
    """Ticks, and knows the shaft's last reported angle and speed. `target_rad` is the commanded
    angle.

    `gaps` counts the times between two ticks, with whatever was done between them. Trips and urgent
    stop requests are raised at the end of a tick. After `end` the loop sends no command any more.
    """

    def __init__(
        self,
        bench: Bench,
        limits: Limits,
        stop_request: StopRequest | None = None,
        observer: RunObserver = NULL_OBSERVER,
        helpers: HelperWatch | None = None,
    ) -> None:
        scale = bench.sensor.scale()
        self._bench = bench
        self._observer = observer
        self._helpers = helpers or HelperWatch()
        self._counts_per_unit = np.repeat([scale.counts_per_N, scale.counts_per_Nm], 3)
        self._limits = limits
        self._stop_request = stop_request or StopRequest()
        self._monitor = LimitMonitor(limits, scale, bench.clock.now_s())
        self._shaft_check = SampleCheck(
            "the drive", sum_shaft, "angle_rad", "speed_rad_s", "torque_Nm"
        )
        self._status_check = StatusCheck()
        self._force_check = SampleCheck("the force sensor", sum_force, "counts")
        self._listeners: list[Listener] = []
        self._force: ForceSamples | None = None
        self._is_over = False
        self._tick_s = bench.clock.now_s()
        self._woke_s = self._tick_s
        self._late_s = 0.0
        self._status: MotorStatus | None = None
        self.gaps = GapCounter()
        self.angle_rad = 0.0
        self.speed_rad_s = 0.0
        self.target_rad = 0.0
        self._target_speed_rad_s = 0.0

    @property
    def now_s(self) -> float:
        return self._tick_s

    @property
    def wrench(self) -> np.ndarray:
        """(6,) mean force [N] and moment [N m] over the records of the last tick that brought
        any.
        """
        if self._force is None:
            return np.full(6, np.nan)
        # Mean over the records of one tick (14 at 7 kHz and 2 ms), which reduces the sensor's
        # noise. Only when asked: strokes do not.
        counts = self._force.counts
        sum_counts = np.add.reduce(counts, axis=0, dtype=np.float64)
        wrench: np.ndarray = sum_counts / len(counts) / self._counts_per_unit
        return wrench

    @property
    def bad_samples(self) -> str:
        """How many samples were no numbers and were dropped, by the name of their column."""
        return describe_bad(self._shaft_check.bad, self._status_check.bad, self._force_check.bad)

    @property
    def peak(self) -> Load:
        """The largest load since the stage began."""
        return self._monitor.peak

    @property
    def is_stop_requested(self) -> bool:
        """Whether the operator wants a stop at the next safe point; a more urgent request is
        raised by the tick itself.
        """
        return bool(self._stop_request.level)

    def expect(self, load: Load | None) -> None:
        """A stage begins in which the model predicts at most this load; None where there is no
        prediction.
        """
        self._monitor.expect(load)

    def start_motion(self) -> float:
        """The commanded motion of a stroke begins now; the observer hears of it. Returns the host
        time.
        """
        self._observer.start(self.now_s)
        return self.now_s

    def end(self) -> None:
        """From now on this loop sends no command."""
        self._is_over = True

    def begin(self) -> None:
        """Waits for the first report of the shaft and takes its angle as the target. All
        monitors are reset.
        """
        started_s = self._tick_s = self._woke_s = self._bench.clock.now_s()
        # A new monitor: while the motor was off the shaft may have been turned by hand, which is no
        # jump of the encoder.
        self._monitor = LimitMonitor(self._limits, self._bench.sensor.scale(), started_s)
        while not self._read():
            self._tick_s += FIRST_POLL_S
            self._bench.clock.wait_until(self._tick_s)
            if self.now_s - started_s > FIRST_REPORT_S:
                raise DeviceError(
                    f"no encoder report within {FIRST_REPORT_S:g} s; check the drive's "
                    "cyclic encoder message"
                )
        # The motor holds the shaft where it stands: any other target would move it with a jerk.
        self.target_rad = self.angle_rad

    def step_to_angle(self, target_rad: float, target_speed_rad_s: float, period_s: float) -> None:
        """Commands an angle, of a target moving at that speed, for one tick; checks everything
        at its end.
        """
        self._refuse_if_over()
        with trip_on_bus_error():
            self._bench.motor.command_angle(target_rad, target_speed_rad_s)
        self._wait(period_s)
        self._check(target_rad, target_speed_rad_s)

    def step_at_speed(self, speed_rad_s: float, period_s: float) -> None:
        """Commands a speed for one tick; checks everything at its end. The target moves on for
        as long as the tick really took.
        """
        self._refuse_if_over()
        with trip_on_bus_error():
            self._bench.motor.command_speed(speed_rad_s)
        began_s = self._tick_s
        self._wait(period_s)
        # The real duration, not the period: a late tick would otherwise look like a following
        # error.
        self._check(self.target_rad + speed_rad_s * (self._tick_s - began_s), speed_rad_s)

    def _wait(self, period_s: float) -> None:
        """Waits until the end of the tick; returns at once where that has passed."""
        # A late tick is not made up for by shorter ones, which would send bursts of commands.
        self._tick_s = max(self._tick_s + period_s, self._bench.clock.now_s())
        self._bench.clock.wait_until(self._tick_s)
        # The time since the last wake-up is the time between commands that the drive's watchdog
        # sees.
        now_s = self._bench.clock.now_s()
        gap_s = now_s - self._woke_s
        self._woke_s = now_s
        self._late_s = gap_s - period_s
        self.gaps.take(gap_s)
        self._monitor.gap(gap_s, period_s)

    def _refuse_if_over(self) -> None:
        # A command after the stop could energise the motor again, or keep its watchdog quiet.
        if self._is_over:
            raise DeviceError("the run has stopped; nothing moves before it is begun again")

    def _check(self, target_rad: float, target_speed_rad_s: float) -> None:
        self.target_rad = target_rad
        self._target_speed_rad_s = target_speed_rad_s
        self._read()
        now = Tracking(target_rad, self.angle_rad, target_speed_rad_s, self.speed_rad_s)
        try:
            self._status = self._status_check.accept(self._bench.motor.status())
        except BadReading as error:
            raise Tripped(Trip.DRIVE_READING, str(error)) from error
        self._monitor.motion(self.now_s, self._status, now)
        # After the limits, because a trip names its cause.
        self._helpers.check()
        # Last, so that a trip takes precedence over a stop request of the same tick.
        self._stop_request.raise_if_urgent()

    def _read(self) -> bool:
        shaft, force = self._read_devices()
        # Listeners take the samples before the limits are checked: a trip must not lose the samples
        # that led to it.
        for listener in self._listeners:
            listener(shaft, force)
        # Put together only where an observer is attached.
        if self._observer is not NULL_OBSERVER:
            tick = Tick(
                self.now_s,
                shaft,
                force,
                self.target_rad,
                self._target_speed_rad_s,
                self._late_s,
                self.gaps.longest_s,
                self._status,
            )
            self._observer.tick(tick)
        self._monitor.reports(self.now_s, shaft, force)
        if len(force.counts):
            self._force = force
        if len(shaft.angle_rad):
            self.angle_rad = float(shaft.angle_rad[-1])
            self.speed_rad_s = float(shaft.speed_rad_s[-1])
        return len(shaft.angle_rad) > 0

    def _read_devices(self) -> tuple[ShaftSamples, ForceSamples]:
        with trip_on_bus_error():
            shaft = self._shaft_check.accept(self._bench.motor.read())
        try:
            return shaft, self._force_check.accept(self._bench.sensor.read())
        except BadReading as error:
            raise Tripped(Trip.SENSOR_READING, str(error)) from error
        except DeviceError as error:
            # Without the sensor nothing guards the leg, so this ends the motion at once.
            raise Tripped(Trip.SENSOR_LOST, str(error)) from error

    @contextmanager
    def record(self, listener: Listener) -> Iterator[SampleCollector]:
        """Everything that the devices report inside the block goes into the collector, and
        through it to the listener.
        """
        collector = SampleCollector(listener)
        with self.listen(collector.take):
            yield collector

    @contextmanager
    def listen(self, listener: Listener) -> Iterator[None]:
        """Everything that the devices report inside the block goes to the listener; nothing of
        it is kept.
        """
        self._listeners.append(listener)
        try:
            yield
        finally:
            self._listeners.remove(listener)


class _TripOnBusError:
    # Not a generator: it is entered twice at every tick.
    def __enter__(self) -> None:
        return

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if isinstance(error, BadReading):
            raise Tripped(Trip.DRIVE_READING, str(error)) from error
        if isinstance(error, DeviceError):
            raise Tripped(Trip.BUS, str(error)) from error


_TRIP_ON_BUS_ERROR = _TripOnBusError()


def trip_on_bus_error() -> AbstractContextManager[None]:
    """Within a run a failing bus, or a drive whose numbers are impossible, is a trip, not a
    device error to be reported later.
    """
    return _TRIP_ON_BUS_ERROR
