"""A rig of which one device is a lab's own: the whole of a run, its recording, its limits, and
what is refused.
"""

import hashlib
import re
from pathlib import Path

import can
import numpy as np
import pytest

from rfca_rig.bench.factory import make_motor, open_bench
from rfca_rig.bench.served import open_served
from rfca_rig.clock import TwinClock, WallClock
from rfca_rig.contracts.motor_rig import Rotor
from rfca_rig.description.rig_file import read_rig
from rfca_rig.devices.checks import Colour
from rfca_rig.devices.netft.twin import NetFtTwin, NetFtTwinSettings
from rfca_rig.devices.own import twin_of
from rfca_rig.doctor.rig_checks import (
    check_own_motor,
    check_own_sensor,
    judge_own_motor,
    judge_own_sensor,
)
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.run import prove_stop
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.recording.store import read_recording
from rfca_rig.twin_server.open_ports import Openings
from rfca_rig.twins.drive_parts import LoopGains
from rfca_rig.twins.wires import can_wire, datagram_link
from rfca_rig.twins.world import TwinWorld
from tests.cli.typed import typed
from tests.own_devices.rigs import EXAMPLES, rig_with

RUN = ("--height", "215", "--speed", "3.249", "--repeats", "1")
FOLDER = Path("runs") / "SIM-flapping-215-mm-3.249-rad-per-s-001"
VALLEY = r"valley \(([\d.]+) s, (-[\d.]+) N\)"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("section", "make"),
    [("motor", "CANopen drive, CiA 402"), ("force_sensor", "Bota Systems, serial")],
)
def test_a_whole_run_in_which_only_one_device_is_hers(section, make, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    said = typed(monkeypatch, capsys, "dynamic", "run", "--rig", rig_with(tmp_path, section), *RUN)
    assert said.exit_code == 0, said.err
    time_s, fz_N = map(float, re.search(VALLEY, said.err).groups())
    assert time_s == pytest.approx(0.831, abs=0.015)  # what the shipped twin's own devices measure
    assert fz_N == pytest.approx(-51.9, abs=0.6)
    kept = read_recording(FOLDER / "run.h5").provenance
    device = {"motor": "motor", "force_sensor": "sensor"}[section]
    assert kept[f"{device}_make"] == make
    for file, name in (("driver", f"our_{device}"), ("twin", f"our_{device}_twin")):
        text = (EXAMPLES / f"{name}.py").read_text()
        assert kept[f"{section}_{file}_file"] == text
        assert kept[f"{section}_{file}_file_sha256"] == hashlib.sha256(text.encode()).hexdigest()
    for file in tmp_path.glob("our_*.py"):
        file.unlink()
    assert (
        typed(monkeypatch, capsys, "check", FOLDER).exit_code == 0
    )  # a recording needs none of her files


@pytest.mark.slow
def test_a_run_with_both_trips_at_her_limits_and_does_not_go_on_with_another_driver(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    rig = rig_with(
        tmp_path,
        "motor",
        "force_sensor",
        change=("following_error_deg = 20.0", "following_error_deg = 3.0"),
    )
    rig.write_text(
        rig.read_text().replace(
            "following_error_deg_s_per_rad = 8.0", "following_error_deg_s_per_rad = 1.0"
        )
    )
    said = typed(monkeypatch, capsys, "dynamic", "run", "--rig", rig, *RUN)
    assert said.exit_code == 3
    assert "TRIP F-02: following error" in said.err
    folder = next(Path("runs").iterdir(), None)
    assert folder is not None
    driver = tmp_path / "our_motor.py"
    driver.write_text(driver.read_text() + "\n# mended\n")
    said = typed(monkeypatch, capsys, "resume", folder, "--after-trip", "--dry-run")
    assert said.exit_code == 2
    assert (
        f"{rig}: would execute {driver}, which never drove a run on this computer; read "
        f"it, then give --rig {rig}"
    ) in said.err


def test_her_drive_proves_its_watchdog_before_anything_moves(tmp_path):
    with open_bench(read_rig(rig_with(tmp_path, "motor")), 1) as bench:
        assert 0.1 <= prove_stop(bench) <= 0.13


def test_her_drive_without_a_watchdog_is_refused_and_left_without_torque(tmp_path):
    rig = read_rig(rig_with(tmp_path, "motor"))
    clock = TwinClock()
    rotor = Rotor()
    with can_wire() as (here, there):
        drive = twin_of(rig.motor)(there, rig.motor, LoopGains(), None)
        sensor = NetFtTwin(datagram_link()[1], NetFtTwinSettings(), np.random.default_rng(1))
        clock.carry(TwinWorld(rotor, drive, sensor).process)
        bench = Bench(make_motor(rig, here, clock), None, None, clock, True)
        with pytest.raises(
            DeviceError,
            match="watchdog let it run through 1 s of silence; switch it on in the drive",
        ):
            prove_stop(bench)
        clock.wait_until(clock.now_s() + 0.01)
        assert rotor.angle_rad == pytest.approx(0.3, abs=1e-3)
        assert not drive.is_on


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            ("node_id = 5", "node = 5"),
            r"rig\.toml:\d+: motor\.node: unknown key; did you mean node_id\?$",
        ),
        (
            ("node_id = 5", "node_id = 400"),
            r"rig\.toml:\d+: motor\.node_id: should be less than or equal to 126, not 400",
        ),
        (("counts_per_turn = 16384.0", ""), r"rig\.toml:\d+: motor\.counts_per_turn: missing"),
        (
            ("direction = -1", "direction = -1\nguardian = true"),
            r"motor\.guardian: is for drives without a watchdog",
        ),
        (('"our_motor.py" ', '"ours.py" '), r"ours\.py: cannot be read: No such file"),
        (
            ('twin_file = "our_motor_twin.py"', ""),
            r"\[motor\] our_motor\.py has no twin: name one in twin_file \(docs/add-a-motor\.md\)",
        ),
        (
            ('twin_file = "our_motor_twin.py"', 'twin_file = "our_sensor.py"'),
            r"our_sensor\.py: defines no class of its own as TWIN",
        ),
    ],
)
def test_what_is_wrong_with_her_section_is_said_in_one_line(change, said, tmp_path):
    with (
        pytest.raises(BadInput, match=said) as refused,
        open_bench(read_rig(rig_with(tmp_path, "motor", change=change)), 1),
    ):
        pass
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("before", "after", "said"),
    [
        (
            "MOTOR = OurKeys",
            "",
            r"our_motor\.py: defines no class of its own as MOTOR; see docs/add-a-motor\.md",
        ),
        (
            "MOTOR = OurKeys",
            "MOTOR = MotorKeys",
            r"our_motor\.py: defines no class of its own as MOTOR",
        ),
        ("MOTOR = OurKeys", "MOTOR = OurMotor", r"our_motor\.py: MOTOR does not inherit MotorKeys"),
        (
            "import struct",
            "import no_such_thing",
            r"our_motor\.py:\d+: ModuleNotFoundError: No module named 'no_such_thing'",
        ),
        ("MILLI_RPM = 60e3", "MILLI_RPM = 60e3 +", r"our_motor\.py:\d+: invalid syntax"),
    ],
)
def test_what_is_wrong_with_her_file_is_said_with_its_line(before, after, said, tmp_path):
    rig = rig_with(tmp_path, "motor")
    driver = tmp_path / "our_motor.py"
    driver.write_text(driver.read_text().replace(before, after, 1))
    with pytest.raises(BadInput, match=said) as refused:
        read_rig(rig)
    assert "\n" not in str(refused.value)


