"""The ODrive driver on its twin, over the bytes of the wire."""

import math
import re

import can
import numpy as np
import pytest
from can.interfaces.virtual import VirtualBus

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.motor import UnpluggedBus
from rfca_rig.contracts.motor_rig import Rotor
from rfca_rig.devices.netft.twin import NetFtTwin, NetFtTwinSettings
from rfca_rig.devices.odrive import codec as cansimple
from rfca_rig.devices.odrive import messages as odrive
from rfca_rig.devices.odrive.driver import OdriveMotor, OdriveSettings
from rfca_rig.devices.odrive.messages import ControlMode
from rfca_rig.devices.odrive.twin import OdriveTwin, OdriveTwinSettings
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.twins.drive_parts import LoopGains
from rfca_rig.twins.wires import can_wire, datagram_link
from rfca_rig.twins.world import TwinWorld
from tests.devices.rig import twin_rig

GEARED = {"gear_ratio": 9.0, "direction": -1, "zero_turns": 2.75}


def frames_of(bus: can.BusABC) -> list[can.Message]:
    return list(iter(lambda: bus.recv(timeout=0), None))


def send(bus: can.BusABC, frame: cansimple.Frame) -> None:
    bus.send(can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False))


def test_enabling_moves_nothing_even_where_a_stale_set_point_waits_in_the_drive() -> None:
    with twin_rig(Rotor(angle_rad=1.2), observers=1) as rig:
        send(rig.others[0], cansimple.set_input_pos(0, -3.0, 5.0))
        rig.motor.enable()
        shaft, _ = rig.run(0.2, angle_rad=1.2)
        assert np.abs(shaft.angle_rad - 1.2).max() < 1e-6
        assert np.abs(shaft.torque_Nm).max() < 1e-3
        assert rig.motor.status().state == "closed loop"
        assert rig.motor.status().fault is None


def test_enabling_sends_the_set_point_before_the_loop_closes() -> None:
    with twin_rig(observers=1) as rig:
        rig.motor.enable()
        orders = [
            m.arbitration_id
            for m in frames_of(rig.others[0])
            if m.arbitration_id in {0x07, 0x0B, 0x0C} and not m.is_remote_frame
        ]
        assert orders[:5] == [0x07, 0x0C, 0x0B, 0x07, 0x0C]


def test_a_loaded_shaft_is_held_where_it_stands() -> None:
    with twin_rig(Rotor(load_Nm=0.0)) as rig:
        rig.motor.enable()
        rig.rotor.load_Nm = 3.0
        shaft, _ = rig.run(1.5, angle_rad=0.3)
        assert shaft.angle_rad[-1] == pytest.approx(0.3, abs=1e-3)
        assert shaft.torque_Nm[-1] == pytest.approx(-3.0, rel=0.02)


@pytest.mark.parametrize("scale", [{}, GEARED])
def test_a_commanded_speed_is_reached_whatever_gear_direction_and_zero(
    scale: dict[str, float],
) -> None:
    with twin_rig(motor=OdriveSettings(0, **scale), motor_twin=OdriveTwinSettings(**scale)) as rig:
        rig.motor.enable()
        shaft, _ = rig.run(1.0, speed_rad_s=3.2)
        assert shaft.speed_rad_s[-1] == pytest.approx(3.2, rel=1e-3)
        assert rig.rotor.speed_rad_s == pytest.approx(3.2, rel=1e-3)
        assert shaft.angle_rad[-1] == pytest.approx(rig.rotor.angle_rad, abs=1e-5)


@pytest.mark.parametrize("scale", [{}, GEARED])
def test_a_commanded_angle_is_reached_and_held(scale: dict[str, float]) -> None:
    with twin_rig(motor=OdriveSettings(0, **scale), motor_twin=OdriveTwinSettings(**scale)) as rig:
        rig.motor.enable()
        shaft, _ = rig.run(2.0, angle_rad=-0.7)
        assert rig.rotor.angle_rad == pytest.approx(-0.7, abs=2e-3)
        assert abs(shaft.speed_rad_s[-1]) < 1e-2


def test_a_moving_target_is_followed_with_its_speed_fed_forward() -> None:
    with twin_rig() as rig:
        rig.motor.enable()
        behind = []
        for tick in range(500):
            target_rad = 0.3 + 2.0 * 2e-3 * tick
            rig.motor.command_angle(target_rad, 2.0)
            rig.clock.wait_until(rig.clock.now_s() + 2e-3)
            behind.append(target_rad + 2.0 * 2e-3 - rig.motor.read().angle_rad[-1])
        assert abs(behind[-1]) < 0.02


