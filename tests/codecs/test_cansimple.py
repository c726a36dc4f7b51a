"""ODrive CANSimple frames against the documented layouts."""

import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.devices.odrive import codec as cs
from rfca_rig.devices.odrive import messages as om
from rfca_rig.devices.odrive.messages import error_text, part_error_text, result_text, state_text
from rfca_rig.errors import DeviceError, MalformedFrame, NotEncodable

# Bytes worked out by hand from the field tables of the protocol: little-endian, node 3 unless said
# otherwise.
GOLDEN = [
    (cs.version(3, om.Version((0, 6, 10), (4, 4, 58))), 0x060, "02 04 04 3a 00 06 0a 00"),
    (cs.heartbeat(3, om.Heartbeat(0x01000000, 1, 3, True)), 0x061, "00 00 00 01 01 03 01 00"),
    (cs.estop(3), 0x062, ""),
    (cs.errors(3, om.ErrorReport(0x02000000, 0x200)), 0x063, "00 00 00 02 00 02 00 00"),
    (cs.set_axis_state(3, om.AxisState.CLOSED_LOOP), 0x067, "08 00 00 00"),
    (cs.encoder_estimates(3, 1.0, -0.5), 0x069, "00 00 80 3f 00 00 00 bf"),
    (cs.set_controller_mode(3, om.ControlMode.VELOCITY), 0x06B, "02 00 00 00 01 00 00 00"),
    (cs.set_input_pos(3, 2.0, -1.0, 0.256), 0x06C, "00 00 00 40 18 fc 00 01"),
    (cs.set_input_vel(3, 1.5, 0.0), 0x06D, "00 00 c0 3f 00 00 00 00"),
    (cs.set_input_torque(3, -2.0), 0x06E, "00 00 00 c0"),
    (cs.iq(3, 4.0, 0.25), 0x074, "00 00 80 40 00 00 80 3e"),
    (cs.temperatures(3, 32.0, 64.0), 0x075, "00 00 00 42 00 00 80 42"),
    (cs.bus_voltage_current(3, 24.0, 1.0), 0x077, "00 00 c0 41 00 00 80 3f"),
    (cs.clear_errors(3), 0x078, "00"),
    (cs.torques(3, 8.0, -8.0), 0x07C, "00 00 00 41 00 00 00 c1"),
    (cs.set_axis_state(62, om.AxisState.IDLE), 0x7C7, "01 00 00 00"),
    (cs.read_endpoint(3, 0x1234), 0x064, "00 34 12 00"),
    (cs.write_endpoint(3, 0x1234, bytes.fromhex("cd cc cc 3d")), 0x064, "01 34 12 00 cd cc cc 3d"),
    (cs.write_endpoint(3, 201, b"\x01"), 0x064, "01 c9 00 00 01"),
    (cs.endpoint_value(3, 201, b"\x01"), 0x065, "00 c9 00 00 01 00 00 00"),
    (cs.address(63, om.Address(3, 0x0123456789AB)), 0x7E6, "03 ab 89 67 45 23 01"),
    (cs.reboot(3, om.RebootAction.SAVE_CONFIGURATION), 0x076, "01"),
]


@pytest.mark.parametrize(("frame", "arbitration_id", "data"), GOLDEN)
def test_a_frame_has_the_documented_id_and_bytes(
    frame: cs.Frame, arbitration_id: int, data: str
) -> None:
    assert frame == (arbitration_id, bytes.fromhex(data))


