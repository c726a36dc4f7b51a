"""The moteus driver on its twin, over the bytes of the wire."""

import re
from contextlib import AbstractContextManager
from dataclasses import replace

import can
import numpy as np
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.motor_rig import MotorRig, Rotor, drain, motor_rig
from rfca_rig.devices.moteus import codec as moteus
from rfca_rig.devices.moteus.codec import (
    Mode,
    Refusal,
    Register,
    Reply,
    Route,
    Subframe,
    Width,
    Write,
)
from rfca_rig.devices.moteus.driver import MoteusMotor, MoteusSettings
from rfca_rig.devices.moteus.twin import MoteusGains, MoteusTwin, MoteusTwinSettings
from rfca_rig.errors import BadInput, BadReading, DeviceError
from rfca_rig.twins.wires import can_wire

GEARED = {"gear_ratio": 3.0, "direction": -1, "zero_turns": 2.75}


def rig(
    rotor: Rotor | None = None, settings: MoteusSettings | None = None, **twin
) -> AbstractContextManager[MotorRig]:
    return motor_rig(
        lambda bus, clock: MoteusMotor(bus, clock, settings or MoteusSettings()),
        lambda bus: MoteusTwin(bus, MoteusTwinSettings(**twin)),
        rotor,
    )


def send(
    bus: can.BusABC,
    *subframes: Subframe,
    wants_reply: bool = False,
    source: int = 5,
    destination: int = 1,
) -> None:
    identifier = moteus.arbitration_id(Route(source, destination, wants_reply))
    bus.send(
        can.Message(
            arbitration_id=identifier,
            is_extended_id=True,
            is_fd=True,
            data=moteus.encode(subframes),
        )
    )


def order(position_turns: float, speed_turns_s: float) -> tuple[Write, ...]:
    return (
        Write(Register.MODE, Width.INT8, Mode.POSITION),
        Write(Register.COMMAND_POSITION, Width.FLOAT, position_turns),
        Write(Register.COMMAND_VELOCITY, Width.FLOAT, speed_turns_s),
    )


def state_of(
    counter: int, mode: int = Mode.STOPPED, position_turns: float = 0.0
) -> tuple[Reply, ...]:
    return (
        Reply(Register.MODE, Width.INT8, mode),
        Reply(Register.POSITION, Width.FLOAT, position_turns),
        Reply(Register.VELOCITY, Width.FLOAT, 0.0),
        Reply(Register.TORQUE, Width.FLOAT, 0.0),
        Reply(Register.FAULT, Width.INT16, 0),
        Reply(Register.MILLISECOND_COUNTER, Width.INT32, counter),
    )


def answer(bus: can.BusABC, *subframes: Subframe, source: int = 1, destination: int = 0x20) -> None:
    send(bus, *subframes, source=source, destination=destination)


def orders_in(messages: list[can.Message]) -> list[dict[int, float]]:
    """What the frames of a driver wrote, register by register."""
    orders = []
    for message in messages:
        writes = [item for item in moteus.decode(message.data) if isinstance(item, Write)]
        orders.append({write.register: write.value for write in writes})
    return orders


# -- enabling
# --------------------------------------------------------------------------------------------------


def test_enabling_stops_first_and_then_starts_from_where_the_drive_finds_itself() -> None:
    with rig() as r:
        r.motor.enable()
        orders = [order for order in orders_in(drain(r.observer)) if Register.MODE in order]
        assert orders[0] == {Register.MODE: Mode.STOPPED}
        assert {order[Register.MODE] for order in orders[1:]} == {Mode.POSITION}
        assert all(
            np.isnan(order[Register.COMMAND_POSITION]) and order[Register.COMMAND_VELOCITY] == 0.0
            for order in orders[1:]
        )


