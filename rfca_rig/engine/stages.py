"""How each stage of a plan is carried out.

In fatigue cycles the shaft turns without pause. Of each turn a few numbers are kept, in memory that
does not grow.
"""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.drivers.roles import ForceSamples, Photo, Photographer, SensorScale, ShaftSamples
from rfca_rig.engine.loop import Loop
from rfca_rig.engine.stopping import Cycle, RecordedSamples, Sink
from rfca_rig.errors import RigError, Stopped, Trip, Tripped
from rfca_rig.protocol.plan import (
    MOVE_RAMP_S,
    STOPPING_S,
    TURN_RAD,
    Approach,
    Cycles,
    Flap,
    Hold,
    MoveShaft,
    SettleCriterion,
    turn_to,
    turns_between,
)

HOLD_PERIOD_S = 0.01
# Averages 350 records at 7 kHz: sensor noise of 0.15 N becomes 0.01 N. Still short enough to see a
# leg that swings.
MEAN_S = 0.05

# Seconds between two commands, in strokes and in moves.
TICK_S = 0.002
MOVE_TICK_S = 0.005
# Share of a tick: rounding of the times must not turn one tick into two.
SLACK = 1e-3

# A cycle ends in the air, this far before the start angle. The start angle is then reached
# forwards: a bent leg that is pushed backwards wedges.
BEFORE_START_RAD = math.radians(30.0)
# Least share of the stage's speed. The square-root profile alone would approach its end ever more
# slowly and never command a start from rest.
CREEP_SHARE = 0.05
# Drives report the angle in single precision: at a gear ratio of 9 it is resolved to 2.5 degrees
# after so many turns.
MAX_TURNS = 100_000


@dataclass(frozen=True)
class Settled:
    """Result: `reached` is False where the time limit came first; `wrench` (6,) is the last mean
    of force [N] and moment [N m].
    """

    reached: bool
    wrench: NDArray[np.float64]


def settle(loop: Loop, target_rad: float, criterion: SettleCriterion) -> Settled:
    """Holds the shaft at `target_rad` until force and angle stay within the bands of the criterion,
    or its time limit is reached.

    Returns
    -------
    Settled
        Whether the criterion was met, and the mean wrench (6,) in N and N m.
    """
    per_mean = round(MEAN_S / HOLD_PERIOD_S)
    # At least two means: the range of a single one is zero and would always be within the band.
    means: deque[np.ndarray] = deque(maxlen=max(2, round(criterion.for_s / MEAN_S)))
    began_s = loop.now_s
    # Half a mean is allowed for, because the loop's times do not add up to exact multiples of
    # MEAN_S.
    while loop.now_s - began_s < criterion.limit_s - 0.5 * MEAN_S:
        ticks = []
        for _ in range(per_mean):
            loop.step_to_angle(target_rad, 0.0, HOLD_PERIOD_S)
            ticks.append([loop.angle_rad, *loop.wrench])
        means.append(np.mean(ticks, axis=0))
        if len(means) == means.maxlen and _inside(np.ptp(means, axis=0), criterion):
            return Settled(True, np.mean(means, axis=0)[1:])
    return Settled(False, np.mean(means, axis=0)[1:])


def _inside(band: np.ndarray, criterion: SettleCriterion) -> bool:
    # Column 0 is the angle, columns 1 to 3 the force; the criterion has no band for moments.
    return bool(band[0] <= criterion.angle_band_rad and band[1:4].max() <= criterion.force_band_N)


class PhotoCapture:
    """A photo that is taken while the loop goes on. It never waits, and keeps the stage waiting for
    `limit_s` at most.

    An error of the camera costs its photo, not the run: force and shaft are measured all the same.
    """

    def __init__(self, camera: Photographer | None, now_s: float, limit_s: float) -> None:
        """Requests the photo; without a camera nothing is requested."""
        self.photo: Photo | None = None
        self.fault = ""
        self._camera = camera
        self._limit_s = limit_s
        self._ends_s = now_s + limit_s
        if camera is not None:
            self._begin(camera)

    def _begin(self, camera: Photographer) -> None:
        try:
            camera.begin()
        except RigError as error:
            self._end(str(error))

    def is_under_way(self, now_s: float) -> bool:
        """Whether to ask again later. Once False, `photo` holds the photo, or `fault` says why
        there is none.
        """
        if self._camera is None:
            return False
        try:
            self.photo = self._camera.fetch_photo()
        except RigError as error:
            self._end(str(error))
        if self.photo is not None:
            self._end("")
        elif not self.fault and now_s >= self._ends_s:
            self._end(
                f"the camera gave no photo within {self._limit_s:g} s; check its cable and power"
            )
        return self._camera is not None

    def _end(self, fault: str) -> None:
        self.fault = fault
        self._camera = None


