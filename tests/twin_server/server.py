"""A twin server in a process of its own, as a user starts it."""

import json
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

COMMAND = (sys.executable, "-c", "from rfca_rig.cli.main import run; run()")
SERVE = ("twin", "serve", "--json")
ANY_FREE = tuple(
    word
    for name in ("rdt", "http", "command", "can", "control")
    for word in (f"--{name}-port", "0")
)
READY_S = 300.0  # a first compilation on a machine that is busy with something else


@dataclass(frozen=True)
class Server:
    process: subprocess.Popen[str]
    ports: dict[str, int | str]

    @property
    def host(self) -> str:
        return str(self.ports["host"])

    @property
    def rdt(self) -> tuple[str, int]:
        return self.host, int(self.ports["rdt_port"])

    @property
    def can(self) -> dict[str, object]:
        """For can.Bus."""
        return {
            "interface": "socketcand",
            "channel": "can0",
            "host": self.host,
            "port": int(self.ports["can_port"]),
        }

    def told(self, line: str) -> str:
        """The whole answer to one line on the control port."""
        with socket.create_connection(
            ("127.0.0.1", int(self.ports["control_port"])), timeout=60.0
        ) as connection:
            connection.sendall(f"{line}\n".encode())
            answer = ""
            while not answer.endswith("ok\n") and not answer.startswith("error"):
                received = connection.recv(4096)
                assert received, f"the server ended at the line {line!r}"
                answer += received.decode()
        return answer

    def interrupted(self) -> tuple[int, str]:
        """Exit code and last words after ^C."""
        self.process.send_signal(signal.SIGINT)
        _, said = self.process.communicate(timeout=60.0)
        return self.process.returncode, said


@contextmanager
def serving(*options: str, command: Sequence[str] = COMMAND) -> Iterator[Server]:
    """`command` is a program that takes the words of `rfca-rig`."""
    words = [*command, *SERVE, *ANY_FREE, *options]
    with subprocess.Popen(
        words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            assert select.select([process.stdout], [], [], READY_S)[0], "the server did not come up"
            line = process.stdout.readline()
            assert line, process.stderr.read()
            yield Server(process, json.loads(line))
        finally:
            process.kill()