@pytest.mark.parametrize(
    ("command", "data", "message"),
    [
        (0x00, "02 04 04 3a 00 06 0a 00", om.Version((0, 6, 10), (4, 4, 58))),
        (0x01, "00 00 00 01 01 03 01 ff", om.Heartbeat(0x01000000, 1, 3, True)),
        (0x01, "00 00 00 00 08 00 fe 00", om.Heartbeat(0, 8, 0, False)),
        (0x02, "", om.Estop()),
        (0x03, "00 00 00 02 00 02 00 00", om.ErrorReport(0x02000000, 0x200)),
        (0x07, "08 00 00 00", om.SetAxisState(8)),
        (0x07, "08 00 00 00 00 00 00 00", om.SetAxisState(8)),
        (0x09, "00 00 80 3f 00 00 00 bf", om.EncoderEstimates(1.0, -0.5)),
        (0x0B, "02 00 00 00 01 00 00 00", om.SetControllerMode(2, 1)),
        (0x0C, "00 00 00 40 18 fc 00 01", om.SetInputPos(2.0, -1.0, 0.256)),
        (0x0D, "00 00 c0 3f 00 00 00 00", om.SetInputVel(1.5, 0.0)),
        (0x0E, "00 00 00 c0", om.SetInputTorque(-2.0)),
        (0x14, "00 00 80 40 00 00 80 3e", om.Iq(4.0, 0.25)),
        (0x15, "00 00 00 42 00 00 80 42", om.Temperatures(32.0, 64.0)),
        (0x17, "00 00 c0 41 00 00 80 3f", om.BusPower(24.0, 1.0)),
        (0x18, "00", om.ClearErrors()),
        (0x18, "", om.ClearErrors()),
        (0x1C, "00 00 00 41 00 00 00 c1", om.Torques(8.0, -8.0)),
        (0x04, "00 34 12 00", om.RxSdo(0, 0x1234)),
        (0x04, "01 34 12 00 07", om.RxSdo(1, 0x1234, b"\x07")),
        (0x05, "00 34 12 00 07 00 00 00", om.TxSdo(0x1234, bytes([7, 0, 0, 0]))),
        (0x06, "03 ab 89 67 45 23 01", om.Address(3, 0x0123456789AB)),
        (0x06, "03 ab 89 67 45 23 01 09", om.Address(3, 0x0123456789AB)),
        (0x16, "02", om.Reboot(2)),
    ],
)
def test_documented_bytes_are_read_as_their_message(
    command: int, data: str, message: om.Message
) -> None:
    assert cs.decode(5 << 5 | command, bytes.fromhex(data)) == message


def test_a_command_that_is_not_used_here_is_nothing() -> None:
    assert cs.decode(5 << 5 | 0x1A, bytes(8)) is None


@pytest.mark.parametrize("length", [0, 4, 6, 7])
@pytest.mark.parametrize("command", [0x01, 0x09, 0x0C, 0x1C])
def test_a_wrong_length_is_a_malformed_frame(command: int, length: int) -> None:
    with pytest.raises(MalformedFrame, match=f"{length} bytes, expected 8"):
        cs.decode(command, bytes(length))


@pytest.mark.parametrize("command", [0x04, 0x05])
def test_an_endpoint_without_its_number_is_a_malformed_frame(command: int) -> None:
    with pytest.raises(MalformedFrame, match="3 bytes, expected 4 to 8"):
        cs.decode(command, bytes(3))


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_no_bytes_make_the_decoder_raise_anything_but_its_own_error(
    arbitration_id: int, data: bytes
) -> None:
    try:
        cs.decode(arbitration_id, data)
    except MalformedFrame as error:
        assert isinstance(error, DeviceError)


single = st.floats(width=32, allow_nan=False)


@given(st.integers(0, 63), single, single)
def test_floats_survive_the_wire(node: int, first: float, second: float) -> None:
    arbitration_id, data = cs.encoder_estimates(node, first, second)
    assert cs.node_of(arbitration_id) == node
    assert cs.decode(arbitration_id, data) == om.EncoderEstimates(first, second)
    assert cs.decode(*cs.set_input_vel(node, first, second)) == om.SetInputVel(first, second)


