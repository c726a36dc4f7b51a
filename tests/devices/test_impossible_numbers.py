"""Numbers that cannot be, in every field of every device: two reports in a row do not disturb,
the third names the signal.
"""

import struct
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import inf, nan

import can
import numpy as np
import pytest

from rfca_rig.clock import Clock, TwinClock
from rfca_rig.contracts.motor_rig import MotorRig, motor_rig
from rfca_rig.devices.cubemars.codec.servo import Packet
from rfca_rig.devices.cubemars.driver.servo import CubemarsServoMotor, ServoSettings
from rfca_rig.devices.cubemars.twin import CubemarsServoTwin, ServoTwinSettings
from rfca_rig.devices.moteus import codec as moteus
from rfca_rig.devices.moteus.codec import Register, Reply, Width
from rfca_rig.devices.moteus.driver import MoteusMotor, MoteusSettings
from rfca_rig.devices.moteus.twin import MoteusTwin, MoteusTwinSettings
from rfca_rig.devices.odrive.driver import OdriveMotor, OdriveSettings
from rfca_rig.devices.odrive.messages import OdriveCommand, OdriveFirmware
from rfca_rig.devices.odrive.twin import OdriveTwin, OdriveTwinSettings
from rfca_rig.drivers.drive_report import DriveReports, Report, ShaftGear
from rfca_rig.drivers.record_stream import Record, RecordStream
from rfca_rig.drivers.roles import ForceSamples, MotorStatus, ShaftMotor, ShaftSamples
from rfca_rig.engine.interfaces import Bench
from rfca_rig.engine.loop import Loop
from rfca_rig.errors import BadReading, Trip, Tripped
from rfca_rig.twins.wires import can_wire
from tests.devices.test_daq_ft import made
from tests.engine.obedient import Motor, Sensor
from tests.engine.test_trips import LIMITS

IMPOSSIBLE = (nan, inf, -inf, 1e30)
Alter = Callable[[can.Message], can.Message | None]


class AlteredBus(can.BusABC):
    """The driver's end of the wire. The next `left` frames that `alter` knows come altered; it
    returns None for all others.
    """

    def __init__(self, end: can.BusABC, alter: Alter) -> None:
        super().__init__(channel="altered")
        self.channel_info = "altered"
        self._end = end
        self._alter = alter
        self.left = 0

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        self._end.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message = self._end.recv(timeout)
        if message is not None and self.left > 0:
            altered = self._alter(message)
        else:
            altered = None
        if altered is None:
            return message, False
        self.left -= 1
        return altered, False


def with_data(message: can.Message, data: bytes) -> can.Message:
    return can.Message(
        arbitration_id=message.arbitration_id,
        data=data,
        is_extended_id=message.is_extended_id,
        is_fd=message.is_fd,
        bitrate_switch=message.bitrate_switch,
    )


def odrive_float(command: OdriveCommand, place: int, value: float) -> Alter:
    def alter(message: can.Message) -> can.Message | None:
        if message.arbitration_id & 0x1F != command or message.dlc != 8:
            return None
        numbers = list(struct.unpack("<ff", message.data))
        numbers[place] = value
        return with_data(message, struct.pack("<ff", *numbers))

    return alter


def moteus_register(register: Register, value: float) -> Alter:
    def alter(message: can.Message) -> can.Message | None:
        subframes = moteus.decode(message.data)
        if not any(isinstance(one, Reply) and one.register == register for one in subframes):
            return None
        changed = [
            Reply(register, Width.FLOAT, value)
            if isinstance(one, Reply) and one.register == register
            else one
            for one in subframes
        ]
        return with_data(message, moteus.encode(changed))

    return alter


def servo_field(place: int, count: int) -> Alter:
    def alter(message: can.Message) -> can.Message | None:
        if message.arbitration_id >> 8 != Packet.STATUS:
            return None
        fields = list(struct.unpack(">hhhbB", message.data))
        fields[place] = count
        return with_data(message, struct.pack(">hhhbB", *fields))

    return alter


SERVO = {"gear_ratio": 9.0, "pole_pairs": 21, "torque_constant_Nm_per_A": 0.115}
OLDER = {"dialect": OdriveFirmware.V0_5, "torque_constant_Nm_per_A": 0.5}


def odrive(bus: can.BusABC, clock: Clock) -> ShaftMotor:
    return OdriveMotor(bus, clock, OdriveSettings(0))


def older_odrive(bus: can.BusABC, clock: Clock) -> ShaftMotor:
    return OdriveMotor(bus, clock, OdriveSettings(0, **OLDER))


