"""A pause between two stages: the shaft is held with every limit checked, and the run goes on as
if nothing had been.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.clock import Clock
from rfca_rig.engine.interfaces import StopLevel, StopRequest
from rfca_rig.engine.run import Supervision, may_pause, run_plan
from rfca_rig.errors import Stopped, Trip, Tripped
from rfca_rig.protocol.plan import Flap, Hold, MoveShaft, SetHeight
from rfca_rig.recording.run_text import events_of
from tests.engine.rigs import one_condition, recorder_on, twin_rig
from tests.engine.test_stops import MOTION, ends_without_torque, tapped

PAUSED_S = 30.0


class Pausing:
    """Observer and operator in one: asks for a pause in the first stroke, and lets the run go on,
    or does what it is told, after a time.
    """

    def __init__(self, clock: Clock, stop_request: StopRequest, then) -> None:
        self._clock = clock
        self._stop_request = stop_request
        self._then = then
        self._has_asked = False
        self.began_s = np.inf
        self.ended_s = np.inf
        self.ticks = []

    def stage(self, stage, expected, turns_rad):
        del expected, turns_rad
        if isinstance(stage, Flap) and not self._has_asked:
            self._has_asked = True
            self._stop_request.is_pause_asked = True

    def start(self, start_s):
        pass

    def energising(self):
        pass

    def pause(self, is_paused):
        if is_paused:
            self.began_s = self._clock.now_s()
        else:
            self.ended_s = self._clock.now_s()

    def tick(self, tick):
        if self.began_s <= tick.now_s < self.ended_s:
            self.ticks.append(tick)
            if tick.now_s - self.began_s > PAUSED_S:
                self._then(self._stop_request)


def go_on(stop_request):
    stop_request.is_pause_asked = False


def with_little_noise():
    """Without any, the sensor would count as frozen."""
    rig = twin_rig()
    return rig.model_copy(
        update={"twin": rig.twin.model_copy(update={"noise_N": 1e-4, "noise_Nm": 1e-5})}
    )


def run_with(folder, then=None, repeats=2):
    """Recording, events, observer and the bus of a run, with a pause that ends by `then`."""
    rig = with_little_noise()
    stop_request = StopRequest()
    with recorder_on(rig, folder) as (bench, recorder, kept):
        wiretap = tapped(bench)
        supervision = Supervision(stop_request=stop_request)
        observer = None
        if then is not None:
            observer = Pausing(bench.clock, stop_request, then)
            supervision = replace(supervision, observer=observer)
        done = []
        try:
            run_plan(one_condition(rig, repeats), bench, recorder, done.append, supervision)
        finally:
            assert ends_without_torque(wiretap)
        return kept.finish(), events_of(folder), observer, done


@pytest.mark.slow
def test_a_recording_with_a_pause_is_that_without_one_but_for_the_times(tmp_path):
    plain, _, _, _ = run_with(tmp_path / "plain")
    paused, events, observer, done = run_with(tmp_path / "paused", go_on)
    assert observer.ended_s - observer.began_s == pytest.approx(PAUSED_S, abs=0.05)
    (begin,) = [event for event in events if event["event"] == "paused"]
    (end,) = [event for event in events if event["event"] == "pause ends"]
    assert end["waited_s"] == pytest.approx(PAUSED_S, abs=0.05)
    assert end["t_s"] - begin["t_s"] == pytest.approx(end["waited_s"], abs=0.02)
    assert len(plain.strokes) == len(paused.strokes) == 2
    for stroke, same in zip(plain.strokes, paused.strokes, strict=True):
        for name in ("fy_N", "fz_N", "tx_Nm", "shaft_angle_rad"):
            t_s, values = stroke.channel(name)
            same_t_s, same_values = same.channel(name)
            # Datagrams of 40 records: a recording may begin or end with another one.
            common = (t_s >= same_t_s[0]) & (t_s <= same_t_s[-1])
            assert common.sum() > len(t_s) - 80
            interpolated = np.interp(t_s[common], same_t_s, same_values)
            # The leg has hung longer and swings less when the second stroke begins: 0.11 N in fz.
            small = 0.002 * np.ptp(values)
            np.testing.assert_allclose(interpolated, values[common], rtol=0.0, atol=small)
    # Nothing differs before the pause.
    _, first_N = plain.strokes[0].channel("fz_N")
    _, same_N = paused.strokes[0].channel("fz_N")
    np.testing.assert_array_equal(first_N, same_N)
    assert [stage.label for stage in done] == [stage.label for stage in one_condition_stages()]


def one_condition_stages():
    return one_condition(with_little_noise(), 2).stages


@pytest.mark.slow
def test_the_shaft_is_held_in_the_air_and_the_drive_fed(tmp_path):
    _, _, observer, done = run_with(tmp_path / "run", go_on)
    angles_rad = np.concatenate([tick.shaft.angle_rad for tick in observer.ticks])
    assert np.ptp(angles_rad) < 2e-3
    # No two commands are further apart than the drive's watchdog allows.
    assert np.diff([tick.now_s for tick in observer.ticks]).max() < 0.011
    # Of the leg's weight, and no contact with the ground.
    counts = np.concatenate([tick.force.counts for tick in observer.ticks])
    assert np.abs(counts[:, :3]).max() / 1e6 < 4.0
    # It waits where the shaft has come back to the start of a stroke, not right after the stroke.
    assert isinstance(done[-1], MoveShaft)


@pytest.mark.slow
def test_a_limit_trips_in_a_pause_as_ever(tmp_path):
    def hit(stop_request):
        del stop_request
        raise Tripped(Trip.FORCE, "a blow")

    with pytest.raises(Tripped, match="a blow"):
        run_with(tmp_path / "run", hit)


@pytest.mark.slow
def test_the_sensor_that_falls_silent_in_a_pause_trips(tmp_path):
    rig = with_little_noise()
    stop_request = StopRequest()
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        observer = Pausing(bench.clock, stop_request, lambda _: bench.sensor.stop())
        supervision = Supervision(stop_request=stop_request, observer=observer)
        with pytest.raises(Tripped) as error:
            run_plan(one_condition(rig, 2), bench, recorder, lambda _: None, supervision)
    assert error.value.code is Trip.SENSOR_SILENT


@pytest.mark.slow
@pytest.mark.parametrize("level", [StopLevel.SAFE_POINT, StopLevel.TORQUE_OFF])
def test_a_stop_ends_a_pause(tmp_path, level):
    with pytest.raises(Stopped, match="enough"):
        run_with(tmp_path / "run", lambda request: request.ask(level, "enough"), repeats=3)


def test_it_never_waits_on_the_ground_and_not_before_the_rack_was_set():
    rack = SetHeight(0.215)
    home = MoveShaft(0.2, 1.0, forwards=True)
    down = MoveShaft(1.2, 0.2)
    (flap, *_) = one_condition(twin_rig()).flaps
    assert not may_pause([], rack)
    assert may_pause([rack], home)
    assert may_pause([rack, home], flap)
    assert not may_pause([rack, home, flap], home)
    assert not may_pause([rack, home, down], Hold)
    assert not may_pause([rack, home, down], down)
    assert may_pause([rack, home, flap, home, down], rack)


@pytest.mark.slow
def test_motion_stops_with_the_pause(tmp_path):
    """The bus carries commands of one angle only."""
    rig = with_little_noise()
    stop_request = StopRequest()
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        wiretap = tapped(bench)
        sent = []

        def remember(request):
            sent.append(len(wiretap.sent))
            go_on(request)

        observer = Pausing(bench.clock, stop_request, remember)
        supervision = Supervision(stop_request=stop_request, observer=observer)
        run_plan(one_condition(rig, 2), bench, recorder, lambda _: None, supervision)
        frames = wiretap.sent[sent[0] - 2000 : sent[0]]
    commands = {bytes(frame.data) for frame in frames if frame.arbitration_id & 0x1F in MOTION}
    assert len(commands) == 1