def move(loop: Loop, stage: MoveShaft) -> None:
    """Moves along a trapezoidal speed profile to the angle, the nearest way or forwards."""
    way_rad = turn_to(stage.angle_rad, loop.target_rad, stage.forwards)
    start_rad = loop.target_rad
    goal_rad = loop.target_rad + way_rad
    duration_s = abs(way_rad) / stage.speed_rad_s + MOVE_RAMP_S
    # Angles are commanded, not speeds: the move ends exactly at the goal even where the drive lags
    # on the way.
    for k in range(1, math.ceil(duration_s / MOVE_TICK_S) + 1):
        travelled, speed = _trapezoid(k * MOVE_TICK_S / duration_s, MOVE_RAMP_S / duration_s)
        loop.step_to_angle(
            start_rad + way_rad * travelled, way_rad * speed / duration_s, MOVE_TICK_S
        )
    loop.step_to_angle(goal_rad, 0.0, MOVE_TICK_S)


def _trapezoid(x: float, ramp: float) -> tuple[float, float]:
    """Share of the way and its derivative at share `x` of the time, with ramps of share `ramp`
    at both ends.
    """
    # A move shorter than two ramps becomes a triangle.
    ramp = min(ramp, 0.5)
    # Plateau speed that makes the whole way 1: plateau of length 1 - 2 ramp, and two ramps of half
    # height on average.
    top = 1.0 / (1.0 - ramp)
    if x >= 1.0:
        return 1.0, 0.0
    if x < ramp:
        return 0.5 * top * x * x / ramp, top * x / ramp
    if x > 1.0 - ramp:
        return 1.0 - 0.5 * top * (1.0 - x) ** 2 / ramp, top * (1.0 - x) / ramp
    return top * (x - 0.5 * ramp), top


def flap(loop: Loop, stage: Flap, sink: Sink) -> RecordedSamples:
    """Holds, ramps to speed, sweeps, and stops in the air; records until the end of the sweep.

    Returns
    -------
    Recorded
        Samples of both devices, host time of the commanded start, and whole turns to subtract from
        the shaft angle.
    """
    turns_rad = turns_between(0.0, loop.target_rad)
    hold_rad = loop.target_rad
    sink.begin(stage)
    with loop.record(sink.take) as collector:
        # Recorded at rest first, so that the stroke's initial state is part of the recording.
        for _ in range(round(stage.before_s / TICK_S)):
            loop.step_to_angle(hold_rad, 0.0, TICK_S)
        start_s = loop.start_motion()
        sink.start(start_s, turns_rad)
        _sweep(loop, stage)
    _stop_in_the_air(loop, stage)
    return RecordedSamples(collector.shaft(), collector.force(), start_s, turns_rad, settled=True)


def approach(loop: Loop, stage: Approach) -> None:
    """The same stroke as `flap`, unrecorded."""
    loop.start_motion()
    _sweep(loop, stage)
    _stop_in_the_air(loop, stage)


def _sweep(loop: Loop, stage: Flap | Approach) -> None:
    for k in _ticks(loop, math.ceil(stage.stroke_s / TICK_S)):
        # a command stands for a whole tick, so it takes the speed of the tick's middle
        loop.step_at_speed(stage.speed_rad_s * min((k + 0.5) * TICK_S / stage.ramp_s, 1.0), TICK_S)


def _stop_in_the_air(loop: Loop, stage: Flap | Approach) -> None:
    for k in _ticks(loop, round(STOPPING_S / TICK_S)):
        loop.step_at_speed(stage.speed_rad_s * (1.0 - (k + 0.5) * TICK_S / STOPPING_S), TICK_S)
    # A drive that sagged under load is behind its target. The way back must begin where the shaft
    # really is.
    loop.target_rad = loop.angle_rad