@given(single, st.floats(-32.767, 32.767), st.floats(-32.767, 32.767))
def test_feed_forwards_survive_to_half_a_thousandth(
    position: float, speed: float, torque: float
) -> None:
    message = cs.decode(*cs.set_input_pos(0, position, speed, torque))
    assert isinstance(message, om.SetInputPos)
    assert message.position_turns == position
    assert abs(message.speed_turns_s - speed) <= 0.5000001e-3
    assert abs(message.torque_Nm - torque) <= 0.5000001e-3


@given(st.integers(0, 2**32 - 1), st.integers(0, 255), st.integers(0, 255), st.booleans())
def test_a_heartbeat_survives_the_wire(error: int, state: int, result: int, done: bool) -> None:
    beat = om.Heartbeat(error, state, result, done)
    assert cs.decode(*cs.heartbeat(7, beat)) == beat


@pytest.mark.parametrize("speed", [32.768, -40.0, float("nan"), float("inf")])
def test_a_feed_forward_beyond_its_field_is_refused_with_the_limit(speed: float) -> None:
    with pytest.raises(NotEncodable, match=r"limit 32\.767"):
        cs.set_input_pos(0, 0.0, speed)


def test_a_position_beyond_single_precision_is_refused() -> None:
    with pytest.raises(NotEncodable, match="INPUT_POS"):
        cs.set_input_pos(0, 1e39)


@pytest.mark.parametrize("node", [-1, 64])
def test_a_node_that_cannot_be_is_refused(node: int) -> None:
    with pytest.raises(NotEncodable, match="0 to 63"):
        cs.estop(node)


def test_an_error_word_is_told_bit_by_bit() -> None:
    text = error_text(1 << 24 | 1 << 9 | 1 << 7, om.OdriveFirmware.V0_6)
    assert text.startswith("error 0x01000280 (")
    assert "WATCHDOG_TIMER_EXPIRED: no command reached the drive in time" in text
    assert "DC_BUS_UNDER_VOLTAGE" in text
    assert "bit 7: not documented" in text


@given(st.integers(0, 2**32 - 1), st.integers(0, 255))
def test_every_number_of_a_heartbeat_has_words(error: int, state: int) -> None:
    assert error_text(error, om.OdriveFirmware.V0_6).count(":") == error.bit_count()
    assert state_text(state)
    assert result_text(state)


DBC = """VERSION ""
BU_: host drive
BO_ 33 Heartbeat: 8 drive
 SG_ Axis_Error : 0|32@1+ (1,0) [0|0] "" host
 SG_ Axis_State : 32|8@1+ (1,0) [0|0] "" host
 SG_ Procedure_Result : 40|8@1+ (1,0) [0|0] "" host
 SG_ Trajectory_Done_Flag : 48|1@1+ (1,0) [0|0] "" host
BO_ 44 Set_Input_Pos: 8 host
 SG_ Input_Pos : 0|32@1- (1,0) [0|0] "rev" drive
 SG_ Vel_FF : 32|16@1- (0.001,0) [0|0] "rev/s" drive
 SG_ Torque_FF : 48|16@1- (0.001,0) [0|0] "Nm" drive
SIG_VALTYPE_ 44 Input_Pos : 1;
"""


@given(
    st.integers(0, 2**32 - 1), st.integers(0, 15), st.booleans(), single, st.integers(-32767, 32767)
)
def test_another_decoder_reads_the_same_from_the_documented_bit_positions(
    error: int, state: int, done: bool, position: float, steps: int
) -> None:
    cantools = pytest.importorskip("cantools")
    database = cantools.database.load_string(DBC, "dbc")
    beat = database.decode_message(*cs.heartbeat(1, om.Heartbeat(error, state, state, done)))
    assert beat == {
        "Axis_Error": error,
        "Axis_State": state,
        "Procedure_Result": state,
        "Trajectory_Done_Flag": done,
    }
    pos = database.decode_message(*cs.set_input_pos(1, position, steps / 1000.0))
    assert pos["Input_Pos"] == position
    assert pos["Vel_FF"] == pytest.approx(steps / 1000.0)