def test_torque_is_reported_at_the_shaft_with_its_sign() -> None:
    with twin_rig(
        motor=OdriveSettings(0, **GEARED), motor_twin=OdriveTwinSettings(**GEARED)
    ) as rig:
        rig.motor.enable()
        rig.rotor.load_Nm = 2.0
        shaft, _ = rig.run(2.0, speed_rad_s=1.0)
        assert shaft.torque_Nm[-1] == pytest.approx(-2.0, rel=0.02)


def test_torque_may_come_from_the_motor_current() -> None:
    clock = TwinClock()
    with can_wire() as (here, there):
        clock.carry(
            lambda _: [
                send(there, cansimple.iq(0, 9.0, 4.0)),
                send(there, cansimple.encoder_estimates(0, 0.0, 0.0)),
            ]
        )
        motor = OdriveMotor(
            here, clock, OdriveSettings(0, gear_ratio=2.0, torque_constant_Nm_per_A=0.5)
        )
        clock.wait_until(0.1)
        assert motor.read().torque_Nm.tolist() == [4.0]


def test_the_controller_mode_is_sent_only_when_it_changes() -> None:
    with twin_rig(observers=1) as rig:
        rig.motor.enable()
        frames_of(rig.others[0])
        rig.run(0.1, speed_rad_s=1.0)
        rig.run(0.1, angle_rad=0.5)
        modes = [m.data[0] for m in frames_of(rig.others[0]) if m.arbitration_id == 0x0B]
        assert modes == [ControlMode.VELOCITY, ControlMode.POSITION]


def test_going_over_to_angle_never_meets_an_old_target() -> None:
    with twin_rig(observers=1) as rig:
        rig.motor.enable()
        rig.run(0.1, speed_rad_s=1.0)
        frames_of(rig.others[0])
        rig.motor.command_angle(0.5)
        assert [m.arbitration_id for m in frames_of(rig.others[0])] == [0x0C, 0x0B]


def test_disabling_takes_the_torque_away_and_may_be_repeated() -> None:
    with twin_rig() as rig:
        rig.motor.enable()
        rig.run(0.3, speed_rad_s=2.0)
        rig.motor.disable()
        rig.motor.disable()
        speed_rad_s = rig.rotor.speed_rad_s
        shaft, _ = rig.run(0.3)
        assert np.all(shaft.torque_Nm == 0.0)
        assert rig.rotor.speed_rad_s == speed_rad_s
        assert rig.motor.status().state == "idle"
        assert rig.motor.status().fault is None


def test_the_watchdog_stops_the_motor_when_commands_stop() -> None:
    with twin_rig(motor_twin=OdriveTwinSettings(watchdog_s=0.1)) as rig:
        rig.motor.enable()
        rig.run(0.3, speed_rad_s=2.0)
        shaft, _ = rig.run(0.4)
        torqued = shaft.device_s[shaft.torque_Nm != 0.0]
        assert 0.08 < torqued[-1] - shaft.device_s[0] < 0.11
        assert re.search(
            "0x01000000.*WATCHDOG_TIMER_EXPIRED: no command", rig.motor.status().fault or ""
        )


def test_commands_after_the_watchdog_tripped_do_not_move_the_shaft() -> None:
    with twin_rig(motor_twin=OdriveTwinSettings(watchdog_s=0.1)) as rig:
        rig.motor.enable()
        rig.run(0.4)
        shaft, _ = rig.run(0.2, speed_rad_s=5.0)
        assert np.all(shaft.torque_Nm == 0.0)


def test_the_watchdog_is_proven_by_starving_it() -> None:
    with twin_rig(motor_twin=OdriveTwinSettings(watchdog_s=0.15)) as rig:
        rig.motor.enable()
        assert 0.15 <= rig.motor.prove_watchdog(0.4) <= 0.27
        rig.motor.enable()
        assert rig.motor.status().fault is None


