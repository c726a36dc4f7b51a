"""The maker's own Python package on the twin server, over the serial line on which a moteus
speaks as a fdcanusb does.
"""

import asyncio
import math
import subprocess
import sys
import time
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import can
import pytest
import serial

from rfca_rig.clock import WallClock
from rfca_rig.codecs import fdcanusb
from rfca_rig.description.rig_file import read_rig
from rfca_rig.devices.drive_setup import DriveNeeds, Setting
from rfca_rig.devices.moteus.setup import MoteusSetup
from rfca_rig.twin_server.can_ports import FdcanusbPort, SharedWire
from tests.bench.test_moteus_and_odrive_rigs import MOTEUS, rig_with
from tests.twin_server.server import serving


@pytest.fixture
def port() -> Iterator[tuple[FdcanusbPort, can.BusABC, serial.Serial]]:
    wire = SharedWire("test")
    opened = FdcanusbPort(wire)
    other = wire.join()
    with serial.Serial(opened.path, timeout=60.0) as line:
        yield opened, other, line
    opened.close()
    wire.leave(other)


def answers(port: FdcanusbPort, line: serial.Serial, said: bytes, expected: int = 1) -> list[str]:
    """What the port says to a line, which takes the kernel a moment to carry."""
    line.write(said)
    lines = []
    rest = b""
    deadline_s = time.monotonic() + 60.0
    while len(lines) < expected and time.monotonic() < deadline_s:
        port.poll(0.0)
        more, rest = fdcanusb.split(rest + line.read(line.in_waiting))
        lines += more
    return [fdcanusb.parse_line(one)[0] for one in lines]


def test_a_frame_goes_onto_the_bus_and_the_answer_comes_back(port) -> None:
    opened, bus, line = port
    assert answers(opened, line, b"can send 8001 1100505050505050 BF\n") == ["OK"]
    message = bus.recv(timeout=0)
    assert (
        message.arbitration_id,
        message.is_extended_id,
        message.is_fd,
        message.bitrate_switch,
    ) == (0x8001, True, True, True)
    bus.send(
        can.Message(arbitration_id=0x100, data=b"\x21\x00\x0a", is_fd=True, is_extended_id=False)
    )
    assert sorted(answers(opened, line, b"conf get can.bitrate\n", 2)) == [
        "1000000",
        "rcv 0100 21000A e b F r",
    ]


def test_what_it_cannot_do_is_refused_and_once_guarded_all_lines_must_be(port) -> None:
    opened, bus, line = port
    assert answers(opened, line, b"tel list\n")[0].startswith("ERR not an order")
    assert answers(opened, line, b"conf get x\n") == ["ERR error reading"]
    assert answers(opened, line, b"can send 8001 00 *00\n")[0].startswith("ERR checksum mismatch")
    assert answers(opened, line, fdcanusb.encode_line("can send 8001 1100")) == ["OK"]
    assert answers(opened, line, b"can send 8001 1100\n") == ["ERR checksum required"]
    assert answers(opened, line, "can sénd\n".encode()) == ["ERR checksum required"]
    assert bus.recv(timeout=0) is not None
    assert bus.recv(timeout=0) is None


def test_classic_frames_pass_both_ways(port) -> None:
    opened, bus, line = port
    bus.send(can.Message(arbitration_id=0x100, data=b"\x21\x00\x0a", is_extended_id=False))
    assert sorted(answers(opened, line, b"can std 12 0A bf\n", 2)) == [
        "OK",
        "rcv 0100 21000A e b f r",
    ]
    message = bus.recv(timeout=0)
    assert (message.arbitration_id, message.is_fd, message.is_extended_id) == (0x12, False, False)


def test_it_says_nothing_of_the_bus_while_it_is_off(port) -> None:
    opened, bus, line = port
    assert answers(opened, line, b"can on\n") == ["ERR already in BusOn"]
    assert answers(opened, line, b"can off\n") == ["OK"]
    bus.send(can.Message(arbitration_id=0x100, data=b"\x21", is_extended_id=False))
    assert answers(opened, line, b"can send 12 0A\n") == ["ERR not in BusOn state"]
    assert answers(opened, line, b"can on\ncan send 12 0A\n", 2) == ["OK", "OK"]
    assert bus.recv(timeout=0).arbitration_id == 0x12


def talk(rig_file: Path, conversation: Callable[[Any, Any], Awaitable[None]]) -> None:
    moteus = pytest.importorskip(
        "moteus", reason="moteus is not installed; it comes with the extra 'third-party-clients'"
    )

    async def over(path: str) -> None:
        device = moteus.FdcanusbDevice(path)
        try:
            controller = moteus.Controller(id=3, transport=moteus.Transport(device))
            await asyncio.wait_for(conversation(controller, moteus), 20.0)
        finally:
            device.close()

    with serving("--rig", str(rig_file)) as server:
        asyncio.run(over(str(server.ports["fdcanusb"])))


