"""ODrive's CANSimple frames, both directions and both dialects; pure.

Layouts: ODrive CANSimple protocol (docs/can-protocol.rst and odrive-cansimple.dbc) of firmware 0.6.
Little-endian throughout. The same documents of firmware 0.5.6 differ as follows:

- Heartbeat bytes 5..7 are flag bits (40 motor, 48 encoder, 56 controller error, 63 trajectory done)
  instead of procedure result and trajectory done.
- 0x03, 0x04 and 0x1D are error words of the parts.
- 0x1C is a voltage instead of torques, and 0x15 is not temperatures.
- 0x00 is not answered.
- Clearing errors takes no byte.
- Restarting takes no byte, and saves nothing.

Endpoints (0x04, 0x05), addresses (0x06) and saving (0x16) belong to 0.6 only. Sources: the same
protocol page, sections on arbitrary parameter access and on discovery, and ODrive's examples
`can_restore_config.py` and `can_enumerate.py`.
"""

import struct
from collections.abc import Callable

from rfca_rig.devices.odrive.messages import (
    BROADCAST_NODE,
    PASSTHROUGH,
    Address,
    BusPower,
    ClearErrors,
    EncoderEstimates,
    ErrorReport,
    Estop,
    Heartbeat,
    Iq,
    Message,
    OdriveCommand,
    OdriveFirmware,
    OdrivePart,
    OlderCommand,
    PartError,
    Reboot,
    RxSdo,
    SdoOpcode,
    SetAxisState,
    SetControllerMode,
    SetInputPos,
    SetInputTorque,
    SetInputVel,
    Temperatures,
    Torques,
    TxSdo,
    Version,
)
from rfca_rig.errors import MalformedFrame, NotEncodable

Frame = tuple[int, bytes]


_TWO_FLOATS = struct.Struct("<ff")
_ONE_FLOAT = struct.Struct("<f")
_TWO_WORDS = struct.Struct("<II")
_ONE_WORD = struct.Struct("<I")
_HEARTBEAT = struct.Struct("<IBBBx")
_OLDER_HEARTBEAT = struct.Struct("<IBBBB")
_ONE_LONG_WORD = struct.Struct("<Q")
_VERSION = struct.Struct("<8B")
_INPUT_POS = struct.Struct("<fhh")
_ONE_BYTE = struct.Struct("<B")
_EMPTY = struct.Struct("")
# Node id, and a serial number of 48 bits. A byte may follow that only firmware 0.6.11 knows.
_ADDRESS = struct.Struct("<B6s")
# Opcode, endpoint and a reserved byte; up to four bytes of a value follow.
_SDO = struct.Struct("<BHB")
SDO_LENGTHS = range(_SDO.size, 9)

# Feed-forwards are 16-bit integers in steps of 0.001, the drive's default scale.
FEED_FORWARD_STEP = 1e-3
PART_COMMANDS = {
    OdrivePart.MOTOR: OlderCommand.MOTOR_ERROR,
    OdrivePart.ENCODER: OlderCommand.ENCODER_ERROR,
    OdrivePart.CONTROLLER: OlderCommand.CONTROLLER_ERROR,
}


def _version(protocol: int, *rest: int) -> Version:
    return Version(
        firmware=(rest[3], rest[4], rest[5]),
        hardware=(rest[0], rest[1], rest[2]),
        protocol=protocol,
        unreleased=rest[6],
    )


def _heartbeat(error: int, state: int, result: int, flags: int) -> Heartbeat:
    return Heartbeat(error, state, result, bool(flags & 1))


def _older_heartbeat(
    error: int, state: int, motor: int, encoder: int, controller: int
) -> Heartbeat:
    # Bits 40, 48 and 56 of the frame are bit 0 of these bytes, bit 63 is bit 7 of the last.
    failed = tuple(
        part
        for part, flags in zip(OdrivePart, (motor, encoder, controller), strict=True)
        if flags & 1
    )
    return Heartbeat(error, state, 0, bool(controller & 0x80), failed)


def _part_error(part: OdrivePart) -> Callable[[int], PartError]:
    return lambda word: PartError(part, word)


