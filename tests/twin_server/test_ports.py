"""The server's openings, driven over real sockets and pseudo terminals by python-can and by
hand.
"""

import socket
from contextlib import closing, suppress
from itertools import product

import can
import numpy as np
import pytest

from rfca_rig.bench.served import LONGEST_LEAP_S, RealTimeLoop
from rfca_rig.devices.netft.codec import RdtCommand, encode_request
from rfca_rig.devices.netft.ports import CommandPort, UdpLink
from rfca_rig.devices.netft.twin import NetFtBoxTwin, NetFtTwin, NetFtTwinSettings
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.twin_server.can_ports import SharedWire, SlcanPort, SocketcandPort
from rfca_rig.twin_server.faults import CAN_FAULTS, ControlPort, FaultPanel
from rfca_rig.twin_server.tcp import (
    IDLE_S,
    MAX_CLIENTS,
    MAX_QUEUED_BYTES,
    is_loopback,
    listening_tcp,
)
from rfca_rig.twins.wires import datagram_link
from tests.twin_server.polling import polled, quick_clock
from tests.waiting import PATIENCE_S

HOST = "127.0.0.1"
FRAME = can.Message(arbitration_id=0x029, data=b"\1\2\3", is_extended_id=False)


@pytest.fixture
def wire():
    return SharedWire("wire")


@pytest.fixture
def server(wire):
    port = SocketcandPort(wire, HOST, 0, 1000.0)
    with polled(port):
        yield port


def client(server) -> can.BusABC:
    return can.Bus(interface="socketcand", channel="can0", host=HOST, port=server.port)


def same(one: can.Message | None, other: can.Message) -> bool:
    return one is not None and (one.arbitration_id, one.data, one.is_extended_id) == (
        other.arbitration_id,
        other.data,
        other.is_extended_id,
    )


def test_frames_pass_both_ways_between_clients_and_the_twin(wire, server):
    twin = wire.join()
    one = client(server)
    other = client(server)
    long = can.Message(arbitration_id=0x1ABCDEF0, data=bytes(8), is_extended_id=True)
    for message in (FRAME, long):
        one.send(message)
        assert same(other.recv(PATIENCE_S), message)
        assert same(twin.recv(0), message)
        assert one.recv(0) is None
        twin.send(message)
        assert same(one.recv(PATIENCE_S), message) and same(other.recv(PATIENCE_S), message)
    one.shutdown()
    other.shutdown()


def test_a_frame_is_stamped_with_the_time_since_the_epoch(wire, server):
    bus = client(server)
    wire_end = wire.join()
    while (heard := bus.recv(0.1)) is None:
        wire_end.send(FRAME)
    assert (
        1000.0 < heard.timestamp < 1000.0 + 3600.0
    )  # the loop that polls has a clock of its own, from 0
    bus.shutdown()


def test_a_client_that_leaves_is_forgotten(wire, server):
    bus = client(server)
    assert len(wire._ends) == 1
    bus.shutdown()
    with closing(socket.create_connection((HOST, server.port), PATIENCE_S)) as knock:
        assert knock.recv(20) == b"< hi >"
    for _ in range(6000):
        if not wire._ends:
            break
        quick_clock.wait_until(quick_clock.now_s() + 0.01)
    assert wire._ends == []


def said(connection: socket.socket, line: bytes) -> bytes:
    connection.sendall(line)
    return connection.recv(200)


def test_what_socketcand_does_not_know_is_refused(server):
    with closing(socket.create_connection((HOST, server.port), PATIENCE_S)) as talk:
        assert talk.recv(20) == b"< hi >"
        assert said(talk, b"< send 123 0 >") == b"< error open a bus first >"
        assert said(talk, b"< open vcan7 >") == b"< ok >"
        assert said(talk, b"< bcmmode >") == b"< ok >"
        assert said(talk, b"< dance >") == b"< error unknown command >"
        assert said(talk, b"< send 123 9 1 >") == b"< error could not parse send command >"
        assert said(talk, b"junk < echo >") == b"< echo >"
        assert said(talk, b"x" * 2000) == b""


def test_a_client_that_does_not_read_is_let_go_and_does_not_hold_up_the_others(wire):
    port = SocketcandPort(wire, HOST, 0, 0.0)
    lazy = socket.create_connection((HOST, port.port), PATIENCE_S)
    lazy.sendall(b"< open can0 >< rawmode >")
    port.poll(0.0)
    port.poll(0.1)
    twin = wire.join()
    sent = 0
    while len(wire._ends) == 2:
        for _ in range(20_000):
            twin.send(FRAME)
        sent += 20_000
        port.poll(1.0)
        assert sent < 10_000_000
    assert sent * 20 > MAX_QUEUED_BYTES
    port.close()
    lazy.close()