def moteus_motor(bus: can.BusABC, clock: Clock) -> ShaftMotor:
    return MoteusMotor(bus, clock, MoteusSettings())


def servo_motor(bus: can.BusABC, clock: Clock) -> ShaftMotor:
    return CubemarsServoMotor(bus, clock, ServoSettings(1, **SERVO))


TWINS = {
    odrive: lambda bus: OdriveTwin(bus, OdriveTwinSettings(temperature_period_s=0.01)),
    older_odrive: lambda bus: OdriveTwin(bus, OdriveTwinSettings(**OLDER)),
    moteus_motor: lambda bus: MoteusTwin(bus, MoteusTwinSettings()),
    servo_motor: lambda bus: CubemarsServoTwin(bus, ServoTwinSettings(**SERVO)),
}


@dataclass(frozen=True)
class Field:
    """`signal` is its name in the message, `alter` replaces its value in a frame."""

    driver: Callable[[can.BusABC, Clock], ShaftMotor]
    signal: str
    value: float
    alter: Alter

    @property
    def title(self) -> str:
        return f"{self.driver.__name__}-{self.signal.replace(' ', '-')}-{self.value:g}"


def fields_of_drives() -> Iterator[Field]:
    estimates = OdriveCommand.ENCODER_ESTIMATES
    temperatures = OdriveCommand.TEMPERATURES
    for value in IMPOSSIBLE:
        for place, signal in enumerate(("position", "speed")):
            yield Field(odrive, signal, value, odrive_float(estimates, place, value))
            yield Field(older_odrive, signal, value, odrive_float(estimates, place, value))
        yield Field(odrive, "torque", value, odrive_float(OdriveCommand.TORQUES, 1, value))
        yield Field(older_odrive, "current", value, odrive_float(OdriveCommand.IQ, 1, value))
        for place, signal in enumerate(("inverter temperature", "motor temperature")):
            yield Field(odrive, signal, value, odrive_float(temperatures, place, value))
        for register, signal in (
            (Register.POSITION, "position"),
            (Register.VELOCITY, "speed"),
            (Register.TORQUE, "torque"),
            (Register.MODE, "mode"),
            (Register.FAULT, "fault"),
            (Register.MILLISECOND_COUNTER, "millisecond counter"),
            (Register.TEMPERATURE, "board temperature"),
        ):
            yield Field(moteus_motor, signal, value, moteus_register(register, value))
    # All that 16 and 8 bits can carry beyond what the manual states.
    for place, signal, counts in (
        (1, "speed", (32_767, -32_768)),
        (2, "current", (6_001, -6_001, 32_767)),
        (3, "temperature", (-128,)),
    ):
        for count in counts:
            yield Field(servo_motor, signal, count, servo_field(place, count))


FIELDS = list(fields_of_drives())


@contextmanager
def altered_rig(field: Field) -> Iterator[tuple[MotorRig, AlteredBus]]:
    buses: list[AlteredBus] = []

    def driver(bus: can.BusABC, clock: Clock) -> ShaftMotor:
        buses.append(AlteredBus(bus, field.alter))
        return field.driver(buses[0], clock)

    with motor_rig(driver, TWINS[field.driver]) as rig:
        yield rig, buses[0]


@pytest.mark.parametrize("speed_rad_s", [0.0, 1.0], ids=["held", "moving"])
@pytest.mark.parametrize("field", FIELDS, ids=[field.title for field in FIELDS])
def test_a_field_of_a_drive(field: Field, speed_rad_s: float) -> None:
    with altered_rig(field) as (rig, bus):
        rig.motor.enable()
        rig.run(0.1, speed_rad_s=speed_rad_s)
        bus.left = 2
        samples = rig.run(0.1, speed_rad_s=speed_rad_s)
        assert bus.left == 0
        assert np.isfinite([samples.angle_rad, samples.speed_rad_s, samples.torque_Nm]).all()
        assert np.abs(samples.torque_Nm).max() < 100.0
        assert rig.motor.status().fault is None
        assert rig.motor.identity()["bad_reports"] == f"2 of {field.signal}"
        bus.left = 1000
        with pytest.raises(
            BadReading, match=f"the drive reports {field.signal} .*, 3 bad reports in a row"
        ):
            rig.run(0.1, speed_rad_s=speed_rad_s)
        rig.motor.disable()


# -- a drive of a lab: the base class, and one written from scratch
# --------------------------------------------------------------


class Gear(ShaftGear):
    gear_ratio = 1.0
    direction = 1
    zero_turns = 0.0