def test_the_scale_of_a_feed_forward_is_a_thousandth() -> None:
    assert struct.unpack("<fhh", cs.set_input_pos(0, 0.0, 1.2344, 0.0006)[1]) == (0.0, 1234, 1)


# -- firmware 0.5
# --------------------------------------------------------------------------------------------------

V0_5 = om.OdriveFirmware.V0_5


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("00 08 00 00 01 00 00 00", om.Heartbeat(0x800, 1, 0, False)),
        ("00 00 00 00 08 00 00 80", om.Heartbeat(0, 8, 0, True)),
        ("40 00 00 00 01 01 00 00", om.Heartbeat(0x40, 1, 0, False, (om.OdrivePart.MOTOR,))),
        (
            "00 00 00 00 01 00 01 81",
            om.Heartbeat(0, 1, 0, True, (om.OdrivePart.ENCODER, om.OdrivePart.CONTROLLER)),
        ),
    ],
)
def test_an_older_heartbeat_has_flags_where_the_newer_has_a_result(
    data: str, message: om.Heartbeat
) -> None:
    assert cs.heartbeat(3, message, V0_5) == (0x061, bytes.fromhex(data))
    assert cs.decode(0x061, bytes.fromhex(data), V0_5) == message


def test_older_part_errors_have_the_documented_ids_and_64_bits() -> None:
    assert cs.part_error(3, om.PartError(om.OdrivePart.MOTOR, 0x800000008)) == (
        0x063,
        bytes.fromhex("08 00 00 00 08 00 00 00"),
    )
    assert cs.part_error(3, om.PartError(om.OdrivePart.ENCODER, 0x80)) == (
        0x064,
        bytes.fromhex("80 00 00 00 00 00 00 00"),
    )
    assert cs.part_error(3, om.PartError(om.OdrivePart.CONTROLLER, 1)) == (
        0x07D,
        bytes.fromhex("01 00 00 00 00 00 00 00"),
    )


def test_the_dialects_do_not_read_each_others_messages() -> None:
    assert cs.decode(0x1C, bytes(8), V0_5) is None
    assert cs.decode(0x15, bytes(8), V0_5) is None
    assert cs.decode(0x04, bytes(8), V0_5) == om.PartError(om.OdrivePart.ENCODER, 0)
    assert cs.decode(0x05, bytes(8), V0_5) is None
    assert cs.decode(0x16, b"", V0_5) == om.Reboot()
    assert cs.decode(0x1D, bytes(8)) is None
    assert cs.clear_errors(3, V0_5) == (0x078, b"")


@pytest.mark.parametrize(
    ("command", "name"), [(0x01, "HEARTBEAT"), (0x03, "MOTOR_ERROR"), (0x1D, "CONTROLLER_ERROR")]
)
def test_a_wrong_length_names_the_older_message_and_dialect(command: int, name: str) -> None:
    with pytest.raises(
        MalformedFrame,
        match=rf"\({name}\) has 7 bytes, expected 8; does the drive speak CANSimple 0\.5",
    ):
        cs.decode(command, bytes(7), V0_5)


@given(st.integers(0, 0x7FF), st.binary(max_size=8))
def test_no_bytes_make_the_older_decoder_raise_anything_but_its_own_error(
    arbitration_id: int, data: bytes
) -> None:
    try:
        cs.decode(arbitration_id, data, V0_5)
    except MalformedFrame as error:
        assert isinstance(error, DeviceError)


@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 255),
    st.booleans(),
    st.sets(st.sampled_from(om.OdrivePart)),
)
def test_an_older_heartbeat_survives_the_wire(
    error: int, state: int, done: bool, failed: set[om.OdrivePart]
) -> None:
    beat = om.Heartbeat(
        error, state, 0, done, tuple(part for part in om.OdrivePart if part in failed)
    )
    assert cs.decode(*cs.heartbeat(7, beat, V0_5), V0_5) == beat