def test_every_command_carries_its_own_watchdog_and_switches_trajectories_off() -> None:
    with rig(settings=MoteusSettings(watchdog_s=0.25, torque_limit_Nm=6.0)) as r:
        r.motor.enable()
        drain(r.observer)
        r.motor.command_speed(1.0)
        r.motor.command_angle(0.5, 1.0)
        r.motor.command_angle(0.5)
        for order in orders_in(drain(r.observer)):
            assert order[Register.COMMAND_TIMEOUT] == 0.25
            assert order[Register.COMMAND_MAXIMUM_TORQUE] == 6.0
            assert order[Register.COMMAND_VELOCITY_LIMIT] < 0.0
            assert order[Register.COMMAND_ACCELERATION_LIMIT] < 0.0
            assert {
                Register.COMMAND_POSITION,
                Register.COMMAND_VELOCITY,
            } <= order.keys()  # left out, they would be 0


def test_frames_are_can_fd_with_an_extended_id_and_of_a_length_that_exists() -> None:
    with rig(settings=MoteusSettings(bitrate_switch=False)) as r:
        r.motor.enable()
        for message in drain(r.observer):
            assert message.is_fd
            assert len(message.data) in moteus.FD_LENGTHS
            assert not message.bitrate_switch or message.arbitration_id >> 8 & 0x7F == 1


def test_commands_before_enabling_do_not_start_the_drive() -> None:
    with rig() as r:
        r.run(0.1, speed_rad_s=1.0)
        r.run(0.1, angle_rad=1.0)
        assert r.rotor.angle_rad == 0.3
        assert r.motor.status().state == "stopped"


def test_a_silent_bus_is_explained() -> None:
    with (
        can_wire() as (here, _),
        pytest.raises(
            DeviceError,
            match=r"within 1 s no answer from drive 1, and no other frames.*CAN-FD at 1 and 5",
        ),
    ):
        MoteusMotor(here, TwinClock(), MoteusSettings()).enable()


def test_a_wrong_id_is_explained_with_the_ids_that_are_there() -> None:
    clock = TwinClock()
    with can_wire() as (here, there):
        clock.carry(lambda _: answer(there, *state_of(1), source=4))
        with pytest.raises(
            DeviceError,
            match="frames from id 4 but no answer from drive 1; check drive_id and can_prefix",
        ):
            MoteusMotor(here, clock, MoteusSettings()).enable()


def test_a_firmware_without_a_register_is_explained() -> None:
    clock = TwinClock()
    with can_wire() as (here, there):
        clock.carry(
            lambda _: answer(
                there, *state_of(1)[:-1], Refusal(Register.MILLISECOND_COUNTER, 1, of_write=False)
            )
        )
        with pytest.raises(DeviceError, match="cannot tell MILLISECOND_COUNTER: unknown register"):
            MoteusMotor(here, clock, MoteusSettings()).enable()


def test_a_drive_that_does_not_stop_is_not_enabled() -> None:
    clock = TwinClock()
    with can_wire() as (here, there):
        clock.carry(lambda now_s: answer(there, *state_of(round(1e3 * now_s), Mode.BRAKE)))
        with pytest.raises(DeviceError, match="does not stop within 1 s: mode brake"):
            MoteusMotor(here, clock, MoteusSettings()).enable()


def test_a_drive_that_never_gets_to_position_mode_is_not_enabled() -> None:
    with rig(starting_s=5.0) as r:
        with pytest.raises(DeviceError, match="not in position mode after 1 s: mode calibrating"):
            r.motor.enable()
        assert orders_in(drain(r.observer))[-1] == {Register.MODE: Mode.STOPPED}


# -- asking
# --------------------------------------------------------------------------------------------------


def test_a_command_asks_and_a_read_without_one_asks_by_itself() -> None:
    with rig() as r:
        r.motor.enable()
        r.motor.read()
        drain(r.observer)
        r.motor.command_speed(0.0)
        r.tick()
        assert len(r.motor.read().angle_rad) == 1
        assert len([m for m in drain(r.observer) if m.arbitration_id & 0x8000]) == 1
        r.tick()
        assert len(r.motor.read().angle_rad) == 0
        (question,) = (m for m in drain(r.observer) if m.arbitration_id & 0x8000)
        assert orders_in([question]) == [{}]
        r.tick()
        assert len(r.motor.read().angle_rad) == 1


