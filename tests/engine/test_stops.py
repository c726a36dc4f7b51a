"""Whatever goes wrong: the motion stops, the motor is without torque, what was recorded is kept."""

from dataclasses import replace

import can
import numpy as np
import pytest

from rfca_rig.devices.odrive.messages import AxisState, OdriveCommand
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.run import run_plan
from rfca_rig.errors import DeviceError, Stopped, Tripped
from rfca_rig.protocol.plan import Flap
from rfca_rig.recording.run_folder import read_stages
from tests.engine.rigs import changed, nothing, one_condition, recorder_on, twin_rig

MOTION = {OdriveCommand.INPUT_POS, OdriveCommand.INPUT_VEL, OdriveCommand.INPUT_TORQUE}


class Wiretap:
    """Stands between driver and bus, and keeps every frame that was sent."""

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.sent: list[can.Message] = []

    def send(self, message: can.Message, timeout: float | None = None) -> None:
        self.sent.append(message)
        self._bus.send(message, timeout)

    def __getattr__(self, name: str) -> object:
        return getattr(self._bus, name)


def tapped(bench: Bench) -> Wiretap:
    wiretap = Wiretap(bench.motor._bus)
    bench.motor._bus = wiretap
    return wiretap


def ends_without_torque(wiretap: Wiretap) -> bool:
    """The last word on the wire is: idle; nothing moves after it."""
    commands = [(message.arbitration_id & 0x1F, bytes(message.data)) for message in wiretap.sent]
    idle = max(
        i
        for i, (command, data) in enumerate(commands)
        if command == OdriveCommand.AXIS_STATE and data[0] == AxisState.IDLE
    )
    return not any(command in MOTION for command, _ in commands[idle:])


def stopped_by(tmp_path, rig, plan, error, match, spoil=None):
    """Runs into the error; returns what is on disk, and the bench."""
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        wiretap = tapped(bench)
        with pytest.raises(error, match=match):
            run_plan(plan, spoil(bench) if spoil else bench, recorder, nothing)
        assert ends_without_torque(wiretap)
        before = bench.clock.now_s()
        bench.clock.wait_until(before + 3.0)
        assert abs(bench.motor.read().torque_Nm[-1]) == 0.0
    return read_stages(tmp_path / "run")


def test_force_above_the_limit_trips_and_says_the_numbers(tmp_path):
    rig = changed(twin_rig(), "limits", force_N=30.0)
    kept = stopped_by(tmp_path, rig, one_condition(rig), Tripped, r"force 30\.\d N, limit 30 N")
    assert kept.strokes == ()
    (until_then,) = kept.raw
    assert np.abs(until_then.streams["force"].columns["fz_N"].values).max() > 25.0
    assert 0.5 < until_then.streams["shaft"].t_s[-1] < 1.5


def test_moment_above_the_limit_trips(tmp_path):
    rig = changed(twin_rig(), "limits", torque_Nm=3.0)
    stopped_by(tmp_path, rig, one_condition(rig), Tripped, r"moment 3\.\d+ N m, limit 3 N m")


def test_a_shaft_that_runs_away_trips(tmp_path):
    rig = changed(twin_rig(), "limits", speed_rad_s=2.0)
    stopped_by(
        tmp_path, rig, one_condition(rig), Tripped, r"shaft at -?2\.\d+ rad/s, limit 2 rad/s"
    )


def test_a_drive_too_weak_to_follow_trips(tmp_path):
    rig = twin_rig()
    weak = rig.twin.model_copy(
        update={"drive": rig.twin.drive.model_copy(update={"torque_limit_Nm": 2.0})}
    )
    rig = rig.model_copy(update={"twin": weak})
    stopped_by(tmp_path, rig, one_condition(rig), Tripped, "deg from where it should be")


class QuietSensor:
    """Streams until told not to."""

    def __init__(self, sensor, quiet_after):
        self._sensor = sensor
        self._left = quiet_after

    def read(self):
        samples = self._sensor.read()
        self._left -= 1
        if self._left > 0:
            return samples
        return replace(
            samples,
            **{
                name: getattr(samples, name)[:0]
                for name in ("host_s", "device_s", "sequence", "status", "counts")
            },
        )

    def __getattr__(self, name):
        return getattr(self._sensor, name)


