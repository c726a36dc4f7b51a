"""A new drive of each make: refused, set up, found right by the doctor, and good for a stroke."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import can
import numpy as np
import pytest

from rfca_rig.bench.factory import TwinRack, list_drive_needs, make_motor, make_twins
from rfca_rig.bench.leg_plant import LegPlant
from rfca_rig.bench.sensors import make_sensor_pair, sensor_twin_maker
from rfca_rig.clock import TwinClock
from rfca_rig.description.rig_file import RigFile, read_rig
from rfca_rig.devices import find_motor
from rfca_rig.devices.checks import Listener
from rfca_rig.devices.drive_setup import DriveSetup, Setting
from rfca_rig.devices.odrive import codec, settings
from rfca_rig.devices.odrive.endpoints import read_endpoint_file
from rfca_rig.devices.odrive.memory import TWIN_ENDPOINTS
from rfca_rig.devices.odrive.messages import AxisState, Heartbeat
from rfca_rig.devices.odrive.twin import FIRMWARE, OdriveTwin
from rfca_rig.doctor.rig_checks import check_drive
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.run import prove_stop, run_plan
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.twins.wires import can_wire
from tests.engine.rigs import ROOT, nothing, one_condition, twin_rig
from tests.twin_server.test_real_run import InMemory

ENDPOINTS = ROOT / "calibration" / "twin-endpoints.json"
ODRIVE = 'device = "odrive"\nnode_id = 3\ngear_ratio = 9.0\ndirection = 1\nzero_turns = 0.0\n'
ODRIVE_0_6 = f"{ODRIVE}encoder_period_ms = 2.0\n"
ODRIVE_0_5 = f'{ODRIVE_0_6}dialect = "0.5"\ntorque_constant_Nm_per_A = 0.5\n'
AK = "direction = 1\nguardian = false\ndrive_id = 5\n"
MIT = f'{AK}device = "cubemars-mit"\nmodel = "AK80-9"\nzero_rad = 0.0\n'
SERVO = (
    f'{AK}device = "cubemars-servo"\ngear_ratio = 9.0\npole_pairs = 21\n'
    "torque_constant_Nm_per_A = 0.115\nzero_deg = 0.0\nstatus_period_ms = 2.0\n"
)
MOTEUS = 'device = "moteus"\ndirection = 1\ndrive_id = 3\nzero_turns = 0.0\n'
HELD_DEG = 20.0


def rig_with(motor: str, folder: Path) -> RigFile:
    """The twin's rig file with another motor."""
    text = (ROOT / "calibration" / "twin.toml").read_text()
    head, _, rest = text.partition("[motor]\n")
    file = folder / "rig.toml"
    file.write_text(f"{head}[motor]\n{motor}\n{rest[rest.index('[force_sensor]') :]}")
    (folder / "twin-camera.toml").write_text(
        (ROOT / "calibration" / "twin-camera.toml").read_text()
    )
    return read_rig(file)


@dataclass
class NewDrive:
    """A twin rig whose drive is new, with a free end of its bus."""

    rig: RigFile
    bus: can.BusABC
    observer: can.BusABC
    clock: TwinClock
    twin: OdriveTwin
    plant: LegPlant
    bench: Bench

    def setup(self, endpoints: Path | None = ENDPOINTS) -> DriveSetup:
        keys = self.rig.motor
        if keys.device != "odrive" or keys.dialect == "0.5":
            endpoints = None
        made = find_motor(keys.device).make_setup(
            keys, self.bus, self.clock, list_drive_needs(self.rig, endpoints)
        )
        assert made is not None
        return made

    def driver(self, **zero: float) -> ShaftMotor:
        """A driver of the rig file with another zero."""
        motor = self.rig.motor.model_copy(update=zero)
        return make_motor(self.rig.model_copy(update={"motor": motor}), self.bus, self.clock)

    def sent(self) -> list[can.Message]:
        """What is on the bus since the last call, of master and drive."""
        return list(iter(lambda: self.observer.recv(timeout=0), None))

    def wait(self, seconds: float) -> None:
        self.clock.wait_until(self.clock.now_s() + seconds)