def test_reading_alone_does_not_keep_the_watchdog_quiet() -> None:
    with rig() as r:
        r.motor.enable()
        r.run(0.3)
        assert r.motor.status().state == "timeout"
        assert r.motor.status().fault == "mode 11 (timeout: no command reached the drive for 0.1 s)"


def test_the_watchdog_trips_after_the_time_that_the_command_gave_whatever_the_drives_own() -> None:
    with rig(settings=MoteusSettings(watchdog_s=0.05), default_timeout_s=0.3) as r:
        r.motor.enable()
        assert 0.05 <= r.motor.prove_watchdog(0.4) <= 0.06


def test_a_timed_out_drive_brakes_and_is_not_moved_by_later_commands() -> None:
    with rig() as r:
        r.motor.enable()
        r.run(0.5, speed_rad_s=3.0)
        r.run(0.5)
        stood_rad = r.rotor.angle_rad
        assert abs(r.rotor.speed_rad_s) < 1e-3
        r.run(0.3, speed_rad_s=3.0)
        assert r.rotor.angle_rad == pytest.approx(stood_rad, abs=1e-3)


def test_answers_lost_on_the_way_are_counted_and_time_goes_on_right() -> None:
    with rig(Rotor(speed_rad_s=0.0)) as r:
        r.motor.enable()
        r.run(1.0, speed_rad_s=2.0)
        for tick in range(200):
            r.motor.command_speed(2.0)
            r.tick(deaf=tick % 5 == 0)
            blocks = r.motor.read()
            assert len(blocks.angle_rad) == (0 if tick % 5 == 0 else 1)
            if len(blocks.angle_rad):
                assert blocks.host_s[0] == pytest.approx(r.clock.now_s() - 2e-3)
        assert int(r.motor.identity()["answers_lost"]) == 40
        assert r.motor.status().fault is None


def test_a_late_answer_is_stamped_with_when_it_was_asked_for() -> None:
    clock = TwinClock()
    with can_wire() as (here, there):
        motor = MoteusMotor(here, clock, MoteusSettings())
        stamps = []
        for tick in range(6):  # each answer comes a tick late
            motor.read()
            if tick:
                answer(there, *state_of(500 + 10 * (tick - 1), position_turns=float(tick)))
            clock.wait_until(0.01 * (tick + 1))
            stamps += motor.read().device_s.tolist()
        assert stamps == pytest.approx([0.0, 0.01, 0.02, 0.03, 0.04], abs=1e-9)


def test_a_doubled_answer_is_taken_once() -> None:
    clock = TwinClock()
    with can_wire() as (here, there):
        motor = MoteusMotor(here, clock, MoteusSettings())
        motor.read()
        for _ in range(2):
            answer(there, *state_of(500))
        assert len(motor.read().angle_rad) == 1


def test_two_answers_of_one_moment_are_one_sample() -> None:
    with rig() as r:
        r.motor.enable()
        r.tick()
        r.motor.read()
        r.motor.read()  # asks by itself ...
        r.motor.command_speed(0.0)  # ... and a command at the same moment asks again
        r.tick()
        assert len(r.motor.read().angle_rad) == 1


def test_frames_of_others_and_our_own_come_back_are_not_the_drives() -> None:
    with can_wire() as (here, there):
        motor = MoteusMotor(here, TwinClock(), MoteusSettings())
        motor.read()
        answer(there, *state_of(1), source=3)
        answer(there, *state_of(1), destination=0)  # the drive, to another master
        answer(there, *state_of(1), source=0x20, destination=1)
        send(there, *state_of(1), wants_reply=True, source=1, destination=0x20)
        there.send(
            can.Message(arbitration_id=0x120, is_remote_frame=True, dlc=8, is_extended_id=True)
        )
        assert len(motor.read().angle_rad) == 0
        assert motor.status().state == "unknown"


