"""MIT mode frames of AK drives against the vendor's packing, and the tables they are scaled by."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.devices.cubemars import codec as cubemars_drives
from rfca_rig.devices.cubemars.codec import MIT_RANGES, MitRanges, error_text, mit_ranges
from rfca_rig.devices.cubemars.codec.mit import (
    MitCommand,
    MitReply,
    Special,
    decode_command,
    decode_reply,
    encode_command,
    encode_reply,
    encode_special,
    nearest_speed,
    position_code,
    position_of,
)
from rfca_rig.errors import BadInput, DeviceError, MalformedFrame, NotEncodable

AK80_9 = MIT_RANGES["AK80-9"]
models = st.sampled_from(list(MIT_RANGES.values()))
shares = st.floats(0.0, 1.0)
DBC = Path(cubemars_drives.__file__).parent / "dbc"


def commanded(ranges: MitRanges, p: float, v: float, kp: float, kd: float, t: float) -> MitCommand:
    """Each field at a share of its range."""
    ends = (ranges.position_rad, ranges.speed_rad_s)
    signed = [
        end * (2.0 * share - 1.0)
        for end, share in zip((*ends, ranges.torque_Nm), (p, v, t), strict=True)
    ]
    return MitCommand(signed[0], signed[1], 500.0 * kp, 5.0 * kd, signed[2])


def vendor_packed(p: float, v: float, kp: float, kd: float, t: float, ranges: MitRanges) -> bytes:
    """The packing as the manual's and Katz's C code do it: fields cut off, then shifted byte by
    byte.
    """

    def cut(x: float, low: float, high: float, bits: int) -> int:
        return int((x - low) * ((1 << bits) - 1) / (high - low))

    pi = cut(p, -ranges.position_rad, ranges.position_rad, 16)
    vi = cut(v, -ranges.speed_rad_s, ranges.speed_rad_s, 12)
    ki = cut(kp, 0.0, 500.0, 12)
    di = cut(kd, 0.0, 5.0, 12)
    ti = cut(t, -ranges.torque_Nm, ranges.torque_Nm, 12)
    return bytes(
        [
            pi >> 8,
            pi & 255,
            vi >> 4,
            (vi & 15) << 4 | ki >> 8,
            ki & 255,
            di >> 4,
            (di & 15) << 4 | ti >> 8,
            ti & 255,
        ]
    )


@pytest.mark.parametrize(
    ("data", "values"),
    [
        ("7fff7ff0000007ff", (0.0, 0.0, 0.0, 0.0, 0.0)),
        ("8a3c8510a3199954", (1.0, 2.0, 20.0, 0.5, 3.0)),
    ],
)
def test_commands_of_other_senders_are_read_to_one_count(
    data: str, values: tuple[float, ...]
) -> None:
    assert vendor_packed(*values, AK80_9).hex() == data
    read = decode_command(AK80_9, bytes.fromhex(data))
    assert isinstance(read, MitCommand)
    counts = (25.0 / 65535, 100.0 / 4095, 500.0 / 4095, 5.0 / 4095, 36.0 / 4095)
    told = (
        read.position_rad,
        read.speed_rad_s,
        read.kp_Nm_per_rad,
        read.kd_Nm_s_per_rad,
        read.torque_Nm,
    )
    assert all(
        0.0 <= true - got < count for true, got, count in zip(values, told, counts, strict=True)
    )
    assert encode_command(AK80_9, read).hex() == data


def test_the_special_frames_are_the_documented_bytes() -> None:
    assert encode_special(Special.ENTER).hex() == "fffffffffffffffc"
    assert encode_special(Special.EXIT).hex() == "fffffffffffffffd"
    assert encode_special(Special.ZERO).hex() == "fffffffffffffffe"
    for special in Special:
        assert decode_command(AK80_9, encode_special(special)) is special


def test_a_command_with_everything_at_its_end_is_no_special_frame() -> None:
    highest = MitCommand(12.5, 50.0, 500.0, 5.0, 17.98)
    assert isinstance(decode_command(AK80_9, encode_command(AK80_9, highest)), MitCommand)


def test_a_reply_is_read_as_documented() -> None:
    reply = decode_reply(AK80_9, bytes.fromhex("05 8000 8007ff 47 02"))
    assert (reply.drive_id, reply.position_code, reply.temperature_degC, reply.error) == (
        5,
        0x8000,
        31,
        2,
    )
    assert reply.position_rad == pytest.approx(0.5 * 25.0 / 65535)
    assert reply.speed_rad_s == pytest.approx(0.5 * 100.0 / 4095)
    assert reply.torque_Nm == pytest.approx(-0.5 * 36.0 / 4095)


@pytest.mark.parametrize("length", [6, 7])
def test_firmware_without_temperature_and_error_is_read_too(length: int) -> None:
    reply = decode_reply(AK80_9, bytes.fromhex("05 ffff ffffff 18 02")[:length])
    assert (reply.temperature_degC, reply.error) == (None, None)
    assert (reply.position_rad, reply.speed_rad_s, reply.torque_Nm) == pytest.approx(
        (12.5, 50.0, 18.0)
    )


def test_older_firmware_sends_the_temperature_as_it_is() -> None:
    assert (
        decode_reply(
            MIT_RANGES["AK80-9-V2.0"], bytes([1, 128, 0, 128, 8, 0, 35, 0])
        ).temperature_degC
        == 35
    )


@given(models, shares, shares, shares, shares, shares)
def test_a_command_survives_to_half_a_count(
    ranges: MitRanges, p: float, v: float, kp: float, kd: float, t: float
) -> None:
    sent = commanded(ranges, p, v, kp, kd, t)
    got = decode_command(ranges, encode_command(ranges, sent))
    assert isinstance(got, MitCommand)
    all_on = (
        1.0 if min(p, v, kp, kd) > 1.0 - 0.51 / 4095 else 0.0
    )  # moved by one count lest it be a special frame
    assert (
        abs(got.position_rad - sent.position_rad)
        <= (0.5001 + all_on) * 2.0 * ranges.position_rad / 65535
    )
    assert abs(got.speed_rad_s - sent.speed_rad_s) <= 0.5001 * 2.0 * ranges.speed_rad_s / 4095
    assert abs(got.kp_Nm_per_rad - sent.kp_Nm_per_rad) <= 0.5001 * 500.0 / 4095
    assert abs(got.kd_Nm_s_per_rad - sent.kd_Nm_s_per_rad) <= 0.5001 * 5.0 / 4095
    assert abs(got.torque_Nm - sent.torque_Nm) <= 0.5001 * 2.0 * ranges.torque_Nm / 4095


@given(st.binary(min_size=8, max_size=8), models)
def test_every_eight_bytes_are_a_command_that_packs_to_them_again(
    data: bytes, ranges: MitRanges
) -> None:
    read = decode_command(ranges, data)
    assert (
        encode_special(read) if isinstance(read, Special) else encode_command(ranges, read)
    ) == data


@given(
    models,
    st.integers(1, 126),
    st.integers(0, 65535),
    shares,
    shares,
    st.integers(0, 200),
    st.integers(0, 7),
)
def test_a_reply_survives_to_one_count(
    ranges: MitRanges, drive: int, code: int, v: float, t: float, warmth: int, error: int
) -> None:
    speed = ranges.speed_rad_s * (2.0 * v - 1.0)
    torque = ranges.torque_Nm * (2.0 * t - 1.0)
    sent = MitReply(
        drive,
        code,
        position_of(ranges, code),
        speed,
        torque,
        warmth - ranges.temperature_offset_degC,
        error,
    )
    got = decode_reply(ranges, encode_reply(ranges, sent))
    assert (got.drive_id, got.position_code, got.position_rad) == (drive, code, sent.position_rad)
    assert (got.temperature_degC, got.error) == (sent.temperature_degC, error)
    assert 0.0 <= speed - got.speed_rad_s + 1e-9 <= 1.0001 * 2.0 * ranges.speed_rad_s / 4095
    assert 0.0 <= torque - got.torque_Nm + 1e-9 <= 1.0001 * 2.0 * ranges.torque_Nm / 4095


@given(models, st.floats(-200.0, 200.0))
def test_a_position_beyond_the_field_keeps_its_count(
    ranges: MitRanges, position_rad: float
) -> None:
    behind = position_rad - position_of(ranges, position_code(ranges, position_rad))
    assert -1e-9 <= behind <= 1.0001 * 2.0 * ranges.position_rad / 65535


@given(st.binary(max_size=64))
def test_no_bytes_make_a_decoder_raise_anything_but_its_own_error(data: bytes) -> None:
    for decode in (decode_command, decode_reply):
        try:
            decode(AK80_9, data)
        except MalformedFrame as error:
            assert isinstance(error, DeviceError)


@pytest.mark.parametrize("length", [0, 5, 9])
def test_a_wrong_length_is_a_malformed_frame(length: int) -> None:
    with pytest.raises(MalformedFrame, match=f"{length} bytes"):
        decode_reply(AK80_9, bytes(length))
    with pytest.raises(MalformedFrame, match=f"{length} bytes, expected 8"):
        decode_command(AK80_9, bytes(length))


@pytest.mark.parametrize(
    ("command", "said"),
    [
        (MitCommand(12.6, 0.0, 0.0, 0.0, 0.0), "position in rad 12.6 .* -12.5 and 12.5"),
        (MitCommand(0.0, -51.0, 0.0, 0.0, 0.0), "speed in rad/s -51 .* -50 and 50"),
        (MitCommand(0.0, 0.0, -1.0, 0.0, 0.0), "kp .* 0 and 500"),
        (MitCommand(0.0, 0.0, 0.0, 5.1, 0.0), "kd .* 0 and 5"),
        (MitCommand(0.0, 0.0, 0.0, 0.0, float("nan")), "torque in N m nan"),
    ],
)
def test_a_value_outside_its_range_is_refused_with_the_limits(
    command: MitCommand, said: str
) -> None:
    with pytest.raises(NotEncodable, match=said):
        encode_command(AK80_9, command)


def test_the_speed_that_a_command_carries_is_the_one_that_arrives() -> None:
    got = decode_command(AK80_9, encode_command(AK80_9, MitCommand(0.0, 3.249, 0.0, 5.0, 0.0)))
    assert isinstance(got, MitCommand)
    assert (
        got.speed_rad_s
        == nearest_speed(AK80_9, 3.249)
        == pytest.approx(3.249, abs=0.5 * 100.0 / 4095)
    )


def test_a_model_that_is_not_in_the_table_is_refused_with_those_that_are() -> None:
    with pytest.raises(BadInput, match=r"'AK80-65' is not known, known are .*AK80-64"):
        mit_ranges("AK80-65")


def test_errors_have_words_whatever_the_code() -> None:
    assert error_text(0) == "error 0 (none)"
    assert error_text(4).startswith("error 4 (supply voltage below")
    assert error_text(7) == "error 7 (motor stalled)"
    assert error_text(99) == "error 99 (not documented)"


@pytest.mark.parametrize("model", list(MIT_RANGES))
def test_the_shipped_database_is_the_one_of_the_table(model: str) -> None:
    assert (DBC / f"cubemars_mit_{model}.dbc").read_text() == cubemars_drives.mit_dbc(
        MIT_RANGES[model]
    )


@pytest.fixture(scope="module")
def databases():
    cantools = pytest.importorskip("cantools")
    return {
        model: cantools.database.load_file(DBC / f"cubemars_mit_{model}.dbc")
        for model in MIT_RANGES
    }


@given(st.sampled_from(list(MIT_RANGES)), st.binary(min_size=8, max_size=8))
def test_a_bus_monitor_reads_the_same_from_the_shipped_database(
    databases, model: str, data: bytes
) -> None:
    ranges = MIT_RANGES[model]
    command = decode_command(ranges, data)
    reply = decode_reply(ranges, data)
    seen = databases[model].get_message_by_name("MIT_Reply").decode(data, decode_choices=False)
    assert seen == pytest.approx(
        {
            "Drive_Id": reply.drive_id,
            "Position": reply.position_rad,
            "Speed": reply.speed_rad_s,
            "Torque": reply.torque_Nm,
            "Temperature": reply.temperature_degC,
            "Error": reply.error,
        }
    )
    if isinstance(command, MitCommand):
        values = (
            command.position_rad,
            command.speed_rad_s,
            command.kp_Nm_per_rad,
            command.kd_Nm_s_per_rad,
            command.torque_Nm,
        )
        told = dict(zip(("Position", "Speed", "Kp", "Kd", "Torque"), values, strict=True))
        assert databases[model].get_message_by_name("MIT_Command").decode(data) == pytest.approx(
            told
        )


@given(shares, shares, shares, shares, shares)
def test_a_bus_monitor_sends_what_the_codec_reads(
    databases, p: float, v: float, kp: float, kd: float, t: float
) -> None:
    sent = commanded(AK80_9, p, v, kp, kd, t)
    fields = {
        "Position": sent.position_rad,
        "Speed": sent.speed_rad_s,
        "Kp": sent.kp_Nm_per_rad,
        "Kd": sent.kd_Nm_s_per_rad,
    }
    data = databases["AK80-9"].encode_message(
        "MIT_Command", {**fields, "Torque": sent.torque_Nm}, strict=False
    )
    got = decode_command(AK80_9, data)
    if isinstance(got, MitCommand):
        assert got.speed_rad_s == pytest.approx(sent.speed_rad_s, abs=100.0 / 4095)
        assert got.torque_Nm == pytest.approx(sent.torque_Nm, abs=36.0 / 4095)


def test_a_drive_that_replies_under_its_own_id_has_a_database_of_its_replies() -> None:
    cantools = pytest.importorskip("cantools")
    database = cantools.database.load_string(
        cubemars_drives.mit_dbc(AK80_9, 7, reply_id=None), "dbc"
    )
    assert (
        database.decode_message(7, bytes.fromhex("07 8000 800800 47 05"))["Error"]
        == "encoder fault"
    )
    assert [message.name for message in database.messages] == ["MIT_Reply"]
