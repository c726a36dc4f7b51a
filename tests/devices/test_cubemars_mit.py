"""The driver of an AK drive in MIT mode on its twin, over the bytes of the wire."""

import math
import re
from collections import deque
from contextlib import AbstractContextManager

import can
import numpy as np
import pytest
from can.interfaces.virtual import VirtualBus

from rfca_rig.clock import TwinClock
from rfca_rig.contracts.motor_rig import MotorRig, Rotor, concatenate_samples, drain, motor_rig
from rfca_rig.devices.cubemars.codec import MIT_RANGES
from rfca_rig.devices.cubemars.codec.mit import (
    MitCommand,
    Special,
    decode_command,
    decode_reply,
    encode_command,
    encode_special,
)
from rfca_rig.devices.cubemars.driver.mit import CubemarsMitMotor, MitSettings
from rfca_rig.devices.cubemars.twin import CubemarsMitTwin, MitTwinSettings
from rfca_rig.devices.netft.twin import NetFtTwin, NetFtTwinSettings
from rfca_rig.drivers.roles import ShaftSamples
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.twins.wires import can_wire, datagram_link
from rfca_rig.twins.world import TwinWorld

RANGES = MIT_RANGES["AK80-9"]
TURNED = {"direction": -1, "zero_rad": 2.25}


def send(bus: can.BusABC, data: bytes, drive_id: int = 1) -> None:
    bus.send(can.Message(arbitration_id=drive_id, data=data, is_extended_id=False))


def rig(
    rotor: Rotor | None = None, settings: MitSettings | None = None, **twin
) -> AbstractContextManager[MotorRig]:
    return motor_rig(
        lambda bus, clock: CubemarsMitMotor(bus, clock, settings or MitSettings(1, "AK80-9")),
        lambda bus: CubemarsMitTwin(bus, MitTwinSettings(**twin)),
        rotor,
    )


def orders_heard(bus: can.BusABC) -> list[MitCommand | Special]:
    return [
        decode_command(RANGES, message.data)
        for message in drain(bus)
        if message.arbitration_id == 1
    ]


def test_no_torque_is_ever_made_from_a_position_by_the_drive() -> None:
    with rig() as r:
        r.motor.enable()
        r.run(0.2, speed_rad_s=4.0)
        r.run(0.2, angle_rad=-3.0)
        r.motor.disable()
        commands = [order for order in orders_heard(r.observer) if isinstance(order, MitCommand)]
        assert len(commands) > 200
        assert {command.kp_Nm_per_rad for command in commands} == {0.0}


def test_gains_are_taken_off_before_the_mode_is_entered_and_before_it_is_left() -> None:
    with rig() as r:
        r.motor.enable()
        r.motor.disable()
        orders = orders_heard(r.observer)
        assert [order for order in orders if isinstance(order, Special)] == [
            Special.EXIT,
            Special.ENTER,
            Special.EXIT,
        ]
        for at, order in enumerate(orders):
            if isinstance(order, Special):
                assert orders[at - 1].kd_Nm_s_per_rad == 0.0
                assert abs(orders[at - 1].torque_Nm) < 0.005


@pytest.mark.slow
@pytest.mark.parametrize("model", list(MIT_RANGES))
def test_every_model_turns_at_the_speed_that_was_asked_for(model: str) -> None:
    with rig(settings=MitSettings(1, model), model=model) as r:
        r.motor.enable()
        r.run(0.5, speed_rad_s=3.249)
        began_rad = r.rotor.angle_rad
        r.run(1.0, speed_rad_s=3.249)
        assert r.rotor.angle_rad - began_rad == pytest.approx(3.249, abs=1e-3)
        assert r.motor.status().fault is None


def test_a_speed_between_two_codes_is_kept_by_what_goes_into_the_torque_field() -> None:
    """The speed field alone would leave 6 mrad/s; the driver's own loop is as good as off here."""
    with rig(settings=MitSettings(1, "AK80-9", angle_gain_per_s=1e-6)) as r:
        r.motor.enable()
        between_rad_s = 100.0 * 0.75 / 4095
        r.run(1.0, speed_rad_s=between_rad_s)
        assert r.rotor.speed_rad_s == pytest.approx(between_rad_s, abs=1e-3)


