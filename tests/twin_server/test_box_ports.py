"""The Net F/T box's web page and command interface, driven over real sockets by our own drivers
and by hand.
"""

import socket
from contextlib import closing

import numpy as np
import pytest

from rfca_rig.devices.netft.codec import ReadCalibrationInfo, encode_calibration, encode_command
from rfca_rig.devices.netft.driver import CommandBox, HttpBox
from rfca_rig.devices.netft.ports import FORCE_FAULTS, CommandPort, HttpPort
from rfca_rig.devices.netft.twin import NetFtBoxTwin, NetFtTwin, NetFtTwinSettings
from rfca_rig.twin_server.faults import FaultPanel
from rfca_rig.twins.wires import datagram_link
from tests.twin_server.polling import polled, quick_clock
from tests.waiting import PATIENCE_S

HOST = "127.0.0.1"


@pytest.fixture
def box():
    link, _ = datagram_link()
    settings = NetFtTwinSettings(counts_per_N=1e6, counts_per_Nm=2e6)
    return NetFtBoxTwin(NetFtTwin(link, settings, np.random.default_rng(1)))


def test_the_box_s_page_is_read_by_our_own_driver_and_by_hand(box):
    with polled(port := HttpPort(box, FaultPanel(FORCE_FAULTS), HOST, 0)):
        configuration = HttpBox(HOST, port.port).read_configuration()
        assert (configuration.counts_per_force, configuration.counts_per_torque) == (1e6, 2e6)
        for request, status in (
            (b"GET /nothing HTTP/1.1", b"404"),
            (b"PUT / HTTP/1.1", b"405"),
            (b"hello", b"400"),
            (b"x" * 9000, b"400"),
        ):
            with closing(socket.create_connection((HOST, port.port), PATIENCE_S)) as talk:
                talk.sendall(request + b"\r\n\r\n")
                answer = b"".join(iter(lambda talk=talk: talk.recv(4096), b""))
            assert answer.split(b" ")[1] == status


def test_a_request_may_come_in_pieces(box):
    with (
        polled(port := HttpPort(box, FaultPanel(FORCE_FAULTS), HOST, 0)),
        closing(socket.create_connection((HOST, port.port), PATIENCE_S)) as talk,
    ):
        for piece in (b"GET /netft", b"api2.xml HTTP/1.1\r\nHost: x\r\n", b"\r\n"):
            talk.sendall(piece)
            quick_clock.wait_until(quick_clock.now_s() + 0.02)
        answer = b"".join(iter(lambda: talk.recv(4096), b""))
    assert answer.startswith(b"HTTP/1.1 200 OK\r\n")
    assert b"<cfgcpf>" in answer


def test_the_command_interface_is_read_by_our_own_driver_and_takes_commands_in_pieces(box):
    with polled(port := CommandPort(box, HOST, 0)):
        info = CommandBox(HOST, port.port).read_configuration()
        assert (info.counts_per_force, info.counts_per_torque) == (1_000_000, 2_000_000)
        with closing(socket.create_connection((HOST, port.port), PATIENCE_S)) as talk:
            asked = encode_command(ReadCalibrationInfo())
            talk.sendall(asked + asked[:7])
            assert talk.recv(100) == encode_calibration(info)
            talk.sendall(asked[7:])
            assert talk.recv(100) == encode_calibration(info)
