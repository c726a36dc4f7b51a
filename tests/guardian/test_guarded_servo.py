"""A guardian as a process, between a program that turns a shaft and the twin of an AK drive in
servo mode on a bus of its own.
"""

import signal

import pytest

from rfca_rig.clock import WallClock
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.run import prove_stop
from tests.guardian.driven import driving, guarded, is_gone, let_go
from tests.guardian.rigs import SILENCE_S, far_end
from tests.guardian.test_guarded_mit import SMALL_S, STAMPED_S


@pytest.fixture(scope="module")
def servo():
    with far_end("servo") as served:
        yield served


@pytest.mark.realtime
def test_a_program_that_is_killed_in_mid_motion_leaves_no_torque(servo):
    with driving(servo) as d:
        assert d.greatest_torque_Nm() > 1.0
        d.program.kill()
        assert let_go(d, 1.0) < SILENCE_S + SMALL_S
        assert is_gone(d.guardian)


@pytest.mark.realtime
def test_a_program_that_is_stopped_leaves_no_torque(servo):
    with driving(servo) as d:
        d.program.send_signal(signal.SIGSTOP)
        assert SILENCE_S - STAMPED_S < let_go(d, 1.0) < SILENCE_S + SMALL_S


@pytest.mark.realtime
def test_the_guardian_is_proven_by_starving_it(servo, monkeypatch):
    with guarded(servo, monkeypatch) as motor:
        assert (
            SILENCE_S
            < prove_stop(Bench(motor, None, None, WallClock(), is_real=True))
            < SILENCE_S + SMALL_S
        )
        assert "N m that the motor held were gone" in motor.identity()["guardian_proof"]