@pytest.mark.parametrize(
    "twin", [{"reply_id": None}, {"tells_errors": False}, {"reply_id": None, "tells_errors": False}]
)
def test_replies_count_whatever_id_and_length_the_firmware_gives_them(twin: dict) -> None:
    with rig(**twin) as r:
        r.motor.enable()
        shaft = r.run(0.5, speed_rad_s=2.0)
        assert shaft.angle_rad[-1] == pytest.approx(r.rotor.angle_rad, abs=6e-3)
        assert r.motor.status().fault is None
        assert r.motor.identity()["errors_told"] == (
            "yes" if twin.get("tells_errors", True) else "no"
        )
        assert r.motor.identity()["temperature_degC"] == (
            "31" if twin.get("tells_errors", True) else "unknown"
        )


def test_commands_heard_back_are_no_replies() -> None:
    with rig() as r:
        r.motor.enable()
        r.run(0.1, speed_rad_s=2.0)
        for order in (MitCommand(0.0, 1.0, 0.0, 5.0, 0.0), MitCommand(-12.5, 1.0, 0.0, 5.0, 0.0)):
            send(r.observer, encode_command(RANGES, order))
        send(r.observer, encode_special(Special.EXIT))
        assert len(r.motor.read().angle_rad) == 0
        assert r.motor.status().fault is None


def test_a_position_that_stops_at_the_end_of_its_range_is_a_fault_not_an_angle() -> None:
    with rig(Rotor(angle_rad=11.0), wraps=False) as r:
        r.motor.enable()
        r.run(1.0, speed_rad_s=3.0)
        assert re.search(
            (
                r"end of its range \(code 65535\) while the shaft turns: this firmware does "
                r"not count on"
            ),
            r.motor.status().fault,
        )


def test_passing_the_end_of_the_range_is_none_where_the_firmware_wraps() -> None:
    for speed_rad_s in (0.05, 0.6, 20.0):
        with rig(Rotor(angle_rad=12.5 - 0.2 * speed_rad_s)) as r:
            r.motor.enable()
            r.run(1.0, speed_rad_s=speed_rad_s)
            assert r.rotor.angle_rad > 12.5
            assert r.motor.status().fault is None


@pytest.mark.parametrize("by_rad", [0.698, -0.698, 3.0])
def test_an_encoder_that_slips_by_a_ninth_of_a_turn_is_a_fault(by_rad: float) -> None:
    with rig() as r:
        r.motor.enable()
        r.run(0.1, speed_rad_s=3.0)
        r.twin.leap(by_rad)
        r.run(0.01, speed_rad_s=3.0)
        assert re.search(
            r"position leapt by -?\d+ counts within 2\.0 ms.*encoder slipped",
            r.motor.status().fault,
        )
        r.motor.disable()
        assert r.motor.status().fault is None


def test_a_model_with_another_scale_is_found_out_by_its_motion() -> None:
    with rig(settings=MitSettings(1, "AK80-9-V2.0"), model="AK80-9") as r:
        r.motor.enable()
        r.run(2.0, speed_rad_s=3.0)
        assert re.search(
            r"speed that the drive reports is 0\.51 times that of its angle; check model",
            r.motor.status().fault,
        )


def test_a_drive_in_servo_mode_is_explained() -> None:
    with pytest.raises(
        DeviceError,
        match="drive 1 sends status frames of servo mode; check that it is set to MIT mode",
    ):
        enabled_beside(can.Message(arbitration_id=0x2901, data=bytes(8), is_extended_id=True))


def test_a_wrong_id_is_explained_with_the_ids_that_are_there() -> None:
    with rig(drive_id=4) as r, pytest.raises(DeviceError, match="no frames at all"):
        r.motor.enable()
    with pytest.raises(DeviceError, match="frames of 4 but no reply from drive 1; check drive_id"):
        enabled_beside(can.Message(arbitration_id=0, data=b"\x04" + bytes(7), is_extended_id=False))