def _ticks(loop: Loop, count: int) -> Iterator[int]:
    """Numbers of the ticks of a stretch of time. A late tick skips those that it replaced, so
    the stretch keeps its length.
    """
    start_s = loop.now_s
    while (k := math.floor((loop.now_s - start_s) / TICK_S + SLACK)) < count:
        yield k


def hold(
    loop: Loop, stage: Hold, sink: Sink, camera: Photographer | None = None
) -> RecordedSamples:
    """Waits until settled and for the dwell, then records for the averaging time while the photo is
    taken; holds the shaft throughout.

    Raises Tripped where no report of the shaft came while it averaged.

    Returns
    -------
    Recorded
        Samples, the photo or why there is none, and how long the shaft had stood before.
    """
    target_rad = loop.target_rad
    timing = stage.timing
    stopped_s = loop.now_s
    settled = settle(loop, target_rad, stage.settle)
    _stand(loop, target_rad, timing.dwell_s)
    start_s = loop.now_s
    turns_rad = turns_between(stage.angle_rad, target_rad)
    sink.begin(stage)
    sink.start(start_s, turns_rad)
    capture = PhotoCapture(
        camera if timing.photo_limit_s > 0 else None, loop.now_s, timing.photo_limit_s
    )
    with loop.record(sink.take) as collector:
        _stand(loop, target_rad, timing.average_s)
    # Commands go on while the camera is awaited: silence would make the drive's watchdog act.
    while capture.is_under_way(loop.now_s):
        loop.step_to_angle(target_rad, 0.0, HOLD_PERIOD_S)
    shaft = collector.shaft()
    # A mean of no samples is no measurement. The limit of their age may be longer than the
    # averaging time.
    if not len(shaft.angle_rad):
        raise Tripped(
            Trip.READING_OLD,
            f"no report of the shaft's angle in the {timing.average_s:g} s of {stage.label}",
        )
    return RecordedSamples(
        shaft,
        collector.force(),
        start_s,
        turns_rad,
        settled.reached,
        capture.photo,
        capture.fault,
        start_s - stopped_s,
    )


def _stand(loop: Loop, target_rad: float, duration_s: float) -> None:
    for _ in range(math.ceil(duration_s / HOLD_PERIOD_S)):
        loop.step_to_angle(target_rad, 0.0, HOLD_PERIOD_S)


def run_cycles(loop: Loop, stage: Cycles, sink: Sink, scale: SensorScale) -> None:
    """Turns the shaft from the start angle until the last cycle is done. After a stop request, one
    more cycle is the last.

    Each cycle is handed to the sink as soon as it is done. Raises Stopped where the drive has made
    more turns than it can report well.

    Parameters
    ----------
    loop : Loop
        The control loop, with the shaft at the start angle.
    stage : Cycles
        Speed and number of the cycles.
    sink : Sink
        Receives every cycle.
    scale : SensorScale
        Counts of the force sensor per N and per N m.
    """
    tally = CycleTally(scale)
    turning = CycleProfile(loop.target_rad, stage)
    sink.begin(stage)
    sink.start(loop.now_s, 0.0)
    with loop.listen(tally.take):
        while not turning.is_over:
            loop.step_at_speed(turning.speed_rad_s(loop.target_rad), MOVE_TICK_S)
            if turning.count_if_complete(loop.target_rad):
                # Cycles are counted by the commanded angle, which grows steadily, not by the
                # reported one, which lags and has noise.
                sink.cycle(tally.cycle(turning.number))
                if loop.is_stop_requested:
                    # One more cycle, not an immediate end: the shaft needs part of a turn to slow
                    # down in the air.
                    turning.end_after_next()
    loop.step_at_speed(0.0, MOVE_TICK_S)
    # A drive that sagged under load is behind its target. The way back must begin where the shaft
    # really is.
    loop.target_rad = loop.angle_rad
    sink.cycles(stage)
    # Checked between blocks of cycles, when all cycles are handed over: the run can be resumed
    # without loss.
    check_turns(loop.angle_rad)


def check_turns(angle_rad: float) -> None:
    """Raises Stopped where the angle has more turns than a drive can report precisely."""
    turns = abs(angle_rad) / TURN_RAD
    if not turns <= MAX_TURNS:
        raise Stopped(
            f"the shaft has turned {turns:.0f} times since the drive was switched on, and "
            "drives tell such angles only coarsely; "
            "switch the drive off and on again, check its zero, then go on with rfca-rig resume"
        )


