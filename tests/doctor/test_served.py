"""The whole command over loopback, where the far ends of the wires are the twin server."""

import json
import re
import time
from collections.abc import Callable
from functools import partial

import pytest

from rfca_rig.bench.sensor_bench import open_sensor
from rfca_rig.cli.commands.doctor import WIDTH
from rfca_rig.description.rig_file import read_rig
from rfca_rig.doctor.sensor_setup import (
    PUSHES,
    LoadStep,
    hang_mass,
    judge_mounting,
    measure_loads,
)
from tests.cli.typed import Said, typed
from tests.engine.rigs import ROOT
from tests.twin_server.server import Server, serving
from tests.twin_server.test_other_devices import rig_text


@pytest.fixture(scope="module")
def server():
    with serving() as served:
        yield served


@pytest.fixture
def told(server, monkeypatch, capsys, tmp_path):
    """`told(server, **changed)` runs the command on a real rig's file with these addresses; what
    is `changed` stands otherwise.
    """
    monkeypatch.setenv(
        "CAN_CONFIG", json.dumps({"host": server.host, "port": server.ports["can_port"]})
    )
    server.told("off all")

    def run(*options: str, **changed: str) -> Said:
        file = tmp_path / "real.toml"
        file.write_text(written(server, changed))
        return typed(monkeypatch, capsys, "doctor", "--rig", file, "--runs", tmp_path, *options)

    return run


def written(server: Server, changed: dict[str, str]) -> str:
    text = (
        (ROOT / "calibration" / "twin.toml")
        .read_text()
        .partition("[twin]")[0]
        .replace('kind = "twin"', 'kind = "real"')
    )
    motor = '[motor]\ninterface = "socketcand"\nchannel = "can0"\n'
    sensor = (
        f'[force_sensor]\nhost = "{server.host}"\nport = {server.rdt[1]}\nhttp_port = '
        f"{server.ports['http_port']}\n"
    )
    text = text.replace("[motor]\n", motor).replace("[force_sensor]\n", sensor)
    for key, value in changed.items():
        text, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", text)
        assert count == 1, key
    return text


def by_subject(said: Said) -> dict[str, dict[str, object]]:
    return {one["subject"]: one for one in json.loads(said.out)["findings"]}


DRIVE = ("CAN bus", "drive", "drive error", "drive's encoder", "drive's torque")
SENSOR = ("sensor's box", "sensor's records", "sensor's rate", "sensor's status")


def repeated(look: Callable[[], Said], subjects: tuple[str, ...]) -> Said:
    """What `look` says once every one of `subjects` is green, or the last of five times.

    The twins of a loaded machine fall behind real time: their rates and losses are then the
    machine's own affair.
    """
    for _ in range(5):
        said = look()
        seen = by_subject(said)
        if all(seen.get(name, {}).get("colour") == "green" for name in subjects):
            break
    return said


@pytest.mark.realtime
def test_a_healthy_rig_has_a_green_drive_and_sensor(told):
    said = repeated(lambda: told("--json"), (*DRIVE, *SENSOR))
    seen = by_subject(said)
    assert {name: seen[name]["colour"] for name in (*DRIVE, *SENSOR)} == dict.fromkeys(
        (*DRIVE, *SENSOR), "green"
    ), said.out
    assert re.match(r"at [\d.]+ deg, encoder at [\d.]+ turns: is it\?", str(seen["shaft"]["seen"]))
    assert {
        "receive buffer",
        "clock",
        "disk for runs",
        "python packages",
        "compiled code",
    } < seen.keys()
    assert said.exit_code == (json.loads(said.out)["red"] > 0)


@pytest.mark.realtime
def test_a_wrong_node_id_is_named_with_its_remedy_within_80_columns(told):
    said = told(node_id="5")
    assert said.exit_code == 1
    assert re.search(
        r"^red     drive             heard node 0, the rig file says 5$", said.out, re.MULTILINE
    )
    assert "\n    odrv0.axis0.config.can.node_id = 5\n" in said.out
    assert max(map(len, said.out.splitlines())) <= WIDTH
    assert "\x1b" not in said.out
    assert said.out.startswith("REAL ")
    assert re.search(r"\d+ green, \d+ yellow, [1-9]\d* red\n$", said.out)


@pytest.mark.realtime
def test_a_silent_drive_is_told(told, server):
    assert server.told("on can-silent") == "ok\n"
    said = by_subject(told("--json"))
    assert said["drive"]["colour"] == "red"
    assert said["drive"]["seen"] == "nothing at all heard on the bus"
    assert "power" in said["drive"]["fix"]


@pytest.mark.realtime
def test_a_sensor_on_another_port_is_unreachable(told, server):
    said = by_subject(told("--json", port="9"))
    assert said["sensor's records"]["colour"] == "red"
    assert "the box answers, but not on UDP port 9" in said["sensor's records"]["fix"]
    nobody = by_subject(told("--json", port="9", http_port="9"))
    assert nobody["sensor's box"]["colour"] == "red"
    assert "Connection refused" in nobody["sensor's box"]["seen"]
    assert f"ping -c 3 {server.host}" in nobody["sensor's records"]["commands"]


@pytest.mark.realtime
def test_a_box_set_otherwise_and_a_sensor_beyond_its_range_are_told(told, server):
    assert server.told("on force-saturated") == "ok\n"
    said = by_subject(told("--json", counts_per_N="500000.0"))
    assert "counts_per_N is 500000" in said["sensor's box"]["seen"]
    assert "saturation" in said["sensor's status"]["seen"]