def _address(node_id: int, serial_number: bytes) -> Address:
    return Address(node_id, int.from_bytes(serial_number, "little"))


def _input_pos(position: float, speed: int, torque: int) -> SetInputPos:
    return SetInputPos(position, speed * FEED_FORWARD_STEP, torque * FEED_FORWARD_STEP)


# Command -> its fields, the constructor of the message, and the accepted payload lengths (some
# senders pad to eight bytes).
_Layouts = dict[int, tuple[struct.Struct, Callable[..., Message], frozenset[int]]]
_SHARED: _Layouts = {
    OdriveCommand.VERSION: (_VERSION, _version, frozenset({8})),
    OdriveCommand.ESTOP: (_EMPTY, Estop, frozenset({0, 8})),
    OdriveCommand.AXIS_STATE: (_ONE_WORD, SetAxisState, frozenset({4, 8})),
    OdriveCommand.ENCODER_ESTIMATES: (_TWO_FLOATS, EncoderEstimates, frozenset({8})),
    OdriveCommand.CONTROLLER_MODE: (_TWO_WORDS, SetControllerMode, frozenset({8})),
    OdriveCommand.INPUT_POS: (_INPUT_POS, _input_pos, frozenset({8})),
    OdriveCommand.INPUT_VEL: (_TWO_FLOATS, SetInputVel, frozenset({8})),
    OdriveCommand.INPUT_TORQUE: (_ONE_FLOAT, SetInputTorque, frozenset({4, 8})),
    OdriveCommand.IQ: (_TWO_FLOATS, Iq, frozenset({8})),
    OdriveCommand.BUS_VOLTAGE_CURRENT: (_TWO_FLOATS, BusPower, frozenset({8})),
    OdriveCommand.CLEAR_ERRORS: (_EMPTY, ClearErrors, frozenset({0, 1, 8})),
}
_NEWER: _Layouts = {
    OdriveCommand.HEARTBEAT: (_HEARTBEAT, _heartbeat, frozenset({8})),
    OdriveCommand.ERRORS: (_TWO_WORDS, ErrorReport, frozenset({8})),
    OdriveCommand.TEMPERATURES: (_TWO_FLOATS, Temperatures, frozenset({8})),
    OdriveCommand.TORQUES: (_TWO_FLOATS, Torques, frozenset({8})),
    OdriveCommand.ADDRESS: (_ADDRESS, _address, frozenset({7, 8})),
    OdriveCommand.REBOOT: (_ONE_BYTE, Reboot, frozenset({1, 8})),
}
_OLDER: _Layouts = {
    OdriveCommand.HEARTBEAT: (_OLDER_HEARTBEAT, _older_heartbeat, frozenset({8})),
    OdriveCommand.REBOOT: (_EMPTY, Reboot, frozenset({0, 8})),
    **{
        command: (_ONE_LONG_WORD, _part_error(part), frozenset({8}))
        for part, command in PART_COMMANDS.items()
    },
}
_OF_V0_5 = _SHARED | _OLDER
_OF_V0_6 = _SHARED | _NEWER


def decode(
    arbitration_id: int, data: bytes | bytearray, dialect: OdriveFirmware = OdriveFirmware.V0_6
) -> Message | None:
    """The message in one data frame; None for a command that is not used here. Raises
    MalformedFrame for a wrong length.
    """
    # The low five bits of the id are the command, the rest is the node.
    if dialect is OdriveFirmware.V0_6 and arbitration_id & 0x1F in _SDO_COMMANDS:
        return _decode_sdo(arbitration_id, bytes(data))
    layout = (_OF_V0_6 if dialect is OdriveFirmware.V0_6 else _OF_V0_5).get(arbitration_id & 0x1F)
    if layout is None:
        return None
    fields, message, lengths = layout
    if len(data) not in lengths:
        raise MalformedFrame(
            f"CAN frame 0x{arbitration_id:03x} ({_name(arbitration_id & 0x1F, dialect)}) "
            f"has {len(data)} bytes, expected {min(lengths)}; "
            f"does the drive speak CANSimple {dialect}?"
        )
    return message(*fields.unpack_from(data))


