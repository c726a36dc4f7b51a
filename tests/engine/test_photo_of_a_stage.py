"""A stage's photo, whatever the camera does: the drive is commanded all along, the stage ends,
and the run says what became of it.
"""

import threading
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rfca_rig.drivers.camera import CameraThread
from rfca_rig.drivers.roles import Photo
from rfca_rig.engine.run import run_plan
from rfca_rig.engine.stages import HOLD_PERIOD_S
from rfca_rig.engine.stopping import Sink
from rfca_rig.errors import DeviceError
from rfca_rig.protocol.experiments import StaticStages, static_plan
from rfca_rig.protocol.plan import SettleCriterion
from tests.engine.rigs import nothing, recorder_on, twin_rig

LIMIT_S = 2.0
SETTLE = SettleCriterion(0.2, 0.01, 0.1, 3.0)


def plan(*angles_deg: float, average_s: float = 0.1, dwell_s: float = 0.0):
    angles = tuple((float(np.radians(angle)), "loading") for angle in angles_deg)
    stages = StaticStages("stages", (0.235,), angles, 2.0, SETTLE, average_s, dwell_s)
    return static_plan(stages, replace(twin_rig().facts(), photo_limit_s=LIMIT_S))


class Frozen:
    """A camera that never answers."""

    def photo(self):
        threading.Event().wait()

    def close(self):
        """Never called: its thread ends with the process."""

    def identity(self):
        return {"camera": "frozen"}


class Later:
    """A photographer whose photos come so long after they were asked for; an error is raised
    instead.
    """

    def __init__(self, clock, *after_s):
        self._clock = clock
        self._after = iter(after_s)
        self._due_s = np.inf
        self._number = 0

    def begin(self):
        after = next(self._after)
        if isinstance(after, Exception):
            raise after
        self._due_s = self._clock.now_s() + after
        self._number = self._number + 1

    def fetch_photo(self):
        if self._clock.now_s() < self._due_s:
            return None
        self._due_s = np.inf
        return Photo(np.zeros((2, 2, 3), np.uint8), 0.0, f"photo-{self._number}")


class Kept(Sink):
    """What the engine recorded."""

    def __init__(self):
        self.recorded = []

    def hold(self, _stage, recorded):
        self.recorded.append(recorded)


class Watched:
    """The bench's motor, with the time of every command."""

    def __init__(self, motor, clock):
        self._motor = motor
        self._clock = clock
        self.commanded_s = []

    def command_angle(self, angle_rad, speed_rad_s=0.0):
        self.commanded_s.append(self._clock.now_s())
        self._motor.command_angle(angle_rad, speed_rad_s)

    def __getattr__(self, name):
        return getattr(self._motor, name)


def run(tmp_path, camera_on, *angles_deg, average_s=0.1, dwell_s=0.0):
    """What was recorded, when the motor was commanded, and when each stage was over."""
    over_s = []
    with recorder_on(twin_rig(), tmp_path / "run") as (bench, _, _file):
        kept = Kept()
        motor = Watched(bench.motor, bench.clock)
        run_plan(
            plan(*angles_deg, average_s=average_s, dwell_s=dwell_s),
            replace(bench, motor=motor, camera=camera_on(bench.clock)),
            kept,
            lambda stage: over_s.append((stage.label, bench.clock.now_s())),
        )
    return (
        kept.recorded,
        motor.commanded_s,
        {label: at_s for label, at_s in over_s if label.startswith("hold")},
    )


def test_a_frozen_camera_ends_its_stage_in_the_time_it_says_and_the_next_one_at_once(tmp_path):
    recorded, commanded_s, over_s = run(tmp_path, lambda _clock: CameraThread(Frozen()), 50.0, 55.0)
    assert (
        recorded[0].photo_fault == "the camera gave no photo within 2 s; check its cable and power"
    )
    assert recorded[1].photo_fault.startswith(
        "the camera has not answered since an earlier photo; unplug it"
    )
    assert [stage.photo for stage in recorded] == [None, None]
    assert all(len(stage.force.counts) > 500 for stage in recorded)
    took_s = [at_s - stage.start_s for at_s, stage in zip(over_s.values(), recorded, strict=True)]
    assert took_s == [
        pytest.approx(LIMIT_S, abs=2 * HOLD_PERIOD_S),
        pytest.approx(0.1, abs=2 * HOLD_PERIOD_S),
    ]
    assert (
        max(later - earlier for earlier, later in pairwise(commanded_s)) < 0.05
    )  # the watchdog's share