def test_a_watchdog_that_is_off_is_found_out() -> None:
    with twin_rig(motor_twin=OdriveTwinSettings(watchdog_s=None)) as rig:
        rig.motor.enable()
        with pytest.raises(
            DeviceError, match=r"watchdog let it run through 0\.5 s.*enable_watchdog"
        ):
            rig.motor.prove_watchdog(0.5)
        rig.run(0.2)
        assert rig.motor.status().state == "idle"


def test_a_fault_of_the_drive_is_told_with_its_code_and_meaning() -> None:
    with twin_rig() as rig:
        rig.motor.enable()
        rig.run(0.1, speed_rad_s=1.0)
        rig.motor_twin.set_error(1 << 13)
        rig.run(0.2, speed_rad_s=1.0)
        assert rig.motor.status().fault == "error 0x00002000 (MOTOR_OVER_TEMP: motor too hot)"
        assert rig.motor.status().state == "idle"


def test_falling_to_idle_without_an_error_is_a_fault_too() -> None:
    with twin_rig(observers=1) as rig:
        rig.motor.enable()
        send(rig.others[0], cansimple.set_axis_state(0, 1))
        rig.run(0.2, speed_rad_s=1.0)
        assert re.search(
            "left closed loop for idle without an error", rig.motor.status().fault or ""
        )


def test_an_emergency_stop_on_the_bus_is_told_and_is_cleared_by_enabling_anew() -> None:
    with twin_rig(observers=1) as rig:
        rig.motor.enable()
        send(rig.others[0], cansimple.estop(0))
        rig.run(0.2, speed_rad_s=1.0)
        assert "ESTOP_REQUESTED" in (rig.motor.status().fault or "")
        rig.motor.enable()
        assert rig.motor.status().fault is None


def test_a_refused_enable_says_with_what_error() -> None:
    with (
        twin_rig(motor_twin=OdriveTwinSettings(arming_error=1 << 3)) as rig,
        pytest.raises(
            DeviceError,
            match=r"refuses closed loop with error 0x00000008 \(MISSING_ESTIMATE: .*idle.*disarmed",
        ),
    ):
        rig.motor.enable()


def test_a_refused_enable_leaves_the_motor_idle() -> None:
    with twin_rig(motor_twin=OdriveTwinSettings(arming_error=1 << 3), observers=1) as rig:
        with pytest.raises(DeviceError):
            rig.motor.enable()
        orders = [m for m in frames_of(rig.others[0]) if m.arbitration_id == 0x07]
        assert orders[-1].data[0] == 1


def test_a_silent_bus_is_explained() -> None:
    with (
        can_wire() as (here, _),
        pytest.raises(
            DeviceError,
            match=r"within 1 s no frames at all on the CAN bus; check the drive's power",
        ),
    ):
        OdriveMotor(here, TwinClock(), OdriveSettings(0)).enable()


def test_a_wrong_node_is_explained_with_the_nodes_that_are_there() -> None:
    with (
        twin_rig(motor=OdriveSettings(5)) as rig,
        pytest.raises(DeviceError, match="frames from node 0 but none from node 5; check node_id"),
    ):
        rig.motor.enable()


@pytest.mark.parametrize(
    ("frames", "said"),
    [
        (
            [cansimple.encoder_estimates(0, 0.0, 0.0), cansimple.torques(0, 0.0, 0.0)],
            "no heartbeat from node 0",
        ),
        (
            [cansimple.heartbeat(0, odrive.Heartbeat(0, 1, 0, False))],
            "no encoder estimates from node 0; set its encoder_msg_rate_ms to 1$",
        ),
        (
            [
                cansimple.heartbeat(0, odrive.Heartbeat(0, 1, 0, False)),
                cansimple.encoder_estimates(0, 0.0, 0.0),
            ],
            r"no torques \(0x1C\) from node 0",
        ),
    ],
)
def test_a_message_that_is_not_switched_on_is_named(
    frames: list[cansimple.Frame], said: str
) -> None:
    clock = TwinClock()
    with can_wire() as (here, there):
        clock.carry(lambda _: [send(there, frame) for frame in frames])
        with pytest.raises(DeviceError, match=said):
            OdriveMotor(here, clock, OdriveSettings(0)).enable()


