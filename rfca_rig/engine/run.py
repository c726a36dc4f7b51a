"""Runs a plan on a bench. Every run ends the same way: the motor without torque, the sensor
stopped.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import takewhile

from rfca_rig.engine.interfaces import NULL_OBSERVER, Bench, RunObserver, StopLevel, StopRequest
from rfca_rig.engine.loop import Loop
from rfca_rig.engine.stages import (
    HOLD_PERIOD_S,
    TICK_S,
    approach,
    flap,
    hold,
    move,
    run_cycles,
    settle,
)
from rfca_rig.engine.stopping import UNKNOWN_STANDSTILL, Sink, ramp_down, stop, switch_off
from rfca_rig.errors import RigError, Stopped, Trip, Tripped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import (
    Approach,
    Cycles,
    Flap,
    Hold,
    Limits,
    MoveShaft,
    Plan,
    Rest,
    SetHeight,
    Stage,
    StiffnessCheck,
    whole_turns,
)
from rfca_rig.subprocesses import HelperWatch

Progress = Callable[[Stage], None]

# The longest that a drive may keep its torque without a command. Its heartbeat, which reports the
# stop, adds up to 0.1 s.
SILENCE_S = 1.0


def stages_to_safe_point(done: Sequence[Stage], to_come: Sequence[Stage]) -> Sequence[Stage]:
    """Stages still to be run before the motor may be disabled; none where nothing has moved since
    the rack was set.

    A leg bent on the ground must go on in the direction of its stroke: the plan's next move
    forwards does that. From the start angle the shaft turns to where it waits without torque, as at
    the end of every height.
    """
    if not done or isinstance(done[-1], SetHeight):
        return ()
    # Only up to the next setting of the rack: moves beyond it belong to another height.
    moves = [
        stage
        for stage in takewhile(lambda stage: not isinstance(stage, SetHeight), to_come)
        if isinstance(stage, MoveShaft)
    ]
    if _is_in_the_air(done):
        out_of_ground = []
    else:
        out_of_ground = [move for move in moves if move.forwards][:1]
    to_parking = [move for move in moves[-1:] if not move.forwards]
    return (*out_of_ground, *to_parking)


def may_pause(done: Sequence[Stage], to_come: Stage) -> bool:
    """Whether a run may wait between these stages: the motor holds the shaft, and the leg is in the
    air, or parked before the rack is set. A leg that stays bent on the ground would creep, and its
    motor warm up.
    """
    if not done:
        return False
    return isinstance(to_come, SetHeight) or _is_in_the_air(done)


def _is_in_the_air(done: Sequence[Stage]) -> bool:
    """Whether the last motion led to the start angle; resting there and checks in between do not
    count.
    """
    moved = [stage for stage in done if not isinstance(stage, Rest | StiffnessCheck)]
    if not moved or isinstance(moved[-1], SetHeight):
        return True
    last = moved[-1]
    before = moved[-2:-1]
    return isinstance(last, MoveShaft) and (
        last.forwards or not before or isinstance(before[0], SetHeight)
    )


class RampUp:
    """Remembers the peaks of first strokes, condition by condition.

    The load at full speed is extrapolated in three ways: in the ratio of the model's loads,
    linearly in the speed (momentum of an impact), and linearly in its square (energy of an impact).
    The largest counts. It is an estimate, not a bound: the limits are checked in motion as always.
    The linear ways need two first strokes of different speeds.
    """

    def __init__(self, limits: Limits, expected: Mapping[Stage, Load]) -> None:
        self._limits = limits
        self._expected = expected
        strokes = [
            (stage, load) for stage, load in expected.items() if isinstance(stage, Flap | Cycles)
        ]
        self._at_full = {(stage.height_m, stage.speed_rad_s): load for stage, load in strokes}
        self._peaks: dict[tuple[float, float], list[tuple[float, Load]]] = {}

    def take(self, stage: Approach, peak: Load) -> None:
        """Adds a finished first stroke. Raises Tripped where the prediction for full speed
        passes a limit.
        """
        condition = (stage.height_m, stage.full_speed_rad_s)
        self._peaks.setdefault(condition, []).append((stage.speed_rad_s, peak))
        predicted = self.predict_full_speed(stage, peak)
        # Written so that a prediction that is no number passes the limit.
        if not (
            predicted.force_N <= self._limits.force_N
            and predicted.torque_Nm <= self._limits.torque_Nm
        ):
            raise Tripped(
                Trip.FULL_SPEED_TOO_MUCH,
                f"{stage.label} brought {peak.force_N:.0f} N and {peak.torque_Nm:.1f} N "
                f"m, which predicts {predicted.force_N:.0f} N and "
                f"{predicted.torque_Nm:.1f} N m at full speed; limits "
                f"{self._limits.force_N:g} N and {self._limits.torque_Nm:g} N m; "
                "raise the rack or go slower",
            )

    def predict_full_speed(self, stage: Approach, peak: Load) -> Load:
        """Predicted load at the full speed of the condition, from all of its first strokes so
        far.
        """
        peaks = self._peaks.get(
            (stage.height_m, stage.full_speed_rad_s), [(stage.speed_rad_s, peak)]
        )
        return Load(
            self._largest(
                stage,
                [(speed, load.force_N) for speed, load in peaks],
                self._model_ratio(stage, "force_N"),
            ),
            self._largest(
                stage,
                [(speed, load.torque_Nm) for speed, load in peaks],
                self._model_ratio(stage, "torque_Nm"),
            ),
        )

    def _largest(self, stage: Approach, peaks: list[tuple[float, float]], ratio: float) -> float:
        full = stage.full_speed_rad_s
        (speed, value) = peaks[-1]
        # The peak itself is among them: a prediction for a higher speed must never be below what
        # was measured.
        estimates = [value, ratio * value]
        # Two strokes at one speed give no slope.
        if len(peaks) > 1 and peaks[-2][0] != speed:
            before, earlier = peaks[-2]
            estimates.append(value + (value - earlier) * (full - speed) / (speed - before))
            estimates.append(
                value + (value - earlier) * (full**2 - speed**2) / (speed**2 - before**2)
            )
        return max(estimates)

    def _model_ratio(self, stage: Approach, of: str) -> float:
        load = self._expected.get(stage)
        full_speed_load = self._at_full.get((stage.height_m, stage.full_speed_rad_s))
        if load is None or full_speed_load is None or not getattr(load, of):
            # Without a prediction of the model, or with one of zero load, the ratio is not defined:
            # the other two ways remain.
            return 1.0
        return float(getattr(full_speed_load, of) / getattr(load, of))


@dataclass(frozen=True)
class Supervision:
    """Load that the model predicts for each stage, the operator's stop request, an observer, and
    processes that must not end.

    They come on top of the plan's limits. The observer sees everything and decides nothing.
    """

    expected: Mapping[Stage, Load] = field(default_factory=dict)
    stop_request: StopRequest = field(default_factory=StopRequest)
    observer: RunObserver = NULL_OBSERVER
    helpers: HelperWatch = field(default_factory=HelperWatch)


def run_plan(
    plan: Plan, bench: Bench, sink: Sink, progress: Progress, supervision: Supervision | None = None
) -> None:
    """Carries out every stage, the first of which must be a SetHeight.

    However it ends, the motor is without torque afterwards, and every stage that the sink was given
    is complete.

    Parameters
    ----------
    plan : Plan
        Stages, limits and rates.
    bench : Bench
        The devices.
    sink : Sink
        Receives what the stages record.
    progress : callable
        Called with each stage after it is done.
    supervision : Supervision, optional
        Predicted loads, stop request and observer.

    Raises
    ------
    Tripped
        A limit was passed.
    DeviceError
        A device failed or refused.
    Stopped
        The operator requested it.
    """
    run = _Run(plan, bench, sink, supervision or Supervision())
    try:
        run.carry_out(progress)
    except KeyboardInterrupt:
        # A third ^C, or one while a person sets the rack: it interrupts whatever is waiting, and
        # `finally` still disables the motor.
        raise Stopped("stopped at once by the operator") from None
    finally:
        run.stop()


class _Run:
    """One run of a plan."""

    def __init__(self, plan: Plan, bench: Bench, sink: Sink, supervision: Supervision) -> None:
        self._plan = plan
        self._bench = bench
        self._sink = sink
        self._expected = supervision.expected
        self._stop_request = supervision.stop_request
        self._observer = supervision.observer
        self._loop = Loop(
            bench, plan.limits, supervision.stop_request, supervision.observer, supervision.helpers
        )
        self._approaches = RampUp(plan.limits, supervision.expected)
        self._is_cut_short = False

    def carry_out(self, progress: Progress) -> None:
        try:
            for stage in self._stages_to_do():
                # While the rack is set the loop does not tick and the run waits for a person: a
                # request must interrupt it instead.
                self._stop_request.is_ticking = not isinstance(stage, SetHeight)
                self._loop.expect(self._expected.get(stage))
                self._observer.stage(
                    stage, self._expected.get(stage), whole_turns(stage, self._loop.target_rad)
                )
                self._carry_out(stage)
                progress(stage)
            # 0.1 s at the last target: the shaft comes to rest under control before the torque is
            # removed.
            for _ in range(50):
                self._loop.step_to_angle(self._loop.target_rad, 0.0, TICK_S)
        except Stopped:
            if self._stop_request.level == StopLevel.RAMP_DOWN:
                # Only this level slows down first; TORQUE_OFF goes straight to `stop`. Slows the
                # shaft down before its torque is removed. A trip meanwhile only ends that sooner.
                self._stop_request.is_over = True
                try:
                    ramp_down(self._loop)
                except RigError as error:
                    raise Stopped(
                        f"{self._stop_request.why}; while it slowed down: {error}"
                    ) from None
            raise
        # Raised only now, at rest in the air, so that a stop at a safe point is not reported as a
        # completed run.
        if self._is_cut_short:
            self._stop_request.raise_at_safe_point()

    def stop(self) -> None:
        """Ends every run, whatever went before."""
        # Order: no more requests, no more commands, then the torque. A command after the disable
        # frame could energise the motor again.
        self._stop_request.is_over = True
        self._loop.end()
        standstill = UNKNOWN_STANDSTILL
        try:
            standstill = stop(self._bench)
        finally:
            # Also where the drive did not answer: the recording must say how the motion ended.
            self._sink.off(self._loop.gaps, standstill, self._loop.bad_samples)

    def _stages_to_do(self) -> Iterator[Stage]:
        """The plan's stages; once a stop is requested, only those that bring the leg into the
        air.
        """
        stages = self._plan.stages
        for number, stage in enumerate(stages):
            if self._stop_request.is_pause_asked and may_pause(stages[:number], stage):
                self._pause()
            if self._stop_request.level:
                self._is_cut_short = True
                yield from stages_to_safe_point(stages[:number], stages[number:])
                return
            yield stage

    def _pause(self) -> None:
        """Holds the shaft where it stands, as between stages, until the operator lets the run go on
        or stops it. Commands go on, so every limit is checked and the drive's watchdog is fed.
        """
        loop = self._loop
        began_s = loop.now_s
        # The loop sees a request here, also where the stage before was a setting of the rack.
        self._stop_request.is_ticking = True
        # At rest the leg's weight is all that is expected; the limits alone watch over it.
        loop.expect(None)
        self._sink.begin_pause()
        self._observer.pause(True)
        while self._stop_request.is_pause_asked and not self._stop_request.level:
            loop.step_to_angle(loop.target_rad, 0.0, HOLD_PERIOD_S)
        self._observer.pause(False)
        self._sink.end_pause(loop.now_s - began_s)

    def _carry_out(self, stage: Stage) -> None:
        loop = self._loop
        sink = self._sink
        match stage:
            case SetHeight():
                self._change_height(stage)
            case MoveShaft():
                move(loop, stage)
            case Rest():
                sink.take_tare(settle(loop, loop.target_rad, stage.settle).wrench)
            case Approach():
                approach(self._loop, stage)
                self._sink.take_first_stroke(stage, self._loop.peak)
                # Recorded first: the recording then shows the stroke from which a trip was
                # predicted.
                self._approaches.take(stage, self._loop.peak)
            case Flap():
                sink.flap(stage, flap(loop, stage, sink))
            case Hold():
                sink.hold(stage, hold(loop, stage, sink, self._bench.camera))
            case Cycles():
                run_cycles(loop, stage, sink, self._bench.sensor.scale())

    def _change_height(self, stage: SetHeight) -> None:
        """A person comes near the leg, so the motor is without torque meanwhile; afterwards it
        holds the shaft where it stands.
        """
        switch_off(self._bench)
        self._bench.rack.set_height(stage.height_m)
        # A stop that was requested while the person worked must take effect before the motor is
        # energised.
        self._observer.energising()
        if self._stop_request.level:
            self._stop_request.raise_at_safe_point()
        # The sensor streams before the motor is energised: there is no tick with torque and without
        # force data.
        self._bench.sensor.start()
        self._bench.motor.enable()
        self._loop.begin()


def prove_stop(bench: Bench) -> float:
    """Energises the motor where the shaft stands, stops commanding, and returns the seconds until
    the drive removed its torque.

    Raises DeviceError where the drive refuses to be enabled or keeps its torque. In every case the
    motor is without torque afterwards.
    """
    try:
        bench.motor.enable()
        return bench.motor.prove_watchdog(SILENCE_S)
    finally:
        # Also after a failed proof: a drive whose watchdog did not act must not stay energised.
        bench.motor.disable()
