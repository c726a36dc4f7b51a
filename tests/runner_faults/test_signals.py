"""Keys, signals and deaths of a run in a process of its own; `endings` is the table of what
becomes of motor and recording.
"""

import fcntl
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import can
import pytest

from rfca_rig.devices.odrive import codec as cansimple
from rfca_rig.devices.odrive.messages import (
    WATCHDOG_EXPIRED,
    AxisState,
    Heartbeat,
    OdriveCommand,
    OdriveFirmware,
    Torques,
)
from rfca_rig.errors import BadInput
from rfca_rig.recording import run_folder
from rfca_rig.recording.model import Recording
from rfca_rig.recording.run_text import check_not_running, events_of
from tests.twin_server.server import Server, serving

PATIENCE_S = 240.0
RUN = "from rfca_rig.cli.main import run; run()"
WORDS = ("dynamic", "run", "--height", "215", "--speed", "2.433", "--repeats", "400", "--json")
OFF_AT_ONCE = "motor off"

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")


@dataclass
class Running:
    """A run under way, and the terminal that it believes to have."""

    process: subprocess.Popen[bytes]
    runs: Path
    terminal: int

    @property
    def folder(self) -> Path:
        (folder,) = self.runs.iterdir()
        return folder

    def acknowledged(self) -> int:
        if self.runs.is_dir() and any(self.runs.iterdir()):
            return len(list(self.folder.glob("stages/*.h5")))
        return 0

    def ended(self) -> int:
        return self.process.wait(PATIENCE_S)

    def kept(self) -> Recording:
        wait_for(lambda: is_over(self.folder), "the recorder goes on")
        return run_folder.read_stages(self.folder)

    def motor_off(self) -> dict[str, object]:
        """The event that tells of it; the twin's own motor dies with the process."""
        (event,) = [event for event in events_of(self.folder) if event["event"] == OFF_AT_ONCE]
        return event


def wait_for(come: Callable[[], object], otherwise: str) -> None:
    until_s = time.monotonic() + PATIENCE_S
    while not come():
        assert time.monotonic() < until_s, otherwise
        time.sleep(0.02)


def is_over(folder: Path) -> bool:
    try:
        check_not_running(folder)
    except BadInput:
        return False
    return True


@contextmanager
def running(folder: Path, *before: str, words: Sequence[str] = WORDS) -> Iterator[Running]:
    """A run on the twin in a session and on a terminal of its own, as soon as it has kept two
    strokes.
    """
    here, there = pty.openpty()
    words = [*before, sys.executable, "-c", RUN, *words, "--runs", str(folder / "runs")]
    ends = {"stdin": there, "stdout": there, "stderr": there}
    with subprocess.Popen(
        words,
        **ends,
        start_new_session=True,
        preexec_fn=_take_terminal,  # noqa: PLW1509
        cwd=folder,
    ) as process:
        os.close(there)
        run = Running(process, folder / "runs", here)
        try:
            wait_for(
                lambda: run.acknowledged() >= 2 or process.poll() is not None,
                "no stroke was recorded",
            )
            assert process.poll() is None
            yield run
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def _take_terminal() -> None:
    """The one that it has for its input rules over its session, as a shell's does."""
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP], ids=lambda number: number.name)
def test_a_signal_from_outside_ends_the_run_at_once(tmp_path: Path, number: signal.Signals) -> None:
    with running(tmp_path) as run:
        run.process.send_signal(number)
        assert run.ended() == 130
        assert number.name in str(run.motor_off()["why"])
        assert len(run.kept().strokes) >= 2


@pytest.mark.slow
def test_one_key_ends_the_run_at_the_next_safe_point(tmp_path: Path) -> None:
    with running(tmp_path) as run:
        run.process.send_signal(signal.SIGINT)
        assert run.ended() == 130
        assert "at a safe point" in str(run.motor_off()["why"])
        kept = run.kept()
        assert len(kept.strokes) >= 2
        assert kept.raw == ()


@pytest.mark.slow
def test_two_keys_end_it_at_once(tmp_path: Path) -> None:
    with running(tmp_path) as run:
        os.killpg(run.process.pid, signal.SIGSTOP)  # so that both are there at the same tick
        run.process.send_signal(signal.SIGINT)
        os.killpg(run.process.pid, signal.SIGCONT)
        run.process.send_signal(signal.SIGINT)
        assert run.ended() == 130
        assert "stopped" in str(run.motor_off()["why"])
        assert len(run.kept().strokes) >= 2


@pytest.mark.slow
def test_a_closed_terminal_ends_it_though_nothing_can_be_said(tmp_path: Path) -> None:
    with running(tmp_path) as run:
        os.close(run.terminal)
        assert run.ended() != 0
        assert "SIGHUP" in str(run.motor_off()["why"])
        assert len(run.kept().strokes) >= 2