@pytest.mark.slow
@pytest.mark.parametrize(
    ("after_s", "average_s", "lasts_s"), [(0.0, 0.3, 0.3), (0.2, 0.3, 0.3), (1.5, 0.3, 1.5)]
)
def test_the_photo_is_taken_while_the_mean_is_and_waited_for_no_longer_than_it_takes(
    tmp_path, after_s, average_s, lasts_s
):
    recorded, commanded_s, over_s = run(
        tmp_path, lambda clock: Later(clock, after_s), 50.0, average_s=average_s
    )
    (stage,) = recorded
    (end_s,) = over_s.values()
    assert (stage.photo.name, stage.photo_fault) == ("photo-1", "")
    assert end_s - stage.start_s == pytest.approx(lasts_s, abs=3 * HOLD_PERIOD_S)
    assert len(stage.force.counts) / 7000.0 == pytest.approx(average_s, abs=3 * HOLD_PERIOD_S)
    assert max(later - earlier for earlier, later in pairwise(commanded_s)) < 0.05


@pytest.mark.slow
def test_a_photo_that_came_too_late_is_no_other_stage_s(tmp_path):
    recorded, _, _ = run(tmp_path, lambda clock: Later(clock, LIMIT_S + 0.5, 0.1), 50.0, 55.0)
    assert [stage.photo and stage.photo.name for stage in recorded] == [None, "photo-2"]


def test_a_camera_that_fails_costs_the_photo_not_the_stage(tmp_path):
    recorded, _, _ = run(
        tmp_path, lambda clock: Later(clock, DeviceError("unplugged"), 0.1), 50.0, 55.0
    )
    assert [stage.photo_fault for stage in recorded] == ["unplugged", ""]
    assert recorded[1].photo.name == "photo-1"


def test_a_mistake_in_a_camera_s_driver_is_never_swallowed_and_the_motor_is_off(tmp_path):
    with recorder_on(twin_rig(), tmp_path / "run") as (bench, _, _file):
        with pytest.raises(ZeroDivisionError):
            run_plan(
                plan(50.0),
                replace(bench, camera=Later(bench.clock, ZeroDivisionError())),
                Kept(),
                nothing,
            )
        bench.clock.wait_until(bench.clock.now_s() + 1.0)
        assert abs(bench.motor.read().torque_Nm[-1]) == 0.0


def test_without_a_camera_or_without_the_wish_no_photo_is_asked_for(tmp_path):
    recorded, _, over_s = run(tmp_path, lambda _clock: None, 50.0)
    assert (recorded[0].photo, recorded[0].photo_fault) == (None, "")
    assert next(iter(over_s.values())) - recorded[0].start_s == pytest.approx(
        0.1, abs=2 * HOLD_PERIOD_S
    )


@pytest.mark.slow
def test_the_dwell_comes_between_settling_and_the_mean(tmp_path):
    starts_s = []
    stood_s = []
    for dwell_s in (0.0, 0.7):
        folder = tmp_path / f"{dwell_s}"
        folder.mkdir()
        (stage,), _, _ = run(folder, lambda _clock: None, 50.0, dwell_s=dwell_s)
        starts_s.append(stage.start_s)
        stood_s.append(stage.stood_s)
        assert stage.settled
    assert starts_s[1] - starts_s[0] == pytest.approx(0.7, abs=HOLD_PERIOD_S)
    assert stood_s[1] - stood_s[0] == pytest.approx(0.7, abs=HOLD_PERIOD_S)
    assert SETTLE.for_s <= stood_s[0] < SETTLE.limit_s
