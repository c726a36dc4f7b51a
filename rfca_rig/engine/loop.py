"""The control loop: one tick reads the devices, checks the limits, and only then commands the drive."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from rfca_rig.drivers.roles import ForceSamples
from rfca_rig.engine.bench import Bench
from rfca_rig.engine.tap import Listener, Tap
from rfca_rig.engine.watch import Tracking, Watch
from rfca_rig.errors import DeviceError
from rfca_rig.protocol.plan import Limits

FIRST_REPORT_S = 1.0
FIRST_LOOK_S = 0.005


class Loop:
    """Ticks, and knows the shaft as last reported. `target_rad` is where the shaft should be.

    `worst_gap_s` is the longest that a tick has taken, with whatever was done between it and the one before.
    """

    def __init__(self, bench: Bench, limits: Limits) -> None:
        self._bench = bench
        self._scale = bench.sensor.scale()
        self._limits = limits
        self._watch = Watch(limits, self._scale)
        self._taps: list[Tap] = []
        self._force_N = np.full(3, np.nan)
        self._tick_s = bench.clock.now_s()
        self._woke_s = self._tick_s
        self.worst_gap_s = 0.0
        self.angle_rad = 0.0
        self.speed_rad_s = 0.0
        self.target_rad = 0.0

    @property
    def now_s(self) -> float:
        return self._tick_s

    @property
    def force_N(self) -> np.ndarray:
        """(3,) mean over the records of the last tick that brought any."""
        return self._force_N

    def begin(self) -> None:
        """Waits for the first report of the shaft, and takes that as the target. Old watches are forgotten."""
        self._watch = Watch(self._limits, self._scale)
        started_s = self._tick_s = self._woke_s = self._bench.clock.now_s()
        while not self._read():
            self._tick_s += FIRST_LOOK_S
            self._bench.clock.wait_until(self._tick_s)
            if self.now_s - started_s > FIRST_REPORT_S:
                raise DeviceError(f"no encoder report within {FIRST_REPORT_S:g} s; check the drive's cyclic encoder message")
        self.target_rad = self.angle_rad

    def to_angle(self, target_rad: float, target_speed_rad_s: float, period_s: float) -> None:
        """Commands an angle (of a target moving at that speed) for one tick, and checks everything at its end."""
        self._bench.motor.command_angle(target_rad, target_speed_rad_s)
        self._wait(period_s)
        self._check(target_rad, target_speed_rad_s)

    def at_speed(self, speed_rad_s: float, period_s: float) -> None:
        """Commands a speed for one tick; the target moves along, for as long as the tick really took."""
        self._bench.motor.command_speed(speed_rad_s)
        began_s = self._tick_s
        self._wait(period_s)
        self._check(self.target_rad + speed_rad_s * (self._tick_s - began_s), speed_rad_s)

    def _wait(self, period_s: float) -> None:
        """To the end of the tick; one that is over already ends now."""
        self._tick_s = max(self._tick_s + period_s, self._bench.clock.now_s())
        self._bench.clock.wait_until(self._tick_s)
        self._note_gap()

    def _note_gap(self) -> None:
        """The drive's watchdog sees the time between commands, which is that between ends of waiting."""
        now_s = self._bench.clock.now_s()
        self.worst_gap_s, self._woke_s = max(self.worst_gap_s, now_s - self._woke_s), now_s

    def _check(self, target_rad: float, target_speed_rad_s: float) -> None:
        self.target_rad = target_rad
        self._read()
        self._watch.drive(self._bench.motor.status())
        self._watch.tracking(Tracking(target_rad, self.angle_rad, target_speed_rad_s, self.speed_rad_s))

    def _read(self) -> bool:
        shaft, force = self._bench.motor.read(), self._bench.sensor.read()
        for tap in self._taps:
            tap.take(shaft, force)
        self._watch.force(self.now_s, force)
        self._remember_force(force)
        if len(shaft.angle_rad):
            self.angle_rad, self.speed_rad_s = float(shaft.angle_rad[-1]), float(shaft.speed_rad_s[-1])
        return len(shaft.angle_rad) > 0

    def _remember_force(self, force: ForceSamples) -> None:
        if len(force.counts):
            self._force_N = force.counts[:, :3].mean(axis=0) / self._scale.counts_per_N

    @contextmanager
    def recorded(self, listener: Listener) -> Iterator[Tap]:
        """Everything the devices report inside the block goes into the tap, and through it to the listener."""
        tap = Tap(listener)
        self._taps.append(tap)
        try:
            yield tap
        finally:
            self._taps.remove(tap)
