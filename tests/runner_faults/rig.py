"""A whole twin rig in this process whose every part can be made to fail, a short plan for it,
and the folder it records into.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import can
import numpy as np

from rfca_rig.bench.leg_plant import LegPlant, TwinScatter
from rfca_rig.bench.recorder import Recorder
from rfca_rig.cli.run_experiment import SignalHandler
from rfca_rig.clock import TwinClock
from rfca_rig.devices.netft.driver import NetFtSensor
from rfca_rig.devices.netft.ports import FORCE_FAULTS, TamperedLink
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.devices.netft.twin import NetFtTwin, NetFtTwinSettings
from rfca_rig.devices.odrive.driver import OdriveMotor, OdriveSettings
from rfca_rig.devices.odrive.twin import (
    FAULTS,
    OdriveDialect,
    OdriveTwin,
    OdriveTwinSettings,
    odrive_events,
)
from rfca_rig.drivers.roles import Photo
from rfca_rig.engine.interfaces import Bench, StopRequest
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import (
    Flap,
    Hold,
    HoldTiming,
    Limits,
    MoveShaft,
    Plan,
    Rates,
    Rest,
    SetHeight,
    SettleCriterion,
    Stage,
)
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import InProcessRecorder
from rfca_rig.recording.model import Recording
from rfca_rig.twin_server.faults import CAN_FAULTS, FaultPanel, TamperedBus
from rfca_rig.twins.wires import can_wire, datagram_link
from rfca_rig.twins.world import TwinPlant, TwinWorld
from tests.engine import rigs
from tests.runner_faults.breakable import (
    BreakableBus,
    BreakableCamera,
    BreakableClock,
    BreakableKeeper,
    BreakableLink,
    RunawayDrive,
)
from tests.runner_faults.pendulum import Pendulum
from tests.runner_faults.truth import Truth

GEAR = 9.0
HEIGHT_M = 0.25
START_RAD = 0.246
PARKED_RAD = 0.698
RETURN_RAD_S = 12.0
# What the model is taken to predict for the stroke.
EXPECTED_LOAD = Load(60.0, 8.0)
SETTLE = SettleCriterion(force_band_N=3.0, angle_band_rad=0.05, for_s=0.1, limit_s=0.3)


@dataclass(frozen=True)
class Fidelity:
    """How much the simulation is to cost: which plant, how often the devices report, how long
    all of it is watched after the run.
    """

    plant: str
    decimation: int
    encoder_s: float
    step_s: float
    watched_s: float

    @property
    def force_Hz(self) -> float:
        return 7000.0 / self.decimation


CHEAP = Fidelity("pendulum", decimation=28, encoder_s=4e-3, step_s=4e-3, watched_s=1.0)
TRUE = Fidelity("leg", decimation=1, encoder_s=2e-3, step_s=2e-3, watched_s=4.0)


twin_rig = cache(rigs.twin_rig)


def short_limits() -> Limits:
    return twin_rig().facts().limits


def short_plan(
    limits: Limits, fidelity: Fidelity, speed_rad_s: float = 5.0, hold_s: float = 0.1
) -> Plan:
    """One height: a stage in which the shaft is held and a photo taken, and a stroke; two and a
    half seconds of the rig's time.
    """
    hold = Hold(
        HEIGHT_M, 1, "loading", START_RAD, SETTLE, HoldTiming(0.0, hold_s, photo_limit_s=0.2)
    )
    flap = Flap(HEIGHT_M, speed_rad_s, 1, 0.05, 1.3, before_s=0.04)
    way = (SetHeight(HEIGHT_M), MoveShaft(START_RAD, RETURN_RAD_S), Rest(SETTLE))
    back = (MoveShaft(START_RAD, RETURN_RAD_S, forwards=True), MoveShaft(PARKED_RAD, RETURN_RAD_S))
    return Plan(
        "faults",
        "dynamic",
        (*way, hold, flap, *back),
        limits,
        Rates(fidelity.force_Hz, 1.0 / fidelity.encoder_s),
    )


class Agenda:
    """What is to happen at which time of the twins; carried along by their clock, before they
    move on.
    """

    def __init__(self, clock: TwinClock) -> None:
        self._clock = clock
        self._reached_s = clock.now_s()
        self._due: list[tuple[float, Callable[[], None]]] = []

    def at(self, t_s: float, act: Callable[[], None]) -> None:
        self._due = sorted([*self._due, (t_s, act)], key=lambda entry: entry[0])

    def process(self, to_s: float) -> None:
        """Acts that fall due before the world stands at `to_s`; one may raise, as a pressed key
        does.
        """
        reached_s = self._reached_s
        self._reached_s = to_s
        while self._due and self._due[0][0] <= reached_s:
            self._due.pop(0)[1]()


@dataclass
class FaultyRig:
    """Everything a cause may lay hands on. `begun_s` is when the cause began."""

    clock: TwinClock
    engine_clock: BreakableClock
    truth: Truth
    panel: FaultPanel
    drive: OdriveTwin
    runaway: RunawayDrive
    events: dict[str, Callable[[], None]]
    bus: BreakableBus
    link: BreakableLink
    observer: can.BusABC
    camera: BreakableCamera
    motor: OdriveMotor
    sensor: NetFtSensor
    keeper: BreakableKeeper
    recorder: Recorder
    folder: Path
    agenda: Agenda
    plan: Plan
    watched_s: float
    stop_request: StopRequest = field(default_factory=StopRequest)
    said: list[str] = field(default_factory=list)
    begun_s: float = float("nan")
    bench: Bench = field(init=False)
    ear: SignalHandler = field(init=False)

    def __post_init__(self) -> None:
        self.bench = Bench(
            self.motor, self.sensor, Rack(self.truth), self.engine_clock, False, self.camera
        )
        self.ear = SignalHandler(self.stop_request, self.said.append)

    def expected(self) -> dict[Stage, Load]:
        return {stage: EXPECTED_LOAD for stage in self.plan.stages if isinstance(stage, Flap)}

    def event(self, name: str) -> None:
        """A fault of the twin's own catalogue."""
        if name in self.events:
            self.events[name]()
        else:
            self.panel.switch_on(name)