_SDO_COMMANDS = frozenset({OdriveCommand.RX_SDO, OdriveCommand.TX_SDO})


def _decode_sdo(arbitration_id: int, data: bytes) -> RxSdo | TxSdo:
    command = OdriveCommand(arbitration_id & 0x1F)
    if len(data) not in SDO_LENGTHS:
        raise MalformedFrame(
            f"CAN frame 0x{arbitration_id:03x} ({command.name}) has {len(data)} bytes, expected "
            f"{SDO_LENGTHS[0]} to {SDO_LENGTHS[-1]}; does the drive speak CANSimple 0.6?"
        )
    opcode, endpoint_id, _ = _SDO.unpack_from(data)
    if command == OdriveCommand.RX_SDO:
        return RxSdo(opcode, endpoint_id, data[_SDO.size :])
    return TxSdo(endpoint_id, data[_SDO.size :])


def _name(command: int, dialect: OdriveFirmware) -> str:
    older = dialect == OdriveFirmware.V0_5 and command in set(OlderCommand)
    if older:
        return OlderCommand(command).name
    return OdriveCommand(command).name


def node_of(arbitration_id: int) -> int:
    """The address of the drive that sent a frame, or that the frame is for."""
    return arbitration_id >> 5


def _frame(
    node: int, command: OdriveCommand | OlderCommand, fields: struct.Struct = _EMPTY, *values: float
) -> Frame:
    if not 0 <= node <= BROADCAST_NODE:
        raise NotEncodable(
            f"CAN node {node} does not exist; addresses go from 0 to {BROADCAST_NODE}"
        )
    try:
        return node << 5 | command, fields.pack(*values)
    except (struct.error, OverflowError) as error:
        raise NotEncodable(
            f"CAN {command.name} to node {node} cannot carry {values}: {error}"
        ) from error


def _steps(value: float, name: str) -> int:
    # Written with `not`, so that NaN is refused too.
    if not abs(value) <= 32.767:
        raise NotEncodable(
            f"{name} {value:g} does not fit a CAN feed-forward, limit 32.767; lower the "
            "speed or the gear ratio"
        )
    return round(value / FEED_FORWARD_STEP)


def request(node: int, command: OdriveCommand | OlderCommand) -> Frame:
    """Request of one message, to be sent as a remote frame (firmware 0.5.6 also accepts a data
    frame without bytes).
    """
    return _frame(node, command)


def version(node: int, reply: Version) -> Frame:
    return _frame(
        node,
        OdriveCommand.VERSION,
        _VERSION,
        reply.protocol,
        *reply.hardware,
        *reply.firmware,
        reply.unreleased,
    )


def heartbeat(node: int, beat: Heartbeat, dialect: OdriveFirmware = OdriveFirmware.V0_6) -> Frame:
    if dialect == OdriveFirmware.V0_5:
        motor, encoder, controller = (part in beat.failed for part in OdrivePart)
        return _frame(
            node,
            OdriveCommand.HEARTBEAT,
            _OLDER_HEARTBEAT,
            beat.error,
            beat.state,
            motor,
            encoder,
            controller | beat.trajectory_done << 7,
        )
    return _frame(
        node,
        OdriveCommand.HEARTBEAT,
        _HEARTBEAT,
        beat.error,
        beat.state,
        beat.procedure_result,
        beat.trajectory_done,
    )


def estop(node: int) -> Frame:
    return _frame(node, OdriveCommand.ESTOP)


def errors(node: int, report: ErrorReport) -> Frame:
    return _frame(
        node, OdriveCommand.ERRORS, _TWO_WORDS, report.active_errors, report.disarm_reason
    )


def part_error(node: int, report: PartError) -> Frame:
    """The error word of one part; firmware 0.5 only."""
    return _frame(node, PART_COMMANDS[report.part], _ONE_LONG_WORD, report.word)


def set_axis_state(node: int, state: int) -> Frame:
    return _frame(node, OdriveCommand.AXIS_STATE, _ONE_WORD, state)