def test_a_parent_that_is_killed_takes_the_terminal_along(tmp_path: Path) -> None:
    with running(tmp_path, "sh", "-c", '"$@"; true', "sh") as run:
        run.process.kill()
        kept = run.kept()
        assert "SIGHUP" in str(run.motor_off()["why"])
        assert len(kept.strokes) >= 2


@pytest.mark.slow
def test_a_recorder_that_is_killed_ends_it(tmp_path: Path) -> None:
    with running(tmp_path) as run:
        acknowledged = run.acknowledged()
        os.kill(recorder_of(run.process.pid), signal.SIGKILL)
        assert run.ended() == 1
        assert len(run.kept().strokes) >= acknowledged


@pytest.mark.slow
def test_a_stage_is_announced_when_it_is_on_disk_and_a_recorder_that_hangs_is_reported(
    tmp_path: Path,
) -> None:
    """Then the power goes."""
    with running(tmp_path, words=WORDS[:-1]) as run:
        recorder = recorder_of(run.process.pid)
        os.kill(recorder, signal.SIGSTOP)
        printed = read_until(run.terminal, b"is silent")
        os.killpg(run.process.pid, signal.SIGKILL)
        os.kill(recorder, signal.SIGKILL)
        run.ended()
        assert 1 <= printed.count(b"valley (") <= run.acknowledged()


def read_until(terminal: int, words: bytes) -> bytes:
    """What a terminal shows, until it shows `words`."""
    shown = b""
    until_s = time.monotonic() + PATIENCE_S
    while words not in shown:
        assert time.monotonic() < until_s, shown[-500:]
        if select.select([terminal], [], [], 1.0)[0]:
            shown += os.read(terminal, 1 << 16)
    return shown


def recorder_of(process_id: int) -> int:
    children = (
        Path(f"/proc/{process_id}/task/{process_id}/children").read_text(encoding="utf-8").split()
    )
    (recorder,) = [
        int(child)
        for child in children
        if "recorder_process" in Path(f"/proc/{child}/cmdline").read_text(encoding="utf-8")
    ]
    return recorder


@pytest.mark.slow
def test_a_run_that_is_killed_keeps_what_it_had(tmp_path: Path) -> None:
    with running(tmp_path) as run:
        acknowledged = run.acknowledged()
        run.process.send_signal(signal.SIGKILL)
        assert run.ended() == -signal.SIGKILL
        assert len(run.kept().strokes) >= acknowledged


@pytest.mark.slow
def test_a_run_whose_process_stands_for_a_while_goes_on_where_time_is_simulated(
    tmp_path: Path,
) -> None:
    with running(tmp_path) as run:
        run.process.send_signal(signal.SIGSTOP)
        time.sleep(0.3)
        kept = run.acknowledged()
        run.process.send_signal(signal.SIGCONT)
        wait_for(lambda: run.acknowledged() > kept, "it does not go on")
        run.process.send_signal(signal.SIGTERM)
        assert run.ended() == 130


# -- in real time: what the drive does when its master is no more
# ---------------------------------------------------------------


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    with serving() as server:
        monkeypatch.setenv(
            "CAN_CONFIG", f'{{"host": "{server.host}", "port": {server.ports["can_port"]}}}'
        )
        yield server


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=lambda number: number.name)
def test_a_drive_whose_master_dies_or_stands_lets_go(
    served: Server, number: signal.Signals
) -> None:
    command = [sys.executable, "-m", "tests.runner_faults.turning"]
    with (
        can.Bus(**served.can) as observer,
        subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        ) as program,
    ):
        try:
            assert program.stdout.readline() == "turning\n", program.stderr.read()
            program.send_signal(number)
            heard(
                observer,
                lambda said: isinstance(said, Heartbeat) and said.state == AxisState.CLOSED_LOOP,
            )
            beat = heard(
                observer, lambda said: isinstance(said, Heartbeat) and said.state == AxisState.IDLE
            )
            assert beat.error & WATCHDOG_EXPIRED[OdriveFirmware.V0_6]
            assert heard(observer, lambda said: isinstance(said, Torques)).estimate_Nm == 0.0
        finally:
            program.kill()


def heard(bus: can.BusABC, is_it: Callable[[object], bool]) -> object:
    """The next message of the drive of which that is true."""
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        message = bus.recv(timeout=1.0)
        if (
            message is not None
            and message.arbitration_id & 0x1F in {OdriveCommand.HEARTBEAT, OdriveCommand.TORQUES}
            and message.dlc == 8
        ):
            said = cansimple.decode(message.arbitration_id, message.data)
            if is_it(said):
                return said
    raise AssertionError("the drive never said it")