@pytest.mark.realtime
def test_a_sensor_that_was_never_checked_with_a_hand_is_yellow(told):
    said = by_subject(told("--json"))
    assert said["sensor's mounting"]["colour"] == "yellow"
    assert said["sensor's mounting"]["commands"] == ["rfca-rig setup sensor --rig FILE"]


class HandAtTheServer:
    """Pushes the twin behind the network, when a person would."""

    def __init__(self, server: Server) -> None:
        self._server = server

    def apply(self, step: LoadStep) -> None:
        force_N = 20.0
        if step.mass_kg is not None:
            force_N = step.mass_kg * 9.80665
        force = " ".join(f"{force_N * share:g}" for share in step.direction)
        assert self._server.told(f"push {force} {1e3 * step.lever_m:g}") == "ok\n"

    def release(self) -> None:
        assert self._server.told("push 0 0 0") == "ok\n"


@pytest.mark.realtime
@pytest.mark.parametrize(
    ("fault", "axes"), [(None, ("x", "y", "z")), ("sensor-turned-90", ("-y", "x", "z"))]
)
def test_a_sensor_on_the_network_is_pushed_and_its_axes_found(server, tmp_path, fault, axes):
    server.told("off all")
    if fault is not None:
        server.told(f"on {fault}")
    file = tmp_path / "real.toml"
    file.write_text(written(server, {}))
    rig = read_rig(file)
    mass = hang_mass(1.0, 100.0)
    with open_sensor(rig, 0) as bench:
        assert bench.load is None
        assert [str(finding.colour) for finding in bench.settings] == ["green"]
        loads = measure_loads(bench.sensor, bench.clock, HandAtTheServer(server), (*PUSHES, mass))
    server.told("off all")
    check = judge_mounting(loads, mass, rig.sensor.mounting, rig.sensor.below_shaft_mm)
    assert check.axes.names == axes
    assert [str(finding.colour) for finding in check.findings[1:]] == ["green"] * 3, check.findings


@pytest.mark.realtime
def test_a_bus_that_does_not_exist_is_told(told):
    said = told("--json", interface='"kvaser"', channel='"77"')
    bus = by_subject(said)["CAN bus"]
    assert bus["colour"] == "red"
    assert "kvaser 77 cannot be opened" in bus["seen"]
    assert "canlib" in bus["fix"]
    assert "drive" not in by_subject(said)
    assert said.exit_code == 1


@pytest.mark.realtime
def test_an_error_of_the_drive_is_told_with_its_meaning(told, server):
    """Last, for the drive keeps it."""
    assert server.told("on over-temperature") == "ok\n"
    time.sleep(0.3)
    said = by_subject(told("--json"))
    assert said["drive error"]["colour"] == "red"
    assert "MOTOR_OVER_TEMP: motor too hot" in said["drive error"]["seen"]
    assert said["drive error"]["commands"] == ["odrv0.clear_errors()"]


@pytest.mark.realtime
def test_a_controller_on_a_serial_line_and_a_drive_in_mit_mode_are_looked_at(
    monkeypatch, capsys, tmp_path
):
    served_file = tmp_path / "served.toml"
    real_file = tmp_path / "real.toml"
    served_file.write_text(rig_text())
    with serving("--rig", str(served_file)) as server:
        monkeypatch.setenv(
            "CAN_CONFIG", json.dumps({"host": server.host, "port": server.ports["can_port"]})
        )
        text = rig_text().partition("[twin]")[0].replace('kind = "twin"', 'kind = "real"')
        text = text.replace("[motor]\n", '[motor]\ninterface = "socketcand"\n')
        real_file.write_text(
            text.replace("[force_sensor]\n", f'[force_sensor]\nport = "{server.ports["serial"]}"\n')
        )
        subjects = (
            "CAN bus",
            "drive",
            "drive error",
            "serial port",
            "sensor",
            "sensor's rate",
            "sensor's records",
        )
        look = partial(
            typed, monkeypatch, capsys, "doctor", "--json", "--rig", real_file, "--runs", tmp_path
        )
        seen = by_subject(repeated(look, subjects))
    for subject in subjects:
        assert seen[subject]["colour"] == "green", seen[subject]
    assert seen["drive"]["seen"].startswith("AK drive 1 in MIT mode")


def test_a_twin_rig_says_that_its_devices_are_twins_and_checks_the_computer(
    monkeypatch, capsys, tmp_path
):
    said = typed(monkeypatch, capsys, "doctor", "--rig", "twin", "--runs", tmp_path)
    assert said.exit_code == 0
    assert said.out.startswith("SIM ")
    for subject in ("devices", "clock", "disk for runs", "python packages", "compiled code"):
        assert re.search(rf"^(green|yellow) +{subject} ", said.out, re.MULTILINE), subject
    assert "are twins" in said.out


def test_a_rig_file_that_is_not_there_is_bad_input(monkeypatch, capsys):
    assert typed(monkeypatch, capsys, "doctor", "--rig", "no-such-rig").exit_code == 2


def test_without_a_rig_file_nothing_missing_is_red(monkeypatch, capsys, tmp_path):
    monkeypatch.setattr("rfca_rig.devices.netft.checks.AS_DELIVERED", "127.0.0.1")
    said = typed(monkeypatch, capsys, "doctor", "--runs", tmp_path)
    for subject in (
        "CAN interface",
        "CAN adapters",
        "serial port",
        "Net F/T",
        "receive buffer",
        "clock",
        "python packages",
    ):
        assert re.search(rf"^(green|yellow) +{subject} ", said.out, re.MULTILINE), subject
    assert "counts_per_N" in said.out or "none at 127.0.0.1" in said.out
    assert max(map(len, said.out.splitlines())) <= WIDTH