@pytest.mark.realtime
def test_its_controller_turns_the_served_leg(tmp_path: Path) -> None:
    rig_with(tmp_path, MOTEUS)

    async def conversation(controller: Any, moteus: Any) -> None:
        await controller.set_stop()
        begun = (await controller.query()).values[moteus.Register.POSITION]
        for _ in range(100):
            state = await controller.set_position(
                position=math.nan, velocity=-0.2, watchdog_timeout=1.0, query=True
            )
            await asyncio.sleep(0.005)
        assert state.values[moteus.Register.MODE] == moteus.Mode.POSITION
        assert state.values[moteus.Register.POSITION] < begun - 0.05
        await controller.set_stop(query=True)
        assert (await controller.query()).values[moteus.Register.MODE] == moteus.Mode.STOPPED

    talk(tmp_path / "rig.toml", conversation)


@pytest.mark.realtime
def test_its_controller_learns_that_the_served_drive_timed_out(tmp_path: Path) -> None:
    rig_with(tmp_path, MOTEUS)

    async def conversation(controller: Any, moteus: Any) -> None:
        await controller.set_stop()
        await controller.set_position(position=math.nan, watchdog_timeout=0.1, query=True)
        await asyncio.sleep(0.3)
        assert (await controller.query()).values[moteus.Register.MODE] == moteus.Mode.TIMEOUT
        await controller.set_stop()

    talk(tmp_path / "rig.toml", conversation)


@pytest.mark.realtime
def test_its_stream_reads_writes_and_saves_settings_of_the_served_drive(tmp_path: Path) -> None:
    rig_with(tmp_path, MOTEUS)

    async def conversation(controller: Any, moteus: Any) -> None:
        stream = moteus.Stream(controller)
        await stream.write_message(b"tel stop")
        await stream.flush_read()

        async def get(name: bytes) -> float:
            return float(await stream.command(b"conf get " + name, allow_any_response=True))

        assert await get(b"id.id") == 3.0
        assert math.isnan(await get(b"servopos.position_min"))
        await stream.command(b"conf set servo.default_timeout_s 0.5")
        await stream.command(b"conf write")
        await stream.command(b"conf set servo.default_timeout_s 0.2")
        assert await get(b"servo.default_timeout_s") == pytest.approx(0.2)
        await stream.command(b"conf load")
        assert await get(b"servo.default_timeout_s") == 0.5
        with pytest.raises(moteus.CommandError, match="error setting"):
            await stream.command(b"conf set servo.no_such 1")

    talk(tmp_path / "rig.toml", conversation)


@pytest.mark.realtime
def test_its_tool_and_ours_agree_on_the_settings_of_a_new_drive(tmp_path: Path) -> None:
    """It writes what ours says that the rig needs; then ours finds nothing wrong."""
    pytest.importorskip(
        "moteus", reason="moteus is not installed; it comes with the extra 'third-party-clients'"
    )
    rig_with(tmp_path, MOTEUS)

    def use_tool(port: str, target: int, *words: str) -> str:
        command = [sys.executable, "-m", "moteus.moteus_tool", "--fdcanusb", port]
        done = subprocess.run(
            [*command, "--target", str(target), *words],
            capture_output=True,
            text=True,
            timeout=120.0,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        return done.stdout

    def wrong_at(port: str) -> tuple[list[Setting], tuple[str, ...]]:
        """Wrong settings as ours finds them, and the lines that it proposes for all but the id."""
        keys = read_rig(tmp_path / "rig.toml").motor.model_copy(
            update={"interface": "fdcanusb", "channel": port}
        )
        with keys.open() as bus:
            setup = MoteusSetup(keys, bus, WallClock(), DriveNeeds(20.0, 25.0, 0.1, 0.05))
            wrong = [setting for setting in setup.read() if setting.is_wrong]
            return wrong, setup.list_lines([one for one in wrong if one.name != "id.id"])

    with serving("--rig", str(tmp_path / "rig.toml")) as server:
        port = str(server.ports["fdcanusb"])
        assert server.told("on factory-settings") == "ok\n"
        listed = use_tool(port, 1, "--dump-config")
        assert "servopos.position_min -0.01" in listed
        assert "id.id 1" in listed
        wrong, lines = wrong_at(port)
        assert {setting.name for setting in wrong} == {
            "id.id",
            "servopos.position_min",
            "servopos.position_max",
        }
        file = tmp_path / "settings.cfg"
        file.write_text("\n".join(line for line in lines if line.startswith("conf ")))
        use_tool(port, 1, "--write-config", str(file))
        assert server.told("on drive-restart") == "ok\n"
        wrong, _ = wrong_at(port)
        assert [setting.name for setting in wrong] == ["id.id"]
