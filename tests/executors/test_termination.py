"""What ends a command from outside lets it clean up, once."""

import os
import signal
from threading import Thread

import pytest

from rfca_rig.executors.cores import VARIABLE
from rfca_rig.executors.parallel import CAN_COPY, map_in_processes
from rfca_rig.executors.termination import SIGNALS, interrupt_on_termination
from tests.waiting import wait_for


def send(number: int) -> None:
    os.kill(os.getpid(), number)


def handlers() -> list[object]:
    return [signal.getsignal(number) for number in SIGNALS]


@pytest.fixture(autouse=True)
def _default_handlers():
    """The program that started the tests may ignore some signals, as nohup does."""
    before = [signal.signal(number, signal.SIG_DFL) for number in SIGNALS]
    yield
    for number, handler in zip(SIGNALS, before, strict=True):
        signal.signal(number, handler)


@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
def test_a_signal_interrupts_and_a_second_one_leaves_the_cleaning_up_alone(number):
    before = handlers()
    cleaned_up = []
    with pytest.raises(KeyboardInterrupt), interrupt_on_termination():
        try:
            send(number)
        finally:
            send(signal.SIGTERM)
            cleaned_up.append(number)
    assert cleaned_up == [number]
    assert handlers() == before == [signal.SIG_DFL] * len(SIGNALS)


def test_a_block_within_another_changes_nothing():
    cleaned_up = []
    with pytest.raises(KeyboardInterrupt), interrupt_on_termination():
        outer = handlers()
        try:
            with interrupt_on_termination():
                assert handlers() == outer
                send(signal.SIGTERM)
        finally:
            # The inner block has ended, and the signals are still those of the outer one.
            send(signal.SIGTERM)
            cleaned_up.append("outer")
    assert cleaned_up == ["outer"]


def test_what_nohup_ignores_stays_ignored():
    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)
    try:
        with interrupt_on_termination():
            send(signal.SIGTERM)
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGTERM, before)


def test_in_a_thread_signals_stay_as_they_are():
    seen = []

    def work() -> None:
        with interrupt_on_termination():
            seen.extend(handlers())

    thread = Thread(target=work)
    thread.start()
    thread.join()
    assert seen == handlers()


@pytest.mark.skipif(not CAN_COPY, reason="this system makes no copies of a process")
def test_copies_of_the_process_end_without_a_word(monkeypatch, tmp_path, capfd):
    """They are ended by SIGTERM themselves, and inherit what the block has made of it."""
    monkeypatch.setenv(VARIABLE, "2")
    here = os.getpid()

    def work(_: int) -> None:
        if os.getpid() == here:
            wait_for((tmp_path / "copy").exists)
            send(signal.SIGTERM)
        (tmp_path / "copy").touch()
        wait_for(lambda: False)

    with pytest.raises(KeyboardInterrupt), interrupt_on_termination():
        map_in_processes(work, range(2))
    assert capfd.readouterr().err == ""
