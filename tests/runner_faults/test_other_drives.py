"""The same stops with drives of other makes: what ends the run, and that the torque is gone
then.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.devices.cubemars.driver.mit import CubemarsMitMotor, MitSettings
from rfca_rig.devices.cubemars.driver.servo import CubemarsServoMotor, ServoSettings
from rfca_rig.devices.cubemars.twin import FAULTS as CUBEMARS_FAULTS
from rfca_rig.devices.cubemars.twin import (
    CubemarsMitTwin,
    CubemarsServoTwin,
    MitTwinSettings,
    ServoTwinSettings,
)
from rfca_rig.devices.moteus.driver import MoteusMotor, MoteusSettings
from rfca_rig.devices.moteus.twin import FAULTS as MOTEUS_FAULTS
from rfca_rig.devices.moteus.twin import MoteusTwin, MoteusTwinSettings
from rfca_rig.devices.netft.driver import NetFtSensor
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.devices.netft.twin import NetFtTwin
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.run import run_plan
from rfca_rig.engine.stopping import Sink
from rfca_rig.errors import Tripped
from rfca_rig.protocol.plan import Hold
from rfca_rig.twins.wires import can_wire, datagram_link
from rfca_rig.twins.world import TwinWorld
from tests.runner_faults.pendulum import Pendulum
from tests.runner_faults.rig import (
    CHEAP,
    PARKED_RAD,
    Agenda,
    Rack,
    box_settings,
    short_limits,
    short_plan,
)
from tests.runner_faults.truth import Truth

SERVO = {"gear_ratio": 9.0, "pole_pairs": 21, "torque_constant_Nm_per_A": 0.115}
DRIVES: dict[str, tuple[Callable, Callable]] = {
    "moteus": (
        lambda bus, clock: MoteusMotor(bus, clock, MoteusSettings()),
        lambda bus: MoteusTwin(bus, MoteusTwinSettings()),
    ),
    "AK in MIT mode": (
        lambda bus, clock: CubemarsMitMotor(bus, clock, MitSettings(1, "AK80-9")),
        lambda bus: CubemarsMitTwin(bus, MitTwinSettings(watchdog_s=0.1)),
    ),
    "AK in servo mode": (
        lambda bus, clock: CubemarsServoMotor(bus, clock, ServoSettings(1, **SERVO)),
        lambda bus: CubemarsServoTwin(bus, ServoTwinSettings(watchdog_s=0.1, **SERVO)),
    ),
}
CAUSES: dict[str, set[str]] = {
    "over-force": {"L-01"},
    "over-temperature": {"D-01"},
    "drive-restart": {"D-01", "F-04"},
    "drive-hot": {"D-04"},
    "encoder-frozen": {"F-02", "F-03", "D-01"},
    "encoder-jump": {"D-01", "F-04"},
}


class InStroke(Sink):
    """A sink that keeps nothing, and says when a stroke has begun."""

    def __init__(self, begun: Callable[[float], None]) -> None:
        self._begun = begun

    def start(self, start_s: float, turns_rad: float) -> None:  # noqa: ARG002
        self._begun(start_s)


@dataclass
class DrivenRig:
    clock: TwinClock
    agenda: Agenda
    truth: Truth
    twin: Any
    bench: Bench


@contextmanager
def driven(drive: str) -> Iterator[DrivenRig]:
    driver, twin = DRIVES[drive]
    clock = TwinClock()
    truth = Truth(Pendulum(PARKED_RAD))
    agenda = Agenda(clock)
    (here, there) = datagram_link()
    with can_wire() as (drivers_end, twins_end):
        motor_twin = twin(twins_end)
        clock.carry(agenda.process)
        clock.carry(
            TwinWorld(
                truth, motor_twin, NetFtTwin(there, box_settings(CHEAP), np.random.default_rng(1))
            ).process
        )
        sensor = NetFtSensor(here, clock, NetFtSettings(rate_Hz=CHEAP.force_Hz, buffered=False))
        bench = Bench(driver(drivers_end, clock), sensor, Rack(truth), clock, is_real=False)
        yield DrivenRig(clock, agenda, truth, motor_twin, bench)


def begin(rig: DrivenRig, name: str) -> None:
    if name == "over-force":
        rig.truth.pull[2] = 400.0
    elif name == "drive-hot":
        rig.twin.warmth.fever_K_s = 1000.0
    elif name == "encoder-jump" and isinstance(rig.twin, MoteusTwin):
        rig.twin.restart()  # its jump is one of the wire, and tested there
    else:
        if isinstance(rig.twin, MoteusTwin):
            faults = MOTEUS_FAULTS
        else:
            faults = CUBEMARS_FAULTS
        faults.events(rig.twin)[name]()


@pytest.mark.parametrize("name", CAUSES)
@pytest.mark.parametrize("drive", DRIVES)
def test_a_cause_ends_the_run_and_the_torque_is_gone(drive: str, name: str) -> None:
    with driven(drive) as rig:
        whole = short_plan(short_limits(), CHEAP)
        plan = replace(
            whole, stages=[stage for stage in whole.stages if not isinstance(stage, Hold)]
        )
        sink = InStroke(lambda start_s: rig.agenda.at(start_s + 0.15, lambda: begin(rig, name)))
        with pytest.raises(Tripped) as ended:
            run_plan(plan, rig.bench, sink, lambda _: None)
        over_s = rig.clock.now_s()
        rig.clock.wait_until(over_s + 0.5)
        assert str(ended.value.code) in CAUSES[name], str(ended.value)
        assert not any(moment.powered for moment in rig.truth.after(over_s))
