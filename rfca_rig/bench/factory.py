"""Opens the devices that a rig file describes: the real ones, or their twins on wires of their own.

The make of a device is asked of the registry (`devices`).
"""

from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import can
import numpy as np

from rfca_rig.bench.concealment import open_seal
from rfca_rig.bench.fault_injection import FaultInjection
from rfca_rig.bench.leg_plant import LegPlant, TwinScatter
from rfca_rig.bench.sensors import (
    make_camera,
    make_force_sensor,
    make_sensor_pair,
    make_twin_camera,
    sensor_twin_maker,
)
from rfca_rig.clock import Clock, TwinClock, WallClock
from rfca_rig.description.rig_file import RigFile, TwinDriveSection, TwinSection
from rfca_rig.devices import USUAL_WATCHDOG_S, find_motor, load_object
from rfca_rig.devices.drive_setup import DriveNeeds
from rfca_rig.devices.sections import MotorKeys, MotorSection, OwnMotorSection
from rfca_rig.drivers.can_frames import CanBusSettings
from rfca_rig.drivers.guard import TorqueOffFrames
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.engine.interfaces import Bench
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.guardian.guarded_bus import GuardedBus
from rfca_rig.subprocesses import can_be_started
from rfca_rig.twin_server.faults import FaultEvent, FaultPanel
from rfca_rig.twin_server.open_ports import TwinMaker
from rfca_rig.twin_server.sensor_mount import SimulatedLoad, mount_twin
from rfca_rig.twins.drive_parts import LoopGains
from rfca_rig.twins.wires import can_wire
from rfca_rig.twins.world import MotorTwin, SensorTwin, TwinPlant, TwinWorld
from rfca_rig.vision.leg_photo import PhotoSetup

# Height of the twin's rack until a plan sets it.
FIRST_HEIGHT_M = 0.25


class HandRack:
    """Asks a person to set the height, and waits. The engine has disabled the motor before."""

    def set_height(self, height_m: float) -> None:
        """Returns when Enter was pressed. Raises BadInput where the input ended without it."""
        try:
            input(
                f"REAL motor off. Set the rack to {1e3 * height_m:.1f} mm, clear the leg, "
                "then press Enter "
            )
        except EOFError:
            raise BadInput(
                "the input ended before the rack was confirmed to stand at "
                f"{1e3 * height_m:.1f} mm; run it from a terminal, "
                "where a person can press Enter"
            ) from None


class TwinRack:
    """Moves at once."""

    def __init__(self, plant: TwinPlant) -> None:
        self._plant = plant

    def set_height(self, height_m: float) -> None:
        self._plant.set_height(height_m)


def open_commanding_bus(rig: RigFile, clock: WallClock) -> can.BusABC:
    """The bus for a run, held by a guardian where the rig file wants one; the caller shuts it down.

    Raises what python-can raises, and BadInput where this system has no guardian.
    """
    motor = rig.motor
    torque_off = find_motor(motor.device).torque_off
    # A drive without such frames has a watchdog of its own, which is nearer to the motor.
    if torque_off is None or not motor.is_guarded:
        return motor.open()
    # Refused, not ignored: a drive without a watchdog must not run without the guardian that its
    # rig file wants.
    if not can_be_started():
        raise BadInput(
            f"{rig.rig.title}: motor.guardian: this system has none; use Linux, or see "
            "docs/guardian.md on going without"
        )
    settings = CanBusSettings(motor.interface, motor.channel, motor.bitrate, motor.fd_bitrate)
    frames: TorqueOffFrames = load_object(torque_off)(motor, rig.limits.drive_silent_ms / 1e3)
    return GuardedBus(settings, frames, motor.guardian_silence_ms / 1e3, clock)


def make_motor(rig: RigFile, bus: can.BusABC, clock: Clock) -> ShaftMotor:
    """The driver that [motor] names, on its end of the bus."""
    motor = rig.motor
    if isinstance(motor, OwnMotorSection) and not isinstance(motor, MotorKeys):
        raise BadInput(
            f"{rig.rig.title}: {motor.file} was not loaded; read the rig file from where it stands"
        )
    return find_motor(motor.device).make_driver(motor, bus, clock, rig.limits.drive_silent_ms / 1e3)


