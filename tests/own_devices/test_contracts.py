"""The worked examples keep the contracts; so does a drive that speaks only when it is spoken to."""

import struct
from pathlib import Path

import can
import pytest

from rfca_rig.clock import Clock
from rfca_rig.contracts import own_devices
from rfca_rig.contracts.motor import MotorContract
from rfca_rig.contracts.motor_rig import drain, motor_rig
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.errors import DeviceError
from rfca_rig.own import MotorKeys, Report, SpeedDrive, SpeedDriveTwin
from rfca_rig.twins.drive_parts import LoopGains
from tests.cli.typed import typed
from tests.own_devices.rigs import EXAMPLES, lines_of_code, rig_with, section


class TestTheExampleMotor(own_devices.TestOurMotor):
    """docs/examples/our_motor.py against docs/examples/our_motor_twin.py."""


class TestTheExampleSensor(own_devices.TestOurForceSensor):
    """docs/examples/our_sensor.py against docs/examples/our_sensor_twin.py."""


class Polled(SpeedDrive[MotorKeys]):
    """A drive that reports only when it is asked: 0x10 turn, 0x11 off, 0x12 ask, 0x13 clear,
    0x14 on; 0x20 is its answer.
    """

    make = "polled"

    def say(self, identifier: int, value: float = 0.0) -> list[can.Message]:
        return [
            can.Message(
                arbitration_id=identifier, data=struct.pack("<f", value), is_extended_id=False
            )
        ]

    def to_clear(self) -> list[can.Message]:
        return self.say(0x13)

    def to_energise(self, last: Report) -> list[can.Message]:  # noqa: ARG002 (a drive that needs one step only)
        return self.say(0x14)

    def to_turn(self, turns_s: float) -> list[can.Message]:
        return self.say(0x10, turns_s)

    def to_let_go(self) -> list[can.Message]:
        return self.say(0x11)

    def to_ask(self) -> list[can.Message]:
        return self.say(0x12)

    def hear(self, message: can.Message) -> Report | None:
        if message.arbitration_id != 0x20:
            return None
        turns, turns_s, torque_Nm, is_on, fault, celsius = struct.unpack("<fffBBB", message.data)
        state = "on" if is_on else "off"
        return Report(
            turns,
            turns_s,
            torque_Nm,
            bool(is_on),
            state,
            f"error {fault} (broken)" if fault else None,
            celsius,
        )


class PolledTwin(SpeedDriveTwin):
    """The other end."""

    tells_temperature = True

    def obey(self, message: can.Message) -> None:
        kind = message.arbitration_id
        if kind == 0x12:
            self.asked()
            return
        self.feed()
        if kind == 0x10:
            self.turn(struct.unpack("<f", message.data)[0])
        elif kind == 0x11:
            self.is_on = False
        elif kind == 0x13:
            self.fault = 0
        elif kind == 0x14:
            self.fault = self.refuses_with
            if not self.fault:
                self.turn(0.0)
                self.switch_on()

    def report(self, turns: float, turns_s: float, torque_Nm: float) -> list[can.Message]:
        data = struct.pack(
            "<fffBBB",
            turns,
            turns_s,
            torque_Nm,
            self.is_on,
            self.fault,
            round(self.warmth.reported_degC),
        )
        return [can.Message(arbitration_id=0x20, data=data, is_fd=True, is_extended_id=False)]

    def starve(self) -> None:
        self.is_on = False

    def stale_set_point(self) -> list[can.Message]:
        return [can.Message(arbitration_id=0x10, data=struct.pack("<f", 9.0), is_extended_id=False)]

    def fail(self) -> str:
        self.fault = 7
        self.is_on = False
        return r"error 7 \(broken\)"

    def refuse(self) -> str:
        self.refuses_with = 9
        return r"refuses with error 9 \(broken\)"


class TestADriveThatOnlyAnswers(MotorContract):
    keys = MotorKeys(device="own", file="here", direction=-1, gear_ratio=3.0, zero_turns=2.75)

    def driver(self, bus: can.BusABC, clock: Clock) -> ShaftMotor:
        return Polled(bus, clock, self.keys, 0.3)

    def twin(self, bus: can.BusABC, watchdog_s: float | None) -> PolledTwin:
        return PolledTwin(bus, self.keys, LoopGains(), watchdog_s)

    def leave_stale_set_point(self, bus: can.BusABC) -> None:
        for message in self.twin(bus, None).stale_set_point():
            bus.send(message)

    def fail(self, twin: PolledTwin) -> str:
        return twin.fail()

    def refuse(self, twin: PolledTwin) -> str:
        return twin.refuse()


class IncurableTwin(PolledTwin):
    """Its error comes back whatever it is told."""

    def obey(self, message: can.Message) -> None:
        super().obey(message)
        self.fault = 7


def test_a_drive_whose_error_cannot_be_cleared_is_not_told_to_energise() -> None:
    keys = TestADriveThatOnlyAnswers.keys
    with motor_rig(
        lambda bus, clock: Polled(bus, clock, keys, 0.3),
        lambda bus: IncurableTwin(bus, keys, LoopGains(), 0.1),
    ) as rig:
        with pytest.raises(
            DeviceError, match=r"not enabled: it still reports error 7 \(broken\), state off"
        ):
            rig.motor.enable()
        assert 0x14 not in {message.arbitration_id for message in drain(rig.observer)}


@pytest.mark.long
def test_the_command_runs_the_contract_and_names_what_is_not_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """In a process of its own pytest runs inside pytest: only the shorter of the contracts, with
    a driver that forgets the checksum.
    """
    rig = rig_with(tmp_path, "force_sensor")
    sensor = tmp_path / "our_sensor.py"
    sensor.write_text(
        sensor.read_text().replace("if checksum != crc_x25(record[1:-2]):", "if checksum == 70000:")
    )
    said = typed(monkeypatch, capfd, "contract", rig)
    assert said.exit_code == 1
    assert "test_damaged_bytes_are_counted_and_the_stream_is_found_again" in said.out


def test_a_rig_without_a_device_of_its_own_has_no_contract_to_keep(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    said = typed(monkeypatch, capsys, "contract", "twin")
    assert said.exit_code == 2
    assert 'names no device = "own"' in said.err


@pytest.mark.parametrize(
    ("page", "table", "files"),
    [
        ("add-a-motor", "motor", ("our_motor", "our_motor_twin")),
        ("add-a-force-sensor", "force_sensor", ("our_sensor", "our_sensor_twin")),
    ],
)
def test_the_page_shows_the_section_and_the_length_of_the_files_that_are_tested(
    page: str, table: str, files: tuple[str, ...]
) -> None:
    text = (EXAMPLES.parent / f"{page}.md").read_text()
    assert f"```toml\n{section(table).strip()}\n```" in text
    for file in files:
        assert f"{lines_of_code(EXAMPLES / f'{file}.py')} lines" in text