def test_the_doctor_asks_her_drivers(tmp_path):
    with open_bench(read_rig(rig_with(tmp_path, "motor", "force_sensor")), 1) as bench:
        drive = judge_own_motor(bench.motor, bench.clock)
        sensor = judge_own_sensor(bench.sensor, bench.clock)
    assert re.fullmatch(r"500 reports/s, shaft at [\d.]+ deg, switch on disabled", drive.seen)
    assert sensor.colour is Colour.GREEN
    assert re.match(r"80[01] records/s, 0 lost", sensor.seen)


def test_the_doctor_says_what_cannot_be_opened(tmp_path):
    rig = read_rig(
        rig_with(
            tmp_path,
            "motor",
            "force_sensor",
            change=("node_id = 5", 'node_id = 5\nchannel = "can77"'),
        )
    )
    clock = TwinClock()
    for findings in (
        list(check_own_motor(rig.motor, clock)),
        list(check_own_sensor(rig.force_sensor, clock)),
    ):
        assert [one.colour for one in findings] == [Colour.GREEN, Colour.RED]
        assert "cannot be opened" in findings[1].seen


def test_a_frame_that_her_driver_cannot_read_is_an_error_with_its_bytes(tmp_path):
    rig = read_rig(rig_with(tmp_path, "motor"))
    with can_wire() as (here, there):
        motor = make_motor(rig, here, TwinClock())
        there.send(can.Message(arbitration_id=0x185, data=b"\1\2\3", is_extended_id=False))
        with pytest.raises(
            DeviceError,
            match="CAN frame 0x185 010203 cannot be read: unpack requires a buffer of 8 bytes",
        ):
            motor.read()


def test_the_twin_server_puts_her_twins_on_real_wires():
    rig = read_rig(EXAMPLES / "our-rig.toml")
    with open_served(rig, 1, Openings(), WallClock()) as served:
        assert served.reached.addresses[0].startswith("our_sensor.py on serial line /dev/")
        port = rig.force_sensor.model_copy(update={"port": served.reached.names["serial"]}).open()
        port.write(b"C")
        answer = b""
        # A busy kernel takes its time to carry a byte through a pseudo terminal.
        for _ in range(400):
            served.serve([], 0.05, print)
            answer += port.read(100)
            if len(answer) >= 7:
                break
        assert answer == b"r,0,C,0"
        port.close()