def test_a_frame_that_cannot_be_read_is_an_error_and_the_samples_before_it_are_kept() -> None:
    with can_wire() as (here, there):
        motor = MoteusMotor(here, TwinClock(), MoteusSettings())
        motor.read()
        answer(there, *state_of(1, position_turns=0.25))
        there.send(
            can.Message(
                arbitration_id=0x120,
                is_extended_id=True,
                is_fd=True,
                data=bytes.fromhex("2f 01 00"),
            )
        )
        with pytest.raises(DeviceError, match="ends 3 bytes too early"):
            motor.read()
        assert motor.read().angle_rad == pytest.approx([0.5 * np.pi])


def test_a_drive_that_knows_no_position_is_an_error() -> None:
    with can_wire() as (here, there):
        motor = MoteusMotor(here, TwinClock(), MoteusSettings())
        motor.read()
        for counter in (1, 2):
            answer(there, *state_of(counter, position_turns=float("nan")))
            assert len(motor.read().angle_rad) == 0
        answer(there, *state_of(3, position_turns=float("nan")))
        with pytest.raises(
            BadReading, match="the drive reports position nan turns, 3 bad reports in a row"
        ):
            motor.read()


# -- the drive
# --------------------------------------------------------------------------------------------------


def test_being_stopped_from_elsewhere_is_a_fault_and_commands_do_not_start_the_drive_again() -> (
    None
):
    with rig() as r:
        r.motor.enable()
        r.run(0.1, speed_rad_s=1.0)
        send(r.observer, Write(Register.MODE, Width.INT8, Mode.STOPPED))
        r.run(0.01, speed_rad_s=1.0)
        drain(r.observer)
        r.run(0.2, speed_rad_s=1.0)
        assert r.rotor.drives[-1][1].torque_Nm(1.0, 1.0) == 0.0
        assert {order.get(Register.MODE) for order in orders_in(drain(r.observer)) if order} == {
            Mode.STOPPED
        }
        assert re.search(
            "left position mode for stopped without a fault", r.motor.status().fault or ""
        )


def test_what_limits_the_output_is_told_and_is_no_fault() -> None:
    with can_wire() as (here, there):
        motor = MoteusMotor(here, TwinClock(), MoteusSettings())
        motor.read()
        limited = [
            replace(item, value=99) if item.register == Register.FAULT else item
            for item in state_of(1, Mode.POSITION)
        ]
        answer(there, *limited)
        motor.read()
        assert motor.status().state == "position, limit 99 (output limited by servo.max_current_A)"
        assert motor.status().fault is None


def test_a_restart_of_the_drive_is_a_fault_and_counted_and_time_does_not_run_back() -> None:
    with rig() as r:
        r.motor.enable()
        r.run(0.5, speed_rad_s=1.0)
        r.twin.restart()
        shaft = r.run(0.1)
        assert np.all(np.diff(shaft.device_s) > 0.0)
        assert shaft.device_s[-1] - shaft.device_s[0] == pytest.approx(0.1, abs=0.005)
        assert "the drive restarted, its millisecond counter began again" in (
            r.motor.status().fault or ""
        )
        assert r.motor.identity()["restarts"] == "1"


def test_a_torque_limit_of_the_command_holds() -> None:
    with rig(settings=MoteusSettings(torque_limit_Nm=2.0)) as r:
        r.motor.enable()
        r.rotor.load_Nm = 5.0
        shaft = r.run(0.5, angle_rad=0.3)
        assert np.abs(shaft.torque_Nm[-100:]).max() < 2.0 * 1.05
        assert r.rotor.speed_rad_s > 1.0


def test_a_spring_of_the_drives_gain_gives_way_as_far_as_it_must() -> None:
    with rig(gains=MoteusGains(kp_Nm_per_rad=100.0)) as r:
        r.motor.enable()
        r.rotor.load_Nm = 2.0
        r.run(1.0, angle_rad=0.3)
        assert r.rotor.angle_rad - 0.3 == pytest.approx(2.0 / 100.0, rel=1e-3)


