"""Signals become stop_request; where no loop is ticking they interrupt; once the stop is under
way they are heard no more.
"""

import os
import signal

import pytest

from rfca_rig.cli.progress import make_marked_say
from rfca_rig.cli.run_experiment import handle_signals
from rfca_rig.engine.interfaces import StopLevel, StopRequest


def sent(stop_request, *signals, say=lambda _: None):
    with handle_signals(stop_request, say):
        for one in signals:
            os.kill(os.getpid(), one)
    return stop_request


@pytest.mark.parametrize(
    ("signals", "level"),
    [
        ((signal.SIGINT,), StopLevel.SAFE_POINT),
        ((signal.SIGINT, signal.SIGINT), StopLevel.TORQUE_OFF),
        ((signal.SIGTERM,), StopLevel.RAMP_DOWN),
        ((signal.SIGHUP,), StopLevel.RAMP_DOWN),
        ((signal.SIGINT, signal.SIGTERM), StopLevel.RAMP_DOWN),
    ],
)
def test_what_is_heard_while_the_loop_ticks(signals, level):
    assert sent(StopRequest(is_ticking=True), *signals).level is level


def test_a_third_key_interrupts_a_loop_that_hangs():
    with pytest.raises(KeyboardInterrupt):
        sent(StopRequest(is_ticking=True), *[signal.SIGINT] * 3)


@pytest.mark.parametrize("one", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_while_a_person_is_waited_for_one_is_enough(one):
    with pytest.raises(KeyboardInterrupt):
        sent(StopRequest(), one)


def test_the_stop_itself_is_not_interrupted():
    assert (
        sent(StopRequest(is_over=True), *[signal.SIGINT] * 5, signal.SIGTERM).level
        is StopLevel.GO_ON
    )


def test_while_the_recording_is_finished_only_a_second_key_ends_the_run():
    said = []
    with handle_signals(StopRequest(is_over=True), said.append) as ear:
        ear.begin_closing()
        os.kill(os.getpid(), signal.SIGTERM)
        os.kill(os.getpid(), signal.SIGINT)
        assert [line[:30] for line in said] == ["the recording is being finishe"] * 2
        with pytest.raises(KeyboardInterrupt):
            os.kill(os.getpid(), signal.SIGINT)


def test_a_terminal_that_is_gone_keeps_nobody_from_stopping(monkeypatch):
    class Gone:
        def write(self, _text):
            raise OSError("Input/output error")

        def flush(self):
            raise OSError("Input/output error")

    monkeypatch.setattr("sys.stderr", Gone())
    assert (
        sent(
            StopRequest(is_ticking=True), signal.SIGINT, say=make_marked_say("SIM", quiet=False)
        ).level
        is StopLevel.SAFE_POINT
    )


def test_afterwards_everything_is_as_before():
    before = signal.getsignal(signal.SIGINT)
    sent(StopRequest(is_ticking=True), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