@contextmanager
def new_drive(rig: RigFile) -> Iterator[NewDrive]:
    with can_wire(ends=3) as (bus, twins_end, observer):
        clock = TwinClock()
        pair = make_sensor_pair(
            rig, sensor_twin_maker(rig, rig.twin, np.random.default_rng(1)), None
        )
        twins = make_twins(rig, rig.twin, 1, twins_end, lambda _: pair.twin, None, True)
        twins.world.held_rad = np.radians(HELD_DEG)
        clock.carry(twins.world.process)
        bench = Bench(
            make_motor(rig, bus, clock),
            pair.driver(clock),
            TwinRack(twins.plant),
            clock,
            False,
            None,
        )
        yield NewDrive(rig, bus, observer, clock, twins.motor, twins.plant, bench)


def by_name(found: tuple[Setting, ...]) -> dict[str, Setting]:
    return {setting.name: setting for setting in found}


def write_over_can(drive: NewDrive) -> None:
    setup = drive.setup()
    wrong = [setting for setting in setup.read() if setting.is_wrong]
    assert len(wrong) >= 3
    setup.write(wrong)
    setup.save()


def type_lines(drive: NewDrive) -> None:
    """As a person copies them into the maker's own tool."""
    setup = drive.setup()
    for line in setup.list_lines(setup.list_wanted()):
        drive.twin.type_line(line)


@pytest.mark.parametrize(
    ("motor", "set_up", "refusal", "zero"),
    [
        (ODRIVE_0_6, write_over_can, "node 0 but none from node 3", {"zero_turns": -0.5}),
        (ODRIVE_0_6, type_lines, "node 0 but none from node 3", {"zero_turns": -0.5}),
        (ODRIVE_0_5, type_lines, "node 0 but none from node 3", {"zero_turns": -0.5}),
        (MIT, type_lines, "no frames at all on the CAN bus", {}),
        (SERVO, type_lines, "drive 1 but none of drive 5", {}),
        (MOTEUS, write_over_can, "no answer from drive 3", {"zero_turns": 0.0}),
    ],
    ids=[
        "0.6 over CAN",
        "0.6 by odrivetool",
        "0.5 by odrivetool",
        "MIT mode",
        "servo mode",
        "moteus over CAN-FD",
    ],
)
def test_a_new_drive_is_refused_then_set_up_then_green_then_does_a_stroke(
    motor, set_up, refusal, zero, tmp_path
):
    with new_drive(rig_with(motor, tmp_path)) as drive:
        with pytest.raises(DeviceError, match=refusal):
            drive.bench.motor.enable()
        drive.bench.motor.disable()
        drive.wait(1.5)
        set_up(drive)
        assert [setting for setting in drive.setup().read() if setting.is_wrong] == []
        findings = list(check_drive(drive.rig.motor, Listener(drive.bus, drive.clock)))
        assert {finding.colour.value for finding in findings} == {"green"}, findings
        # An incremental encoder counts from where the drive started again.
        bench = replace(drive.bench, motor=drive.driver(**zero))
        if motor in (ODRIVE_0_6, ODRIVE_0_5):
            assert prove_stop(bench) == pytest.approx(0.15, abs=0.06)
        sink = InMemory(bench.sensor.scale())
        run_plan(one_condition(drive.rig), bench, sink, nothing)
        (stroke,) = sink.strokes
        assert stroke.streams["force"].columns["fz_N"].values.min() < -40.0


@pytest.fixture
def drive(tmp_path) -> Iterator[NewDrive]:
    with new_drive(rig_with(ODRIVE_0_6, tmp_path)) as made:
        yield made


def test_every_value_that_a_drive_may_have_is_read_and_the_wrong_ones_are_told(drive):
    setup = drive.setup()
    found = by_name(setup.read())
    factory = settings.factory_values(setup._dialect)
    del factory[settings.BAUD_RATE]
    read = {name: found[name].actual for name in factory if name in found}
    assert read == {name: pytest.approx(factory[name]) for name in read}
    # Message 0x14 is not needed where 0x1C reports the torque.
    assert set(factory) - set(read) == {"axis0.config.can.iq_msg_rate_ms"}
    assert found[settings.BAUD_RATE].actual == 1e6
    assert setup.describe()[1] == "node 0 answers, the rig file has 3"
    assert "firmware 0.6.10, board 0.0.0, idle, 48.0 V" in setup.describe()[0]