def test_a_serial_adapter_carries_frames_of_every_kind(wire):
    port = SlcanPort(wire)
    with polled(port):
        bus = can.Bus(interface="slcan", channel=port.path, bitrate=1_000_000, sleep_after_open=0.0)
        twin = wire.join()
        remote = can.Message(arbitration_id=0x20, is_remote_frame=True, is_extended_id=False, dlc=8)
        for message in (
            FRAME,
            remote,
            can.Message(arbitration_id=0x1ABCDEF0, data=b"", is_extended_id=True),
        ):
            bus.send(message)
            heard = None
            for _ in range(6000):
                if (heard := twin.recv(0)) is not None:
                    break
                quick_clock.wait_until(quick_clock.now_s() + 0.01)
            assert same(heard, message) and heard.is_remote_frame == message.is_remote_frame
            twin.send(message)
            assert same(received(bus), message)
        assert bus.get_version(1.0) == (10, 13)
        bus.shutdown()


def received(bus: can.BusABC) -> can.Message | None:
    """Past the adapter's acknowledgements, which python-can gives as nothing."""
    for _ in range(6000):
        if (message := bus.recv(0.01)) is not None:
            return message
    return None


def test_records_go_to_whoever_started_last_and_to_nobody_before():
    link = UdpLink(HOST, 0)
    one, other = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(2))
    for each in (one, other):
        each.connect((HOST, link.port))
        each.settimeout(0.2)
    start = encode_request(RdtCommand.START_SINGLE)
    stop = encode_request(RdtCommand.STOP)
    link.send(b"nobody")
    one.send(start)
    assert link.receive_all() == [start]
    link.send(b"first")
    assert one.recv(100) == b"first"
    other.send(stop)
    other.send(b"junk")
    assert link.receive_all() == [stop, b"junk"]
    link.send(b"second")
    assert one.recv(100) == b"second"
    other.send(start)
    link.receive_all()
    link.send(b"stolen")
    assert other.recv(100) == b"stolen"
    with pytest.raises(TimeoutError):
        one.recv(100)
    for each in (one, other, link):
        each.close()


@pytest.fixture
def control():
    panel = FaultPanel(CAN_FAULTS)
    heights = []
    port = ControlPort(panel, 0, heights.append, lambda: "well")
    with polled(port):
        yield port, panel, heights


def answered(port: ControlPort, line: str) -> str:
    with closing(socket.create_connection((HOST, port.port), PATIENCE_S)) as talk:
        talk.sendall(f"{line}\n".encode())
        answer = ""
        while not answer.endswith("ok\n") and not (
            answer.startswith("error") and answer.endswith("\n")
        ):
            answer += talk.recv(4096).decode()
    return answer


def test_lines_switch_faults_and_set_the_height(control):
    port, panel, heights = control
    assert answered(port, "on bus-off") == "ok\n"
    assert panel.is_on("bus-off")
    listed = answered(port, "faults").splitlines()
    assert len(listed) == len(CAN_FAULTS) + 1
    assert listed[1] == "bus-off            on   the drive neither hears nor says anything"
    assert answered(port, "off bus-off") == "ok\n"
    assert not panel.is_on("bus-off")
    panel.switch_on("can-short")
    assert answered(port, "off all") == "ok\n"
    assert not panel.any_on()
    assert answered(port, "height 215") == "ok\n"
    assert heights == [0.215]
    assert answered(port, "status") == "well\nok\n"


def test_a_height_that_the_simulation_refuses_is_an_answer_and_no_end():
    def refuse(height_m: float) -> None:
        raise SimulationFailed("no rest pose found")

    with polled(port := ControlPort(FaultPanel(CAN_FAULTS), 0, refuse, lambda: "well")):
        assert answered(port, "height 250") == "error no rest pose found\n"
        assert answered(port, "status") == "well\nok\n"


@pytest.mark.parametrize(
    ("line", "error"),
    [
        ("on flood", "no fault is called 'flood'"),
        ("dance", "cannot read 'dance'"),
        ("height nan", "height nan"),
        ("on", "cannot read"),
    ],
)
def test_a_line_that_cannot_be_obeyed_is_answered_with_the_reason(control, line, error):
    assert answered(control[0], line).startswith(f"error {error}")


def test_an_address_that_is_no_address_is_refused():
    assert is_loopback("127.0.0.9") and not is_loopback("0.0.0.0")
    for wrong in ("localhost", "1.2.3", "::1"):
        with pytest.raises(BadInput):
            is_loopback(wrong)
    with (
        closing(listening_tcp(HOST, 0)) as taken,
        pytest.raises(BadInput, match=r"cannot listen on 127\.0\.0\.1 port"),
    ):
        listening_tcp(HOST, taken.getsockname()[1])


