"""The settings of a moteus on its twin, over the bytes of the wire."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from math import isnan, nan

import can
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.motor_rig import IdleSensor, MotorRig, Rotor, motor_rig
from rfca_rig.devices import load_object
from rfca_rig.devices.drive_setup import DriveNeeds, Setting
from rfca_rig.devices.moteus import DEVICE, codec, console
from rfca_rig.devices.moteus.codec import ClientStreamData, Mode, Register, Route, Width, Write
from rfca_rig.devices.moteus.driver import MoteusMotor, MoteusSettings
from rfca_rig.devices.moteus.section import MoteusSection
from rfca_rig.devices.moteus.setup import MoteusSetup
from rfca_rig.devices.moteus.twin import MoteusTwin, MoteusTwinSettings
from rfca_rig.errors import DeviceError
from rfca_rig.twins.wires import CanEnd, can_wire
from rfca_rig.twins.world import TwinWorld

NEEDS = DriveNeeds(20.0, 25.0, 0.1, 0.05)
KEYS = {"device": "moteus", "direction": 1, "zero_turns": 0.0}


@dataclass
class Drive:
    """A drive on a bus with us; `observer` hears all."""

    clock: TwinClock
    bus: CanEnd
    observer: CanEnd
    twin: MoteusTwin

    def setup(self, **keys: object) -> MoteusSetup:
        """A session of its own, as each start of the program is one."""
        section = MoteusSection.model_validate({"drive_id": 3, **KEYS, **keys})
        assert load_object(DEVICE.setup or "") is MoteusSetup
        return MoteusSetup(section, self.bus, self.clock, NEEDS)

    def run(self, seconds: float) -> None:
        self.clock.wait_until(self.clock.now_s() + seconds)


@contextmanager
def drive(**twin: object) -> Iterator[Drive]:
    with can_wire() as (here, there):
        clock = TwinClock()
        made = MoteusTwin(there, MoteusTwinSettings(**twin))
        clock.carry(TwinWorld(Rotor(), made, IdleSensor()).process)
        observer = CanEnd("observer", here._others)
        here._others.append(observer)
        yield Drive(clock, here, observer, made)


def by_name(settings: Sequence[Setting]) -> dict[str, Setting]:
    return {setting.name: setting for setting in settings}


def wrong(settings: Sequence[Setting]) -> list[Setting]:
    return [setting for setting in settings if setting.is_wrong]


def test_a_drive_from_the_factory_is_found_and_its_wrong_settings_are_named() -> None:
    with drive(is_new=True) as new:
        settings = new.setup(watchdog_ms=250.0).read()
    assert {setting.name: (setting.actual, setting.wanted) for setting in wrong(settings)} == {
        "id.id": (1.0, 3.0),
        "servopos.position_min": (-0.01, pytest.approx(nan, nan_ok=True)),
        "servopos.position_max": (0.01, pytest.approx(nan, nan_ok=True)),
        "servo.default_timeout_s": (0.1, 0.25),
    }
    shown = by_name(settings)
    assert shown["servo.max_current_A"].actual == 100.0
    assert shown["motor_position.rotor_to_output_ratio"].actual == 1.0
    assert shown["motor.poles"].actual == 0.0


def test_a_drive_that_was_set_up_has_nothing_wrong() -> None:
    with drive(drive_id=3) as ready:
        assert wrong(ready.setup().read()) == []


def test_what_was_written_and_saved_outlasts_a_power_cycle() -> None:
    with drive(is_new=True) as new:
        setup = new.setup(watchdog_ms=250.0, can_prefix=7)
        setup.write(wrong(setup.read()))
        assert wrong(setup.read()) == []
        setup.save()
        new.twin.restart()
        again = new.setup(watchdog_ms=250.0, can_prefix=7).read()
    assert wrong(again) == []
    assert by_name(again)["id.id"].actual == 3.0
    assert by_name(again)["servo.default_timeout_s"].actual == 0.25


def test_what_was_written_and_not_saved_is_lost_at_a_power_cycle() -> None:
    with drive(is_new=True) as new:
        setup = new.setup()
        setup.write(wrong(setup.read()))
        new.twin.restart()
        lost = new.setup().read()
    assert [setting.name for setting in wrong(lost)] == [
        "id.id",
        "servopos.position_min",
        "servopos.position_max",
    ]


def test_a_drive_that_would_hold_the_shaft_without_its_master_is_set_to_damp() -> None:
    with drive(drive_id=3) as unsafe:
        unsafe.twin._console.take(b"conf set servo.timeout_mode 10\n")
        (setting,) = wrong(unsafe.setup().read())
        assert (setting.name, setting.actual, setting.wanted) == ("servo.timeout_mode", 10.0, 12.0)
        unsafe.twin._console.take(b"conf set servo.timeout_mode 15\n")
        assert wrong(unsafe.setup().read()) == []


def test_a_refused_setting_is_one_line_with_the_drives_own_words() -> None:
    with drive(drive_id=3) as ready:
        setup = ready.setup()
        with pytest.raises(
            DeviceError,
            match=r"^drive 3 refused 'conf set servo\.no_such 1': ERR error setting; compare with "
            r"the reference of its firmware$",
        ):
            setup.write([Setting("servo.no_such", "", 1.0, None)])
        with pytest.raises(DeviceError, match="refused 'conf set nothing 1': ERR unknown group"):
            setup.write([Setting("nothing", "", 1.0, None)])


def test_a_refusal_leaves_the_drive_where_it_was() -> None:
    with drive(is_new=True) as new:
        setup = new.setup()
        with pytest.raises(DeviceError, match="drive 1 refused"):
            setup.write([Setting("id.id", "", 3.0, 1.0), Setting("servo.no_such", "", 1.0, None)])
        assert by_name(setup.read())["id.id"].actual == 1.0


def test_a_firmware_without_a_setting_is_named_with_the_remedy() -> None:
    with drive(drive_id=3) as old:
        del old.twin._console._in_force[console.TIMEOUT_MODE]
        with pytest.raises(
            DeviceError,
            match=r"^drive 3 does not tell servo\.timeout_mode \(ERR error reading\); update its "
            r"firmware: python -m moteus\.moteus_tool --target 3 --flash FILE$",
        ):
            old.setup().read()


def test_no_drive_at_all_is_said_so() -> None:
    with (
        can_wire() as (here, _),
        pytest.raises(DeviceError, match=r"^no id from 1 to 126 answers; check its power, the wir"),
    ):
        MoteusSetup(
            MoteusSection.model_validate({"drive_id": 3, **KEYS}), here, TwinClock(), NEEDS
        ).read()


def test_of_several_drives_none_is_taken_for_the_rig_files() -> None:
    with drive(is_new=True) as new:
        other = CanEnd("other", new.bus._others)
        new.bus._others.append(other)
        second = MoteusTwin(other, MoteusTwinSettings(drive_id=9))
        new.clock.carry(TwinWorld(Rotor(), second, IdleSensor()).process)
        with pytest.raises(
            DeviceError, match=r"^drives 1, 9 answer, none with the id 3 .* connect the drive alone"
        ):
            new.setup().read()
        # With its id, or one of the two, there is no doubt.
        assert by_name(new.setup(drive_id=9).read())["id.id"].actual == 9.0


def send(bus: can.BusABC, *subframes: codec.Subframe, drive_id: int = 3) -> None:
    identifier = codec.arbitration_id(Route(5, drive_id))
    bus.send(
        can.Message(
            arbitration_id=identifier,
            is_extended_id=True,
            is_fd=True,
            data=codec.encode(subframes),
        )
    )


def test_a_drive_that_another_program_runs_is_left_alone() -> None:
    with drive(drive_id=3) as running:
        send(
            running.observer,
            Write(Register.MODE, Width.INT8, Mode.POSITION),
            Write(Register.COMMAND_POSITION, Width.FLOAT, nan),
            Write(Register.COMMAND_TIMEOUT, Width.FLOAT, nan),
        )
        running.run(0.1)
        with pytest.raises(
            DeviceError, match=r"^drive 3 is not stopped: position; end the program that runs it"
        ):
            running.setup().read()


def test_half_a_command_of_a_program_before_is_refused_and_its_reports_are_ended() -> None:
    with drive(drive_id=3) as ready:
        executed: list[str] = []
        execute = ready.twin._console._execute

        def note(line: str) -> list[str]:
            executed.append(line)
            return execute(line)

        ready.twin._console._execute = note
        send(ready.observer, ClientStreamData(1, b"conf set servo.max_current_A 5"))
        ready.run(0.01)
        assert by_name(ready.setup().read())["servo.max_current_A"].actual == 100.0
        assert executed[:2] == ["conf set servo.max_current_A 5tel stop", "tel stop"]


def test_a_drive_that_falls_silent_is_one_line() -> None:
    with drive(drive_id=3) as ready:
        setup = ready.setup()
        setup.read()
        ready.twin._is_mine = lambda _: False
        with pytest.raises(
            DeviceError, match=r"^drive 3 did not answer 'conf write' within 3 s; check the adapter"
        ):
            setup.save()


def test_the_lines_for_the_makers_tool_do_the_same() -> None:
    with drive(is_new=True) as new:
        setup = new.setup()
        lines = setup.list_lines(wrong(setup.read()))
        assert lines == (
            "python -m moteus_gui.tview --target 1",
            "conf set servopos.position_min nan",
            "conf set servopos.position_max nan",
            "conf set id.id 3",
            "python -m moteus_gui.tview --target 3",
            "conf write",
        )
        for line in lines:
            if line.startswith("conf"):
                new.twin._console.take(line.encode() + b"\n")
        new.twin.restart()
        assert wrong(new.setup().read()) == []


# -- what the settings do
# --------------------------------------------------------------------------------------------------


@contextmanager
def motor(**twin: object) -> Iterator[MotorRig]:
    with motor_rig(
        lambda bus, clock: MoteusMotor(bus, clock, MoteusSettings()),
        lambda bus: MoteusTwin(bus, MoteusTwinSettings(**twin)),
    ) as rig:
        yield rig


def test_a_new_drive_does_not_start_outside_the_factorys_limits() -> None:
    """The rotor rests at 0.3 rad, 0.05 turns from the zero of the drive."""
    with motor(is_new=True) as rig:
        with pytest.raises(DeviceError, match=r"fault 39 \(outside limit: started outside servo"):
            rig.motor.enable()
        assert all(law.torque_Nm(0.3, 0.0) == 0.0 for _, law in rig.rotor.drives)


def test_the_target_stops_at_a_limit() -> None:
    with motor() as rig:
        rig.twin._console.take(b"conf set servopos.position_max 0.1\n")
        rig.motor.enable()
        rig.run(1.0, speed_rad_s=2.0)
        assert rig.rotor.angle_rad == pytest.approx(0.1 * 6.2832, abs=0.01)


def test_limits_hold_where_the_drive_counts_against_the_angle() -> None:
    geared = {"gear_ratio": 2.0, "direction": -1, "zero_turns": 0.25}
    with motor_rig(
        lambda bus, clock: MoteusMotor(bus, clock, MoteusSettings(**geared)),
        lambda bus: MoteusTwin(bus, MoteusTwinSettings(**geared)),
    ) as rig:
        # 1 rad of the shaft is 0.3183 turns of the drive, counted down from 0.25.
        rig.twin._console.take(b"conf set servopos.position_min -0.0683\n")
        rig.motor.enable()
        rig.run(1.0, speed_rad_s=2.0)
        assert rig.rotor.angle_rad == pytest.approx(1.0, abs=0.01)


def test_the_default_timeout_holds_for_commands_without_one() -> None:
    with drive(drive_id=3) as ready:
        ready.twin._console.take(b"conf set servo.default_timeout_s 0.3\n")
        send(
            ready.observer,
            Write(Register.MODE, Width.INT8, Mode.POSITION),
            Write(Register.COMMAND_POSITION, Width.FLOAT, nan),
        )
        ready.run(0.25)
        assert ready.twin._mode == Mode.POSITION
        ready.run(0.1)
        assert ready.twin._mode == Mode.TIMEOUT


def test_none_is_a_value_of_its_own() -> None:
    assert Setting("", "", nan, 0.01).is_wrong
    assert Setting("", "", 0.01, nan).is_wrong
    assert not Setting("", "", nan, nan).is_wrong
    assert isnan(console.parse_setting(console.format_setting(nan)))