def test_what_is_not_saved_is_lost_when_the_drive_starts_again(drive):
    setup = drive.setup()
    wrong = [setting for setting in setup.read() if setting.is_wrong]
    setup.write(wrong)
    assert [setting for setting in setup.read() if setting.is_wrong] == []
    drive.twin.restart()
    again = [setting for setting in drive.setup().read() if setting.is_wrong]
    assert [setting.name for setting in again] == [setting.name for setting in wrong]
    setup = drive.setup()
    setup.read()
    setup.write(wrong)
    setup.save()
    drive.twin.restart()
    assert [setting for setting in drive.setup().read() if setting.is_wrong] == []


def test_the_watchdog_s_time_is_written_before_the_watchdog_and_the_node_last(drive):
    setup = drive.setup()
    wrong = [setting for setting in setup.read() if setting.is_wrong]
    drive.sent()
    setup.write(wrong)
    written = [
        int.from_bytes(message.data[1:3], "little")
        for message in drive.sent()
        if message.arbitration_id == 0x004 and message.data[0] == 1
    ]
    timeout, enable = (
        TWIN_ENDPOINTS[name].endpoint_id
        for name in (settings.WATCHDOG_TIMEOUT, settings.ENABLE_WATCHDOG)
    )
    assert written.index(timeout) < written.index(enable)
    assert len(written) == len(wrong) - 1


def endpoint_file(folder: Path, **changed: str) -> Path:
    file = folder / "flat_endpoints.json"
    file.write_text(json.dumps(json.loads(ENDPOINTS.read_text()) | changed))
    return file


@pytest.mark.parametrize("changed", [{"fw_version": "0.6.9"}, {"hw_version": "4.4.58"}])
def test_an_endpoint_file_of_another_firmware_or_board_is_refused(drive, tmp_path, changed):
    setup = drive.setup(endpoint_file(tmp_path, **changed))
    drive.sent()
    with pytest.raises(BadInput) as refused:
        setup.read()
    for version in ("0.6.10", "0.0.0", *changed.values()):
        assert version in str(refused.value)
    assert not [message for message in drive.sent() if message.arbitration_id & 0x1F == 0x04]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "is no JSON"),
        ("[" * 100_000, "is no JSON"),
        ("[]", "has no table of endpoints"),
        ('{"endpoints": {}}', "does not say fw_version and hw_version"),
    ],
)
def test_a_file_that_is_no_endpoint_file_is_refused(tmp_path, text, said):
    file = tmp_path / "flat_endpoints.json"
    file.write_text(text)
    with pytest.raises(BadInput, match=said):
        read_endpoint_file(file)


def test_functions_and_types_that_fit_no_frame_are_left_out(tmp_path):
    content = json.loads(ENDPOINTS.read_text())
    content["endpoints"] |= {
        "serial_number": {"id": 4, "type": "uint64"},
        "reboot": {"id": 5, "type": "function"},
        "beyond": {"id": 70_000, "type": "float"},
        "vbus_voltage": {"id": 2, "type": "float"},
    }
    file = tmp_path / "flat_endpoints.json"
    file.write_text(json.dumps(content))
    read = read_endpoint_file(file).endpoints
    assert set(read) - set(TWIN_ENDPOINTS) == {"vbus_voltage"}
    assert read["vbus_voltage"].decode(bytes.fromhex("00 00 c0 41")) == 24.0
    assert read["vbus_voltage"].decode(b"\0\0") is None


def test_the_endpoint_file_of_the_twin_fits_the_twin_and_no_real_board():
    file = read_endpoint_file(ENDPOINTS)
    assert file.endpoints == TWIN_ENDPOINTS
    file.check_version(FIRMWARE)
    assert file.hardware == "0.0.0"


@pytest.mark.parametrize("state", [AxisState.CLOSED_LOOP, 3])
def test_a_drive_that_is_not_idle_is_refused_and_asked_nothing(drive, state):
    drive.twin.take_frames = lambda _: None
    frame = codec.heartbeat(0, Heartbeat(0, state, 0, False))
    drive.twin._send = lambda *_: drive.observer.send(
        can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False)
    )
    drive.sent()
    with pytest.raises(DeviceError, match=r"node 0 is in (closed loop|full calibration), not idle"):
        drive.setup().read()
    assert drive.sent() == []


