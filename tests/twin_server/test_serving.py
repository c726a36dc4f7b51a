"""`rfca-rig twin` as a user types it, and a whole run of the real rig's drivers against it."""

import os
import signal
import socket
from dataclasses import dataclass
from pathlib import Path

import can
import pytest

from rfca_rig.acquisition.acquired import AcquiredDatagrams
from rfca_rig.clock import WallClock
from rfca_rig.devices.netft.driver import NetFtSensor, record_source
from rfca_rig.devices.netft.section import NetFtSettings
from rfca_rig.devices.odrive.driver import OdriveMotor, OdriveSettings
from tests.cli.typed import typed
from tests.twin_server.server import ANY_FREE, serving

REAL_RIG = Path(__file__).parents[1] / "data" / "real-rig.toml"

TICK_S = 2e-3


@pytest.fixture(scope="module")
def served():
    with serving("--fault", "force-lost@0-0.01", "--slcan") as server:
        yield server


@dataclass
class Drivers:
    clock: WallClock
    motor: OdriveMotor
    sensor: NetFtSensor

    def run(self, seconds: float, speed_rad_s: float) -> tuple[list[float], list[int]]:
        """Shaft angles and record numbers, as a control loop gets them."""
        angles = []
        numbers = []
        due_s = self.clock.now_s()
        end_s = due_s + seconds
        while due_s < end_s:
            self.motor.command_speed(speed_rad_s)
            due_s = max(due_s + TICK_S, self.clock.now_s())
            self.clock.wait_until(due_s)
            angles += self.motor.read().angle_rad.tolist()
            numbers += self.sensor.read().sequence.tolist()
        return angles, numbers


@pytest.fixture
def drivers(served):
    clock = WallClock()
    bus = can.Bus(**served.can)
    datagrams = AcquiredDatagrams(record_source(served.host, served.rdt[1]), clock)
    motor = OdriveMotor(
        bus,
        clock,
        OdriveSettings(node_id=0, gear_ratio=9.0, encoder_period_s=2e-3, heartbeat_timeout_s=1.0),
    )
    yield Drivers(clock, motor, NetFtSensor(datagrams, clock, NetFtSettings()))
    datagrams.close()
    bus.shutdown()


@pytest.mark.realtime
def test_our_own_drivers_turn_the_shaft_and_read_the_sensor_over_the_sockets(drivers):
    for _ in range(5):
        drivers.sensor.start()
        drivers.motor.enable()
        drivers.motor.read()
        angles, numbers = drivers.run(1.0, 0.5)
        fault = drivers.motor.status().fault
        drivers.motor.disable()
        drivers.sensor.stop()
        # A loaded machine that stops this process for longer than the watchdog's time is worth
        # another try.
        if fault is None:
            break
    assert fault is None
    assert 0.2 < angles[-1] - angles[0] < 0.65  # a machine that is busy makes the twin slow
    assert numbers == list(range(1, len(numbers) + 1))
    assert len(numbers) > 2000
    assert drivers.sensor.health().lost == 0


@pytest.mark.realtime
def test_a_fault_switched_from_another_terminal_reaches_the_drivers(
    served, drivers, monkeypatch, capsys
):
    drivers.motor.enable()
    said = typed(
        monkeypatch,
        capsys,
        "twin",
        "tell",
        "on",
        "over-temperature",
        "--control-port",
        served.ports["control_port"],
    )
    assert (said.exit_code, said.err) == (0, "")
    drivers.run(0.5, 0.0)
    assert "MOTOR_OVER_TEMP" in str(drivers.motor.status().fault)


def test_faults_are_switched_and_listed_from_another_terminal(served, monkeypatch, capsys):
    port = served.ports["control_port"]
    said = typed(
        monkeypatch, capsys, "twin", "tell", "on", "over-temperature", "--control-port", port
    )
    assert (said.exit_code, said.err) == (0, "")
    listed = typed(monkeypatch, capsys, "twin", "tell", "faults", "--control-port", port)
    assert "over-temperature   once" in listed.out
    refused = typed(monkeypatch, capsys, "twin", "tell", "on", "flood", "--control-port", port)
    assert refused.exit_code == 2
    assert "no fault is called 'flood'" in refused.err


