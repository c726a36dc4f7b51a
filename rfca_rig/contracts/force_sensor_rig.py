"""One force sensor on its twin, for tests: clock, driver, and a wrench of the test's own choosing in place of a plant."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil

import numpy as np
from numpy.typing import NDArray

from rfca_rig.clock import TwinClock
from rfca_rig.drivers.roles import ForceSamples, ForceSensor
from rfca_rig.twins.sensor import SensorTwin

TICK_S = 2e-3

Floats = NDArray[np.float64]
Wrench = Callable[[Floats], Floats]
Tamper = Callable[[], None]


def swinging(times_s: Floats) -> Floats:
    """(m, 6): (1, 2, ... 6) / 2 N and N m at different frequencies, so that no two records are alike."""
    axes: Floats = np.arange(1.0, 7.0)
    return 0.5 * axes * np.sin(2.0 * np.pi * (3.0 + 0.7 * axes) * times_s[:, None])


def constant(*wrench: float) -> Wrench:
    return lambda times_s: np.tile(np.array(wrench), (len(times_s), 1))


@dataclass
class ForceSensorRig:
    """`latency_s` is how late the newest record may be; `resolution` what one step of the device is, in N and N m per axis,
    `time_step_s` one of its clock where it tells the time.

    Each fault begins when it is called; None where the wire cannot carry it. `saturating` is a wrench beyond the range.
    """

    clock: TwinClock
    sensor: ForceSensor
    twin: SensorTwin
    rate_Hz: float
    latency_s: float
    resolution: Floats
    saturating: tuple[float, ...]
    silence: Tamper
    lose: Tamper
    damage: Tamper
    freeze: Tamper
    repeat: Tamper | None = None
    swap: Tamper | None = None
    wrench: Wrench = swinging
    time_step_s: float = 1e-9
    twin_s: float = 0.0
    blocks: list[ForceSamples] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.clock.carry(self._carry)

    def _carry(self, to_s: float) -> None:
        """The twin, in steps of at most a tick, on the wrench as it is now."""
        began_s = self.twin_s
        steps = max(1, ceil((to_s - began_s) / TICK_S - 1e-6))
        for step in range(1, steps + 1):
            end_s = to_s if step == steps else began_s + step * TICK_S
            self.twin.take_requests()
            due_s = self.twin.due(end_s)
            self.twin.measured(self.wrench(due_s).reshape(-1, 6))
        self.twin_s = to_s

    def run(self, seconds: float) -> ForceSamples:
        """Reads every tick, as a control loop does; returns what was read in that time, joined."""
        read = []
        for _ in range(round(seconds / TICK_S)):
            self.clock.wait_until(self.clock.now_s() + TICK_S)
            read.append(self.sensor.read())
        self.blocks += read
        return joined(read)

    def in_units(self, samples: ForceSamples) -> Floats:
        scale = self.sensor.scale()
        in_units: Floats = samples.counts / np.repeat([scale.counts_per_N, scale.counts_per_Nm], 3)
        return in_units


def joined(blocks: list[ForceSamples]) -> ForceSamples:
    return ForceSamples(*(np.concatenate([vars(block)[name] for block in blocks]) for name in vars(blocks[0])))
