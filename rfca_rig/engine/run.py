"""Runs a plan on a bench. There is one way out: the motor without torque, the sensor stopped."""

from collections.abc import Callable

from rfca_rig.engine.bench import Bench
from rfca_rig.engine.loop import Loop
from rfca_rig.engine.settling import settle
from rfca_rig.engine.sink import Sink
from rfca_rig.engine.stages import TICK_S, flap, hold, move
from rfca_rig.errors import DeviceError, Stopped
from rfca_rig.protocol.plan import Flap, Hold, MoveShaft, Plan, Rest, SetHeight, Stage

Progress = Callable[[Stage], None]


def run_plan(plan: Plan, bench: Bench, sink: Sink, progress: Progress) -> None:
    """Carries out every stage, the first of which is a SetHeight; `progress` is called after each.

    Raises Tripped, DeviceError, or Stopped (the operator's ^C). However it ends, the motor is without torque then, and what
    the sink was given is whole.
    """
    loop = Loop(bench, plan.limits)
    try:
        for stage in plan.stages:
            _carry_out(stage, loop, bench, sink)
            progress(stage)
        _halt(loop)
    except KeyboardInterrupt:
        raise Stopped("stopped by the operator; stages finished before are recorded") from None
    finally:
        try:
            _switch_off(bench)
        finally:
            sink.off(loop.worst_gap_s)


def _carry_out(stage: Stage, loop: Loop, bench: Bench, sink: Sink) -> None:
    match stage:
        case SetHeight():
            _change_height(stage, loop, bench)
        case MoveShaft():
            move(loop, stage)
        case Rest():
            settle(loop, loop.target_rad, stage.settle)
        case Flap():
            sink.flap(stage, flap(loop, stage, sink))
        case Hold():
            sink.hold(stage, hold(loop, stage, sink, bench.camera))


def _change_height(stage: SetHeight, loop: Loop, bench: Bench) -> None:
    """Hands come near the leg, so the motor is without torque meanwhile; afterwards it holds where it finds the shaft."""
    _switch_off(bench)
    bench.rack.set_height(stage.height_m)
    bench.sensor.start()
    bench.motor.enable()
    loop.begin()


def _halt(loop: Loop) -> None:
    for _ in range(50):
        loop.to_angle(loop.target_rad, 0.0, TICK_S)


def _switch_off(bench: Bench) -> None:
    try:
        bench.motor.disable()
    except DeviceError as error:
        raise DeviceError(f"the motor could not be told to let go ({error}); press the emergency stop") from error
    finally:
        bench.sensor.stop()