def test_a_foreign_master_id_is_explained() -> None:
    with pytest.raises(DeviceError, match="drive 1 replies under id 17; check its master id"):
        enabled_beside(
            can.Message(arbitration_id=17, data=b"\x01" + bytes(7), is_extended_id=False)
        )


def enabled_beside(said: can.Message) -> None:
    """Enables a drive on a bus where that is all that is said."""
    clock = TwinClock()
    with can_wire() as (here, there):
        clock.carry(lambda _: there.send(said))
        CubemarsMitMotor(here, clock, MitSettings(1, "AK80-9")).enable()


def test_a_drive_that_moves_when_energised_is_let_go() -> None:
    with rig(Rotor(inertia_kg_m2=1e-3), settings=MitSettings(1, "AK80-9", direction=-1)) as r:
        with pytest.raises(DeviceError, match=r"the shaft moved by -?\d\.\d\d rad when energised"):
            pushed_while_enabling(r, -30.0)
        r.tick()
        assert r.rotor.drives[-1][1].torque_Nm(1.0, 1.0) == 0.0


def pushed_while_enabling(r: MotorRig, load_Nm: float) -> None:
    """By a load that begins with the drive's torque."""
    r.clock.carry(
        lambda _: setattr(
            r.rotor, "load_Nm", load_Nm if r.rotor.drives[-1][1].speed_gain_Nm_s_per_rad else 0.0
        )
    )
    r.motor.enable()


def off_s(r: MotorRig, shaft: ShaftSamples) -> np.ndarray:
    """By how much each time stamp is wrong, from where the rotor truly was."""
    times_s, angles_rad, _ = np.array(r.turned).T
    stamped_s = shaft.device_s + r.motor._reports._first_s
    return np.abs(np.interp(shaft.angle_rad, angles_rad, times_s) - stamped_s)


def test_after_a_lost_reply_times_are_a_tick_off_for_20_ms_and_right_again() -> None:
    with rig() as r:
        r.motor.enable()
        r.run(0.5, speed_rad_s=3.0)
        blocks = []
        for _ in range(5):
            r.motor.command_speed(3.0)
            r.tick(deaf=True)
            blocks.append(r.run(0.2, speed_rad_s=3.0))
        wrong_s = off_s(r, concatenate_samples(blocks))
        assert wrong_s.max() < 2.3e-3
        assert (wrong_s > 0.3e-3).sum() <= 5 * 11
        assert r.motor.identity()["replies_lost"] == "5"


class Slow(can.BusABC):
    """The driver's end behind an adapter that holds frames back for a while, now and then, in
    order.
    """

    def __init__(self, bus: can.BusABC, clock: TwinClock) -> None:
        super().__init__(channel="slow")
        self.channel_info = "slow"
        self._bus = bus
        self._clock = clock
        self._held = deque()
        self._count = 0

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._bus.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:  # noqa: ARG002
        for message in drain(self._bus):
            self._count += 1
            self._held.append(
                (self._clock.now_s() + (0.011 if self._count % 50 == 0 else 0.0), message)
            )
        ready = self._held and self._held[0][0] <= self._clock.now_s()
        return (self._held.popleft()[1] if ready else None), False


def test_replies_that_come_late_keep_the_times_at_which_they_were_asked_for() -> None:
    made = motor_rig(
        lambda bus, clock: CubemarsMitMotor(Slow(bus, clock), clock, MitSettings(1, "AK80-9")),
        lambda bus: CubemarsMitTwin(bus, MitTwinSettings()),
    )
    with made as r:
        r.motor.enable()
        r.run(0.5, speed_rad_s=3.0)
        shaft = r.run(1.0, speed_rad_s=3.0)
        assert np.diff(shaft.host_s).max() > 9e-3
        assert off_s(r, shaft).max() < 0.3e-3
        assert r.motor.identity()["replies_lost"] == "0"
        assert r.rotor.speed_rad_s == pytest.approx(3.0, abs=0.05)


