"""Opens the bench a rig file describes: the real devices, or their twins on wires of their own."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager

import can
import numpy as np

from rfca_rig.bench.leg_plant import LegPlant, Scatter
from rfca_rig.bench.racks import HandRack, TwinRack
from rfca_rig.clock import TwinClock, WallClock
from rfca_rig.description.rig_file import RigFile, TwinSection
from rfca_rig.drivers.datagrams import UdpDatagrams
from rfca_rig.drivers.netft import NetFtSensor, NetFtSettings
from rfca_rig.drivers.odrive import OdriveMotor, OdriveSettings
from rfca_rig.engine.bench import Bench
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.twins.can_wire import can_wire
from rfca_rig.twins.datagram_link import datagram_link
from rfca_rig.twins.netft import NetFtTwin, NetFtTwinSettings
from rfca_rig.twins.odrive import OdriveTwin, OdriveTwinSettings
from rfca_rig.twins.speed_loop import LoopGains
from rfca_rig.twins.world import TwinWorld

FIRST_HEIGHT_M = 0.25  # where the twin's rack stands until a plan sets it


@contextmanager
def open_bench(rig: RigFile, seed: int | None) -> Iterator[Bench]:
    """The devices, open for the length of the block. `seed` decides all randomness of a twin; None on a real rig."""
    with ExitStack() as stack:
        if rig.is_real:
            yield _real_bench(rig, stack)
        elif rig.twin is not None and seed is not None:
            yield _twin_bench(rig, rig.twin, seed, stack)
        else:
            raise BadInput(f"{rig.rig.title}: a twin needs a [twin] section and a seed")


def _real_bench(rig: RigFile, stack: ExitStack) -> Bench:
    clock, motor, sensor = WallClock(), rig.motor, rig.force_sensor
    try:
        bus = stack.enter_context(can.Bus(interface=motor.interface, channel=motor.channel, bitrate=motor.bitrate))
    except (can.CanError, OSError, ValueError) as error:
        raise DeviceError(f"CAN bus {motor.interface} {motor.channel} cannot be opened: {error}; check [motor] in the rig file") from error
    datagrams = UdpDatagrams(sensor.host, sensor.port)
    stack.callback(datagrams.close)
    return Bench(OdriveMotor(bus, clock, _drive(rig)), NetFtSensor(datagrams, clock, _box(rig)), HandRack(), clock, is_real=True)


def _twin_bench(rig: RigFile, twin: TwinSection, seed: int, stack: ExitStack) -> Bench:
    clock, noise, chance = TwinClock(), *(np.random.default_rng([seed, stream]) for stream in (0, 1))
    plant = _plant(rig, twin, chance)
    drivers_end, twins_end = stack.enter_context(can_wire())
    drivers_link, twins_link = datagram_link()
    stack.callback(drivers_link.close)
    motor = OdriveTwin(twins_end, _twin_drive(rig, twin))
    sensor = NetFtTwin(twins_link, _twin_box(rig, twin), noise)
    clock.carry(TwinWorld(plant, motor, sensor).process)
    driver = OdriveMotor(drivers_end, clock, _drive(rig))
    return Bench(driver, NetFtSensor(drivers_link, clock, _box(rig)), TwinRack(plant), clock, is_real=False)


def _plant(rig: RigFile, twin: TwinSection, chance: np.random.Generator) -> LegPlant:
    return LegPlant(
        rig=rig.model(),
        height_m=FIRST_HEIGHT_M,
        shaft_angle_rad=rig.facts().parked_angle_rad,
        rotor_inertia_kg_m2=twin.drive.rotor_inertia_kg_m2,
        scatter=Scatter(twin.scatter.friction, twin.scatter.height_mm / 1e3),
        random=chance,
    )


def _drive(rig: RigFile) -> OdriveSettings:
    motor = rig.motor
    return OdriveSettings(
        node_id=motor.node_id,
        gear_ratio=motor.gear_ratio,
        direction=motor.direction,
        zero_turns=motor.zero_turns,
        encoder_period_s=motor.encoder_period_ms / 1e3,
        heartbeat_timeout_s=rig.limits.drive_silent_ms / 1e3,
    )


def _box(rig: RigFile) -> NetFtSettings:
    sensor = rig.force_sensor
    return NetFtSettings(sensor.counts_per_N, sensor.counts_per_Nm, sensor.rate_Hz, address=f"{sensor.host}:{sensor.port}")


def _twin_drive(rig: RigFile, twin: TwinSection) -> OdriveTwinSettings:
    motor, drive = rig.motor, twin.drive
    gains = LoopGains(
        speed_gain_Nm_s_per_rad=drive.speed_gain_Nm_s_per_rad,
        integral_gain_Nm_per_rad=drive.integral_gain_Nm_per_rad,
        angle_gain_per_s=drive.angle_gain_per_s,
        torque_limit_Nm=drive.torque_limit_Nm,
    )
    return OdriveTwinSettings(
        node_id=motor.node_id,
        gear_ratio=motor.gear_ratio,
        direction=motor.direction,
        zero_turns=motor.zero_turns,
        gains=gains,
        encoder_period_s=motor.encoder_period_ms / 1e3,
    )


def _twin_box(rig: RigFile, twin: TwinSection) -> NetFtTwinSettings:
    sensor = rig.force_sensor
    return NetFtTwinSettings(
        counts_per_N=sensor.counts_per_N,
        counts_per_Nm=sensor.counts_per_Nm,
        decimation=_box(rig).decimation,
        noise_std=(twin.noise_N,) * 3 + (twin.noise_Nm,) * 3,
    )