class CycleProfile:
    """Speed of the shaft at each angle, and the end of each cycle. All angles are commanded
    ones, which the shaft follows.
    """

    def __init__(self, start_rad: float, stage: Cycles) -> None:
        self._stage = stage
        self._start_rad = start_rad
        self._count = stage.count
        self._done = 0

    @property
    def is_over(self) -> bool:
        return self._done >= self._count

    @property
    def number(self) -> int:
        """Of the cycle completed last, counted over the whole run."""
        return self._stage.first + self._done - 1

    def count_if_complete(self, target_rad: float) -> bool:
        """Whether one more cycle is complete at this target angle; counts it."""
        is_complete = target_rad >= self._end_rad(self._done + 1)
        self._done += is_complete
        return is_complete

    def end_after_next(self) -> None:
        """Makes the next cycle the last one, so that there is room to slow down in it."""
        self._count = min(self._count, self._done + 1)

    def speed_rad_s(self, target_rad: float) -> float:
        """Speed in rad/s: constant acceleration from the start, constant deceleration towards the
        end of the last cycle.

        At a distance s from either end it is sqrt(2 a s), where a is the stage's speed divided by
        MOVE_RAMP_S; at most the stage's speed.
        """
        # The same profile serves both ends: the shorter distance decides. Rounding may make it
        # slightly negative, hence the 0.
        top = self._stage.speed_rad_s
        both_ramps = 2.0 * self._stage.speed_rad_s / MOVE_RAMP_S
        from_start_rad = target_rad - self._start_rad
        to_end_rad = self._end_rad(self._count) - target_rad
        return max(
            min(top, math.sqrt(both_ramps * max(min(from_start_rad, to_end_rad), 0.0))),
            CREEP_SHARE * top,
        )

    def _end_rad(self, count: int) -> float:
        return self._start_rad + TURN_RAD * count - BEFORE_START_RAD


class CycleTally:
    """Peak loads and mean speed of the cycle under way."""

    def __init__(self, scale: SensorScale) -> None:
        self._counts_per_unit = np.repeat([scale.counts_per_N, scale.counts_per_Nm], 3)
        self._began: tuple[float, float] | None = None
        self._last = (math.nan, math.nan, math.nan)
        self._forget()

    def _forget(self) -> None:
        self._peak_force_N = self._peak_moment_Nm = 0.0
        self._min_fz_N = math.inf

    def take(self, shaft: ShaftSamples, force: ForceSamples) -> None:
        """Adds the samples of one tick; `force.counts` (m, 6) are raw counts, both blocks may be
        empty.
        """
        if len(shaft.angle_rad):
            self._last = (
                float(shaft.host_s[-1]),
                float(shaft.device_s[-1]),
                float(shaft.angle_rad[-1]),
            )
            # By the device's own clock: the host's arrival times jitter with the load of the
            # computer.
            self._began = self._began or (float(shaft.device_s[0]), float(shaft.angle_rad[0]))
        if len(force.counts):
            wrench = force.counts / self._counts_per_unit
            squares = wrench * wrench
            self._peak_force_N = max(
                self._peak_force_N, math.sqrt(squares[:, :3].sum(axis=1).max())
            )
            self._peak_moment_Nm = max(
                self._peak_moment_Nm, math.sqrt(squares[:, 3:].sum(axis=1).max())
            )
            self._min_fz_N = min(self._min_fz_N, float(wrench[:, 2].min()))

    def cycle(self, number: int) -> Cycle:
        """The cycle that ends now; the next one begins where it ended."""
        host_s, device_s, angle_rad = self._last
        began_s, began_rad = self._began or (math.nan, math.nan)
        elapsed_s = device_s - began_s
        if elapsed_s > 0.0:
            mean_speed_rad_s = (angle_rad - began_rad) / elapsed_s
        else:
            mean_speed_rad_s = math.nan
        done = Cycle(
            number,
            host_s,
            device_s,
            self._peak_force_N,
            self._peak_moment_Nm,
            self._min_fz_N,
            mean_speed_rad_s,
        )
        # The next cycle begins at this sample, not at the next one: no part of a turn is left out
        # of a mean speed.
        self._began = device_s, angle_rad
        self._forget()
        return done
