"""Configuration of the Net F/T: read over HTTP and over the command interface of its twin, and
held against the settings.
"""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, HTTPServer

import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.devices.netft.codec import (
    COMMAND_BYTES,
    NO_TRANSFORMATION,
    CalibrationInfo,
    RdtCommand,
    ReadForce,
    ToolTransformation,
    decode_reading,
    decode_request,
    encode_command,
)
from rfca_rig.devices.netft.driver import CommandBox, HttpBox, NetFtSensor
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.devices.netft.twin import NetFtBoxTwin, NetFtTwin, NetFtTwinSettings
from rfca_rig.drivers.ports import RECEIVE_BUFFER_BYTES, advise_receive_buffer
from rfca_rig.errors import BadInput, DeviceError, RigError
from rfca_rig.twins.wires import datagram_link

TURNED = ToolTransformation((0.0, 0.0, 12.5), (0.0, 0.0, 45.0))


def made(settings: NetFtTwinSettings | None = None) -> tuple[NetFtBoxTwin, NetFtTwin]:
    settings = settings or NetFtTwinSettings(decimation=7, counts_per_N=1e6, counts_per_Nm=2e6)
    twin = NetFtTwin(datagram_link()[1], settings, np.random.default_rng(1))
    return NetFtBoxTwin(twin), twin


@contextmanager
def http(box: NetFtBoxTwin) -> Iterator[int]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            page = box.page(self.path)
            self.send_response(page.status)
            self.send_header("Content-Type", page.content_type)
            self.end_headers()
            self.wfile.write(page.body)

        def log_message(self, *_: object) -> None:
            return

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        yield server.server_address[1]
        server.shutdown()
        thread.join()


@contextmanager
def commands(answer: Callable[[bytes], bytes], times: int = 1) -> Iterator[int]:
    def serve() -> None:
        for _ in range(times):
            with listening.accept()[0] as client:
                client.sendall(answer(client.recv(COMMAND_BYTES)))

    with socket.create_server(("127.0.0.1", 0)) as listening:
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield listening.getsockname()[1]
        thread.join(5.0)


def test_the_page_tells_units_counts_and_rate() -> None:
    box, _ = made()
    with http(box) as port:
        configuration = HttpBox("127.0.0.1", port).read_configuration()
    assert configuration == box.configuration
    assert (configuration.counts_per_N, configuration.counts_per_Nm) == (1e6, 2e6)
    assert configuration.decimation(7000.0) == 7


@pytest.mark.parametrize("decimation", range(1, 60))
def test_the_twins_page_and_its_stream_agree_at_every_rate(decimation: int) -> None:
    box, _ = made(NetFtTwinSettings(decimation=decimation))
    assert box.configuration.decimation(7000.0) == decimation


def test_a_busy_box_is_told_with_what_it_answered() -> None:
    box, _ = made()
    box.busy = True
    with (
        http(box) as port,
        pytest.raises(
            DeviceError, match=rf"http://127.0.0.1:{port}/netftapi2.xml gives no configuration.*503"
        ),
    ):
        HttpBox("127.0.0.1", port).read_configuration()


def test_a_page_of_something_else_is_told() -> None:
    box, _ = made()
    box.page = lambda target: replace(NetFtBoxTwin.page(box, target), body=b"<html/>")
    with (
        http(box) as port,
        pytest.raises(
            DeviceError, match=r"begins with <html>, expected <netft>; is this a Net F/T\?"
        ),
    ):
        HttpBox("127.0.0.1", port).read_configuration()


def test_nobody_there_is_told_by_both_ways() -> None:
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        port = unused.getsockname()[1]
    for box in (HttpBox("127.0.0.1", port), CommandBox("127.0.0.1", port)):
        with pytest.raises(DeviceError, match="check the address"):
            box.read_configuration()


def test_the_command_interface_tells_units_and_counts() -> None:
    box, _ = made()
    with commands(box.answer) as port:
        configuration = CommandBox("127.0.0.1", port).read_configuration()
    scale_factors = configuration.scale_factors
    assert configuration == CalibrationInfo("N", "Nm", 1_000_000, 2_000_000, scale_factors)
    assert max(scale_factors) < 2**16