def list_drive_needs(rig: RigFile, maker_file: Path | None = None) -> DriveNeeds:
    """What the rig file asks of the settings of its drive."""
    late_s = 1e-3 * rig.limits.late_ms
    # The loop is stopped at half the drive's watchdog.
    return DriveNeeds(
        rig.limits.speed_rad_s, rig.limits.torque_Nm, 2.0 * late_s, late_s, maker_file
    )


@contextmanager
def open_setup_bus(rig: RigFile) -> Iterator[tuple[can.BusABC, Clock]]:
    """The bus of the drive and its clock, to set it up, for the length of the block. No guardian
    holds it, as nothing is enabled. The drive of a twin rig is a new one.

    Raises DeviceError where the bus cannot be opened.
    """
    with ExitStack() as stack:
        if rig.is_real:
            with explain_closed_bus(rig.motor):
                bus = stack.enter_context(rig.motor.open())
            yield bus, WallClock()
        elif rig.twin is not None:
            drivers_end, twins_end = stack.enter_context(can_wire())
            clock = TwinClock()
            panel = FaultInjection(rig, ()).panel
            noise, generator = _randomness(0)
            pair = make_sensor_pair(rig, sensor_twin_maker(rig, rig.twin, noise), panel)
            twins = _put_together(
                rig, rig.twin, generator, twins_end, pair.twin, panel, has_new_drive=True
            )
            clock.carry(twins.world.process)
            yield drivers_end, clock


@contextmanager
def explain_closed_bus(motor: MotorSection) -> Iterator[None]:
    """Within the block, what python-can raises where a bus cannot be opened becomes a DeviceError
    with the way out.
    """
    try:
        yield
    # It raises any of these, depending on the interface.
    except (can.CanError, OSError, ValueError) as error:
        raise DeviceError(
            f"CAN bus {motor.interface} {motor.channel} cannot be opened: {error}; check "
            "[motor] in the rig file, rfca-rig doctor --rig FILE says more"
        ) from error


def _make_motor_twin(
    rig: RigFile, drive: TwinDriveSection, bus: can.BusABC, is_new: bool
) -> MotorTwin:
    """The twin of the drive that [motor] names, on its end of the bus."""
    make = find_motor(rig.motor.device)
    gains = LoopGains(
        speed_gain_Nm_s_per_rad=drive.speed_gain_Nm_s_per_rad,
        integral_gain_Nm_per_rad=drive.integral_gain_Nm_per_rad,
        angle_gain_per_s=drive.angle_gain_per_s,
        torque_limit_Nm=drive.torque_limit_Nm,
    )
    if is_new:
        new_twin = make.make_new_twin(rig.motor, bus, gains)
        if new_twin is not None:
            return new_twin
    watchdog_s = None
    # A drive that a guardian can switch off has no watchdog of its own.
    if make.torque_off is None:
        watchdog_s = USUAL_WATCHDOG_S
    return make.make_twin(rig.motor, bus, gains, watchdog_s)


