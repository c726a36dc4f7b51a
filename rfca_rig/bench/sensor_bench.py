"""The force sensor of a rig alone, in its own axes, with nothing that could turn the shaft: what is
pushed by hand to find out how it is mounted.
"""

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import numpy as np

from rfca_rig.bench.fault_injection import FaultInjection
from rfca_rig.bench.sensors import make_sensor_pair, sensor_twin_maker
from rfca_rig.clock import Clock, TwinClock, WallClock
from rfca_rig.description.rig_file import RigFile
from rfca_rig.devices import find_sensor, load_object
from rfca_rig.devices.checks import Finding
from rfca_rig.drivers.roles import ForceSensor
from rfca_rig.errors import BadInput
from rfca_rig.twin_server.faults import FaultEvent
from rfca_rig.twin_server.sensor_mount import MountedSensorTwin, SimulatedLoad


@dataclass(frozen=True)
class SensorBench:
    """The driver in the device's axes, its clock, and the findings on the settings that the sensor
    states; `load` is what pushes on a twin, None on a real rig.
    """

    sensor: ForceSensor
    clock: Clock
    settings: tuple[Finding, ...]
    load: SimulatedLoad | None


@contextmanager
def open_sensor(
    rig: RigFile, seed: int, faults: Sequence[FaultEvent] = ()
) -> Iterator[SensorBench]:
    """Opens the sensor for the length of the block. The motor is not touched.

    Parameters
    ----------
    rig : RigFile
        The rig.
    seed : int
        Decides the noise of a twin.
    faults : sequence of FaultEvent
        Faults of a twin.

    Raises
    ------
    BadInput
        A twin without a [twin] section.
    DeviceError
        The sensor cannot be opened.
    """
    keys = rig.force_sensor
    make = find_sensor(keys.device)
    clock: Clock
    load = None
    with ExitStack() as stack:
        if rig.is_real:
            wall_clock = clock = WallClock()
            way = make.open_way(keys, wall_clock)
            stack.callback(way.close)
        else:
            if rig.twin is None:
                raise BadInput(f"{rig.rig.title}: a twin needs a [twin] section")
            clock = twin_clock = TwinClock()
            load = SimulatedLoad()
            injection = FaultInjection(rig, faults)
            noise = np.random.default_rng([seed, 0])
            pair = make_sensor_pair(rig, sensor_twin_maker(rig, rig.twin, noise), injection.panel)
            way = pair.way
            twin = MountedSensorTwin(pair.twin, rig.sensor.mounting, injection.panel, load)
            twin_clock.carry(injection.with_faults(lambda to_s: _advance(twin, to_s), None))
        settings: list[Finding] = []
        if make.check_way is not None:
            settings = load_object(make.check_way)(keys, way)
        yield SensorBench(make.make_driver(keys, way, clock), clock, tuple(settings), load)


def _advance(twin: MountedSensorTwin, to_s: float) -> None:
    """A sensor without a leg: all that it bears is what pushes on it."""
    twin.take_requests()
    twin.take_wrench(np.zeros((len(twin.due(to_s)), 6)))
