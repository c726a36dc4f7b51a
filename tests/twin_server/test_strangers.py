"""Clients that other people wrote, unmodified, on the twin server. They come with the extra
`third-party-clients`.
"""

import asyncio
import fcntl
import json
import os
import pty
import select
import struct
import subprocess
import sys
import termios
import time
from importlib.util import find_spec
from pathlib import Path

import can
import pytest

from tests.twin_server.server import serving

PATIENCE_S = 10.0
ENOUGH_BYTES = 60_000  # of a log: some hundred frames, whatever is still held back
# its port is fixed, so the address is the test's own; every 127.x.y.z is this machine on Linux
NETFT_HOST = "127.0.0.77"
DBC = "import odrive_can.utils as u; print(u.get_dbc_path())"


def needs(package: str) -> pytest.MarkDecorator:
    return pytest.mark.skipif(
        find_spec(package) is None,
        reason=f"{package} is not installed; it comes with the extra 'third-party-clients'",
    )


def until(true, patience_s: float = PATIENCE_S) -> None:
    deadline_s = time.monotonic() + patience_s
    while not true():
        assert time.monotonic() < deadline_s
        time.sleep(0.02)


@needs("NetFT")
@pytest.mark.skipif(
    sys.platform != "linux",
    reason="this client has its port fixed, which takes a loopback address of the test's own",
)
def test_netft_streams_tares_and_stops():
    from NetFT import Sensor

    with serving("--listen", NETFT_HOST, "--rdt-port", "49152"):
        sensor = Sensor(NETFT_HOST)
        sensor.sock.settimeout(2.0)
        single = sensor.getMeasurement()
        assert len(single) == 6
        # The leg begins straight at its parked angle, and swings for a second.
        time.sleep(2.0)
        sensor.tare(50)
        sensor.startStreaming()
        time.sleep(0.3)
        assert max(abs(count) for count in sensor.measurement()) < 5e6
        sensor.stopStreaming()
        sensor.thread.join(0.1)
        sensor.sock.close()


@pytest.fixture
def netft_client():
    pytest.importorskip(
        "pynetft", reason="pynetft is not installed; it comes with the extra 'third-party-clients'"
    )
    import pynetft

    def connected(server):
        """It reads the scale off the box's page first."""
        host, port = server.rdt
        return pynetft.Client(
            pynetft.Config(
                sensor_host=host, rdt_port=port, http_port=int(server.ports["http_port"])
            )
        )

    return connected


@pytest.mark.realtime
def test_pynetft_streams_at_7000_records_a_second_and_biases(netft_client):
    with serving() as server:
        client = netft_client(server)
        client.start()
        assert client.wait_for_first_sample(5.0)
        began_s = twins_s(server)
        before = client.health().received_count
        time.sleep(1.5)
        rate_Hz = (client.health().received_count - before) / (twins_s(server) - began_s)
        client.bias()
        until(
            lambda: (
                client.latest_sample() is not None
                and max(abs(v) for v in client.latest_sample().force) < 5.0
            )
        )
        health = client.health()
        client.stop()
    assert health.sensor_configuration.calibration.counts_per_force_unit == 1e6
    assert rate_Hz == pytest.approx(7000.0, rel=0.05)
    assert (
        health.lost_count,
        health.malformed_count,
        health.out_of_order_count,
        health.duplicate_count,
    ) == (0, 0, 0, 0)
    assert health.device_error_count == 0


def twins_s(server) -> float:
    """A busy machine may carry the twins more slowly than the wall clock."""
    return float(server.told("status").split()[2])


@pytest.mark.parametrize(
    ("fault", "counter"),
    [
        ("force-lost", "lost_count"),
        ("force-twice", "duplicate_count"),
        ("force-swapped", "out_of_order_count"),
        ("force-short", "malformed_count"),
        ("force-saturated", "device_error_count"),
        ("force-frozen", "ft_stall_count"),
        ("force-silent", "timeout_count"),
        ("box-restart", "reconnect_count"),
        ("stream-stolen", "reconnect_count"),
    ],
)
def test_pynetft_sees_each_fault_as_what_it_is(netft_client, served, fault, counter):
    client = netft_client(served)
    client.start()
    assert client.wait_for_first_sample(5.0)
    before = getattr(client.health(), counter)
    assert served.told(f"on {fault}") == "ok\n"
    until(lambda: getattr(client.health(), counter) > before)
    assert served.told("off all") == "ok\n"
    client.stop()


@pytest.fixture(scope="module")
def served():
    with serving() as server:
        yield server