def test_a_drive_that_runs_saves_nothing(drive):
    write_over_can(drive)
    motor = drive.driver(zero_turns=-0.5)
    motor.enable()
    frame = codec.reboot(3, 0)
    assert drive.twin._state == AxisState.CLOSED_LOOP
    frame = codec.reboot(3, 1)
    drive.bus.send(can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False))
    drive.wait(0.01)
    assert drive.twin._state == AxisState.CLOSED_LOOP
    motor.disable()


def heartbeats_of(drive: NewDrive, *nodes: int) -> None:
    """Other drives on the same bus."""

    def beat(_now_s: float) -> None:
        for node in nodes:
            frame = codec.heartbeat(node, Heartbeat(0, AxisState.IDLE, 0, False))
            drive.observer.send(
                can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False)
            )

    drive.clock.carry(beat)


def test_of_several_foreign_drives_none_is_touched(drive):
    heartbeats_of(drive, 7)
    drive.sent()
    with pytest.raises(DeviceError, match="nodes 0, 7 answer, and the rig file has 3"):
        drive.setup().read()
    assert not [
        message
        for message in drive.sent()
        if message.arbitration_id >> 5 == 0 and message.is_remote_frame
    ]


def test_other_drives_beside_the_right_one_are_named(drive):
    write_over_can(drive)
    heartbeats_of(drive, 7)
    setup = drive.setup()
    setup.read()
    assert "also on the bus: node 7" in setup.describe()


def test_a_drive_that_sends_nothing_is_found_by_its_address(drive):
    for name in ("heartbeat", "encoder"):
        drive.twin.type_line(f"odrv0.axis0.config.can.{name}_msg_rate_ms = 0")
    found = by_name(drive.setup().read())
    assert found[settings.NODE_ID].actual == 0.0
    assert found["axis0.config.can.heartbeat_msg_rate_ms"].is_wrong


def test_a_silent_bus_names_what_to_look_at_and_the_bit_rate_of_a_new_drive(drive):
    drive.twin._bus.shutdown()
    drive.twin.take_frames = lambda _: None
    drive.twin._send = lambda *_: None
    with pytest.raises(DeviceError, match=r"no ODrive answers at 1000000 bit/s.*250000 bit/s"):
        drive.setup().read()


def test_a_wrong_dialect_is_named_either_way(tmp_path):
    with new_drive(rig_with(ODRIVE_0_5, tmp_path)) as drive:
        drive.rig = rig_with(ODRIVE_0_6, tmp_path)
        with pytest.raises(DeviceError, match=r'put dialect = "0.5" under'):
            drive.setup().read()
    with new_drive(rig_with(ODRIVE_0_6, tmp_path)) as drive:
        drive.rig = rig_with(ODRIVE_0_5, tmp_path)
        with pytest.raises(DeviceError, match=r'0.6.10: put dialect = "0.6" under'):
            drive.setup().read()


def test_without_an_endpoint_file_periods_are_measured_and_only_the_node_is_written(drive):
    setup = drive.setup(None)
    found = by_name(setup.read())
    assert found["axis0.config.can.encoder_msg_rate_ms"].actual == pytest.approx(10.0, abs=0.3)
    assert found["axis0.config.can.torques_msg_rate_ms"].actual == 0.0
    assert found[settings.ENABLE_WATCHDOG].actual is None
    assert [name for name, setting in found.items() if setting.can_write] == [settings.NODE_ID]
    setup.write([found[settings.NODE_ID]])
    setup.save()
    assert by_name(drive.setup(None).read())[settings.NODE_ID].actual == 3.0


def test_a_drive_that_keeps_another_value_is_told_and_nothing_is_saved(drive):
    setup = drive.setup()
    wrong = [setting for setting in setup.read() if setting.is_wrong]
    find = drive.twin._memory.find_endpoint

    def find_all_but_the_watchdog(endpoint_id):
        found = find(endpoint_id)
        return None if found and found[0] == settings.WATCHDOG_TIMEOUT else found

    drive.twin._memory.find_endpoint = find_all_but_the_watchdog
    with pytest.raises(DeviceError, match=r"does not take axis0.config.watchdog_timeout = 0\.1"):
        setup.write(wrong)


