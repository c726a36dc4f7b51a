"""A proxy between a program and a socketcand server that damages frames and remembers all of them.

Run: python -m tests.twin_server.can_proxy

A process of its own, so that it takes no time from the control loop that is measured. Its standard
input takes one fault per line as JSON, `{"kind": "nan", "can_id": 9, "frames": 3}`; when it is
closed, the log goes to the standard output.
"""

import json
import select
import socket
import struct
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import inf, nan

from rfca_rig.devices.odrive.messages import OdriveCommand

# Numbers that replace both floats of a frame.
VALUES = {"nan": nan, "inf": inf, "minus-inf": -inf, "absurd": 1e30}


@dataclass
class FrameFault:
    """What happens to the frames of one id from now on.

    "drop" takes them away, "delay" holds them back for `late_s`, "error" puts `word` into their
    first four bytes; a name of VALUES replaces their floats. "send" sends a frame with `data` to
    the drive, as another master would. "unplug" cuts the program off.
    """

    kind: str
    can_id: int
    frames: float = inf
    late_s: float = 0.0
    # Which of the two floats of a frame is replaced; both where it is None.
    place: int | None = None
    word: int = 0
    data: str = ""
    held: deque[tuple[float, bytes]] = field(default_factory=deque)


@dataclass
class Proxy:
    """The first client, and its connection to the server, which is listened to even after the
    client is gone.

    Later clients, as a program that takes over from its guardian, are passed on to the server.
    `log` has time, direction, id and data in hexadecimal of each frame, and whether it was damaged.
    """

    client: socket.socket
    server: socket.socket
    listening: socket.socket
    later: dict[socket.socket, socket.socket] = field(default_factory=dict)
    fault: FrameFault | None = None
    is_unplugged: bool = False
    rest: bytes = b""
    log: list[tuple[float, str, int, str, bool]] = field(default_factory=list)

    def run(self) -> None:
        orders = sys.stdin.buffer
        while True:
            ends = [
                self.server,
                self.listening,
                orders,
                *self.later,
                *([] if self.is_unplugged else [self.client]),
            ]
            ready, _, _ = select.select(ends, [], [], 1e-3)
            if orders in ready:
                line = orders.readline()
                if not line:
                    return
                self._begin(FrameFault(**json.loads(line)))
            if self.listening in ready:
                client, _ = self.listening.accept()
                server = socket.create_connection(self.server.getpeername())
                for end in (client, server):
                    end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self.later |= {client: server, server: client}
            if self.client in ready:
                self._pass_up(_receive(self.client))
            if self.server in ready:
                self._pass_down(self.server.recv(1 << 16))
            for end in [end for end in self.later if end in ready]:
                self._pass_on(end)
            self._let_go_held()

    def _pass_on(self, end: socket.socket) -> None:
        other = self.later[end]
        received = _receive(end)
        self._log_commands(received)
        if received:
            other.sendall(received)
        else:
            del self.later[end], self.later[other]
            other.close()

    def _begin(self, fault: FrameFault) -> None:
        self.fault = fault
        if fault.kind == "send":
            words = " ".join(f"{byte:02X}" for byte in bytes.fromhex(fault.data))
            self.server.sendall(
                f"< send {fault.can_id:X} {len(fault.data) // 2} {words} >".encode()
            )
            self.fault = None
        if fault.kind == "unplug":
            self.is_unplugged = True
            self.client.close()

    def _pass_up(self, received: bytes) -> None:
        self._log_commands(received)
        if received:
            self.server.sendall(received)
        else:
            self.is_unplugged = True

    def _log_commands(self, received: bytes) -> None:
        now_s = time.monotonic()
        for text in received.split(b">"):
            words = text.split()
            if words[:2] == [b"<", b"send"]:
                self.log.append(
                    (
                        now_s,
                        "up",
                        int(words[2], 16),
                        b"".join(word.rjust(2, b"0") for word in words[4:]).decode(),
                        False,
                    )
                )

    def _pass_down(self, received: bytes) -> None:
        *whole, self.rest = (self.rest + received).split(b">")
        passed = b"".join(self._damage(text + b">") for text in whole)
        if passed and not self.is_unplugged:
            self.client.sendall(passed)

    def _damage(self, message: bytes) -> bytes:
        words = message.split()
        if words[:2] != [b"<", b"frame"]:
            return message
        now_s = time.monotonic()
        can_id = int(words[2], 16)
        fault = self.fault
        is_damaged = fault is not None and fault.can_id == can_id and fault.frames > 0
        # A frame without data, as an emergency stop, has none between its time and the end.
        data = words[4].decode() if len(words) > 5 else ""
        self.log.append((now_s, "down", can_id, data, is_damaged))
        if fault is None or not is_damaged:
            return message
        fault.frames -= 1
        if fault.kind == "delay":
            fault.held.append((now_s, message))
            return b""
        if fault.kind == "drop":
            return b""
        if fault.kind == "error":
            words[4] = (
                (struct.pack("<I", fault.word) + bytes.fromhex(words[4].decode())[4:])
                .hex()
                .upper()
                .encode()
            )
            return b" ".join(words)
        numbers = list(struct.unpack("<ff", bytes.fromhex(words[4].decode())))
        for place in (0, 1) if fault.place is None else (fault.place,):
            numbers[place] = VALUES[fault.kind]
        words[4] = struct.pack("<ff", *numbers).hex().upper().encode()
        return b" ".join(words)

    def _let_go_held(self) -> None:
        while (
            self.fault is not None
            and self.fault.held
            and time.monotonic() - self.fault.held[0][0] >= self.fault.late_s
        ):
            self.client.sendall(self.fault.held.popleft()[1])