def test_a_reply_that_is_still_on_its_way_is_not_lost() -> None:
    clock = TwinClock()
    later = []
    with can_wire() as (here, there):
        motor = CubemarsMitMotor(here, clock, MitSettings(1, "AK80-9"))
        reply = can.Message(
            arbitration_id=0, data=bytes.fromhex("01 8000 800800 47 00"), is_extended_id=False
        )
        motor.disable()  # two frames
        there.send(reply)
        clock.wait_until(1e-3)
        assert motor.read().device_s.tolist() == [0.0]
        assert motor.status().silent_s == pytest.approx(1e-3)
        there.send(reply)
        clock.wait_until(0.5)
        later = motor.read()
        assert len(later.device_s) == 0  # asked at one moment with the first: the same again
        assert motor.status().silent_s == 0.0
        assert motor.identity()["replies_lost"] == "0"


def test_a_drive_that_was_asked_nothing_is_not_silent() -> None:
    with rig() as r:
        r.motor.enable()
        r.motor.disable()
        r.run(2.0)
        assert r.motor.status().silent_s == 0.0
        assert r.motor.status().fault is None


def test_a_reply_of_wrong_length_is_an_error_and_what_came_before_is_kept() -> None:
    clock = TwinClock()
    with can_wire() as (here, there):
        motor = CubemarsMitMotor(here, clock, MitSettings(1, "AK80-9"))
        motor.disable()
        for data in ("01 8000 800800 47 00", "01 8000"):
            there.send(
                can.Message(arbitration_id=0, data=bytes.fromhex(data), is_extended_id=False)
            )
        with pytest.raises(DeviceError, match="3 bytes, expected 6, 7 or 8"):
            motor.read()
        assert len(motor.read().angle_rad) == 1


@pytest.mark.parametrize(
    "act", [lambda motor: motor.command_speed(1.0), lambda motor: motor.command_angle(1.0)]
)
def test_a_command_before_enabling_is_refused_and_not_sent(act) -> None:
    with can_wire() as (here, there):
        with pytest.raises(DeviceError, match="not enabled; nothing was sent"):
            act(CubemarsMitMotor(here, TwinClock(), MitSettings(1, "AK80-9")))
        assert drain(there) == []


def test_a_speed_beyond_the_range_is_refused_and_an_angle_far_away_is_not() -> None:
    with rig(settings=MitSettings(1, "AK80-64"), model="AK80-64") as r:
        r.motor.enable()
        with pytest.raises(
            DeviceError, match=r"commanded speed 8\.5 rad/s, limit 8 \(AK80-64\); nothing was sent"
        ):
            r.motor.command_speed(8.5)
        r.run(3.0, angle_rad=10.0)
        assert r.rotor.angle_rad == pytest.approx(10.0, abs=2e-3)


def test_nothing_winds_up_where_the_drive_gives_all_it_has() -> None:
    with rig() as r:
        r.motor.enable()
        r.run(0.3, speed_rad_s=3.0)
        r.rotor.load_Nm = -25.0  # more than the 18 N m of this model
        r.run(0.3, speed_rad_s=3.0)
        r.rotor.load_Nm = 0.0
        shaft = r.run(1.0, speed_rad_s=3.0)
        assert shaft.speed_rad_s.max() < 3.0 + 18.0 / 5.0 + 0.1
        assert r.rotor.speed_rad_s == pytest.approx(3.0, abs=0.01)


def test_a_supply_that_is_cut_by_silence_is_proof_enough() -> None:
    with rig() as r:
        r.motor.enable()
        r.run(0.1, angle_rad=0.3)
        r.twin._mute_until_s = math.inf
        assert r.motor.prove_watchdog(0.3) == pytest.approx(0.32, abs=0.01)


@pytest.mark.parametrize(
    ("load_Nm", "said"),
    [
        (0.0, "not proven: the motor held 0.0.. N m, too little to see it let go .*park the leg"),
        (0.5, "no watchdog that stopped it within 0.3 s"),
    ],
)
def test_what_is_wrong_with_the_watchdog_is_told_with_what_to_do(load_Nm: float, said: str) -> None:
    with rig() as r:
        r.motor.enable()
        r.rotor.load_Nm = load_Nm
        r.run(0.2, angle_rad=0.3)
        with pytest.raises(DeviceError, match=said + ".*relay into its supply"):
            r.motor.prove_watchdog(0.3)


