"""Test rig for one force sensor: clock, driver, twin, and a prescribed wrench in place of a plant."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import ceil

import numpy as np
from numpy.typing import NDArray

from rfca_rig.clock import TwinClock
from rfca_rig.drivers.roles import ForceSamples, ForceSensor
from rfca_rig.twins.world import SensorTwin

# Period of the reading loop in s.
TICK_S = 2e-3

Floats = NDArray[np.float64]
Wrench = Callable[[Floats], Floats]
Tamper = Callable[[], None]


def swinging(times_s: Floats) -> Floats:
    """Wrench (m, 6) at times (m,): amplitudes (1, 2, ... 6) / 2 N and N m at different frequencies, so that no two records are equal."""
    axes: Floats = np.arange(1.0, 7.0)
    return 0.5 * axes * np.sin(2.0 * np.pi * (3.0 + 0.7 * axes) * times_s[:, None])


def constant(*wrench: float) -> Wrench:
    """A wrench function that returns the same six values (m, 6) at all times (m,)."""
    return lambda times_s: np.tile(np.array(wrench), (len(times_s), 1))


@dataclass
class ForceSensorRig:
    """One sensor with its twin and its faults.

    `latency_s` is the largest delay of the newest record. `resolution` (6,) is one count of the device in N and N m, `time_step_s`
    one step of its clock if it reports time. `saturating` is a wrench beyond the range.
    Each fault starts when it is called; it is None if the wire cannot have it.
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
        """Advances the twin under the present wrench, in steps of at most one tick."""
        began_s = self.twin_s
        steps = max(1, ceil((to_s - began_s) / TICK_S - 1e-6))
        for step in range(1, steps + 1):
            end_s = to_s if step == steps else began_s + step * TICK_S
            self.twin.take_requests()
            due_s = self.twin.due(end_s)
            # The reshape keeps the shape (0, 6) if no sample was due.
            self.twin.measured(self.wrench(due_s).reshape(-1, 6))
        self.twin_s = to_s

    def run(self, seconds: float) -> ForceSamples:
        """Reads at every tick, as a control loop does; returns all records (m, 6) of that time."""
        read = []
        for _ in range(round(seconds / TICK_S)):
            self.clock.wait_until(self.clock.now_s() + TICK_S)
            read.append(self.sensor.read())
        self.blocks += read
        return concatenate_samples(read)

    def in_units(self, samples: ForceSamples) -> Floats:
        """Wrench (m, 6) in N and N m from counts (m, 6)."""
        scale = self.sensor.scale()
        in_units: Floats = samples.counts / np.repeat([scale.counts_per_N, scale.counts_per_Nm], 3)
        return in_units


def concatenate_samples(blocks: list[ForceSamples]) -> ForceSamples:
    """Concatenates blocks of records along the first axis, columns (m,) and (m, 6)."""
    return ForceSamples(*(np.concatenate([vars(block)[name] for block in blocks]) for name in vars(blocks[0])))