@given(st.sampled_from(om.OdrivePart), st.integers(0, 2**64 - 1))
def test_older_errors_survive_the_wire_and_have_words(part: om.OdrivePart, word: int) -> None:
    assert cs.decode(*cs.part_error(7, om.PartError(part, word)), V0_5) == om.PartError(part, word)
    assert part_error_text(part, word).count(":") == word.bit_count()
    assert (
        error_text(word & 0xFFFFFFFF, om.OdriveFirmware.V0_5).count(":")
        == (word & 0xFFFFFFFF).bit_count()
    )


OLDER_DBC = """VERSION ""
BU_: host drive
BO_ 33 Heartbeat: 8 drive
 SG_ Trajectory_Done_Flag : 63|1@1+ (1,0) [0|0] "" host
 SG_ Controller_Error_Flag : 56|1@1+ (1,0) [0|0] "" host
 SG_ Encoder_Error_Flag : 48|1@1+ (1,0) [0|0] "" host
 SG_ Motor_Error_Flag : 40|1@1+ (1,0) [0|0] "" host
 SG_ Axis_State : 32|8@1+ (1,0) [0|0] "" host
 SG_ Axis_Error : 0|32@1+ (1,0) [0|0] "" host
BO_ 36 Get_Encoder_Error: 8 drive
 SG_ Encoder_Error : 0|32@1+ (1,0) [0|0] "" host
"""


@given(
    st.integers(0, 2**32 - 1),
    st.integers(0, 15),
    st.booleans(),
    st.sets(st.sampled_from(om.OdrivePart)),
)
def test_another_decoder_reads_older_frames_the_same(
    error: int, state: int, done: bool, failed: set[om.OdrivePart]
) -> None:
    cantools = pytest.importorskip("cantools")
    database = cantools.database.load_string(OLDER_DBC, "dbc")
    beat = om.Heartbeat(error, state, 0, done, tuple(failed))
    assert database.decode_message(*cs.heartbeat(1, beat, V0_5)) == {
        "Axis_Error": error,
        "Axis_State": state,
        "Trajectory_Done_Flag": done,
        "Motor_Error_Flag": om.OdrivePart.MOTOR in failed,
        "Encoder_Error_Flag": om.OdrivePart.ENCODER in failed,
        "Controller_Error_Flag": om.OdrivePart.CONTROLLER in failed,
    }
    assert database.decode_message(
        *cs.part_error(1, om.PartError(om.OdrivePart.ENCODER, error))
    ) == {"Encoder_Error": error}


@pytest.mark.parametrize(
    ("version", "dialect"), [("0.5.6", V0_5), ("0.6.10", om.OdriveFirmware.V0_6)]
)
def test_the_makers_own_database_reads_our_frames(version: str, dialect: om.OdriveFirmware) -> None:
    cantools = pytest.importorskip("cantools")
    package = pytest.importorskip(
        "odrive_can", reason="the extra `third-party-clients` brings the maker's databases"
    )
    path = Path(package.__file__).parent / "dbc" / f"odrive-cansimple-{version}.dbc"
    database = cantools.database.load_file(path)
    beat = database.decode_message(
        *cs.heartbeat(0, om.Heartbeat(0x800, 8, 0, True), dialect), decode_choices=False
    )
    assert {name: beat[name] for name in ("Axis_Error", "Axis_State", "Trajectory_Done_Flag")} == {
        "Axis_Error": 0x800,
        "Axis_State": 8,
        "Trajectory_Done_Flag": 1,
    }
    assert database.decode_message(*cs.encoder_estimates(0, 1.5, -2.0)) == {
        "Pos_Estimate": 1.5,
        "Vel_Estimate": -2.0,
    }
    assert sorted(database.decode_message(*cs.set_input_vel(0, 1.5, 0.25)).values()) == [0.25, 1.5]
    assert database.decode_message(*cs.iq(0, 4.0, 0.5)) == {"Iq_Setpoint": 4.0, "Iq_Measured": 0.5}
