"""What the operator wants: once the next safe point, twice now, from outside a gentle end. In
every case the motor ends without torque.
"""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from rfca_rig.clock import Clock
from rfca_rig.devices.odrive.messages import OdriveCommand
from rfca_rig.engine.interfaces import StopLevel, StopRequest
from rfca_rig.engine.loop import Loop
from rfca_rig.engine.run import Supervision, run_plan
from rfca_rig.errors import DeviceError, Stopped
from rfca_rig.protocol.plan import Flap, MoveShaft
from rfca_rig.recording.run_folder import read_stages
from tests.engine.rigs import one_condition, recorder_on, twin_rig
from tests.engine.test_stops import MOTION, ends_without_torque, tapped

IN_THE_FIRST_STROKE_S = 2.0


@dataclass
class WithAHandOnTheKey:
    """A clock at whose moment somebody presses; `pressed_s` is when the loop could know."""

    clock: Clock
    at_s: float
    press: object
    pressed_s: float = np.nan

    def now_s(self) -> float:
        return self.clock.now_s()

    def start_time(self):
        return self.clock.start_time()

    def wait_until(self, t_s: float) -> None:
        self.clock.wait_until(t_s)
        if np.isnan(self.pressed_s) and self.clock.now_s() >= self.at_s:
            self.pressed_s = self.clock.now_s()
            self.press()


def pressed(tmp_path, level, at_s=IN_THE_FIRST_STROKE_S, repeats=3):
    """What became of a run of three strokes: its stages, frames on the bus after the key, and
    the recorder.
    """
    rig = twin_rig()
    stop_request = StopRequest()
    done = []
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        wiretap = tapped(bench)
        before = []

        def press():
            stop_request.ask(level, "stopped by a test")
            before.append(len(wiretap.sent))

        clock = WithAHandOnTheKey(bench.clock, at_s, press)
        with pytest.raises(Stopped, match="stopped by a test") as found:
            run_plan(
                one_condition(rig, repeats),
                replace(bench, clock=clock),
                recorder,
                done.append,
                Supervision(stop_request=stop_request),
            )
        assert ends_without_torque(wiretap)
        motion = sum((frame.arbitration_id & 0x1F) in MOTION for frame in wiretap.sent[before[0] :])
    return done, motion, recorder, str(found.value), read_stages(tmp_path / "run")


def test_once_the_stroke_is_finished_and_the_leg_brought_into_the_air(tmp_path):
    done, _, recorder, said, kept = pressed(tmp_path, StopLevel.SAFE_POINT)
    assert [stroke.repeat for stroke in kept.strokes] == [1]
    stroke, onwards, waiting = done[-3:]
    assert isinstance(stroke, Flap)
    assert isinstance(onwards, MoveShaft)
    assert onwards.forwards
    assert waiting.angle_rad == twin_rig().facts().parked_angle_rad
    assert said.endswith("at a safe point")
    assert np.isfinite(recorder.standstill.turned_rad)


def test_twice_not_one_more_motion_frame_leaves(tmp_path):
    _, motion, _, _, kept = pressed(tmp_path, StopLevel.TORQUE_OFF)
    assert motion == 0
    assert kept.strokes == ()
    assert len(kept.raw) == 1


def test_from_outside_the_shaft_slows_down_first(tmp_path):
    _, motion, _, _, kept = pressed(tmp_path, StopLevel.RAMP_DOWN)
    assert 90 <= motion <= 101
    assert kept.strokes == ()


def test_a_wish_at_the_very_end_leaves_a_run_that_is_done(tmp_path):
    rig = twin_rig()
    stop_request = StopRequest()
    plan = one_condition(rig)

    def at_the_last(stage):
        if stage is plan.stages[-1]:
            stop_request.ask(StopLevel.SAFE_POINT, "too late")

    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        run_plan(plan, bench, recorder, at_the_last, Supervision(stop_request=stop_request))
        assert len(recorder.strokes) == 1


def test_a_wish_is_only_replaced_by_a_more_urgent_one():
    stop_request = StopRequest()
    stop_request.ask(StopLevel.RAMP_DOWN, "first")
    stop_request.ask(StopLevel.SAFE_POINT, "second")
    assert (stop_request.level, stop_request.why) == (StopLevel.RAMP_DOWN, "first")


def test_after_the_stop_no_command_leaves_any_more(tmp_path):
    with recorder_on(twin_rig(), tmp_path / "run") as (bench, _, _):
        loop = Loop(bench, one_condition(twin_rig()).limits)
        wiretap = tapped(bench)
        loop.end()
        for command in (
            lambda: loop.step_to_angle(0.0, 0.0, 0.002),
            lambda: loop.step_at_speed(1.0, 0.002),
        ):
            with pytest.raises(DeviceError, match="nothing moves before it is begun again"):
                command()
        assert not [
            frame
            for frame in wiretap.sent
            if frame.arbitration_id & 0x1F in {*MOTION, OdriveCommand.CONTROLLER_MODE}
        ]