def test_the_twins_watchdog_takes_the_command_away_and_stays_in_the_mode() -> None:
    with rig(watchdog_s=0.025) as r:
        r.motor.enable()
        r.run(0.2, speed_rad_s=3.0)
        r.run(0.1)
        assert r.rotor.drives[-1][1].torque_Nm(0.0, 10.0) == 0.0
        r.motor.command_speed(3.0)
        r.tick()
        assert r.rotor.drives[-1][1].speed_gain_Nm_s_per_rad > 0.0


def test_the_twin_remembers_its_last_command_over_leaving_the_mode() -> None:
    with rig() as r:
        send(r.observer, encode_command(RANGES, MitCommand(0.0, 0.0, 0.0, 0.0, 2.0)))
        r.tick()
        assert r.rotor.drives[-1][1].torque_Nm(0.0, 0.0) == 0.0
        send(r.observer, encode_special(Special.ENTER))
        r.tick()
        assert r.rotor.drives[-1][1].torque_Nm(0.0, 0.0) == pytest.approx(2.0, abs=0.01)


def test_the_twin_goes_to_a_position_where_someone_asks_for_one() -> None:
    with rig() as r:
        send(r.observer, encode_special(Special.ENTER))
        for _ in range(1000):
            send(r.observer, encode_command(RANGES, MitCommand(1.0, 0.0, 100.0, 2.0, 0.0)))
            r.tick()
        assert r.rotor.angle_rad == pytest.approx(1.0, abs=1e-3)


def test_zeroing_makes_the_present_position_zero_and_mutes_the_twin_for_a_second() -> None:
    with rig() as r:
        send(r.observer, encode_special(Special.ZERO))
        r.tick()
        drain(r.observer)
        send(r.observer, encode_special(Special.EXIT))
        r.tick()
        assert drain(r.observer) == []
        r.clock.wait_until(1.1)
        send(r.observer, encode_special(Special.EXIT))
        r.tick()
        assert decode_reply(RANGES, drain(r.observer)[0].data).position_rad == pytest.approx(
            0.0, abs=4e-4
        )


def test_the_twin_ignores_what_is_not_for_it_or_cannot_be_read() -> None:
    with rig() as r:
        r.observer.send(can.Message(arbitration_id=1, data=bytes(7), is_extended_id=False))
        r.observer.send(can.Message(arbitration_id=1, data=bytes(8), is_extended_id=True))
        r.observer.send(can.Message(arbitration_id=2, data=bytes(8), is_extended_id=False))
        r.observer.send(
            can.Message(arbitration_id=1, is_remote_frame=True, dlc=8, is_extended_id=False)
        )
        r.tick()
        assert drain(r.observer) == []


@pytest.mark.parametrize(
    "wrong",
    [
        {"drive_id": 0},
        {"drive_id": 127},
        {"model": "AK7"},
        {"direction": 2},
        {"zero_rad": math.nan},
        {"speed_gain_Nm_s_per_rad": 5.1},
        {"angle_gain_per_s": 0.0},
        {"reply_timeout_s": -1.0},
    ],
)
def test_settings_that_cannot_be_are_refused_by_name(wrong: dict) -> None:
    with pytest.raises(BadInput, match=next(iter(wrong))):
        MitSettings(**{"drive_id": 1, "model": "AK80-9", **wrong})


def test_driver_and_twin_also_work_over_python_cans_own_virtual_bus() -> None:
    clock = TwinClock()
    rotor = Rotor()
    with (
        VirtualBus(channel="test of an AK drive") as here,
        VirtualBus(channel="test of an AK drive") as there,
    ):
        sensor = NetFtTwin(datagram_link()[1], NetFtTwinSettings(), np.random.default_rng(1))
        clock.carry(TwinWorld(rotor, CubemarsMitTwin(there, MitTwinSettings()), sensor).process)
        motor = CubemarsMitMotor(here, clock, MitSettings(1, "AK80-9"))
        motor.enable()
        for _ in range(300):
            motor.command_speed(2.0)
            clock.wait_until(clock.now_s() + 2e-3)
        assert motor.read().speed_rad_s[-1] == pytest.approx(2.0, abs=0.05)