def test_the_drives_integrator_takes_the_load_over() -> None:
    with rig(gains=MoteusGains(kp_Nm_per_rad=100.0, ki_Nm_per_rad_s=1000.0)) as r:
        r.motor.enable()
        r.rotor.load_Nm = 2.0
        r.run(2.0, angle_rad=0.3)
        assert r.rotor.angle_rad == pytest.approx(0.3, abs=1e-4)


def test_a_moving_target_goes_on_by_itself_between_commands() -> None:
    with rig(settings=MoteusSettings(watchdog_s=1.0)) as r:
        r.motor.enable()
        r.motor.command_angle(0.3, 2.0)
        r.run(0.5)
        assert r.rotor.angle_rad == pytest.approx(0.3 + 2.0 * 0.5, abs=5e-3)


@pytest.mark.parametrize(
    ("subframes", "refusals"),
    [
        ([Write(Register.MODE, Width.INT8, 5)], [Refusal(Register.MODE, 3, of_write=True)]),
        (
            [Write(Register.POSITION, Width.FLOAT, 1.0)],
            [Refusal(Register.POSITION, 2, of_write=True)],
        ),
        ([Write(0x300, Width.INT8, 1)], [Refusal(0x300, 1, of_write=True)]),
        ([moteus.Read(0x300, Width.INT8)], [Refusal(0x300, 1, of_write=False)]),
    ],
)
def test_the_twin_refuses_what_the_drive_would(
    subframes: list[Subframe], refusals: list[Subframe]
) -> None:
    with rig() as r:
        send(r.observer, *subframes, wants_reply=True)
        r.tick()
        (reply,) = drain(r.observer)
        assert moteus.decode(reply.data) == refusals


def test_the_twin_tells_the_mode_that_it_had_before_the_command_that_asks() -> None:
    with rig() as r:
        r.motor.enable()
        drain(r.observer)
        send(
            r.observer,
            Write(Register.MODE, Width.INT8, Mode.STOPPED),
            moteus.Read(Register.MODE, Width.INT8),
            wants_reply=True,
        )
        r.tick()
        (reply,) = (m for m in drain(r.observer) if m.arbitration_id == 0x105)
        assert moteus.decode(reply.data) == [Reply(Register.MODE, Width.INT8, Mode.POSITION)]
        assert r.rotor.drives[-1][1].torque_Nm(1.0, 1.0) == 0.0


def test_the_twin_answers_only_who_wants_a_reply_and_ignores_what_it_cannot_read() -> None:
    with rig() as r:
        send(r.observer, moteus.Read(Register.MODE, Width.INT8))
        send(r.observer, moteus.Read(Register.MODE, Width.INT8), wants_reply=True, destination=2)
        r.observer.send(
            can.Message(
                arbitration_id=0x8001,
                is_extended_id=True,
                is_fd=True,
                data=bytes.fromhex("42 01 30 00 00 00 00 ff"),
            )
        )
        r.tick()
        assert drain(r.observer) == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"drive_id": 0},
        {"drive_id": 128},
        {"own_id": 1},
        {"can_prefix": 0x2000},
        {"direction": 0},
        {"gear_ratio": 0.0},
        {"zero_turns": float("nan")},
        {"watchdog_s": float("nan")},
        {"torque_limit_Nm": 0.0},
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(wrong: dict[str, float]) -> None:
    with pytest.raises(BadInput, match=next(iter(wrong))):
        MoteusSettings(**wrong)


def test_the_identity_names_firmware_and_serial_number() -> None:
    with rig() as r:
        assert r.motor.identity()["firmware"] == "unknown"
        r.motor.enable()
        identity = r.motor.identity()
        assert identity["firmware"] == "1.3.4"
        assert identity["serial_number"] == "000000030000000200000001"