@pytest.mark.parametrize(("true_ms", "configured_ms"), [(10, 1), (1, 10)])
def test_an_encoder_period_other_than_configured_is_refused_with_both(
    true_ms: int, configured_ms: int
) -> None:
    drive = OdriveTwinSettings(encoder_period_s=1e-3 * true_ms)
    nominal = OdriveSettings(0, encoder_period_s=1e-3 * configured_ms)
    with (
        twin_rig(motor=nominal, motor_twin=drive) as rig,
        pytest.raises(
            DeviceError,
            match=f"encoder estimates come every {true_ms} ms, the settings say {configured_ms} ms",
        ),
    ):
        rig.motor.enable()


def test_a_heartbeat_from_before_the_errors_were_cleared_does_not_count() -> None:
    clock = TwinClock()
    errors = iter([1 << 24, *[0] * 100])
    reports = [cansimple.encoder_estimates(0, 0.0, 0.0), cansimple.torques(0, 0.0, 0.0)] * 2

    def drive_says(now_s: float) -> None:
        for frame in reports:
            send(there, frame)
        if round(now_s / 2e-3) % 25 == 1:
            send(
                there,
                cansimple.heartbeat(
                    0, odrive.Heartbeat(next(errors), 8 if now_s > 0.06 else 1, 0, False)
                ),
            )

    with can_wire() as (here, there):
        clock.carry(drive_says)
        motor = OdriveMotor(here, clock, OdriveSettings(0))
        motor.enable()
        assert motor.status().fault is None


def test_the_twin_does_not_close_the_loop_on_an_error_that_was_not_cleared() -> None:
    with twin_rig(motor_twin=OdriveTwinSettings(watchdog_s=None), observers=1) as rig:
        rig.motor_twin.set_error(1 << 13)
        send(rig.others[0], cansimple.set_axis_state(0, 8))
        rig.run(0.2)
        assert rig.motor.status().state == "idle"


def test_device_time_counts_the_drives_own_periods() -> None:
    with twin_rig() as rig:
        rig.motor.enable()
        shaft, _ = rig.run(0.5, speed_rad_s=1.0)
        assert np.allclose(np.diff(shaft.device_s), 1e-3, atol=1e-12)
        assert len(shaft.device_s) > 500
        assert np.all(np.diff(shaft.host_s) >= 0.0)


def test_lost_encoder_frames_make_device_time_jump_by_what_is_missing() -> None:
    with twin_rig() as rig:
        rig.motor.enable()
        before, _ = rig.run(0.1, speed_rad_s=1.0)
        for _ in range(25):
            rig.motor.command_speed(1.0)
            rig.clock.wait_until(rig.clock.now_s() + 2e-3)
            while rig.wire.recv(timeout=0) is not None:
                pass
        after, _ = rig.run(0.1, speed_rad_s=1.0)
        assert after.device_s[0] - before.device_s[-1] == pytest.approx(0.051)
        assert rig.motor.identity()["encoder_frames_lost"] == "50"


def test_a_late_look_is_not_taken_for_a_loss() -> None:
    with twin_rig(motor_twin=OdriveTwinSettings(watchdog_s=None)) as rig:
        rig.motor.enable()
        rig.run(0.1)
        rig.clock.wait_until(rig.clock.now_s() + 0.5)
        shaft, _ = rig.run(0.1)
        assert np.allclose(np.diff(shaft.device_s), 1e-3, atol=1e-12)
        assert rig.motor.identity()["encoder_frames_lost"] == "0"


def test_nothing_read_while_enabling_is_lost_to_the_next_read() -> None:
    with twin_rig() as rig:
        rig.motor.enable()
        shaft = rig.motor.read()
        assert len(shaft.device_s) == round(1e3 * rig.clock.now_s())
        assert len(rig.motor.read().device_s) == 0


def test_reading_never_carries_time_forward() -> None:
    with twin_rig() as rig:
        rig.motor.read()
        rig.sensor.read()
        assert rig.clock.now_s() == 0.0


def test_a_drive_that_falls_silent_is_a_fault() -> None:
    with twin_rig(motor_twin=OdriveTwinSettings(heartbeat_period_s=0.1)) as rig:
        rig.motor.enable()
        rig.run(0.05, speed_rad_s=1.0)
        while rig.motor.status().silent_s < 0.34:
            rig.clock.wait_until(rig.clock.now_s() + 2e-3)
            while rig.wire.recv(timeout=0) is not None:
                pass
            rig.motor.read()
            assert rig.motor.status().fault is None
        rig.clock.wait_until(rig.clock.now_s() + 0.02)
        while rig.wire.recv(timeout=0) is not None:
            pass
        rig.motor.read()
        assert re.search(
            r"no heartbeat for 0\.3\d s, limit 0\.35 s", rig.motor.status().fault or ""
        )