GOOD = Report(turns=0.0, turns_s=0.0, torque_Nm=0.1, is_on=True, state="on", temperature_C=30.0)
REPORT_FIELDS = {
    "turns": "position",
    "turns_s": "speed",
    "torque_Nm": "torque",
    "temperature_C": "temperature",
}


@pytest.mark.parametrize("period_s", [None, 1e-3], ids=["asked", "cyclic"])
@pytest.mark.parametrize("value", IMPOSSIBLE)
@pytest.mark.parametrize("name", REPORT_FIELDS)
def test_a_field_of_a_plugged_in_drive(name: str, value: float, period_s: float | None) -> None:
    bad = replace(GOOD, **{name: value})
    clock = TwinClock()
    told: list[Report] = []
    with can_wire() as (here, there):
        reports = DriveReports(here, clock, Gear(), period_s, lambda _: told.pop(0))

        def tell(*these: Report) -> None:
            for report in these:
                told.append(report)
                reports.note_query()
                clock.wait_until(clock.now_s() + 1e-3)
                there.send(can.Message(arbitration_id=1))
                reports.drain()

        tell(GOOD, bad, bad, GOOD, bad, bad, GOOD)
        samples = reports.samples()
        assert np.isfinite([samples.angle_rad, samples.speed_rad_s, samples.torque_Nm]).all()
        assert (reports.last.turns, reports.last.torque_Nm, reports.last.temperature_C) == (
            0.0,
            0.1,
            30.0,
        )
        assert reports.doubts is None
        tell(bad, bad)
        with pytest.raises(BadReading, match=f"the drive reports {REPORT_FIELDS[name]} "):
            tell(bad)


def test_what_a_drive_says_of_its_error_counts_though_its_numbers_are_none() -> None:
    with can_wire() as (here, there):
        told = [
            GOOD,
            replace(GOOD, turns=nan, is_on=False, state="fault", fault="0x7305 encoder lost"),
        ]
        reports = DriveReports(here, TwinClock(), Gear(), 1e-3, lambda _: told.pop(0))
        for _ in range(2):
            there.send(can.Message(arbitration_id=1))
            reports.drain()
        assert (reports.last.fault, reports.last.is_on, reports.last.turns) == (
            "0x7305 encoder lost",
            False,
            0.0,
        )


class OwnMotor(Motor):
    """Written from scratch: nothing checks its numbers before the loop. The next `left` ticks
    are bad.
    """

    def __init__(self, clock: TwinClock, name: str, value: float) -> None:
        super().__init__(clock)
        self._name = name
        self._value = value
        self.left = 0

    def read(self) -> ShaftSamples:
        samples = super().read()
        if self._name not in vars(samples):
            return samples
        self.left -= 1
        if self.left >= 0:
            return replace(samples, **{self._name: np.array([self._value])})
        return samples

    def status(self) -> MotorStatus:
        status = replace(super().status(), temperature_C=30.0)
        if self._name not in vars(status):
            return status
        self.left -= 1
        if self.left >= 0:
            return replace(status, **{self._name: self._value})
        return status


class OwnSensor(Sensor):
    """The same for a force sensor, in one of its six values."""

    left = 0
    axis = 0
    value = nan

    def read(self) -> ForceSamples:
        samples = super().read()
        self.left -= 1
        counts = samples.counts.astype(np.float64)
        if self.left >= 0:
            counts[:, self.axis] = self.value
        return replace(samples, counts=counts)


def stepped(
    motor: Motor, sensor: Sensor, clock: TwinClock, speed_rad_s: float
) -> Callable[[int], None]:
    """Makes so many ticks with all limits."""
    limits = replace(LIMITS, sensor_frozen_s=10.0, sensor_silent_s=1.0)
    loop = Loop(Bench(motor, sensor, motor, clock, is_real=False), limits)
    motor.enable()
    loop.begin()

    def step(ticks: int) -> None:
        for _ in range(ticks):
            loop.step_at_speed(speed_rad_s, 0.002)
        assert np.isfinite([loop.angle_rad, loop.speed_rad_s, loop.target_rad]).all()

    return step


@pytest.mark.parametrize("speed_rad_s", [0.0, 1.0], ids=["held", "moving"])
@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize(
    "name", ["angle_rad", "speed_rad_s", "torque_Nm", "temperature_C", "silent_s"]
)
def test_a_number_of_a_drive_that_a_lab_wrote(name: str, value: float, speed_rad_s: float) -> None:
    clock = TwinClock()
    motor = OwnMotor(clock, name, value)
    step = stepped(motor, Sensor(clock), clock, speed_rad_s)
    for _ in range(3):
        step(2)
        motor.left = 2
        step(3)
    motor.left = 3
    with pytest.raises(Tripped, match=f"the drive reports {name} ") as found:
        step(3)
    assert found.value.code == Trip.DRIVE_READING


