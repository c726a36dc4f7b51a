"""The driver of an AK drive in servo mode on its twin, over the bytes of the wire."""

import math
import re
from contextlib import AbstractContextManager

import can
import pytest

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.motor_rig import MotorRig, Rotor, drain, motor_rig
from rfca_rig.devices.cubemars.codec import servo as cubemars_servo
from rfca_rig.devices.cubemars.codec.servo import SetCurrent, SetPosition, SetPositionSpeed, Status
from rfca_rig.devices.cubemars.driver.servo import CubemarsServoMotor, ServoSettings
from rfca_rig.devices.cubemars.twin import CubemarsServoTwin, ServoTwinSettings
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.twins.wires import can_wire

MOTOR = {"gear_ratio": 9.0, "pole_pairs": 21, "torque_constant_Nm_per_A": 0.115}
TURNED = {"direction": -1, "zero_deg": 130.0}


def send(bus: can.BusABC, frame: cubemars_servo.Frame) -> None:
    bus.send(can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=True))


def rig(
    rotor: Rotor | None = None, settings: ServoSettings | None = None, **twin
) -> AbstractContextManager[MotorRig]:
    return motor_rig(
        lambda bus, clock: CubemarsServoMotor(bus, clock, settings or ServoSettings(1, **MOTOR)),
        lambda bus: CubemarsServoTwin(bus, ServoTwinSettings(**MOTOR, **twin)),
        rotor,
    )


def orders_heard(bus: can.BusABC) -> list[cubemars_servo.Message]:
    said = [cubemars_servo.decode(message.arbitration_id, message.data) for message in drain(bus)]
    return [order for order in said if not isinstance(order, Status)]


@pytest.mark.parametrize("angle_rad", [60.0, -200.0])
def test_a_drive_that_counts_more_turns_than_it_shows_is_let_go_before_it_has_moved_far(
    angle_rad: float,
) -> None:
    with rig(Rotor(angle_rad=angle_rad)) as r:
        with pytest.raises(
            DeviceError,
            match=(
                r"moved by -?0\.\d\d rad when commanded to stay; the drive counts its turns "
                r"otherwise"
            ),
        ):
            r.motor.enable()
        r.tick()
        assert r.rotor.drives[-1][1].torque_Nm(1.0, 1.0) == 0.0
        assert abs(r.rotor.angle_rad - angle_rad) < 0.1
        assert abs(r.rotor.speed_rad_s) < 0.4


def test_enabling_lets_go_then_holds_gently_then_holds() -> None:
    with rig() as r:
        r.motor.enable()
        orders = orders_heard(r.observer)
        assert [type(order) for order in orders] == [
            SetCurrent,
            *[SetPositionSpeed] * (len(orders) - 2),
            SetPosition,
        ]
        assert orders[0].current_A == 0.0
        assert {order.speed_erpm for order in orders[1:-1]} == {
            540
        }  # 0.3 rad/s * 9 * 21 * 60 / 2 pi
        assert orders[-1].position_deg == orders[1].position_deg


def test_a_position_that_stops_at_the_end_of_its_range_is_a_fault_not_an_angle() -> None:
    with rig(Rotor(angle_rad=54.0), wraps=False) as r:
        r.motor.enable()
        r.run(1.5, speed_rad_s=3.0)
        assert re.search(
            r"end of its range \(code 32000\) while the shaft turns", r.motor.status().fault
        )


@pytest.mark.parametrize("by_rad", [0.698, -2.0])
def test_an_encoder_that_slips_is_a_fault(by_rad: float) -> None:
    with rig() as r:
        r.motor.enable()
        r.run(0.1, speed_rad_s=3.0)
        r.twin.leap(by_rad)
        r.run(0.01, speed_rad_s=3.0)
        assert re.search(r"position leapt by -?\d+ counts", r.motor.status().fault)


@pytest.mark.parametrize(
    ("wrong", "factor"), [({"pole_pairs": 14}, r"1\.5"), ({"gear_ratio": 64.0}, r"0\.14")]
)
def test_a_wrong_gear_or_number_of_poles_is_found_out_by_its_motion(
    wrong: dict, factor: str
) -> None:
    with rig(settings=ServoSettings(1, **{**MOTOR, **wrong})) as r:
        r.motor.enable()
        r.run(2.0, speed_rad_s=3.0)
        assert re.search(
            rf"speed that the drive reports is {factor} times that of its angle; check gear",
            r.motor.status().fault,
        )


