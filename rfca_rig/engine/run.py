"""Runs a plan on a bench. There is one way out: the motor without torque, the sensor stopped."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

from rfca_rig.engine.bench import Bench
from rfca_rig.engine.cycling import cycle
from rfca_rig.engine.loop import Loop
from rfca_rig.engine.observer import NULL_OBSERVER, RunObserver
from rfca_rig.engine.ramp_up import RampUp
from rfca_rig.engine.settling import settle
from rfca_rig.engine.sink import Sink
from rfca_rig.engine.stages import TICK_S, approach, flap, hold, move
from rfca_rig.engine.stop_request import StopLevel, StopRequest
from rfca_rig.engine.stopping import UNSEEN, ease, stop, switch_off
from rfca_rig.errors import RigError, Stopped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.cycles import Cycles
from rfca_rig.protocol.plan import Approach, Flap, Hold, MoveShaft, Plan, Rest, SetHeight, Stage
from rfca_rig.protocol.safe_points import way_to_safety

Progress = Callable[[Stage], None]


@dataclass(frozen=True)
class Supervision:
    """What a run is watched with besides the plan's limits: the load that the model expects of each stage, the operator's stop_request.

    The observer sees all, and decides nothing.
    """

    expected: Mapping[Stage, Load] = field(default_factory=dict)
    stop_request: StopRequest = field(default_factory=StopRequest)
    observer: RunObserver = NULL_OBSERVER


def run_plan(plan: Plan, bench: Bench, sink: Sink, progress: Progress, supervision: Supervision | None = None) -> None:
    """Carries out every stage, the first of which is a SetHeight; `progress` is called after each.

    Raises Tripped, DeviceError, or Stopped (as the operator requested). However it ends, the motor is without torque then, and what
    the sink was given is whole.
    """
    run = _Run(plan, bench, sink, supervision or Supervision())
    try:
        run.carry_out(progress)
    except KeyboardInterrupt:
        raise Stopped("stopped at once by the operator") from None
    finally:
        run.stop()


class _Run:
    """One run of a plan, and what it needs at hand."""

    def __init__(self, plan: Plan, bench: Bench, sink: Sink, supervision: Supervision) -> None:
        self._plan = plan
        self._bench = bench
        self._sink = sink
        self._expected = supervision.expected
        self._stop_request = supervision.stop_request
        self._observer = supervision.observer
        self._loop = Loop(bench, plan.limits, supervision.stop_request, supervision.observer)
        self._approaches = RampUp(plan.limits, supervision.expected)
        self._is_cut_short = False

    def carry_out(self, progress: Progress) -> None:
        try:
            for stage in self._until_wished():
                self._stop_request.is_ticking = not isinstance(stage, SetHeight)
                self._loop.expect(self._expected.get(stage))
                self._observer.stage(stage, self._expected.get(stage))
                self._carry_out(stage)
                progress(stage)
            self._halt()
        except Stopped:
            if self._stop_request.level == StopLevel.RAMP_DOWN:
                self._ease()
            raise
        if self._is_cut_short:
            self._stop_request.obey_at_safe_point()

    def stop(self) -> None:
        """The way out of every run."""
        self._stop_request.is_over = True
        self._loop.end()
        standstill = UNSEEN
        try:
            standstill = stop(self._bench)
        finally:
            self._sink.off(self._loop.worst_gap_s, standstill)

    def _until_wished(self) -> Iterator[Stage]:
        """The plan's stages; once a stop is requested, only those that bring the leg into the air."""
        stages = self._plan.stages
        for number, stage in enumerate(stages):
            if self._stop_request.level:
                self._is_cut_short = True
                yield from way_to_safety(stages[:number], stages[number:])
                return
            yield stage

    def _carry_out(self, stage: Stage) -> None:
        loop, sink = self._loop, self._sink
        match stage:
            case SetHeight():
                self._change_height(stage)
            case MoveShaft():
                move(loop, stage)
            case Rest():
                sink.rested(settle(loop, loop.target_rad, stage.settle).wrench)
            case Approach():
                self._approach(stage)
            case Flap():
                sink.flap(stage, flap(loop, stage, sink))
            case Hold():
                sink.hold(stage, hold(loop, stage, sink, self._bench.camera))
            case Cycles():
                cycle(loop, stage, sink, self._bench.sensor.scale())

    def _approach(self, stage: Approach) -> None:
        approach(self._loop, stage)
        self._sink.approached(stage, self._loop.peak)
        self._approaches.take(stage, self._loop.peak)

    def _change_height(self, stage: SetHeight) -> None:
        """Hands come near the leg, so the motor is without torque meanwhile; afterwards it holds where it finds the shaft."""
        switch_off(self._bench)
        self._bench.rack.set_height(stage.height_m)
        self._observer.energising()
        if self._stop_request.level:
            self._stop_request.obey_at_safe_point()
        self._bench.sensor.start()
        self._bench.motor.enable()
        self._loop.begin()

    def _halt(self) -> None:
        for _ in range(50):
            self._loop.to_angle(self._loop.target_rad, 0.0, TICK_S)

    def _ease(self) -> None:
        """No emergency: the shaft is slowed down before it loses its torque. What trips meanwhile only ends that sooner."""
        self._stop_request.is_over = True
        try:
            ease(self._loop)
        except RigError as error:
            raise Stopped(f"{self._stop_request.why}; while it slowed down: {error}") from None