def test_a_sensor_that_falls_silent_trips(tmp_path):
    rig = twin_rig()
    stopped_by(
        tmp_path,
        rig,
        one_condition(rig),
        Tripped,
        r"force sensor silent for 5\d ms",
        lambda b: replace(b, sensor=QuietSensor(b.sensor, 400)),
    )


def test_strokes_before_a_trip_are_kept(tmp_path):
    rig = twin_rig()
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        quiet = QuietSensor(bench.sensor, 10**6)

        def silence_after_the_first(stage):
            if isinstance(stage, Flap):
                quiet._left = 50

        with pytest.raises(Tripped, match="silent"):
            run_plan(
                one_condition(rig, 2),
                replace(bench, sensor=quiet),
                recorder,
                silence_after_the_first,
            )
    assert [stroke.repeat for stroke in read_stages(tmp_path / "run").strokes] == [1]


class StatusSensor(QuietSensor):
    """Reports a status word instead of falling silent."""

    word = np.uint32(0)

    def read(self):
        samples = self._sensor.read()
        self._left -= 1
        if self._left > 0:
            return samples
        return replace(samples, status=np.full_like(samples.status, self.word))


@pytest.mark.parametrize(
    ("word", "match"), [(0x80020000, "saturated"), (0x90000000, "reports an error")]
)
def test_a_sensor_that_reports_trouble_trips(tmp_path, word, match):
    class Troubled(StatusSensor):
        pass

    Troubled.word = np.uint32(word)
    rig = twin_rig()
    stopped_by(
        tmp_path,
        rig,
        one_condition(rig),
        Tripped,
        match,
        lambda b: replace(b, sensor=Troubled(b.sensor, 400)),
    )


def test_a_latched_monitor_condition_is_only_a_warning(tmp_path):
    class Warned(StatusSensor):
        word = np.uint32(0x80010000)

    rig = twin_rig()
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        run_plan(
            one_condition(rig), replace(bench, sensor=Warned(bench.sensor, 400)), recorder, nothing
        )
        assert len(recorder.strokes) == 1


@pytest.mark.slow
def test_the_operator_s_key_stops_the_run_and_keeps_what_is_done(tmp_path):
    rig = twin_rig()
    plan = one_condition(rig, repeats=2)

    class Impatient:
        """^C while the second stroke is being handed over."""

        def __init__(self, sink):
            self._sink = sink

        def flap(self, stage, recorded):
            if stage.repeat == 2:
                raise KeyboardInterrupt
            self._sink.flap(stage, recorded)

        def __getattr__(self, name):
            return getattr(self._sink, name)

    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        wiretap = tapped(bench)
        with pytest.raises(Stopped, match="operator"):
            run_plan(plan, bench, Impatient(recorder), nothing)
        assert ends_without_torque(wiretap)
    assert [stroke.repeat for stroke in read_stages(tmp_path / "run").strokes] == [1]


def test_an_emergency_stop_at_the_drive_trips_with_its_meaning(tmp_path):
    rig = twin_rig()

    def pressed(bench):
        class Rack:
            def set_height(self, height_m):
                bench.rack.set_height(height_m)

        class Motor:
            def __init__(self):
                self.calls = 0

            def command_angle(self, angle_rad, speed_rad_s=0.0):
                self.calls += 1
                bench.motor.command_angle(angle_rad, speed_rad_s)
                if self.calls == 300:
                    bench.motor._bus.send(
                        can.Message(
                            arbitration_id=(rig.motor.node_id << 5) | OdriveCommand.ESTOP,
                            is_extended_id=False,
                        )
                    )

            def __getattr__(self, name):
                return getattr(bench.motor, name)

        return replace(bench, motor=Motor(), rack=Rack())

    stopped_by(tmp_path, rig, one_condition(rig), Tripped, r"(?i)drive: .*e-?stop", pressed)


def broken(message, timeout=None):
    raise can.CanOperationError("bus off")


def test_a_broken_bus_is_never_swallowed(tmp_path):
    rig = twin_rig()
    with recorder_on(rig, tmp_path / "run") as (bench, recorder, _):
        tapped(bench).send = broken
        with pytest.raises(DeviceError, match=r"emergency stop"):
            run_plan(one_condition(rig), bench, recorder, nothing)
