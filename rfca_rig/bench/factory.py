"""Opens the devices that a rig file describes: the real ones, or their twins on wires of their own, with a simulated leg between them."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from math import sin

import can
import numpy as np
from numpy.typing import NDArray

from rfca_rig.bench.fault_injection import FaultInjection
from rfca_rig.bench.motors import make_motor, make_motor_twin, open_commanding_bus
from rfca_rig.bench.sensors import make_camera, make_force_sensor, make_sensor_pair, make_twin_camera
from rfca_rig.clock import TwinClock, WallClock
from rfca_rig.description.rig_file import RigFile, TwinSection
from rfca_rig.engine.interfaces import Bench
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.model.catalogue import resolve_effect, set_up
from rfca_rig.model.chain import HELD_SHAFT, Tolerance, advance, allocate_samples, find_rest_state
from rfca_rig.model.motion import ramp_to_speed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stage import allocate_workspace
from rfca_rig.model.state import Chain, Laws, Shaft, State, Work
from rfca_rig.twin_server.faults import FaultEvent
from rfca_rig.twins.wires import can_wire
from rfca_rig.twins.world import MotorTwin, SensorTwin, ShaftDrive, ShaftState, TwinPlant, TwinWorld
from rfca_rig.vision.leg_photo import PhotoSetup

Floats = NDArray[np.float64]

TOLERANCE = Tolerance()

# Longer than a bounce: after it, a contact counts as a new touchdown with new friction.
IN_THE_AIR_S = 0.2


@dataclass(frozen=True)
class TwinScatter:
    """Standard deviations between repeats: floor friction at each touchdown, height at each setting."""

    friction: float = 0.0
    height_m: float = 0.0


@dataclass
class LegPlant:
    """Implements twins.world.TwinPlant, and twins.camera.StandingLeg.

    `rotor_inertia_kg_m2` is the drive's, at the shaft; `random` decides the scatter.
    """

    rig: RigModel
    height_m: float
    shaft_angle_rad: float
    rotor_inertia_kg_m2: float
    scatter: TwinScatter
    random: np.random.Generator
    _now_s: float = 0.0
    _step_s: float = 1e-4
    _airborne_s: float = 0.0
    _chain: Chain = field(init=False)
    _laws: Laws = field(init=False)
    _state: State = field(init=False)
    _work: Work = field(init=False)
    _torque_Nm: float = 0.0

    def __post_init__(self) -> None:
        self._stand(self.shaft_angle_rad)

    def _stand(self, shaft_angle_rad: float) -> None:
        """Resets the leg: hanging at rest, at the present height."""
        still = ramp_to_speed(shaft_angle_rad, 0.0, 1.0, 1.0)
        setup = set_up(self.rig, self.height_m, still)
        # The twins simulate drive and sensor themselves, so effects that act there have no place in this model.
        if setup.drive is not None or setup.sensor_changes or setup.motion is not still:
            raise BadInput("the twin has a drive and a sensor of its own; leave effects that act there out of its rig file")
        for effect, _ in map(resolve_effect, self.rig.effects):
            if effect.needs_order:
                raise BadInput(f"effect {effect.id}: the twin does not count its strokes; leave it out of its rig file")
        self._chain = setup.chain()
        self._laws = setup.compile_laws(self._chain)
        self._state = find_rest_state(self._chain, shaft_angle_rad, self._laws)
        # Kept from step to step: new memory takes longer than the integration of a step.
        self._work = allocate_workspace(self._state.q.size, self._state.anchor.size)

    def advance(self, to_s: float, drive: ShaftDrive, force_times_s: Floats) -> Floats:
        """Moves on to `to_s` and returns the wrench at the sensor.

        Parameters
        ----------
        to_s : float
            End of the step, s.
        drive : ShaftDrive
            Feedback law of the motor, held constant during the step.
        force_times_s : ndarray, shape (m,)
            Times in s within the step.

        Returns
        -------
        ndarray, shape (m, 6)
            Force in N and moment in N m at `force_times_s`; out-of-plane components are zero.
        """
        samples = allocate_samples(force_times_s, self._state.q.size, self._state.anchor.size)
        span_s = (self._now_s, to_s)
        shaft = self._shaft(drive)
        cost = advance(self._chain, shaft, self._state, span_s, self._step_s, TOLERANCE, samples, self._laws, self._work)
        # The integrator's last step width is the best guess for the next call.
        self._step_s = cost.next_s
        if self._deepest_m() < self._chain.ground_depth:
            self._airborne_s += to_s - self._now_s
        elif self._airborne_s > IN_THE_AIR_S:
            self._airborne_s = 0.0
            friction = self.rig.ground.friction_coefficient + self.scatter.friction * self.random.standard_normal()
            # Cut off at zero: with a large scatter, the normal distribution reaches negative friction.
            self._chain = self._chain._replace(mu=max(friction, 0.0))
        self._now_s = to_s
        # At the end of the step: what the drive reports until the next one.
        self._torque_Nm = drive.torque_Nm(float(self._state.q[0]), float(self._state.w[0]))
        return self._wrench(samples.force)

    def _shaft(self, drive: ShaftDrive) -> Shaft:
        return HELD_SHAFT._replace(
            free=True,
            rotor=self.rotor_inertia_kg_m2,
            feed=drive.feed_Nm,
            k_angle=drive.angle_gain_Nm_per_rad,
            angle=drive.angle_rad,
            k_speed=drive.speed_gain_Nm_s_per_rad,
            speed=drive.speed_rad_s,
        )

    def _wrench(self, force: Floats) -> Floats:
        wrench = np.zeros((len(force), 6))
        wrench[:, 1:3] = force[:, :2]
        # Moment about the shaft, moved to the sensor's origin, which is `below_shaft_m` lower.
        wrench[:, 3] = force[:, 2] + self.rig.sensor.below_shaft_m * force[:, 0]
        return wrench

    def _deepest_m(self) -> float:
        depth_m = deepest_m = 0.0
        for length_m, angle_rad in zip(self.rig.leg.link_lengths_m, self._state.q.tolist(), strict=True):
            depth_m += length_m * sin(angle_rad)
            deepest_m = max(deepest_m, depth_m)
        return deepest_m + self.rig.leg.link_radius_m

    def shaft(self) -> ShaftState:
        return ShaftState(float(self._state.q[0]), float(self._state.w[0]), self._torque_Nm)

    def link_angles_rad(self) -> Floats:
        """Angles (n,) of the links from the horizontal, rad."""
        return np.array(self._state.q[: len(self.rig.leg.link_lengths_m)])

    def link_lengths_m(self) -> Floats:
        """Lengths (n,) of the links, m."""
        return np.array(self.rig.leg.link_lengths_m)

    def ground_depth_m(self) -> float:
        return self.height_m

    def set_height(self, height_m: float) -> None:
        """Sets the height in m, within the scatter of a hand on the lead screws."""
        self.height_m = height_m + self.scatter.height_m * self.random.standard_normal()
        self._stand(float(self._state.q[0]))


# Height of the twin's rack until a plan sets it.
FIRST_HEIGHT_M = 0.25


class HandRack:
    """Asks a person to set the height, and waits. The engine has disabled the motor before."""

    def set_height(self, height_m: float) -> None:
        """Returns when Enter was pressed. Raises BadInput where the input ended without it."""
        try:
            input(f"REAL motor off. Set the rack to {1e3 * height_m:.1f} mm, clear the leg, then press Enter ")
        except EOFError:
            raise BadInput(
                f"the input ended before the rack was confirmed to stand at {1e3 * height_m:.1f} mm; run it from a terminal, "
                "where a person can press Enter"
            ) from None


class TwinRack:
    """Moves at once."""

    def __init__(self, plant: TwinPlant) -> None:
        self._plant = plant

    def set_height(self, height_m: float) -> None:
        self._plant.set_height(height_m)


@contextmanager
def open_bench(
    rig: RigFile, seed: int | None, eye: PhotoSetup | None = None, twin_clock: TwinClock | None = None, faults: Sequence[FaultEvent] = ()
) -> Iterator[Bench]:
    """Opens the devices for the length of the block.

    Parameters
    ----------
    rig : RigFile
        The rig.
    seed : int or None
        Decides all randomness of a twin; None on a real rig.
    eye : Eye, optional
        The rig file's camera and marks; with it, the camera is opened too.
    twin_clock : TwinClock, optional
        For a twin whose time must not pass as fast as it can.
    faults : sequence of Switching
        Faults that happen to a twin, by its own clock.

    Raises
    ------
    BadInput
        A twin without a [twin] section or a seed.
    DeviceError
        A device cannot be opened.
    """
    with ExitStack() as stack:
        if rig.is_real:
            yield _real_bench(rig, eye, stack)
        elif rig.twin is not None and seed is not None:
            yield _twin_bench(rig, rig.twin, seed, eye, twin_clock or TwinClock(), FaultInjection(rig, faults), stack)
        else:
            raise BadInput(f"{rig.rig.title}: a twin needs a [twin] section and a seed")


def _real_bench(rig: RigFile, eye: PhotoSetup | None, stack: ExitStack) -> Bench:
    clock, motor = WallClock(), rig.motor
    try:
        bus = stack.enter_context(open_commanding_bus(rig, clock))
    # python-can raises any of these, depending on the interface.
    except (can.CanError, OSError, ValueError) as error:
        raise DeviceError(
            f"CAN bus {motor.interface} {motor.channel} cannot be opened: {error}; check [motor] in the rig file, "
            "rfca-rig doctor --rig FILE says more"
        ) from error
    camera = make_camera(rig.camera, eye, clock, stack) if rig.camera and eye else None
    return Bench(make_motor(rig, bus, clock), make_force_sensor(rig, clock, stack), HandRack(), clock, True, camera)


def _twin_bench(
    rig: RigFile, twin: TwinSection, seed: int, eye: PhotoSetup | None, clock: TwinClock, faults: FaultInjection, stack: ExitStack
) -> Bench:
    drivers_end, twins_end = stack.enter_context(can_wire())
    # Separate generators: a different number of sensor records then changes nothing in the friction of a touchdown.
    noise, chance = _randomness(seed)
    pair = make_sensor_pair(rig, twin, noise, faults.on_link)
    twins = _put_together(rig, twin, chance, faults.on_bus(twins_end), pair.twin)
    clock.carry(faults.with_faults(twins.world.process, twins.motor))
    # A third generator, so that photos change neither the sensor's noise nor the scatter.
    camera = make_twin_camera(eye, twins.plant, twin.camera, np.random.default_rng([seed, 2]), clock) if eye else None
    return Bench(make_motor(rig, drivers_end, clock), pair.driver(clock), TwinRack(twins.plant), clock, False, camera)


@dataclass(frozen=True)
class Twins:
    """The simulated devices of a twin rig; `world` advances all of them."""

    plant: LegPlant
    motor: MotorTwin
    sensor: SensorTwin
    world: TwinWorld


SensorMaker = Callable[[RigFile, TwinSection, np.random.Generator], SensorTwin]


def make_twins(rig: RigFile, twin: TwinSection, seed: int, bus: can.BusABC, make_sensor: SensorMaker) -> Twins:
    """The twins of a rig on their ends of the wires; `make_sensor` makes the sensor's. `seed` decides all their randomness."""
    noise, chance = _randomness(seed)
    return _put_together(rig, twin, chance, bus, make_sensor(rig, twin, noise))


def _randomness(seed: int) -> tuple[np.random.Generator, np.random.Generator]:
    """Generators of the sensor's noise, and of what differs from repeat to repeat."""
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