@pytest.mark.parametrize(("true_ms", "configured_ms"), [(10, 2), (2, 10)])
def test_a_status_period_other_than_configured_is_refused_with_both(
    true_ms: int, configured_ms: int
) -> None:
    settings = ServoSettings(1, **MOTOR, status_period_s=1e-3 * configured_ms)
    with (
        rig(settings=settings, status_period_s=1e-3 * true_ms) as r,
        pytest.raises(
            DeviceError,
            match=f"status frames come every {true_ms} ms, the settings say {configured_ms} ms",
        ),
    ):
        r.motor.enable()


@pytest.mark.parametrize("held_up_s", [0.0, 0.03, 0.1])
def test_status_frames_that_are_held_up_for_a_moment_do_not_refuse_a_drive(
    held_up_s: float,
) -> None:
    with rig() as r:
        r.clock.carry(lambda now_s: drain(r.wire) if now_s < held_up_s else None)
        r.motor.enable()
        began_rad = r.rotor.angle_rad
        r.run(0.5, speed_rad_s=1.0)
        assert r.rotor.angle_rad - began_rad == pytest.approx(0.5, abs=0.1)


def test_a_wrong_id_is_explained_with_the_ids_that_are_there() -> None:
    with (
        rig(drive_id=104) as r,
        pytest.raises(
            DeviceError, match="status frames of drive 104 but none of drive 1; check drive_id"
        ),
    ):
        r.motor.enable()


def test_a_drive_in_mit_mode_is_explained() -> None:
    clock = TwinClock()
    with can_wire() as (here, there):
        clock.carry(
            lambda _: there.send(
                can.Message(arbitration_id=0, data=b"\x01" + bytes(7), is_extended_id=False)
            )
        )
        with pytest.raises(
            DeviceError, match=r"no status frame of drive 1, but frames of MIT mode .*servo mode"
        ):
            CubemarsServoMotor(here, clock, ServoSettings(1, **MOTOR)).enable()


def test_frames_of_others_and_the_handshake_are_no_status() -> None:
    with can_wire() as (here, there):
        motor = CubemarsServoMotor(here, TwinClock(), ServoSettings(1, **MOTOR))
        for identifier, data in (
            (0x2902, bytes(8)),
            (0x2C01, bytes.fromhex("fafbfcfd")),
            (0x0901, bytes(8)),
            (0x0301, bytes(4)),
        ):
            there.send(can.Message(arbitration_id=identifier, data=data, is_extended_id=True))
        there.send(
            can.Message(arbitration_id=0x2901, is_remote_frame=True, dlc=8, is_extended_id=True)
        )
        assert len(motor.read().angle_rad) == 0


def test_a_status_of_wrong_length_is_an_error_and_what_came_before_is_kept() -> None:
    with can_wire() as (here, there):
        motor = CubemarsServoMotor(here, TwinClock(), ServoSettings(1, **MOTOR))
        send(there, cubemars_servo.status(1, Status(900, 0.0, 1.0, 30, 0)))
        there.send(can.Message(arbitration_id=0x2901, data=bytes(7), is_extended_id=True))
        with pytest.raises(DeviceError, match=r"STATUS.*7 bytes, expected 8"):
            motor.read()
        shaft = motor.read()
        assert shaft.angle_rad == pytest.approx([math.pi / 2])
        assert shaft.torque_Nm == pytest.approx([9.0 * 0.115])


@pytest.mark.parametrize(
    "act", [lambda motor: motor.command_speed(1.0), lambda motor: motor.command_angle(1.0)]
)
def test_a_command_before_enabling_is_refused_and_not_sent(act) -> None:
    with can_wire() as (here, there):
        with pytest.raises(DeviceError, match="not enabled; nothing was sent"):
            act(CubemarsServoMotor(here, TwinClock(), ServoSettings(1, **MOTOR)))
        assert drain(there) == []


def test_a_speed_beyond_the_drives_is_refused_with_the_limit() -> None:
    with rig() as r:
        r.motor.enable()
        with pytest.raises(DeviceError, match=r"speed in ERPM .* limit 100000"):
            r.motor.command_speed(56.0)