class HandClock:
    """Stands still but for what `wait_until` and the test add."""

    def __init__(self) -> None:
        self.t_s = 5.0

    def now_s(self) -> float:
        return self.t_s

    def wait_until(self, t_s: float) -> None:
        self.t_s = max(self.t_s, t_s)


def test_the_twins_keep_to_the_clock():
    clock = HandClock()
    moments = []
    RealTimeLoop(moments.append, clock).run([], lambda _: None, 0.1)
    assert np.diff(moments) == pytest.approx(np.full(len(moments) - 1, 1e-3))
    assert moments[-1] == pytest.approx(0.099, abs=1.1e-3)


def test_twins_that_cannot_follow_slip_and_do_not_run_after_the_clock():
    clock = HandClock()
    moments = []

    def slow(to_s: float) -> None:
        moments.append(to_s)
        clock.t_s += 0.2

    loop = RealTimeLoop(slow, clock)
    loop.run([], lambda _: None, 2.0)
    assert np.diff(moments).max() == pytest.approx(LONGEST_LEAP_S)
    assert loop.slipped_s == pytest.approx(1.8 - 0.05 * (len(moments) - 1), abs=0.05)
    assert "behind the clock" in loop.status()


POST = b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: text/plain\r\n\r\n"


def test_a_page_in_a_browser_commands_nothing(wire):
    """A form on any page can send this to any port of the same machine."""
    panel = FaultPanel(CAN_FAULTS)
    control = ControlPort(panel, 0, lambda _: None, lambda: "")
    bus = SocketcandPort(wire, HOST, 0, 0.0)
    twin = wire.join()
    bodies = ((control, b"on can-silent\n"), (bus, b"< open can0 >< send 29 1 7 >"))
    with polled(control), polled(bus):
        for (port, body), first in product(bodies, (len(POST), 2)):
            with closing(socket.create_connection((HOST, port.port), PATIENCE_S)) as talk:
                talk.sendall(POST[:first])
                quick_clock.wait_until(quick_clock.now_s() + 0.05)
                with suppress(ConnectionError):
                    talk.sendall(POST[first:] + body)
                    while talk.recv(200):
                        pass
    assert not panel.is_on("can-silent")
    assert twin.recv(0) is None


def test_a_port_serves_so_many_clients_and_no_more(wire):
    port = SocketcandPort(wire, HOST, 0, 0.0)
    with polled(port):
        clients = [
            socket.create_connection((HOST, port.port), PATIENCE_S) for _ in range(MAX_CLIENTS)
        ]
        assert all(one.recv(20) == b"< hi >" for one in clients)
        with closing(socket.create_connection((HOST, port.port), PATIENCE_S)) as beyond:
            assert beyond.recv(20) == b""
        clients.pop().close()
        until_s = quick_clock.now_s() + PATIENCE_S
        answer = b""
        while not answer and quick_clock.now_s() < until_s:
            with closing(socket.create_connection((HOST, port.port), PATIENCE_S)) as again:
                answer = again.recv(20)
        assert answer == b"< hi >"
        for one in clients:
            one.close()


def box() -> NetFtBoxTwin:
    settings = NetFtTwinSettings(counts_per_N=1e6, counts_per_Nm=2e6)
    return NetFtBoxTwin(NetFtTwin(datagram_link()[0], settings, np.random.default_rng(1)))


@pytest.mark.parametrize("kind", ["control", "socketcand", "command"])
def test_a_client_that_is_idle_makes_room_and_one_that_is_not_stays(wire, kind):
    """By the clock that is passed in: five minutes later, without anything said."""
    port = {
        "control": lambda: ControlPort(FaultPanel(CAN_FAULTS), 0, lambda _: None, lambda: "here"),
        "socketcand": lambda: SocketcandPort(wire, HOST, 0, 0.0),
        "command": lambda: CommandPort(box(), HOST, 0),
    }[kind]()
    idle, busy = (socket.create_connection((HOST, port.port), PATIENCE_S) for _ in range(2))
    with closing(port), closing(idle), closing(busy):
        port.poll(0.0)
        for now_s in (0.4 * IDLE_S, 0.8 * IDLE_S, 1.01 * IDLE_S, 1.02 * IDLE_S):
            busy.sendall(b"< echo >\n".ljust(20))
            quick_clock.wait_until(quick_clock.now_s() + 0.05)
            port.poll(now_s)
        while idle.recv(100):
            pass
        busy.settimeout(0.2)
        with pytest.raises(TimeoutError):
            while busy.recv(100):
                pass