@pytest.mark.parametrize("value", [nan, inf, -inf])
@pytest.mark.parametrize("axis", range(6))
def test_a_value_of_a_sensor_that_a_lab_wrote(axis: int, value: float) -> None:
    clock = TwinClock()
    sensor = OwnSensor(clock)
    sensor.axis = axis
    sensor.value = value
    step = stepped(Motor(clock), sensor, clock, 1.0)
    for _ in range(3):
        step(2)
        sensor.left = 2
        step(3)
    sensor.left = 3
    with pytest.raises(Tripped, match="the force sensor reports counts ") as found:
        step(3)
    assert found.value.code == Trip.SENSOR_READING


# -- force sensors
# --------------------------------------------------------------------------------------------------


class Keys:
    counts_per_N = counts_per_Nm = 1e3
    rate_Hz = 1000.0
    port = "a port"

    def model_dump(self) -> dict[str, object]:
        return {}


class Port:
    """A serial port that has one byte for each record."""

    def __init__(self) -> None:
        self.in_waiting = 0

    def read(self, size: int) -> bytes:
        self.in_waiting = 0
        return bytes(size)

    def write(self, _data: bytes) -> None:
        raise AssertionError("nothing is sent to it")

    def close(self) -> None:
        """Nothing is open."""


class OwnStream(RecordStream):
    make = "own"
    record_bytes = 1

    def __init__(self, port: Port, clock: TwinClock, records: list[Record]) -> None:
        self.records = records
        super().__init__(port, clock, Keys())

    def to_start(self) -> Sequence[tuple[bytes, bytes]]:
        return ()

    def to_stop(self) -> bytes:
        return b""

    def decode(self, _record: bytes) -> Record:
        return self.records.pop(0)


def with_bad(place: int, value: float, time_s: float | None) -> Record:
    counts = [float(axis) for axis in range(6)]
    if place == 6:
        return Record(counts, time_s=value)
    counts[place] = value
    return Record(counts, time_s=time_s)


@pytest.mark.parametrize("has_clock", [False, True], ids=["without-a-clock", "with-a-clock"])
@pytest.mark.parametrize("value", IMPOSSIBLE)
@pytest.mark.parametrize("place", range(7), ids=["fx", "fy", "fz", "tx", "ty", "tz", "record time"])
def test_a_field_of_a_plugged_in_sensor(
    place: int, value: float, has_clock: bool, request: pytest.FixtureRequest
) -> None:
    clock = TwinClock()
    port = Port()
    records = []
    stream = OwnStream(port, clock, records)
    stream.start()

    def tell(*are_bad: bool) -> ForceSamples:
        for is_bad in are_bad:
            clock.wait_until(clock.now_s() + 1e-3)
            time_s = clock.now_s() if has_clock or place == 6 else None
            records.append(
                with_bad(place, value, time_s) if is_bad else Record(tuple(range(6)), time_s=time_s)
            )
        port.in_waiting = len(are_bad)
        return stream.read()

    samples = tell(False, True, False, True, True, False)
    assert samples.counts.tolist() == [list(range(6))] * 3
    assert samples.device_s == pytest.approx([0.0, 0.002, 0.005])
    assert stream.health().malformed == 3
    if place < 6:
        signal = request.node.callspec.id.split("-")[0]
    else:
        signal = "record time"
    with pytest.raises(BadReading, match=f"the force sensor reports {signal} "):
        tell(True, True, True)


@pytest.mark.parametrize("value", [nan, inf])
def test_a_record_with_an_error_is_reported_as_such_whatever_its_counts_are(value: float) -> None:
    clock = TwinClock()
    port = Port()
    stream = OwnStream(port, clock, [Record([value] * 6, is_saturated=True)] * 5)
    stream.start()
    port.in_waiting = 5
    assert stream.read().status.tolist() == [0x80020000] * 5


@pytest.mark.parametrize("gage", range(6))
@pytest.mark.parametrize("value", [nan, inf, -inf])
def test_a_voltage_of_a_card(gage: int, value: float) -> None:
    rig = made()
    rig.sensor.start()
    rig.run(0.01)

    def spoil(samples: int) -> None:
        def tamper(blocks):
            for block in blocks:
                block.volts[:samples, gage] = value
            return blocks

        rig.sensor._gages.tamper = tamper

    spoil(2)
    assert np.abs(rig.run(0.01).counts).max() < 1e9
    spoil(3)
    with pytest.raises(BadReading, match="the force sensor reports voltage "):
        rig.run(0.01)