@dataclass
class Rack:
    plant: TwinPlant

    def set_height(self, height_m: float) -> None:
        self.plant.set_height(height_m)


@contextmanager
def faulty_rig(
    folder: Path, fidelity: Fidelity = CHEAP, watchdog_s: float | None = 0.1
) -> Iterator[FaultyRig]:
    with ExitStack() as stack:
        yield _put_together(folder, fidelity, watchdog_s, np.random.default_rng(1), stack)


def _put_together(
    folder: Path,
    fidelity: Fidelity,
    watchdog_s: float | None,
    random: np.random.Generator,
    stack: ExitStack,
) -> FaultyRig:
    clock = TwinClock()
    panel = FaultPanel((*FORCE_FAULTS, *CAN_FAULTS, *FAULTS.faults))
    agenda = Agenda(clock)
    truth = Truth(_plant(fidelity, random))
    drivers_end, twins_end, observer = stack.enter_context(can_wire(ends=3))
    here, there = datagram_link()
    tampered = TamperedBus(twins_end, panel, OdriveDialect())
    bus = BreakableBus(drivers_end, clock)
    link = BreakableLink(here)
    stack.callback(tampered.shutdown)
    stack.callback(bus.shutdown)
    drive = OdriveTwin(
        tampered,
        OdriveTwinSettings(
            gear_ratio=GEAR, encoder_period_s=fidelity.encoder_s, watchdog_s=watchdog_s
        ),
    )
    box = NetFtTwin(TamperedLink(there, panel), box_settings(fidelity), random)
    runaway = RunawayDrive(drive)
    clock.carry(agenda.process)
    clock.carry(TwinWorld(truth, runaway, box, fidelity.step_s).process)
    sensor = NetFtSensor(
        link, clock, NetFtSettings(rate_Hz=fidelity.force_Hz, buffered=fidelity.decimation == 1)
    )
    keeper = BreakableKeeper(_keeper(folder))
    engine_clock = BreakableClock(clock)
    return FaultyRig(
        clock=clock,
        engine_clock=engine_clock,
        truth=truth,
        panel=panel,
        drive=drive,
        runaway=runaway,
        events=dict(odrive_events(drive)),
        bus=bus,
        link=link,
        observer=observer,
        camera=BreakableCamera(Photo(np.zeros((4, 4, 3), np.uint8), 0.0, "black")),
        motor=OdriveMotor(
            bus,
            clock,
            OdriveSettings(
                0,
                gear_ratio=GEAR,
                encoder_period_s=fidelity.encoder_s,
                heartbeat_timeout_s=short_limits().drive_silent_s,
            ),
        ),
        sensor=sensor,
        keeper=keeper,
        recorder=Recorder(keeper, sensor.scale(), engine_clock),
        folder=folder,
        agenda=agenda,
        plan=short_plan(short_limits(), fidelity),
        watched_s=fidelity.watched_s,
    )


def _keeper(folder: Path) -> InProcessRecorder:
    run_folder.create(folder, Recording("a run", "SIM", twin_rig().nominal(), {}, (), ()))
    return InProcessRecorder(folder)


def box_settings(fidelity: Fidelity) -> NetFtTwinSettings:
    noise = (0.12,) * 3 + (0.006,) * 3
    reach = (2e3,) * 3 + (200.0,) * 3
    return NetFtTwinSettings(decimation=fidelity.decimation, noise_std=noise, full_scale=reach)


def _plant(fidelity: Fidelity, random: np.random.Generator) -> TwinPlant:
    if fidelity.plant == "pendulum":
        return Pendulum(PARKED_RAD)
    return LegPlant(twin_rig().model(), HEIGHT_M, PARKED_RAD, 0.006, TwinScatter(), random)
