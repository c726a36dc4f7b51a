"""How each stage of a plan is carried out."""

import math
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.drivers.roles import Photo, Photographer
from rfca_rig.engine.loop import Loop
from rfca_rig.engine.stopping import RecordedSamples, Sink
from rfca_rig.errors import RigError, Trip, Tripped
from rfca_rig.protocol.plan import MOVE_RAMP_S, STOPPING_S, TURN_RAD, Approach, Flap, Hold, MoveShaft, SettleCriterion, turn_to

HOLD_PERIOD_S = 0.01
# Averages 350 records at 7 kHz: sensor noise of 0.15 N becomes 0.01 N. Still short enough to see a leg that swings.
MEAN_S = 0.05

# Seconds between two commands, in strokes and in moves.
TICK_S = 0.002
MOVE_TICK_S = 0.005
# Share of a tick: rounding of the times must not turn one tick into two.
SLACK = 1e-3


@dataclass(frozen=True)
class Settled:
    """Result: `reached` is False where the time limit came first; `wrench` (6,) is the last mean of force [N] and moment [N m]."""

    reached: bool
    wrench: NDArray[np.float64]


def settle(loop: Loop, target_rad: float, criterion: SettleCriterion) -> Settled:
    """Holds the shaft at `target_rad` until force and angle stay within the bands of the criterion, or its time limit is reached.

    Returns
    -------
    Settled
        Whether the criterion was met, and the mean wrench (6,) in N and N m.
    """
    per_mean = round(MEAN_S / HOLD_PERIOD_S)
    # At least two means: the range of a single one is zero and would always be within the band.
    means: deque[np.ndarray] = deque(maxlen=max(2, round(criterion.for_s / MEAN_S)))
    began_s = loop.now_s
    # Half a mean is allowed for, because the loop's times do not add up to exact multiples of MEAN_S.
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
    """A photo that is taken while the loop goes on. It never waits, and keeps the stage waiting for `limit_s` at most.

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
        """Whether to ask again later. Once False, `photo` holds the photo, or `fault` says why there is none."""
        if self._camera is None:
            return False
        self._look(self._camera, now_s)
        return self._camera is not None

    def _look(self, camera: Photographer, now_s: float) -> None:
        try:
            self.photo = camera.fetch_photo()
        except RigError as error:
            self._end(str(error))
        if self.photo is not None:
            self._end("")
        elif not self.fault and now_s >= self._ends_s:
            self._end(f"the camera gave no photo within {self._limit_s:g} s; check its cable and power")

    def _end(self, fault: str) -> None:
        self.fault = fault
        self._camera = None


def move(loop: Loop, stage: MoveShaft) -> None:
    """Moves along a trapezoidal speed profile to the angle, the nearest way or forwards."""
    way_rad = turn_to(stage.angle_rad, loop.target_rad, stage.forwards)
    start_rad, goal_rad = loop.target_rad, loop.target_rad + way_rad
    duration_s = abs(way_rad) / stage.speed_rad_s + MOVE_RAMP_S
    # Angles are commanded, not speeds: the move ends exactly at the goal even where the drive lags on the way.
    for k in range(1, math.ceil(duration_s / MOVE_TICK_S) + 1):
        travelled, speed = _trapezoid(k * MOVE_TICK_S / duration_s, MOVE_RAMP_S / duration_s)
        loop.step_to_angle(start_rad + way_rad * travelled, way_rad * speed / duration_s, MOVE_TICK_S)
    loop.step_to_angle(goal_rad, 0.0, MOVE_TICK_S)


def _trapezoid(x: float, ramp: float) -> tuple[float, float]:
    """Share of the way and its derivative at share `x` of the time, with ramps of share `ramp` at both ends."""
    # A move shorter than two ramps becomes a triangle.
    ramp = min(ramp, 0.5)
    # Plateau speed that makes the whole way 1: plateau of length 1 - 2 ramp, and two ramps of half height on average.
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
        Samples of both devices, host time of the commanded start, and whole turns to subtract from the shaft angle.
    """
    turns_rad = TURN_RAD * round(loop.target_rad / TURN_RAD)
    hold_rad = loop.target_rad
    sink.begin(stage)
    with loop.record(sink.take) as collector:
        # Recorded at rest first, so that the stroke's initial state is part of the recording.
        for _ in range(round(stage.before_s / TICK_S)):
            loop.step_to_angle(hold_rad, 0.0, TICK_S)
        start_s = loop.now_s
        sink.start(start_s, turns_rad)
        _sweep(loop, stage)
    _stop_in_the_air(loop, stage)
    return RecordedSamples(collector.shaft(), collector.force(), start_s, turns_rad, settled=True)