def encoder_estimates(node: int, position_turns: float, speed_turns_s: float) -> Frame:
    return _frame(node, OdriveCommand.ENCODER_ESTIMATES, _TWO_FLOATS, position_turns, speed_turns_s)


def set_controller_mode(node: int, control_mode: int, input_mode: int = PASSTHROUGH) -> Frame:
    return _frame(node, OdriveCommand.CONTROLLER_MODE, _TWO_WORDS, control_mode, input_mode)


def set_input_pos(
    node: int, position_turns: float, speed_turns_s: float = 0.0, torque_Nm: float = 0.0
) -> Frame:
    """The feed-forwards are carried in steps of 0.001 (the drive's default scale); raises
    NotEncodable beyond 32.767.
    """
    steps = _steps(speed_turns_s, "speed in turns/s"), _steps(torque_Nm, "torque in N m")
    return _frame(node, OdriveCommand.INPUT_POS, _INPUT_POS, position_turns, *steps)


def set_input_vel(node: int, speed_turns_s: float, torque_Nm: float = 0.0) -> Frame:
    return _frame(node, OdriveCommand.INPUT_VEL, _TWO_FLOATS, speed_turns_s, torque_Nm)


def set_input_torque(node: int, torque_Nm: float) -> Frame:
    return _frame(node, OdriveCommand.INPUT_TORQUE, _ONE_FLOAT, torque_Nm)


def iq(node: int, setpoint_A: float, measured_A: float) -> Frame:
    return _frame(node, OdriveCommand.IQ, _TWO_FLOATS, setpoint_A, measured_A)


def temperatures(node: int, inverter_degC: float, motor_degC: float) -> Frame:
    return _frame(node, OdriveCommand.TEMPERATURES, _TWO_FLOATS, inverter_degC, motor_degC)


def bus_voltage_current(node: int, voltage_V: float, current_A: float) -> Frame:
    return _frame(node, OdriveCommand.BUS_VOLTAGE_CURRENT, _TWO_FLOATS, voltage_V, current_A)


def clear_errors(node: int, dialect: OdriveFirmware = OdriveFirmware.V0_6) -> Frame:
    """Clear all errors. Firmware 0.6 takes one byte, zero: the drive does not blink. Firmware
    0.5 takes none.
    """
    if dialect == OdriveFirmware.V0_5:
        return _frame(node, OdriveCommand.CLEAR_ERRORS)
    return _frame(node, OdriveCommand.CLEAR_ERRORS, _ONE_BYTE, 0)


def torques(node: int, target_Nm: float, estimate_Nm: float) -> Frame:
    return _frame(node, OdriveCommand.TORQUES, _TWO_FLOATS, target_Nm, estimate_Nm)


def read_endpoint(node: int, endpoint_id: int) -> Frame:
    """Request of the value of an endpoint; firmware 0.6, as all of the following."""
    return _frame(node, OdriveCommand.RX_SDO, _SDO, SdoOpcode.READ, endpoint_id, 0)


def write_endpoint(node: int, endpoint_id: int, value: bytes) -> Frame:
    """Sets an endpoint to a value of up to four bytes, which the endpoint's type determines."""
    can_id, head = _frame(node, OdriveCommand.RX_SDO, _SDO, SdoOpcode.WRITE, endpoint_id, 0)
    return can_id, head + value


def endpoint_value(node: int, endpoint_id: int, value: bytes) -> Frame:
    """The drive's answer to a request: the value, filled up to four bytes."""
    can_id, head = _frame(node, OdriveCommand.TX_SDO, _SDO, 0, endpoint_id, 0)
    return can_id, head + value.ljust(4, b"\0")


def address(node: int, reply: Address) -> Frame:
    """From a drive: its address. To `BROADCAST_NODE`: the drive of that serial number takes the
    node id, and another drive that has it gives it up.
    """
    can_id, _ = _frame(node, OdriveCommand.ADDRESS)
    return can_id, _ADDRESS.pack(reply.node_id, reply.serial_number.to_bytes(6, "little"))


def reboot(node: int, action: int) -> Frame:
    """Starts the drive again, after it has saved or erased its settings."""
    return _frame(node, OdriveCommand.REBOOT, _ONE_BYTE, action)
