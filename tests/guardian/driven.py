"""Programs that turn a shaft behind a guardian, in a process of their own or in this one, and
who listens on the bus.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

import can
import pytest

from rfca_rig.clock import WallClock
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.guardian.process import signature
from tests.guardian.rigs import LAST_WORDS, ServedDrive, motor_on, open_guarded

PATIENCE_S = 20.0


@dataclass
class Driving:
    """A program that turns the shaft, of a process group of its own as a shell would start it;
    and who listens on the bus.
    """

    kind: str
    program: subprocess.Popen
    guardian: int
    ear: can.BusABC
    history: list[can.Message] = field(default_factory=list)

    def last_line(self) -> str:
        """Of what the program said when it ended."""
        return self.program.communicate(timeout=PATIENCE_S)[1].strip().splitlines()[-1]

    def heard(self, seconds: float) -> list[can.Message]:
        until_s = time.monotonic() + seconds
        messages = []
        while (left_s := until_s - time.monotonic()) > 0.0:
            if (message := self.ear.recv(timeout=left_s)) is not None:
                messages.append(message)
        self.history += messages
        return messages

    def is_last_word(self, message: can.Message) -> bool:
        return signature(message) in {signature(word) for word in LAST_WORDS[self.kind].frames()}

    def torque_Nm(self, message: can.Message) -> float | None:
        return LAST_WORDS[self.kind].torque_Nm(message)

    def moving(self, messages: list[can.Message]) -> list[can.Message]:
        return [m for m in messages if self.torque_Nm(m) is None and not self.is_last_word(m)]

    def undisturbed(self) -> None:
        """For a while: commands pass, and nobody lets go."""
        heard = self.heard(0.5)
        assert len(self.moving(heard)) > 20
        assert [m for m in heard if self.is_last_word(m)] == []

    def greatest_torque_Nm(self) -> float:
        """Of a short while."""
        return max(
            abs(torque_Nm) for m in self.heard(0.1) if (torque_Nm := self.torque_Nm(m)) is not None
        )


@contextmanager
def driving(served: ServedDrive, *words: str) -> Iterator[Driving]:
    command = [sys.executable, "-m", "tests.guardian.driving", served.kind, *words]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    with (
        served.observer() as ear,
        subprocess.Popen(
            command, env=served.environment, start_new_session=True, **pipes
        ) as program,
    ):
        try:
            line = program.stdout.readline()
            assert line.startswith("turning"), program.stderr.read()
            while ear.recv(timeout=0) is not None:
                pass
            d = Driving(served.kind, program, int(line.split()[1]), ear)
            d.undisturbed()
            yield d
        finally:
            program.kill()


def is_gone(process_id: int) -> bool:
    deadline_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline_s:
        try:
            os.kill(process_id, 0)
        except ProcessLookupError:
            return True
        time.sleep(0.01)
    return False


def let_go(d: Driving, within_s: float) -> float:
    """The drive is told, moved by nobody since, and shows no torque; returns how long after the
    last command.

    A drive that only answers is asked by telling it to let go once more: the answer shows how it
    was before.
    """
    d.heard(within_s)
    last_command = d.moving(d.history)[-1]
    words = [m for m in d.history if d.is_last_word(m) and m.timestamp >= last_command.timestamp]
    assert len(words) >= 3, "the drive was not told to let go"
    d.ear.send(LAST_WORDS[d.kind].frames()[-1])
    told_Nm = [torque_Nm for m in d.heard(0.3) if (torque_Nm := d.torque_Nm(m)) is not None]
    assert abs(told_Nm[0]) < LAST_WORDS[d.kind].min_visible_torque_Nm()
    return words[0].timestamp - last_command.timestamp


@contextmanager
def guarded(served: ServedDrive, monkeypatch: pytest.MonkeyPatch) -> Iterator[ShaftMotor]:
    monkeypatch.setenv("CAN_CONFIG", served.can_config)
    clock = WallClock()
    with open_guarded(served.kind, clock) as bus:
        motor = motor_on(bus, served.kind, clock)
        try:
            yield motor
        finally:
            motor.disable()
