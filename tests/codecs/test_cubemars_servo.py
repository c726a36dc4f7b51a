"""Servo mode frames of AK drives against the documented layout."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.devices.cubemars import codec as cubemars_drives
from rfca_rig.devices.cubemars.codec import servo
from rfca_rig.devices.cubemars.codec.servo import OriginMode, Packet, Status
from rfca_rig.errors import DeviceError, MalformedFrame, NotEncodable

DBC = Path(cubemars_drives.__file__).parent / "dbc" / "cubemars_servo.dbc"

GOLDEN = [
    (servo.set_duty(0x68, 0.2), 0x068, "00004e20", servo.SetDuty(0.2)),
    (servo.set_duty(0x68, -0.2), 0x068, "ffffb1e0", servo.SetDuty(-0.2)),
    (servo.set_current(0x68, 5.0), 0x168, "00001388", servo.SetCurrent(5.0)),
    (servo.set_current(0x68, -5.0), 0x168, "ffffec78", servo.SetCurrent(-5.0)),
    (servo.set_current_brake(0x68, 5.0), 0x268, "00001388", servo.SetCurrentBrake(5.0)),
    (servo.set_speed(0x68, 1000.0), 0x368, "000003e8", servo.SetSpeed(1000)),
    (servo.set_position(0x68, 180.0), 0x468, "001b7740", servo.SetPosition(180.0)),
    (servo.set_origin(0x68, OriginMode.PERMANENT), 0x568, "01", servo.SetOrigin(1)),
    (
        servo.set_position_speed(0x68, 180.0, 5000.0, 30000.0),
        0x668,
        "001b774001f40bb8",
        servo.SetPositionSpeed(180.0, 5000, 30000),
    ),
    (
        servo.status(0x68, Status(-20000, -3210.0, 1.25, -7, 3)),
        0x2968,
        "b1e0febf007df903",
        Status(-20000, -3210.0, 1.25, -7, 3),
    ),
]


@pytest.mark.parametrize(
    ("frame", "arbitration_id", "data", "message"), GOLDEN, ids=lambda value: type(value).__name__
)
def test_documented_bytes(
    frame: servo.Frame, arbitration_id: int, data: str, message: servo.Message
) -> None:
    assert frame == (arbitration_id, bytes.fromhex(data))
    assert servo.drive_of(arbitration_id) == 0x68
    read = servo.decode(arbitration_id, bytes.fromhex(data))
    assert type(read) is type(message)
    assert [getattr(read, name) for name in read.__slots__] == pytest.approx(
        [getattr(message, name) for name in message.__slots__]
    )


def test_a_position_is_counted_in_ten_thousandths_of_a_degree() -> None:
    """Older printings of the manual have a millionth, one public driver a tenth."""
    assert int.from_bytes(servo.set_position(1, 90.0)[1], "big") == 900_000


@pytest.mark.parametrize("packet", [0x2C, 0x09, 0x08, 0x12345])
def test_a_packet_that_is_not_used_here_is_nothing(packet: int) -> None:
    assert servo.decode(packet << 8 | 1, bytes.fromhex("fafbfcfd")) is None


@pytest.mark.parametrize("length", [0, 3, 7])
@pytest.mark.parametrize("packet", list(Packet))
def test_a_wrong_length_is_a_malformed_frame(packet: Packet, length: int) -> None:
    with pytest.raises(MalformedFrame, match=f"{packet.name}.* {length} bytes, expected"):
        servo.decode(packet << 8 | 1, bytes(length))


@given(
    st.integers(0, 2**29 - 1) | st.sampled_from([packet << 8 | 1 for packet in Packet]),
    st.binary(max_size=64),
)
def test_no_bytes_make_the_decoder_raise_anything_but_its_own_error(
    arbitration_id: int, data: bytes
) -> None:
    try:
        servo.decode(arbitration_id, data)
    except MalformedFrame as error:
        assert isinstance(error, DeviceError)


@given(
    st.integers(0, 255),
    st.floats(-36_000.0, 36_000.0),
    st.integers(-32767, 32767),
    st.integers(-32767, 32767),
)
def test_positions_and_their_limits_survive_the_wire(
    drive: int, position: float, speed: int, rate: int
) -> None:
    assert servo.decode(*servo.set_position(drive, position)).position_deg == pytest.approx(
        position, abs=0.50001e-4
    )
    got = servo.decode(*servo.set_position_speed(drive, position, 10.0 * speed, 10.0 * rate))
    assert (got.speed_erpm, got.acceleration_erpm_s) == (10 * speed, 10 * rate)
    assert got.position_deg == pytest.approx(position, abs=0.50001e-4)


@given(st.floats(-60.0, 60.0), st.floats(-100_000.0, 100_000.0), st.floats(-1.0, 1.0))
def test_currents_speeds_and_duties_survive_to_half_a_step(
    current: float, speed: float, duty: float
) -> None:
    assert servo.decode(*servo.set_current(1, current)).current_A == pytest.approx(
        current, abs=0.50001e-3
    )
    assert servo.decode(*servo.set_current_brake(1, current)).current_A == pytest.approx(
        current, abs=0.50001e-3
    )
    assert servo.decode(*servo.set_speed(1, speed)).speed_erpm == pytest.approx(speed, abs=0.50001)
    assert servo.decode(*servo.set_duty(1, duty)).duty == pytest.approx(duty, abs=0.50001e-5)


i16 = st.integers(-(2**15), 2**15 - 1)


@given(
    st.integers(0, 255),
    i16,
    st.integers(-32767, 32767),
    st.integers(-32767, 32767),
    st.integers(-128, 127),
    st.integers(0, 255),
)
def test_a_status_survives_the_wire(
    drive: int, position: int, speed: int, current: int, warmth: int, error: int
) -> None:
    report = Status(position, 10.0 * speed, 0.01 * current, warmth, error)
    assert servo.decode(*servo.status(drive, report)) == report


@pytest.mark.parametrize(
    ("act", "said"),
    [
        (lambda: servo.set_position(1, 36_001.0), "position in degrees 36001 .* limit 36000"),
        (lambda: servo.set_position(1, float("nan")), "position in degrees nan"),
        (lambda: servo.set_current(1, 61.0), "limit 60"),
        (lambda: servo.set_speed(1, -100_001.0), "limit 100000"),
        (lambda: servo.set_position_speed(1, 0.0, 4e5, 0.0), "limit 327670"),
        (lambda: servo.set_speed(256, 0.0), "drive id 256"),
        (lambda: servo.status(1, Status(40_000, 0.0, 0.0, 0, 0)), "STATUS"),
    ],
)
def test_a_value_outside_its_field_is_refused_with_the_limit(act, said: str) -> None:
    with pytest.raises(NotEncodable, match=said):
        act()


def test_the_shipped_database_is_the_one_of_the_codec() -> None:
    assert DBC.read_text() == cubemars_drives.servo_dbc()


@pytest.fixture(scope="module")
def database():
    return pytest.importorskip("cantools").database.load_file(DBC)


@given(st.sampled_from(list(Packet)), st.binary(min_size=8, max_size=8))
def test_a_bus_monitor_reads_the_same_from_the_shipped_database(
    database, packet: Packet, data: bytes
) -> None:
    frame = next(message for message in database.messages if message.frame_id == packet << 8 | 1)
    assert frame.is_extended_frame
    seen = frame.decode(data[: frame.length], decode_choices=False)
    message = servo.decode(packet << 8 | 1, data[: frame.length])
    told = [getattr(message, name) for name in message.__slots__]
    if packet is Packet.STATUS:
        told[0] *= servo.STATUS_DEG
    assert list(seen.values()) == pytest.approx(told)