def _receive(end: socket.socket) -> bytes:
    """What has arrived; nothing where the other end is gone."""
    try:
        return end.recv(1 << 16)
    except ConnectionError:
        return b""


def main(host: str, port: int) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        print(listening.getsockname()[1], flush=True)
        client, _ = listening.accept()
        with client, socket.create_connection((host, port)) as server:
            for end in (client, server):
                end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            proxy = Proxy(client, server, listening)
            try:
                proxy.run()
            except OSError:
                # The program has ended; what was seen until then counts.
                sys.stdin.buffer.read()
            print(json.dumps(proxy.log), flush=True)


@dataclass(frozen=True)
class LoggedFrame:
    """`direction` is "up" to the drive, or "down" from it."""

    t_s: float
    direction: str
    can_id: int
    data: bytes
    is_damaged: bool


@dataclass
class RunningProxy:
    """The proxy in a process of its own, at `port` of this computer."""

    process: subprocess.Popen[str]
    port: int

    def damage(self, fault: dict[str, object]) -> float:
        """Begins a fault; returns the time, which is the same clock as that of the log."""
        now_s = time.monotonic()
        self.process.stdin.write(json.dumps(fault) + "\n")
        self.process.stdin.flush()
        return now_s

    def finish(self) -> list[LoggedFrame]:
        """Ends the proxy; every frame that passed."""
        out, _ = self.process.communicate(timeout=30.0)
        return [
            LoggedFrame(t_s, direction, can_id, bytes.fromhex(data), damaged)
            for t_s, direction, can_id, data, damaged in json.loads(out)
        ]


@contextmanager
def can_proxy(host: str, port: int) -> Iterator[RunningProxy]:
    command = [sys.executable, "-m", "tests.twin_server.can_proxy", host, str(port)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        try:
            yield RunningProxy(process, int(process.stdout.readline()))
        finally:
            process.kill()


def shows_odrive_torque(frame: LoggedFrame) -> bool:
    """Whether node 0 reports a torque in this frame."""
    return frame.can_id == OdriveCommand.TORQUES and frame.data[4:] != bytes(4)


def last_torque_s(
    frames: list[LoggedFrame], shows_torque: Callable[[LoggedFrame], bool] = shows_odrive_torque
) -> float:
    """When the drive last reported a torque."""
    return max(
        (frame.t_s for frame in frames if frame.direction == "down" and shows_torque(frame)),
        default=nan,
    )


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