def test_a_server_that_is_not_there_is_said_so(monkeypatch, capsys):
    with socket.socket() as unused:
        unused.bind(("127.0.0.1", 0))
        said = typed(
            monkeypatch, capsys, "twin", "tell", "status", "--control-port", unused.getsockname()[1]
        )
    assert said.exit_code == 1
    assert "is rfca-rig twin serve running" in said.err


def test_the_serial_adapter_is_there_too(served):
    bus = can.Bus(interface="slcan", channel=str(served.ports["slcan"]), sleep_after_open=0.0)
    ids = set()
    for _ in range(600):
        message = bus.recv(0.5)
        if message is not None:
            ids.add(message.arbitration_id)
    bus.shutdown()
    assert {0x01, 0x09, 0x1C} <= ids


@pytest.mark.slow
def test_an_interrupt_ends_the_server_with_130_and_leaves_nothing_behind():
    with serving() as server:
        ports = server.ports
        exit_code, said = server.interrupted()
    assert exit_code == 130
    assert said.splitlines()[-1].startswith("rfca-rig: stopped by the operator; running for ")
    assert "Traceback" not in said and "not properly shut down" not in said
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as again:
        again.bind(("127.0.0.1", int(ports["rdt_port"])))
    with pytest.raises(ProcessLookupError):
        os.kill(server.process.pid, 0)


@pytest.mark.slow
def test_a_server_that_is_told_to_terminate_does():
    with serving("--seconds", "60") as server:
        server.process.send_signal(signal.SIGTERM)
        assert server.process.wait(60.0) != 0


def test_it_ends_by_itself_and_says_where_it_was_reached(monkeypatch, capsys):
    said = typed(
        monkeypatch, capsys, "twin", "serve", *ANY_FREE, "--seconds", 0.1, "--fault", "can-silent@0"
    )
    assert said.exit_code == 0
    assert "SIM Net F/T RDT on UDP 127.0.0.1:" in said.err
    assert "SIM fault can-silent on" in said.err
    assert "WARNING" not in said.err
    assert said.out == ""


def test_opening_it_to_the_network_is_warned_of(monkeypatch, capsys):
    said = typed(
        monkeypatch, capsys, "twin", "serve", "--listen", "0.0.0.0", *ANY_FREE, "--seconds", 0.01
    )
    assert said.exit_code == 0
    assert "WARNING open to the network" in said.err
    assert "control lines on TCP 127.0.0.1:" in said.err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--fault", "flood@1"), "no fault is called 'flood'"),
        (("--fault", "force-lost"), "NAME@SECONDS"),
        (("--listen", "nowhere"), "is no address to listen on"),
        (("--rig", str(REAL_RIG)), "only a rig of kind 'twin'"),
        (("--rdt-port", "70000"), "--rdt-port"),
    ],
)
def test_what_cannot_be_served_is_refused_with_exit_code_2(monkeypatch, capsys, words, said):
    told = typed(monkeypatch, capsys, "twin", "serve", "--seconds", 0.1, *ANY_FREE, *words)
    assert told.exit_code == 2
    assert said in told.err


def test_a_port_that_is_taken_is_refused(monkeypatch, capsys, served):
    told = typed(
        monkeypatch, capsys, "twin", "serve", *ANY_FREE, "--rdt-port", served.ports["rdt_port"]
    )
    assert told.exit_code == 2
    assert "another server may be running" in told.err


@pytest.mark.parametrize("words", [(), ("serve",), ("tell",)], ids=" ".join)
def test_it_explains_itself(monkeypatch, capsys, words):
    said = typed(monkeypatch, capsys, "twin", *words, "--help")
    assert said.exit_code == 0
    assert "Usage" in said.out