def test_lost_status_frames_make_device_time_jump_by_what_is_missing() -> None:
    with rig() as r:
        r.motor.enable()
        before = r.run(0.1, speed_rad_s=1.0)
        r.run(0.05, speed_rad_s=1.0, deaf=True)
        after = r.run(0.1, speed_rad_s=1.0)
        assert after.device_s[0] - before.device_s[-1] == pytest.approx(0.052)
        assert r.motor.identity()["status_frames_lost"] == "25"


def test_a_supply_that_is_cut_by_silence_is_proof_enough() -> None:
    with rig() as r:
        r.motor.enable()
        r.run(0.1, angle_rad=0.3)
        r.clock.carry(lambda _: drain(r.wire))
        assert r.motor.prove_watchdog(0.3) < 0.1


def test_a_small_load_that_vanishes_proves_nothing() -> None:
    with rig(watchdog_s=0.1) as r:
        r.motor.enable()
        r.rotor.load_Nm = 0.05
        r.run(1.0, angle_rad=0.3)
        with pytest.raises(DeviceError, match=r"not proven: the motor held 0\.05. N m, too little"):
            r.motor.prove_watchdog(0.5)


def test_after_the_proof_the_motor_is_to_be_enabled_anew() -> None:
    with rig(watchdog_s=0.1) as r:
        r.motor.enable()
        r.rotor.load_Nm = 0.5
        r.run(1.0, angle_rad=0.3)
        r.motor.prove_watchdog(0.5)
        assert orders_heard(r.observer)[-1] == SetCurrent(0.0)
        with pytest.raises(DeviceError, match="not enabled"):
            r.motor.command_speed(1.0)


def test_how_long_the_drive_held_on_is_measured() -> None:
    with rig(watchdog_s=0.2) as r:
        r.motor.enable()
        r.rotor.load_Nm = 0.5
        r.run(1.0, angle_rad=0.3)
        assert r.motor.prove_watchdog(0.5) == pytest.approx(0.2, abs=0.01)


@pytest.mark.parametrize(
    ("load_Nm", "said"),
    [
        (0.0, r"not proven: the motor held 0\.0.* N m.*park the leg"),
        (0.5, "no watchdog that stopped it"),
    ],
)
def test_what_is_wrong_with_the_watchdog_is_told_with_what_to_do(load_Nm: float, said: str) -> None:
    with rig() as r:
        r.motor.enable()
        r.rotor.load_Nm = load_Nm
        r.run(0.5, angle_rad=0.3)
        with pytest.raises(DeviceError, match=said + ".*relay into its supply"):
            r.motor.prove_watchdog(0.3)


def test_the_twin_moves_to_a_position_no_faster_than_it_is_told() -> None:
    with rig() as r:
        for _ in range(500):
            send(r.observer, cubemars_servo.set_position_speed(1, 120.0, 1800.0, 100_000.0))
            r.tick()
        assert r.rotor.speed_rad_s == pytest.approx(
            1800.0 / (9.0 * 21.0) * 2.0 * math.pi / 60.0, rel=1e-2
        )


def test_the_twin_takes_a_current_as_torque_and_a_new_origin_as_zero() -> None:
    with rig() as r:
        send(r.observer, cubemars_servo.set_current(1, 2.0))
        r.tick()
        assert r.rotor.drives[-1][1].torque_Nm(0.0, 0.0) == pytest.approx(2.0 * 9.0 * 0.115)
        send(r.observer, cubemars_servo.set_current(1, 0.0))
        r.rotor.speed_rad_s = 0.0
        send(r.observer, cubemars_servo.set_origin(1, cubemars_servo.OriginMode.TEMPORARY))
        r.tick()
        last = drain(r.observer)[-1]
        assert cubemars_servo.decode(last.arbitration_id, last.data).position_count in {-1, 0}


@pytest.mark.parametrize(
    "wrong",
    [
        {"drive_id": 256},
        {"gear_ratio": 0.0},
        {"pole_pairs": 0},
        {"torque_constant_Nm_per_A": math.nan},
        {"direction": 0},
        {"zero_deg": math.inf},
        {"status_period_s": 0.0},
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(wrong: dict) -> None:
    with pytest.raises(BadInput, match=next(iter(wrong))):
        ServoSettings(**{"drive_id": 1, **MOTOR, **wrong})
