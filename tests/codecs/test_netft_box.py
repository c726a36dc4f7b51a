"""Command interface and configuration page of the ATI Net F/T."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.devices.netft import codec as nc
from rfca_rig.devices.netft.codec import (
    MAX_PAGE_BYTES,
    NetFtConfiguration,
    decode_configuration,
    encode_configuration,
)
from rfca_rig.errors import MalformedFrame, NotEncodable

# Bytes worked out by hand from the field tables of the manual: big-endian.
READ = bytes.fromhex("00 000000000000000000000000000000 0000 0000")
READ_AND_BIAS = bytes.fromhex("00 000000000000000000000000000000 0000 0001")
CALIBRATION = bytes.fromhex("01 00000000000000000000000000000000000000")
A_READING = bytes.fromhex("1234 8002 0001 ffff 7fff 8000 0000 0100")
A_CALIBRATION = bytes.fromhex("1234 02 03 000f4240 000f4240 2710 2710 7530 0400 0400 0400")

PAGE = b"""<?xml version="1.0"?><netft><runstat>0x00000000</runstat><runrate>7000</runrate><runft>1;2;3;4;5;6</runft>
<prodname>Net F/T</prodname><cfgcalsn>FT27462</cfgcalsn><scfgfu>N</scfgfu><scfgtu>Nm</scfgtu><cfgcpf>1000000</cfgcpf><cfgcpt>500000</cfgcpt>
<comrdte>Enabled</comrdte><comrdtrate>1000</comrdtrate><comrdtbsiz>40</comrdtbsiz><setuserfilter>3</setuserfilter></netft>"""

NAMES = st.sampled_from(["N", "lbf", "kN"]), st.sampled_from(["Nm", "lbf-in", "Nmm"])


def with_transformation(cfgtfx: str, distance: str = "mm", angle: str = "degrees") -> bytes:
    elements = (
        f"<cfgtfx>{cfgtfx}</cfgtfx><scfgtdu>{distance}</scfgtdu><scfgtau>{angle}</scfgtau></netft>"
    )
    return PAGE.replace(b"</netft>", elements.encode())


@pytest.mark.parametrize(
    ("page", "shift_mm", "turn_deg"),
    [
        (with_transformation("0;0;0;0;0;0"), (0, 0, 0), (0, 0, 0)),
        # Without a transformation the units mean nothing.
        (with_transformation("0;0;0;0;0;0;", "furlong", ""), (0, 0, 0), (0, 0, 0)),
        (with_transformation("1;-2;12.5;0;0;90"), (1, -2, 12.5), (0, 0, 90)),
        (with_transformation("0;0;1;0;0;0", "in"), (0, 0, 25.4), (0, 0, 0)),
        (with_transformation("0;0;0.1;0;0;0", "m"), (0, 0, 100), (0, 0, 0)),
        (with_transformation("0;0;0;0;3.14159265359;0", "mm", "radians"), (0, 0, 0), (0, 180, 0)),
    ],
)
def test_the_tool_transformation_is_read_in_its_units(page, shift_mm, turn_deg) -> None:
    read = decode_configuration(page).tool_transformation
    assert read.shift_mm == pytest.approx(shift_mm)
    assert read.turn_deg == pytest.approx(turn_deg)
    assert read.is_identity == (not any(shift_mm) and not any(turn_deg))
    configuration = decode_configuration(nc.encode_configuration(decode_configuration(page), {}))
    assert configuration.tool_transformation.is_close(read)


def test_a_page_without_a_tool_transformation_tells_none() -> None:
    assert decode_configuration(PAGE).tool_transformation is None


@pytest.mark.parametrize(
    ("page", "said"),
    [
        (with_transformation("1;2;3"), "cfgtfx is '1;2;3', must be six numbers"),
        (with_transformation("0;0;0;0;0;nan"), "must be six numbers"),
        (with_transformation("0;0;1;0;0;0", "furlong"), "scfgtdu is 'furlong', known are mm"),
        (with_transformation("0;0;1;0;0;0", "mm", ""), "lacks scfgtau"),
    ],
)
def test_a_tool_transformation_that_cannot_be_read_is_malformed(page, said) -> None:
    with pytest.raises(MalformedFrame, match=said):
        decode_configuration(page)


@pytest.mark.parametrize(
    ("page", "is_axia"),
    [
        (PAGE, False),
        (PAGE.replace(b">Net F/T<", b">Ethernet Axia80<"), True),
        (PAGE.replace(b"</netft>", b"<setiirshift>2</setiirshift></netft>"), True),
    ],
)
def test_an_axia_is_known_by_its_page(page, is_axia) -> None:
    assert decode_configuration(page).is_axia is is_axia


def test_a_filter_is_described_as_far_as_it_is_known() -> None:
    assert nc.describe_low_pass("0", False) == "off"
    assert nc.describe_low_pass("8", False) == "on, code 8, about 5 Hz (not verified)"
    assert "cut-off not known here" in nc.describe_low_pass("8", True)
    assert "cut-off not known here" in nc.describe_low_pass("13", False)
    assert nc.lag_of_low_pass_s("8", False) == pytest.approx(0.0318, abs=1e-4)
    assert nc.lag_of_low_pass_s("8", True) is None


def test_commands_are_the_documented_twenty_bytes() -> None:
    assert nc.encode_command(nc.ReadForce()) == READ
    assert nc.encode_command(nc.ReadForce(bias=True)) == READ_AND_BIAS
    assert nc.encode_command(nc.ReadForce(clear_latch=True))[-1] == 2
    assert nc.encode_command(nc.ReadCalibrationInfo()) == CALIBRATION
    assert len(READ) == len(CALIBRATION) == nc.COMMAND_BYTES


@pytest.mark.parametrize(
    "command",
    [
        nc.ReadForce(),
        nc.ReadForce(True, True),
        nc.ReadForce(clear_latch=True),
        nc.ReadCalibrationInfo(),
    ],
)
def test_a_command_survives_the_wire(command: nc.ReadForce | nc.ReadCalibrationInfo) -> None:
    assert nc.decode_command(nc.encode_command(command)) == command


def test_replies_are_read_as_documented() -> None:
    assert nc.decode_reading(A_READING) == nc.NetFtReading(0x8002, (1, -1, 32767, -32768, 0, 256))
    info = nc.decode_calibration(A_CALIBRATION)
    assert info == nc.CalibrationInfo(
        "N", "Nm", 1_000_000, 1_000_000, (10_000, 10_000, 30_000, 1024, 1024, 1024)
    )
    assert (info.counts_per_N, info.counts_per_Nm) == (1e6, 1e6)
    assert nc.encode_reading(nc.decode_reading(A_READING)) == A_READING
    assert nc.encode_calibration(info) == A_CALIBRATION


@given(*NAMES, *[st.integers(1, 2**32 - 1)] * 2, st.tuples(*[st.integers(0, 2**16 - 1)] * 6))
def test_calibration_info_survives_the_wire(
    force: str, torque: str, cpf: int, cpt: int, factors: tuple[int, ...]
) -> None:
    info = nc.CalibrationInfo(force, torque, cpf, cpt, factors)
    assert nc.decode_calibration(nc.encode_calibration(info)) == info


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (A_CALIBRATION[:-1], "of 23 bytes, expected 24"),
        (b"\x12\x35" + A_CALIBRATION[2:], "begins with 0x1235"),
        (A_CALIBRATION[:2] + b"\x07" + A_CALIBRATION[3:], "7 is no known code of a unit of force"),
        (A_CALIBRATION[:4] + bytes(4) + A_CALIBRATION[8:], "must be above 0"),
    ],
)
def test_calibration_info_that_cannot_be_is_malformed(data: bytes, said: str) -> None:
    with pytest.raises(MalformedFrame, match=said):
        nc.decode_calibration(data)


@pytest.mark.parametrize("data", [b"", READ[:-1], bytes([2]).ljust(20, b"\0")])
def test_what_is_no_command_that_reads_is_malformed(data: bytes) -> None:
    with pytest.raises(MalformedFrame):
        nc.decode_command(data)


def test_what_does_not_fit_its_field_is_refused() -> None:
    with pytest.raises(NotEncodable):
        nc.encode_reading(nc.NetFtReading(0, (40_000, 0, 0, 0, 0, 0)))
    with pytest.raises(NotEncodable):
        nc.encode_calibration(nc.CalibrationInfo("N", "Nm", 2**32, 1, (1,) * 6))
    with pytest.raises(NotEncodable):
        nc.encode_calibration(nc.CalibrationInfo("pound", "Nm", 1, 1, (1,) * 6))


@given(st.binary(max_size=40))
def test_no_bytes_make_a_decoder_raise_anything_but_its_own_error(data: bytes) -> None:
    for decoder in (
        nc.decode_command,
        nc.decode_reading,
        nc.decode_calibration,
        decode_configuration,
    ):
        try:
            decoder(data)
        except MalformedFrame:
            continue


def test_a_page_is_read_with_units_and_counts() -> None:
    says = decode_configuration(PAGE)
    assert says == NetFtConfiguration(
        "Net F/T", "FT27462", "N", "Nm", 1e6, 5e5, True, 1000.0, 7000.0, 40, "3"
    )
    assert (says.counts_per_N, says.counts_per_Nm) == (1e6, 5e5)


def test_counts_in_other_units_become_counts_per_newton() -> None:
    says = decode_configuration(
        PAGE.replace(b"<scfgfu>N<", b"<scfgfu>kN<").replace(b"<scfgtu>Nm<", b"<scfgtu>N-mm<")
    )
    assert says.counts_per_N == pytest.approx(1e3)
    assert says.counts_per_Nm == pytest.approx(5e8)


@pytest.mark.parametrize(
    ("asked_Hz", "decimation"),
    [(7000, 1), (1000, 7), (150, 46), (99, 70), (100, 70), (1, 7000), (6999, 1)],
)
def test_the_box_rounds_its_rate_up_to_one_it_can_do(asked_Hz: float, decimation: int) -> None:
    assert (
        replace(decode_configuration(PAGE), rdt_rate_Hz=asked_Hz).decimation(7000.0) == decimation
    )


@pytest.mark.parametrize("name", ["prodname", "scfgfu", "scfgtu", "cfgcpf", "cfgcpt"])
def test_a_page_without_what_forces_hang_on_is_malformed(name: str) -> None:
    with pytest.raises(MalformedFrame, match=f"lacks {name}"):
        decode_configuration(
            PAGE.replace(f"<{name}>".encode(), b"<other>").replace(
                f"</{name}>".encode(), b"</other>"
            )
        )


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b"<scfgfu>N<", b"<scfgfu>stone<", "'stone' is no known unit of force"),
        (b"<cfgcpf>1000000<", b"<cfgcpf>many<", "cfgcpf is 'many', must be a number above 0"),
        (b"<cfgcpf>1000000<", b"<cfgcpf>-1<", "must be a number above 0"),
        (b"<comrdtrate>1000<", b"<comrdtrate>nan<", "must be a number above 0"),
        (b"<comrdte>Enabled<", b"<comrdte>Maybe<", "expected Enabled or Disabled"),
        (b"netft", b"html", "begins with <html>"),
        (b"</netft>", b"", "is not XML"),
        (b"<netft>", b"<!DOCTYPE a><netft>", "no configuration page"),
    ],
)
def test_a_page_that_cannot_be_is_malformed(old: bytes, new: bytes, said: str) -> None:
    with pytest.raises(MalformedFrame, match=said):
        decode_configuration(PAGE.replace(old, new))


def test_a_page_beyond_measure_is_not_read() -> None:
    with pytest.raises(MalformedFrame):
        decode_configuration(PAGE + b" " * MAX_PAGE_BYTES)


@given(
    *NAMES,
    st.floats(1.0, 1e9),
    st.sampled_from([None, True, False]),
    st.sampled_from([None, 1.0, 7000.0]),
)
def test_a_page_survives_the_wire(
    force: str, torque: str, cpf: float, enabled: bool | None, rate: float | None
) -> None:
    says = NetFtConfiguration(
        "a box", "FT1", force, torque, float(f"{cpf:.10g}"), 2e6, enabled, rate
    )
    page = encode_configuration(says, {"runstat": "0x00000000"})
    assert decode_configuration(page) == says
    assert b"<runstat>0x00000000</runstat>" in page


@given(st.integers(0, len(PAGE) - 1), st.binary(max_size=10))
def test_a_damaged_page_is_refused_or_read(at: int, instead: bytes) -> None:
    try:
        decode_configuration(PAGE[:at] + instead + PAGE[at + 5 :])
    except MalformedFrame as error:
        assert "\n" not in str(error)