def test_a_reading_over_the_command_interface_is_the_wrench_to_its_16_bits() -> None:
    box, twin = made()
    scale = np.array(box._scale_factors())
    box.answer(encode_command(ReadForce()))
    wrench = np.array([3.0, -7.5, 600.0, 0.5, -0.75, 29.0])
    twin.take_wrench(np.tile(wrench, (len(twin.due(0.01)), 1)))
    with commands(box.answer) as port:
        reading = CommandBox("127.0.0.1", port).reading(ReadForce())
    counts_per_unit = np.repeat([1e6, 2e6], 3)
    assert np.array(reading.counts) * scale / counts_per_unit == pytest.approx(
        wrench, abs=float((scale / counts_per_unit).max())
    )
    assert reading.status == 0


def test_a_bias_over_the_command_interface_takes_off_what_is_felt() -> None:
    box, twin = made()
    box.answer(encode_command(ReadForce(bias=True)))
    twin.take_wrench(np.full((len(twin.due(0.01)), 6), 4.0))
    assert decode_reading(box.answer(encode_command(ReadForce()))).counts == (0,) * 6


def test_an_idle_twin_measures_only_once_it_was_asked() -> None:
    box, twin = made()
    assert len(twin.due(0.01)) == 0
    box.answer(encode_command(ReadForce()))
    assert len(twin.due(0.02)) == 1


def test_what_is_no_command_gets_no_answer() -> None:
    box, _ = made()
    assert box.answer(b"\x02" + bytes(19)) == b""
    with (
        commands(lambda _: b"\x12\x34") as port,
        pytest.raises(DeviceError, match=r"127\.0\.0\.1:\d+: .* of 2 bytes, expected 24"),
    ):
        CommandBox("127.0.0.1", port).read_configuration()


def test_a_box_that_agrees_starts_its_stream_and_lends_its_serial_number() -> None:
    here, there = datagram_link()
    box, _ = made()
    box.configuration = replace(box.configuration, serial_number="FT27462")
    sensor = NetFtSensor(here, TwinClock(), NetFtSettings(1e6, 2e6, 1000.0), box)
    sensor.start()
    assert [decode_request(datagram).command for datagram in there.receive_all()] == [
        RdtCommand.STOP,
        RdtCommand.START_BUFFERED,
    ]
    assert sensor.identity()["serial_number"] == "FT27462"


@pytest.mark.parametrize(
    ("change", "kind", "said"),
    [
        (
            {"counts_per_force": 1e5},
            BadInput,
            r"counts_per_N is 1000000, the box at 10\.0\.0\.7 is set to 100000 \(100000 per N\)",
        ),
        (
            {"force_unit": "lbf"},
            BadInput,
            r"counts_per_N is 1000000, .* is set to 224808\.9431 \(1e\+06 per lbf\)",
        ),
        (
            {"torque_unit": "Nmm"},
            BadInput,
            r"counts_per_Nm is 2000000, .* is set to 2000000000 \(2e\+06 per Nmm\)",
        ),
        (
            {"rdt_rate_Hz": 7000.0},
            BadInput,
            r"rate_Hz is 1000, .* is set to 7000 records/s \(comrdtrate 7000\)",
        ),
        ({"internal_rate_Hz": 7812.0}, BadInput, r"rate_Hz is 1000, .* is set to 1116 records/s"),
        (
            {"rdt_enabled": False},
            DeviceError,
            r"RDT is disabled on the box at 10\.0\.0\.7; enable it \(comrdte\)",
        ),
        (
            {"tool_transformation": TURNED},
            BadInput,
            (
                r"the tool transformation of the box at 10\.0\.0\.7 is shift 0, 0, 12\.5 mm, turn "
                r"0, 0, 45 degrees, the rig file states none; set it to 0"
            ),
        ),
        (
            {"is_axia": True},
            BadInput,
            r'10\.0\.0\.7 is an Ethernet Axia, .* those of a NetBox; set model = "axia"',
        ),
    ],
)
def test_a_box_set_otherwise_is_refused_in_one_line_before_anything_is_sent(
    change: dict[str, float], kind: type[RigError], said: str
) -> None:
    here, there = datagram_link()
    box, _ = made()
    box.configuration = replace(box.configuration, **change)
    sensor = NetFtSensor(
        here, TwinClock(), NetFtSettings(1e6, 2e6, 1000.0, address="10.0.0.7"), box
    )
    with pytest.raises(kind, match=said) as caught:
        sensor.start()
    assert "\n" not in str(caught.value)
    assert there.receive_all() == []