def test_firmware_that_answers_a_write_too_is_understood(drive):
    """As of 0.6.11."""
    access = drive.twin._access_endpoint

    def answer_a_write_too(order):
        access(order)
        if order.opcode == 1:
            access(replace(order, opcode=0))

    drive.twin._access_endpoint = answer_a_write_too
    write_over_can(drive)
    assert [setting for setting in drive.setup().read() if setting.is_wrong] == []


def test_a_drive_without_an_address_gets_one(drive):
    drive.twin.type_line("odrv0.axis0.config.can.node_id = 63")
    write_over_can(drive)
    assert by_name(drive.setup().read())[settings.NODE_ID].actual == 3.0


def test_the_settings_of_a_twin_rig_that_is_set_up_are_right_but_for_its_limits():
    """The usual twin has no limits of its own."""
    rig = twin_rig()
    with can_wire() as (bus, twins_end):
        clock = TwinClock()
        twin = find_motor("odrive").make_twin(rig.motor, twins_end, drive_gains(rig), 0.1)
        clock.carry(lambda now_s: (twin.take_frames(now_s), advance(twin, now_s)))
        setup = find_motor("odrive").make_setup(
            rig.motor, bus, clock, list_drive_needs(rig, ENDPOINTS)
        )
        wrong = [setting.name for setting in setup.read() if setting.is_wrong]
    names = settings.NAMES[setup._dialect]
    assert wrong == [settings.VEL_LIMIT, names.torque_max, names.torque_min]


def drive_gains(rig):
    from rfca_rig.twins.drive_parts import LoopGains

    return LoopGains(torque_limit_Nm=rig.twin.drive.torque_limit_Nm)


def advance(twin, now_s):
    from rfca_rig.twins.world import ShaftDrive, ShaftState

    standing = ShaftState(0.0, 0.0, 0.0)
    twin.advance(1e-3, now_s, standing, standing, ShaftDrive())


def test_values_between_the_limits_of_a_setting_are_right():
    setting = Setting("name", "purpose", 10.0, 12.0, least=10.0, most=15.0)
    assert not setting.is_wrong
    for actual, is_wrong in ((9.9, True), (10.0, False), (15.0, False), (15.1, True)):
        assert replace(setting, actual=actual).is_wrong is is_wrong
    for actual in (float("inf"), float("nan")):
        assert replace(setting, actual=actual).is_wrong
    assert not replace(setting, actual=None).is_wrong
    assert not replace(setting, wanted=None).is_wrong
    assert replace(setting, least=None, most=None).is_wrong


def test_a_new_drive_gives_up_above_its_speed_limit(drive):
    """Which is why the limit is among the settings."""
    type_lines(drive)
    drive.twin.type_line("odrv0.axis0.controller.config.vel_limit = 2")
    motor = drive.driver(zero_turns=-0.5)
    motor.enable()
    fault = None
    for _ in range(200):
        motor.command_speed(5.0)
        drive.wait(2e-3)
        motor.read()
        fault = motor.status().fault
        if fault:
            break
    assert "VELOCITY_LIMIT_VIOLATION" in fault
    motor.disable()


def test_a_drive_that_starts_again_is_asked_nothing_until_it_is_back(drive):
    setup = drive.setup()
    setup.read()
    drive.sent()
    setup.save()
    asked = [message for message in drive.sent() if message.is_remote_frame]
    assert asked == []


def test_a_drive_that_does_not_come_back_is_told(drive):
    setup = drive.setup()
    setup.read()
    drive.twin._send = lambda *_: None
    with pytest.raises(DeviceError, match="node 0 did not come back within 8 s"):
        setup.save()


@pytest.mark.parametrize(
    "motor", [ODRIVE_0_6, MIT, SERVO], ids=["odrive", "MIT mode", "servo mode"]
)
def test_the_torque_of_a_hand_that_holds_the_leg_is_not_the_motor_s(motor, tmp_path):
    with new_drive(rig_with(motor, tmp_path)) as drive:
        type_lines(drive)
        drive.wait(1.0)
        shaft = drive.plant.shaft()
        assert np.degrees(shaft.angle_rad) == pytest.approx(HELD_DEG, abs=0.2)
        assert abs(shaft.torque_Nm) > 0.3
        driver = drive.driver()
        driver.enable()
        # In MIT mode this frame is also the last question.
        driver.disable()
        drive.wait(0.2)
        driver.disable()
        drive.wait(0.02)
        assert abs(driver.read().torque_Nm[-1]) < 0.05