@pytest.mark.parametrize(
    "act",
    [
        OdriveMotor.enable,
        OdriveMotor.disable,
        lambda m: m.command_speed(1.0),
        lambda m: m.command_angle(1.0),
    ],
)
def test_a_frame_that_cannot_be_sent_is_an_error(act) -> None:
    with UnpluggedBus() as bus, pytest.raises(DeviceError, match="not sent: transmit buffer full"):
        act(OdriveMotor(bus, TwinClock(), OdriveSettings(0)))


def test_a_failing_bus_is_an_error_when_reading() -> None:
    with (
        UnpluggedBus() as bus,
        pytest.raises(DeviceError, match="CAN bus failed while reading the drive: no such device"),
    ):
        OdriveMotor(bus, TwinClock(), OdriveSettings(0)).read()


def test_a_bus_that_went_off_is_an_error_when_reading() -> None:
    with can_wire() as (here, there):
        there.send(can.Message(arbitration_id=0x40, is_error_frame=True, is_extended_id=False))
        with pytest.raises(DeviceError, match="CAN bus is off"):
            OdriveMotor(here, TwinClock(), OdriveSettings(0)).read()


def test_a_frame_of_wrong_length_is_an_error_and_the_samples_before_it_are_kept() -> None:
    with can_wire() as (here, there):
        motor = OdriveMotor(here, TwinClock(), OdriveSettings(0))
        send(there, cansimple.torques(0, 0.0, 0.0))
        send(there, cansimple.encoder_estimates(0, 0.25, 0.0))
        there.send(can.Message(arbitration_id=0x09, data=bytes(7), is_extended_id=False))
        with pytest.raises(DeviceError, match=r"ENCODER_ESTIMATES.*7 bytes"):
            motor.read()
        assert motor.read().angle_rad == pytest.approx([0.5 * math.pi])


def test_frames_of_others_extended_frames_and_requests_are_not_the_drives() -> None:
    with can_wire() as (here, there):
        send(there, cansimple.encoder_estimates(4, 1.0, 1.0))
        there.send(can.Message(arbitration_id=0x09, data=bytes(8), is_extended_id=True))
        there.send(
            can.Message(arbitration_id=0x09, is_remote_frame=True, dlc=8, is_extended_id=False)
        )
        there.send(can.Message(arbitration_id=0x09, data=b"", is_extended_id=False))
        assert len(OdriveMotor(here, TwinClock(), OdriveSettings(0)).read().angle_rad) == 0


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_command_that_is_no_number_is_refused_and_not_sent(value: float) -> None:
    with can_wire() as (here, there):
        motor = OdriveMotor(here, TwinClock(), OdriveSettings(0))
        for act in (motor.command_speed, motor.command_angle):
            with pytest.raises(DeviceError, match="nothing was sent"):
                act(value)
        assert there.recv(timeout=0) is None