def approach(loop: Loop, stage: Approach) -> None:
    """The same stroke as `flap`, unrecorded."""
    _sweep(loop, stage)
    _stop_in_the_air(loop, stage)


def _sweep(loop: Loop, stage: Flap | Approach) -> None:
    for k in _ticks(loop, math.ceil(stage.stroke_s / TICK_S)):
        # a command stands for a whole tick, so it takes the speed of the tick's middle
        loop.step_at_speed(stage.speed_rad_s * min((k + 0.5) * TICK_S / stage.ramp_s, 1.0), TICK_S)


def _stop_in_the_air(loop: Loop, stage: Flap | Approach) -> None:
    for k in _ticks(loop, round(STOPPING_S / TICK_S)):
        loop.step_at_speed(stage.speed_rad_s * (1.0 - (k + 0.5) * TICK_S / STOPPING_S), TICK_S)
    # A drive that sagged under load is behind its target. The way back must begin where the shaft really is.
    loop.target_rad = loop.angle_rad


def _ticks(loop: Loop, count: int) -> Iterator[int]:
    """Numbers of the ticks of a stretch of time. A late tick skips those that it replaced, so the stretch keeps its length."""
    start_s = loop.now_s
    while (k := math.floor((loop.now_s - start_s) / TICK_S + SLACK)) < count:
        yield k


def hold(loop: Loop, stage: Hold, sink: Sink, camera: Photographer | None = None) -> RecordedSamples:
    """Waits until settled and for the dwell, then records for the averaging time while the photo is taken; holds the shaft throughout.

    Raises Tripped where no report of the shaft came while it averaged.

    Returns
    -------
    Recorded
        Samples, the photo or why there is none, and how long the shaft had stood before.
    """
    target_rad, timing, stopped_s = loop.target_rad, stage.timing, loop.now_s
    settled = settle(loop, target_rad, stage.settle)
    _stand(loop, target_rad, timing.dwell_s)
    start_s = loop.now_s
    # The continuous angle may be any number of turns away from the stage's own angle, after moves over the top.
    turns_rad = TURN_RAD * round((target_rad - stage.angle_rad) / TURN_RAD)
    sink.begin(stage)
    sink.start(start_s, turns_rad)
    capture = PhotoCapture(camera if timing.photo_limit_s > 0 else None, loop.now_s, timing.photo_limit_s)
    with loop.record(sink.take) as collector:
        _stand(loop, target_rad, timing.average_s)
    # Commands go on while the camera is awaited: silence would make the drive's watchdog act.
    while capture.is_under_way(loop.now_s):
        loop.step_to_angle(target_rad, 0.0, HOLD_PERIOD_S)
    shaft = collector.shaft()
    # A mean of no samples is no measurement. The silence limit may be longer than the averaging time.
    if not len(shaft.angle_rad):
        raise Tripped(Trip.ENCODER_SILENT, f"no report of the shaft's angle in the {timing.average_s:g} s of {stage.label}")
    return RecordedSamples(shaft, collector.force(), start_s, turns_rad, settled.reached, capture.photo, capture.fault, start_s - stopped_s)


def _stand(loop: Loop, target_rad: float, duration_s: float) -> None:
    for _ in range(math.ceil(duration_s / HOLD_PERIOD_S)):
        loop.step_to_angle(target_rad, 0.0, HOLD_PERIOD_S)
