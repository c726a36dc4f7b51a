"""A guardian as a process, between a program that turns a shaft and the twin of an AK drive in
MIT mode on a bus of its own.
"""

import os
import signal
import time

import can
import pytest

from rfca_rig.clock import WallClock
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.run import prove_stop
from rfca_rig.errors import DeviceError
from rfca_rig.guardian.process import ALIVE_S
from tests.guardian.driven import driving, guarded, is_gone, let_go
from tests.guardian.rigs import SILENCE_S, far_end, motor_on, open_guarded

# on a machine that is busy with other tests; tests/benchmarks/guardian.py says what it is on one
# that is not
SMALL_S = 0.4
STAMPED_S = 0.06  # the server stamps frames within the 50 ms that it may leap


@pytest.fixture(scope="module")
def mit():
    with far_end("mit") as served:
        yield served


# -- who commands is gone
# --------------------------------------------------------------------------------------------------


@pytest.mark.realtime
def test_a_program_that_is_killed_in_mid_motion_leaves_no_torque(mit):
    with driving(mit) as d:
        assert d.greatest_torque_Nm() > 1.0
        d.program.kill()
        assert let_go(d, 1.0) < SILENCE_S + SMALL_S
        assert is_gone(d.guardian)


@pytest.mark.realtime
def test_a_program_that_is_stopped_leaves_no_torque_and_moves_nothing_when_it_goes_on(mit):
    with driving(mit) as d:
        d.program.send_signal(signal.SIGSTOP)
        assert SILENCE_S - STAMPED_S < let_go(d, 1.0) < SILENCE_S + SMALL_S
        d.program.send_signal(signal.SIGCONT)
        assert d.moving(d.heard(0.5)) == []
        assert "guardian let go after 1" in d.last_line()


@pytest.mark.realtime
def test_a_program_that_computes_instead_of_commanding_leaves_no_torque(mit):
    with driving(mit, "silent") as d:
        assert let_go(d, 1.5) < SILENCE_S + SMALL_S


@pytest.mark.realtime
def test_control_c_in_the_terminal_reaches_the_program_and_not_the_guardian(mit):
    """The program ends its run then, and leaves it to the guardian."""
    with driving(mit) as d:
        assert os.getpgid(d.guardian) != os.getpgid(d.program.pid)
        os.killpg(os.getpgid(d.program.pid), signal.SIGINT)
        assert let_go(d, 1.0) < SILENCE_S + SMALL_S
        assert d.last_line() == "KeyboardInterrupt"
        assert is_gone(d.guardian)


# -- the guardian is gone
# --------------------------------------------------------------------------------------------------


@pytest.mark.realtime
@pytest.mark.parametrize("how", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT])
def test_a_guardian_that_is_told_to_end_lets_go_first_and_the_program_hears_it(mit, how):
    with driving(mit) as d:
        os.kill(d.guardian, how)
        assert let_go(d, 1.0) < SILENCE_S + SMALL_S
        assert f"guardian let go because it was ended by {how.name}" in d.last_line()


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("how", "said"),
    [
        (signal.SIGKILL, "guardian ended by itself"),
        (signal.SIGSTOP, "guardian hangs, silent for 0."),
    ],
    ids=["killed", "hung"],
)
def test_a_guardian_that_fails_is_found_out_and_the_program_lets_go_itself(mit, how, said):
    with driving(mit) as d:
        os.kill(d.guardian, how)
        let_go(d, 1.5)
        assert said in (last := d.last_line()) and "the drive was disabled from here" in last
        assert is_gone(d.guardian)


# -- in this process
# --------------------------------------------------------------------------------------------------


@pytest.mark.realtime
def test_the_guardian_is_proven_by_starving_it_and_the_motor_can_be_enabled_again(mit, monkeypatch):
    with guarded(mit, monkeypatch) as motor:
        assert (
            SILENCE_S
            < prove_stop(Bench(motor, None, None, WallClock(), is_real=True))
            < SILENCE_S + SMALL_S
        )
        motor.enable()
        motor.command_angle(float(motor.read().angle_rad[-1]))
        assert motor.status().fault is None
        assert motor.identity()["guardian"] == "disables the motor after 100 ms of silence"


@pytest.mark.realtime
def test_a_command_after_too_long_a_silence_is_refused_and_reading_goes_on(mit, monkeypatch):
    with guarded(mit, monkeypatch) as motor:
        motor.enable()
        time.sleep(SILENCE_S + 3 * ALIVE_S)
        with pytest.raises(DeviceError, match=r"^guardian let go after \d\d\d ms of silence$"):
            for _ in range(100):
                motor.command_speed(1.0)
                time.sleep(0.005)
        motor.read()
        with pytest.raises(DeviceError, match="let go after"):
            motor.command_speed(1.0)
        motor.disable()
        motor.enable()
        motor.command_speed(0.0)


@pytest.mark.realtime
def test_reading_tells_it_too_and_once(mit, monkeypatch):
    with guarded(mit, monkeypatch) as motor:
        motor.enable()
        motor.command_speed(0.0)
        time.sleep(SILENCE_S + SMALL_S)
        with pytest.raises(DeviceError, match=r"^guardian let go after"):
            motor.read()
        motor.read()


def test_a_bus_that_is_not_there_is_told_when_it_is_opened(monkeypatch):
    monkeypatch.setenv("CAN_CONFIG", '{"host": "127.0.0.1"}')
    with pytest.raises(can.CanInitializationError, match="port"):
        open_guarded("mit", WallClock())


@pytest.mark.realtime  # the guardian has a second to say why it could not disable the drive
def test_a_bus_that_breaks_is_an_error_of_the_next_calls_and_of_the_last_word(monkeypatch):
    with far_end("mit") as served:
        monkeypatch.setenv("CAN_CONFIG", served.can_config)
        clock = WallClock()
        bus = open_guarded("mit", clock)
        motor = motor_on(bus, "mit", clock)
        motor.enable()
        served.server.process.kill()
        served.server.process.wait()
        with pytest.raises(DeviceError, match=r"\[Errno \d+\]"):
            for _ in range(50):
                motor.command_speed(1.0)
                time.sleep(0.002)
        with pytest.raises(DeviceError, match=r"not sent: \[Errno \d+\]"):
            motor.disable()
        with pytest.raises(
            can.CanError, match=r"last word was not taken.*press the emergency stop"
        ):
            bus.shutdown()