@pytest.mark.parametrize(
    "wrong",
    [
        {"node_id": 63},
        {"direction": 0},
        {"gear_ratio": 0.0},
        {"zero_turns": math.nan},
        {"encoder_period_s": -1.0},
        {"torque_constant_Nm_per_A": 0.0},
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(wrong: dict[str, float]) -> None:
    with pytest.raises(BadInput, match=next(iter(wrong))):
        OdriveSettings(**{"node_id": 0, **wrong})


def test_the_identity_names_firmware_and_scale() -> None:
    with twin_rig(
        motor=OdriveSettings(0, **GEARED), motor_twin=OdriveTwinSettings(**GEARED)
    ) as rig:
        rig.motor.enable()
        identity = rig.motor.identity()
        assert identity["firmware"] == "0.6.10"
        assert identity["gear_ratio"] == "9.0"
        assert identity["zero_turns"] == "2.75"


def test_the_torque_limit_holds_against_a_load_beyond_it() -> None:
    gains = LoopGains(torque_limit_Nm=2.0)
    with twin_rig(motor_twin=OdriveTwinSettings(gains=gains)) as rig:
        rig.motor.enable()
        rig.rotor.load_Nm = 5.0
        shaft, _ = rig.run(0.5, angle_rad=0.3)
        assert (
            np.abs(shaft.torque_Nm[-400:]).max() < 2.0 * 1.05
        )  # the limit is looked at once a step
        assert rig.rotor.speed_rad_s > 1.0


def test_the_integrator_does_not_wind_up_at_the_torque_limit() -> None:
    with twin_rig(motor_twin=OdriveTwinSettings(gains=LoopGains(torque_limit_Nm=2.0))) as rig:
        rig.motor.enable()
        rig.rotor.load_Nm = -5.0
        rig.run(0.3, speed_rad_s=1.0)
        rig.rotor.load_Nm = 0.0
        shaft, _ = rig.run(1.5, speed_rad_s=1.0)
        assert shaft.speed_rad_s.max() < 1.1
        assert shaft.speed_rad_s[-1] == pytest.approx(1.0, rel=1e-2)


def test_enabling_anew_begins_without_the_torque_of_before() -> None:
    with twin_rig() as rig:
        rig.motor.enable()
        rig.rotor.load_Nm = 3.0
        rig.run(1.0, angle_rad=0.3)
        rig.motor.disable()
        rig.rotor.load_Nm = rig.rotor.speed_rad_s = 0.0
        rig.motor.enable()
        shaft, _ = rig.run(0.1, angle_rad=rig.rotor.angle_rad)
        assert np.abs(shaft.torque_Nm[-100:]).max() < 0.1


def test_a_light_shaft_at_the_torque_limit_does_not_chatter() -> None:
    with twin_rig(
        Rotor(inertia_kg_m2=0.002),
        motor_twin=OdriveTwinSettings(gains=LoopGains(torque_limit_Nm=40.0)),
    ) as rig:
        rig.motor.enable()
        shaft, _ = rig.run(0.5, speed_rad_s=15.0)
        assert shaft.speed_rad_s[-100:] == pytest.approx(15.0, rel=0.01)


def test_a_soft_drive_sags_under_load_and_recovers_by_its_integrator() -> None:
    gains = LoopGains(speed_gain_Nm_s_per_rad=8.0, integral_gain_Nm_per_rad=60.0)
    with twin_rig(motor_twin=OdriveTwinSettings(gains=gains)) as rig:
        rig.motor.enable()
        rig.run(1.0, speed_rad_s=3.0)
        rig.rotor.load_Nm = -4.0
        shaft, _ = rig.run(1.0, speed_rad_s=3.0)
        # a step of load L sags by nearly L / speed gain, and recovers with the time constant speed
        # gain / integral gain
        assert 3.0 - shaft.speed_rad_s.min() == pytest.approx(4.0 / 8.0, rel=0.07)
        recovering = shaft.speed_rad_s[20 + int(1e3 * 8.0 / 60.0)]
        assert 3.0 - recovering == pytest.approx(0.5 * math.exp(-1.0), rel=0.2)
        assert shaft.speed_rad_s[-1] == pytest.approx(3.0, abs=2e-3)


def test_a_set_point_that_is_no_number_stops_the_twin() -> None:
    with twin_rig(observers=1) as rig:
        rig.motor.enable()
        send(rig.others[0], cansimple.set_input_vel(0, math.nan))
        rig.run(0.2, speed_rad_s=1.0)
        assert "MISSING_INPUT" in (rig.motor.status().fault or "")


def test_driver_and_twin_also_work_over_python_cans_own_virtual_bus() -> None:
    clock = TwinClock()
    rotor = Rotor()
    with (
        VirtualBus(channel="test of odrive") as here,
        VirtualBus(channel="test of odrive") as there,
    ):
        sensor = NetFtTwin(datagram_link()[1], NetFtTwinSettings(), np.random.default_rng(1))
        clock.carry(TwinWorld(rotor, OdriveTwin(there, OdriveTwinSettings()), sensor).process)
        motor = OdriveMotor(here, clock, OdriveSettings(0))
        motor.enable()
        for _ in range(300):
            motor.command_speed(2.0)
            clock.wait_until(clock.now_s() + 2e-3)
        assert motor.read().speed_rad_s[-1] == pytest.approx(2.0, rel=1e-2)


def test_a_shut_end_of_the_wire_is_an_error_for_the_driver() -> None:
    with can_wire() as (here, _):
        motor = OdriveMotor(here, TwinClock(), OdriveSettings(0))
    with pytest.raises(DeviceError, match="is shut"):
        motor.read()
