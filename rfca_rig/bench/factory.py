"""Opens the bench a rig file describes: the real devices, or their twins on wires of their own."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass

import can
import numpy as np

from rfca_rig.bench.cameras import make_camera, make_twin_camera
from rfca_rig.bench.fault_injection import FaultInjection
from rfca_rig.bench.force_sensors import make_force_sensor, make_sensor_pair
from rfca_rig.bench.leg_plant import LegPlant, TwinScatter
from rfca_rig.bench.motors import make_motor, make_motor_twin, open_commanding_bus
from rfca_rig.bench.racks import HandRack, TwinRack
from rfca_rig.clock import TwinClock, WallClock
from rfca_rig.description.rig_file import RigFile, TwinSection
from rfca_rig.engine.bench import Bench
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.twin_server.fault_schedule import Switching
from rfca_rig.twins.can_wire import can_wire
from rfca_rig.twins.motor import MotorTwin
from rfca_rig.twins.sensor import SensorTwin
from rfca_rig.twins.world import TwinWorld
from rfca_rig.vision.leg_photo import Eye

FIRST_HEIGHT_M = 0.25  # where the twin's rack stands until a plan sets it


@contextmanager
def open_bench(
    rig: RigFile, seed: int | None, eye: Eye | None = None, twin_clock: TwinClock | None = None, faults: Sequence[Switching] = ()
) -> Iterator[Bench]:
    """The devices, open for the length of the block. `seed` decides all randomness of a twin; None on a real rig.

    With `eye`, the rig file's own, the camera too. `twin_clock` is for a twin whose time is to pass otherwise than as fast as it can,
    `faults` happen to a twin, by its own clock.
    """
    with ExitStack() as stack:
        if rig.is_real:
            yield _real_bench(rig, eye, stack)
        elif rig.twin is not None and seed is not None:
            yield _twin_bench(rig, rig.twin, seed, eye, twin_clock or TwinClock(), FaultInjection(rig, faults), stack)
        else:
            raise BadInput(f"{rig.rig.title}: a twin needs a [twin] section and a seed")


def _real_bench(rig: RigFile, eye: Eye | None, stack: ExitStack) -> Bench:
    clock, motor = WallClock(), rig.motor
    try:
        bus = stack.enter_context(open_commanding_bus(rig, clock))
    except (can.CanError, OSError, ValueError) as error:
        raise DeviceError(
            f"CAN bus {motor.interface} {motor.channel} cannot be opened: {error}; check [motor] in the rig file, "
            "rfca-rig doctor --rig FILE says more"
        ) from error
    camera = make_camera(rig.camera, eye, clock, stack) if rig.camera and eye else None
    return Bench(make_motor(rig, bus, clock), make_force_sensor(rig, clock, stack), HandRack(), clock, True, camera)


def _twin_bench(
    rig: RigFile, twin: TwinSection, seed: int, eye: Eye | None, clock: TwinClock, faults: FaultInjection, stack: ExitStack
) -> Bench:
    drivers_end, twins_end = stack.enter_context(can_wire())
    noise, chance = _randomness(seed)
    pair = make_sensor_pair(rig, twin, noise, faults.on_link)
    twins = _put_together(rig, twin, chance, faults.on_bus(twins_end), pair.twin)
    clock.carry(faults.befalling(twins.world.process, twins.motor))
    camera = make_twin_camera(eye, twins.plant, twin.camera, np.random.default_rng([seed, 2]), clock) if eye else None
    return Bench(make_motor(rig, drivers_end, clock), pair.driver(clock), TwinRack(twins.plant), clock, False, camera)


@dataclass(frozen=True)
class Twins:
    """The devices' side of a twin rig; `world` carries all of it."""

    plant: LegPlant
    motor: MotorTwin
    sensor: SensorTwin
    world: TwinWorld


SensorMaker = Callable[[RigFile, TwinSection, np.random.Generator], SensorTwin]


def make_twins(rig: RigFile, twin: TwinSection, seed: int, bus: can.BusABC, make_sensor: SensorMaker) -> Twins:
    """The twins of a rig on their ends of the wires, the sensor's made elsewhere. `seed` decides all their randomness."""
    noise, chance = _randomness(seed)
    return _put_together(rig, twin, chance, bus, make_sensor(rig, twin, noise))


def _randomness(seed: int) -> tuple[np.random.Generator, np.random.Generator]:
    """The sensor's noise, and what differs from repeat to repeat."""
    return np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1])


def _put_together(rig: RigFile, twin: TwinSection, chance: np.random.Generator, bus: can.BusABC, sensor: SensorTwin) -> Twins:
    plant = _plant(rig, twin, chance)
    motor = make_motor_twin(rig, twin.drive, bus)
    return Twins(plant, motor, sensor, TwinWorld(plant, motor, sensor))


def _plant(rig: RigFile, twin: TwinSection, chance: np.random.Generator) -> LegPlant:
    return LegPlant(
        rig=rig.model(),
        height_m=FIRST_HEIGHT_M,
        shaft_angle_rad=rig.facts().parked_angle_rad,
        rotor_inertia_kg_m2=twin.drive.rotor_inertia_kg_m2,
        scatter=TwinScatter(twin.scatter.friction, twin.scatter.height_mm / 1e3),
        random=chance,
    )
