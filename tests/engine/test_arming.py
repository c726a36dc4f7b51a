"""Nothing moves before the drive has shown that it stops by itself."""

import pytest

from rfca_rig.devices.odrive.twin import OdriveTwinSettings
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.run import prove_stop, run_plan
from rfca_rig.errors import DeviceError
from tests.devices.rig import twin_rig as drive_alone
from tests.engine.rigs import nothing, one_condition, recorder_on, twin_rig
from tests.engine.test_stops import ends_without_torque, tapped


def test_a_drive_that_stops_by_itself_is_proven_and_the_run_goes_on(tmp_path):
    rig = twin_rig()
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        assert 0.05 < prove_stop(bench) < 0.5
        assert bench.motor.status().state == "idle"
        run_plan(one_condition(rig), bench, recorder, nothing)
        assert len(recorder.strokes) == 1


def test_a_drive_without_watchdog_is_refused_and_left_without_torque():
    with drive_alone(motor_twin=OdriveTwinSettings(watchdog_s=None)) as rig:
        with pytest.raises(
            DeviceError, match=r"watchdog let it run through 1 s of silence; set enable_watchdog"
        ):
            prove_stop(Bench(rig.motor, rig.sensor, None, rig.clock, is_real=True))
        rig.run(0.2)
        assert rig.motor.status().state == "idle"


def test_an_operator_who_stops_the_proof_leaves_no_torque_either(tmp_path):
    with recorder_on(twin_rig(), tmp_path / "run") as (bench, _, _):

        def interrupted(_limit_s):
            raise KeyboardInterrupt

        bench.motor.prove_watchdog = interrupted
        wiretap = tapped(bench)
        with pytest.raises(KeyboardInterrupt):
            prove_stop(bench)
        assert ends_without_torque(wiretap)