@contextmanager
def open_bench(
    rig: RigFile,
    seed: int | None,
    eye: PhotoSetup | None = None,
    twin_clock: TwinClock | None = None,
    faults: Sequence[FaultEvent] = (),
    tap_bus: Callable[[can.BusABC, Clock], can.BusABC] | None = None,
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
    tap_bus : callable, optional
        Puts something between the bus of a twin and its driver.

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
            yield _twin_bench(
                rig,
                rig.twin,
                seed,
                eye,
                twin_clock or TwinClock(),
                FaultInjection(rig, faults),
                stack,
                tap_bus,
            )
        else:
            raise BadInput(f"{rig.rig.title}: a twin needs a [twin] section and a seed")


def _real_bench(rig: RigFile, eye: PhotoSetup | None, stack: ExitStack) -> Bench:
    clock = WallClock()
    with explain_closed_bus(rig.motor):
        bus = stack.enter_context(open_commanding_bus(rig, clock))
    if rig.camera and eye:
        camera = make_camera(rig.camera, eye, clock, stack)
    else:
        camera = None
    return Bench(
        make_motor(rig, bus, clock),
        make_force_sensor(rig.force_sensor, rig.sensor.mounting, clock, stack),
        HandRack(),
        clock,
        True,
        camera,
    )


def _twin_bench(
    rig: RigFile,
    twin: TwinSection,
    seed: int,
    eye: PhotoSetup | None,
    clock: TwinClock,
    faults: FaultInjection,
    stack: ExitStack,
    tap_bus: Callable[[can.BusABC, Clock], can.BusABC] | None,
) -> Bench:
    drivers_end, twins_end = stack.enter_context(can_wire())
    # Separate generators: a different number of sensor records then changes nothing in the friction
    # of a touchdown.
    noise, generator = _randomness(seed)
    pair = make_sensor_pair(rig, sensor_twin_maker(rig, twin, noise), faults.panel)
    twins = _put_together(rig, twin, generator, faults.on_bus(twins_end), pair.twin, faults.panel)
    clock.carry(faults.with_faults(twins.world.process, twins.motor))
    # Its photos are those of its own camera, whatever calibration they are read with.
    own_eye = None
    if eye:
        own_eye = rig.eye()
    # A third generator, so that photos change neither the sensor's noise nor the scatter.
    if own_eye:
        camera = make_twin_camera(
            own_eye, twins.plant, twin.camera, np.random.default_rng([seed, 2]), clock
        )
    else:
        camera = None
    drivers_bus: can.BusABC = drivers_end
    if tap_bus is not None:
        drivers_bus = tap_bus(drivers_end, clock)
    return Bench(
        make_motor(rig, drivers_bus, clock),
        pair.driver(clock),
        TwinRack(twins.plant),
        clock,
        False,
        camera,
    )


@dataclass(frozen=True)
class Twins:
    """The simulated devices of a twin rig; `world` advances all of them. `load` is a hand on the
    shaft, where the rig has a panel of faults.
    """

    plant: LegPlant
    motor: MotorTwin
    sensor: SensorTwin
    world: TwinWorld
    load: SimulatedLoad


def make_twins(
    rig: RigFile,
    twin: TwinSection,
    seed: int,
    bus: can.BusABC,
    put_on_ports: Callable[[TwinMaker], SensorTwin],
    panel: FaultPanel,
    has_new_drive: bool = False,
) -> Twins:
    """The twins of a rig on their ends of the wires; `put_on_ports` makes the sensor's on its
    wire. `seed` decides all their randomness, `panel` switches the faults of the sensor's mounting.
    A new drive is as it leaves its maker.
    """
    noise, generator = _randomness(seed)
    sensor = put_on_ports(sensor_twin_maker(rig, twin, noise))
    return _put_together(rig, twin, generator, bus, sensor, panel, has_new_drive)


def _randomness(seed: int) -> tuple[np.random.Generator, np.random.Generator]:
    """Generators of the sensor's noise, and of what differs from repeat to repeat."""
    return np.random.default_rng([seed, 0]), np.random.default_rng([seed, 1])


def _put_together(
    rig: RigFile,
    twin: TwinSection,
    generator: np.random.Generator,
    bus: can.BusABC,
    sensor: SensorTwin,
    panel: FaultPanel | None,
    has_new_drive: bool = False,
) -> Twins:
    plant = _plant(rig, twin, generator)
    motor = _make_motor_twin(rig, twin.drive, bus, has_new_drive)
    load = SimulatedLoad()
    sensor = mount_twin(sensor, rig.sensor.mounting, panel, load)
    return Twins(plant, motor, sensor, TwinWorld(plant, motor, sensor), load)


def _plant(rig: RigFile, twin: TwinSection, generator: np.random.Generator) -> LegPlant:
    model = rig.model()
    return LegPlant(
        rig=replace(model, effects=(*model.effects, *open_seal(twin.concealed))),
        height_m=FIRST_HEIGHT_M,
        shaft_angle_rad=rig.facts().parked_angle_rad,
        rotor_inertia_kg_m2=twin.drive.rotor_inertia_kg_m2,
        scatter=TwinScatter(twin.scatter.friction, twin.scatter.height_mm / 1e3),
        random=generator,
    )