@needs("odrive_can")
def test_odrive_can_turns_the_motor(served):
    from odrive_can import ODriveCAN

    speeds = []

    async def drive() -> str:
        odrive = ODriveCAN(axis_id=0, can_bus=can.Bus(**served.can))
        odrive.feedback_callback = lambda message, _: speeds.append(message.data["Vel_Estimate"])
        await odrive.start()
        odrive.clear_errors()
        odrive.set_controller_mode("VELOCITY_CONTROL", "PASSTHROUGH")
        feeding = asyncio.create_task(feed(odrive))
        await odrive.set_axis_state("CLOSED_LOOP_CONTROL")
        await asyncio.sleep(1.0)
        odrive.check_alive()
        odrive.check_errors()
        state = odrive.axis_state
        feeding.cancel()
        odrive.stop()
        return state

    async def feed(odrive) -> None:
        while True:
            odrive.set_input_vel(0.5)
            await asyncio.sleep(0.02)

    assert asyncio.run(drive()) == "CLOSED_LOOP_CONTROL"
    assert sum(speeds[-20:]) / 20 == pytest.approx(0.5, abs=0.2)


@needs("odrive_can")
@pytest.mark.parametrize(
    ("fault", "said"),
    [("heartbeat-silent", "HeartbeatError"), ("over-temperature", "MOTOR_OVER_TEMP")],
)
def test_odrive_can_notices_a_drive_in_trouble(served, fault, said):
    from odrive_can import ODriveCAN

    async def watch() -> str:
        odrive = ODriveCAN(axis_id=0, can_bus=can.Bus(**served.can))
        await odrive.start()
        served.told(f"on {fault}")
        await asyncio.sleep(0.8)
        try:
            odrive.check_alive()
            odrive.check_errors()
        except Exception as error:
            return f"{type(error).__name__} {error}"
        finally:
            served.told("off all")
            odrive.clear_errors()
            odrive.stop()
        return "nothing"

    assert said in asyncio.run(watch())


@pytest.mark.slow
def test_can_logger_of_python_can_writes_what_is_on_the_bus(served, tmp_path):
    log = tmp_path / "bus.asc"
    words = [sys.executable, "-m", "can.logger", "-i", "socketcand", "-c", "can0", "-f", str(log)]
    with subprocess.Popen(
        words, env=can_config(served), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    ) as logger:
        until(lambda: log.exists() and log.stat().st_size > ENOUGH_BYTES, 30.0)
        logger.send_signal(2)
        logger.wait(15.0)
    ids = [message.arbitration_id for message in can.LogReader(log)]
    assert ids.count(0x09) > 300
    assert ids.count(0x01) > 5


@needs("odrive_can")
def test_cantools_monitor_decodes_the_frames_with_the_vendor_s_own_database(served):
    """What it drew on its terminal is searched for the names of the drive's messages and
    signals.
    """
    dbc = subprocess.run(
        [sys.executable, "-c", DBC], capture_output=True, text=True, check=True
    ).stdout.strip()
    words = [sys.executable, "-m", "cantools", "monitor", "-i", "socketcand", "-c", "can0", dbc]
    names = ("Heartbeat", "Axis_State: IDLE", "Get_Encoder_Estimates", "Pos_Estimate")
    drawn = on_a_terminal(
        words, can_config(served) | {"TERM": "xterm"}, 30.0, [name.encode() for name in names]
    )
    assert all(name in drawn for name in names)


def on_a_terminal(
    words: list[str], environment: dict[str, str], seconds: float, awaited: list[bytes]
) -> str:
    """Runs a program that draws until all that is awaited was drawn, so long at most, and
    returns it; it is asked to quit with q.
    """
    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", 60, 160, 0, 0))
    drawn = b""
    deadline_s = time.monotonic() + seconds
    with subprocess.Popen(words, env=environment, stdin=its, stdout=its, stderr=its) as program:
        while time.monotonic() < deadline_s and not all(name in drawn for name in awaited):
            if select.select([ours], [], [], 0.1)[0]:
                drawn += os.read(ours, 65536)
        os.write(ours, b"q")
        while program.poll() is None and time.monotonic() < deadline_s + PATIENCE_S:
            if select.select([ours], [], [], 0.1)[0]:
                drawn += os.read(ours, 65536)
        program.kill()
    os.close(ours)
    os.close(its)
    return drawn.decode(errors="replace")


def can_config(served) -> dict[str, str]:
    """The environment in which python-can's own programs find the server."""
    return os.environ | {
        "CAN_CONFIG": json.dumps({"host": served.host, "port": int(served.ports["can_port"])})
    }


def test_the_extra_names_every_stranger():
    text = (Path(__file__).parents[2] / "pyproject.toml").read_text()
    extra = text.split("third-party-clients = [")[1].split("]")[0]
    assert all(name in extra for name in ("NetFT", "pynetft", "odrive-can", "cantools"))
