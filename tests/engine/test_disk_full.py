"""A disk that fills up in the middle of a run: the motor is off before anything else, and what
was recorded stays.
"""

import pytest

from rfca_rig.engine.run import run_plan
from rfca_rig.errors import DiskFull
from tests.engine.rigs import one_condition, recorder_on, twin_rig
from tests.engine.test_stops import ends_without_torque, tapped
from tests.recording.dying import FullDisk, instead


@pytest.mark.slow
def test_the_motor_is_off_and_the_stages_before_are_kept(tmp_path):
    rig = twin_rig()
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, kept):
        wiretap = tapped(bench)
        disk = FullDisk(tmp_path / "run", 10**9)

        def fill_up(_stage):
            if recorder.strokes:
                disk.room = disk.used + 100_000

        with instead(disk):
            with pytest.raises(
                DiskFull,
                match=(
                    r"^stopped: disk full: .*0002\.journal: .* cannot be added: No space left "
                    r"on device"
                ),
            ):
                run_plan(one_condition(rig, 3), bench, recorder, fill_up)
            assert ends_without_torque(wiretap)
            bench.clock.wait_until(bench.clock.now_s() + 3.0)
            assert abs(bench.motor.read().torque_Nm[-1]) == 0.0
            kept.keeper.finish("stopped: disk full")
        found = kept.so_far()
        assert [stroke.repeat for stroke in found.strokes] == [1]
        assert found.raw[0].streams["force"].t_s[-1] > 0.0