def sensor_beside(box: NetFtBoxTwin, **stated: object) -> NetFtSensor:
    settings = NetFtSettings(1e6, 2e6, 1000.0, **stated)
    return NetFtSensor(datagram_link()[0], TwinClock(), settings, box)


@pytest.mark.parametrize(
    ("there", "stated", "said"),
    [
        (TURNED, TURNED, None),
        (TURNED, ToolTransformation((0.0, 0.0, 12.504), (0.0, 0.0, 45.0)), None),
        (
            TURNED,
            ToolTransformation((0.0, 0.0, 12.6), (0.0, 0.0, 45.0)),
            "the rig file states shift",
        ),
        (
            NO_TRANSFORMATION,
            TURNED,
            r"tool transformation .* is none, the rig file states shift",
        ),
        (None, TURNED, "the rig file states a tool transformation .* states none; leave out"),
        (None, NO_TRANSFORMATION, None),
    ],
)
def test_a_tool_transformation_must_be_the_one_that_is_stated(there, stated, said) -> None:
    box, _ = made()
    box.configuration = replace(box.configuration, tool_transformation=there)
    sensor = sensor_beside(box, tool_transformation=stated)
    if said is None:
        assert sensor.check_configuration() == []
        return
    with pytest.raises(BadInput, match=said):
        sensor.check_configuration()


@pytest.mark.parametrize(
    ("there", "stated", "said"),
    [
        ("0", None, None),
        (None, None, None),
        (None, 3, None),
        ("3", 3, None),
        ("0", 3, "low_pass is 3, .* has its filter off"),
        ("8", 3, r"low_pass is 3, .* has its filter on, code 8, about 5 Hz \(not verified\)"),
    ],
)
def test_a_stated_filter_must_be_the_one_of_the_box(there, stated, said) -> None:
    box, _ = made()
    box.configuration = replace(box.configuration, low_pass=there)
    sensor = sensor_beside(box, low_pass=stated)
    if said is None:
        assert sensor.check_configuration() == []
        return
    with pytest.raises(BadInput, match=said):
        sensor.check_configuration()


def test_a_filter_that_nobody_stated_is_a_warning_with_its_lag_and_is_recorded() -> None:
    box, _ = made()
    box.configuration = replace(box.configuration, low_pass="8", tool_transformation=None)
    sensor = sensor_beside(box)
    assert "low_pass" not in sensor.identity()
    (warning,) = sensor.check_configuration()
    assert "about 32 ms late" in warning
    assert 'id = "sensor_lag", parameters = { time_constant_s = 0.032 }' in warning
    assert sensor.identity()["low_pass"] == "on, code 8, about 5 Hz (not verified)"
    assert "tool_transformation" not in sensor.identity()


def test_a_netbox_that_is_taken_for_an_axia_is_refused() -> None:
    box, _ = made()
    with pytest.raises(BadInput, match=r'is a NetBox, .*; set model = "net-box"'):
        sensor_beside(box, is_axia=True).check_configuration()


def test_counts_changed_between_two_streams_are_noticed() -> None:
    box, _ = made()
    sensor = NetFtSensor(datagram_link()[0], TwinClock(), NetFtSettings(1e6, 2e6, 1000.0), box)
    sensor.start()
    sensor.stop()
    box.configuration = replace(box.configuration, counts_per_force=2e6)
    with pytest.raises(BadInput, match="counts_per_N"):
        sensor.start()


@pytest.mark.parametrize(
    ("buffered", "command"), [(True, RdtCommand.START_BUFFERED), (False, RdtCommand.START_SINGLE)]
)
def test_a_bias_is_sent_and_the_stream_begun_anew(buffered: bool, command: RdtCommand) -> None:
    here, there = datagram_link()
    sensor = NetFtSensor(here, TwinClock(), NetFtSettings(buffered=buffered))
    sensor.bias()
    sensor.start()
    there.receive_all()
    sensor.bias()
    requests = [decode_request(datagram).command for datagram in there.receive_all()]
    assert requests == [RdtCommand.SET_BIAS, RdtCommand.STOP, command]


def test_a_small_receive_buffer_comes_with_what_to_type() -> None:
    assert (
        advise_receive_buffer(RECEIVE_BUFFER_BYTES)
        == advise_receive_buffer(2 * RECEIVE_BUFFER_BYTES)
        == ""
    )
    line = advise_receive_buffer(212_992)
    assert "gives 208 KiB of receive buffer where 4096 were asked for" in line
    assert "sudo sysctl -w net.core.rmem_max=4194304" in line
