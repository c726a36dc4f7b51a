"""A new drive behind the sockets of the server, set up as a real one is."""

import json
import re
import struct
import time
from pathlib import Path

import can
import pytest

from rfca_rig.devices.odrive import codec, settings
from rfca_rig.devices.odrive.memory import TWIN_ENDPOINTS
from rfca_rig.devices.odrive.messages import Address, RebootAction, TxSdo
from tests.cli.typed import typed
from tests.engine.rigs import ROOT
from tests.twin_server.server import serving
from tests.twin_server.test_real_run import real_rig

ENDPOINTS = ROOT / "calibration" / "twin-endpoints.json"


@pytest.fixture
def setup(monkeypatch, capsys, tmp_path):
    with serving("--new-drive", "--height", "320") as server:
        monkeypatch.setenv(
            "CAN_CONFIG", json.dumps({"host": server.host, "port": server.ports["can_port"]})
        )
        real_rig(tmp_path, server)

        def run(*words):
            return typed(
                monkeypatch, capsys, "setup", "motor", "--rig", tmp_path / "real.toml", *words
            )

        run.server = server
        yield run


def test_what_is_written_over_the_sockets_stays_in_the_drive(setup):
    """Stored values do not depend on how fast this machine carries the twins."""
    wrong = setup("--endpoints", ENDPOINTS)
    assert wrong.exit_code == 1
    assert "8 wrong" in wrong.out
    assert wrong.out.startswith("REAL ")
    written = setup("--endpoints", ENDPOINTS, "--write", "--yes")
    assert written.exit_code == 0, written.err
    again = setup("--endpoints", ENDPOINTS)
    assert (again.exit_code, "14 right, 0 wrong" in again.out) == (0, True), again.out
    assert setup.server.told("tool odrv0.axis0.config.enable_watchdog") == "1\nok\n"


def test_lines_of_the_maker_s_tool_are_typed_on_the_control_port(setup):
    for line in setup("--print").out.splitlines():
        assert setup.server.told(f"tool {line}").endswith("ok\n"), line
    right = setup("--endpoints", ENDPOINTS)
    assert right.exit_code == 0, right.out
    assert setup.server.told("tool odrv0.axis0.config.mood = 7").startswith("error odrivetool")
    assert setup.server.told("tool odrv0.axis0.config.enable_watchdog = so").startswith("error")


def test_a_hand_holds_the_leg_and_lets_it_go(setup):
    server = setup.server
    assert server.told("hold 0") == "ok\n"
    assert server.told("hold high").startswith("error high is no angle in degrees")
    assert server.told("hold 181").startswith("error")
    assert server.told("let go") == "ok\n"
    assert re.match(r"error cannot read 'let it'", server.told("let it"))


@pytest.fixture(scope="module")
def vendor_messages():
    """The messages of node 0 in the maker's own database of firmware 0.6.10."""
    odrive_can = pytest.importorskip(
        "odrive_can", reason="it comes with the extra 'third-party-clients'"
    )
    cantools = pytest.importorskip("cantools")
    database = cantools.database.load_file(
        Path(odrive_can.__file__).parent / "dbc" / "odrive-cansimple-0.6.10.dbc"
    )
    return {
        message.name.removeprefix("Axis0_"): message
        for message in database.messages
        if message.name.startswith("Axis0_")
    }


def number_of(value: bytes) -> int:
    return int.from_bytes(value, "little")


def test_frames_are_what_the_maker_s_own_database_says(vendor_messages):
    cases = {
        "RxSdo": (codec.write_endpoint(0, 201, struct.pack("<f", 0.1)), "Endpoint_ID", 201),
        "TxSdo": (codec.endpoint_value(0, 201, b"\x01"), "Endpoint_ID", 201),
        "Address": (codec.address(0, Address(3, 0x0123456789AB)), "Serial_Number", 0x0123456789AB),
        "Reboot": (codec.reboot(0, RebootAction.SAVE_CONFIGURATION), "Action", 1),
    }
    for name, ((arbitration_id, data), signal, value) in cases.items():
        assert arbitration_id == vendor_messages[name].frame_id, name
        layout = vendor_messages[name].get_signal_by_name(signal)
        assert layout.byte_order == "little_endian"
        raw = number_of(data) >> layout.start & (1 << layout.length) - 1
        assert raw == value, name
    node = vendor_messages["Address"].get_signal_by_name("Node_ID")
    assert (node.start, node.length) == (0, 8)
    opcode = vendor_messages["RxSdo"].get_signal_by_name("Opcode")
    value = vendor_messages["RxSdo"].get_signal_by_name("Value")
    assert (opcode.start, opcode.length, value.start, value.length) == (0, 8, 32, 32)


def test_a_client_that_knows_only_the_maker_s_database_sets_a_value(setup, vendor_messages):
    endpoint_id = TWIN_ENDPOINTS[settings.WATCHDOG_TIMEOUT].endpoint_id
    head = vendor_messages["RxSdo"]
    with can.Bus(**setup.server.can) as bus:

        def ask(opcode: int, value: bytes) -> None:
            data = bytes([opcode]) + endpoint_id.to_bytes(2, "little") + b"\0" + value
            bus.send(can.Message(arbitration_id=head.frame_id, data=data, is_extended_id=False))

        ask(1, struct.pack("<f", 0.25))
        ask(0, b"")
        answer = None
        deadline_s = time.monotonic() + 20.0
        while answer is None and time.monotonic() < deadline_s:
            message = bus.recv(0.1)
            if message is not None and message.arbitration_id == vendor_messages["TxSdo"].frame_id:
                answer = codec.decode(message.arbitration_id, message.data)
    assert answer == TxSdo(endpoint_id, struct.pack("<f", 0.25))
