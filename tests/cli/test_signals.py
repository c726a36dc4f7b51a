"""Signals become wishes; where no loop is ticking they interrupt; once the stop is under way they are heard no more."""

import os
import signal

import pytest

from rfca_rig.cli.signals import heard
from rfca_rig.cli.terminal import marked
from rfca_rig.engine.wishes import Wish, Wishes


def sent(wishes, *signals, say=lambda _: None):
    with heard(wishes, say):
        for one in signals:
            os.kill(os.getpid(), one)
    return wishes


@pytest.mark.parametrize(
    ("signals", "wish"),
    [
        ((signal.SIGINT,), Wish.SAFE_POINT),
        ((signal.SIGINT, signal.SIGINT), Wish.LET_GO),
        ((signal.SIGTERM,), Wish.EASE),
        ((signal.SIGHUP,), Wish.EASE),
        ((signal.SIGINT, signal.SIGTERM), Wish.EASE),
    ],
)
def test_what_is_heard_while_the_loop_ticks(signals, wish):
    assert sent(Wishes(is_ticking=True), *signals).wish is wish


def test_a_third_key_interrupts_a_loop_that_hangs():
    with pytest.raises(KeyboardInterrupt):
        sent(Wishes(is_ticking=True), *[signal.SIGINT] * 3)


@pytest.mark.parametrize("one", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_while_a_person_is_waited_for_one_is_enough(one):
    with pytest.raises(KeyboardInterrupt):
        sent(Wishes(), one)


def test_the_stop_itself_is_not_interrupted():
    assert sent(Wishes(is_over=True), *[signal.SIGINT] * 5, signal.SIGTERM).wish is Wish.GO_ON


def test_a_terminal_that_is_gone_keeps_nobody_from_stopping(monkeypatch):
    class Gone:
        def write(self, _text):
            raise OSError("Input/output error")

        def flush(self):
            raise OSError("Input/output error")

    monkeypatch.setattr("sys.stderr", Gone())
    assert sent(Wishes(is_ticking=True), signal.SIGINT, say=marked("SIM", quiet=False)).wish is Wish.SAFE_POINT


def test_afterwards_everything_is_as_before():
    before = signal.getsignal(signal.SIGINT)
    sent(Wishes(is_ticking=True), signal.SIGINT)
    assert signal.getsignal(signal.SIGINT) is before
