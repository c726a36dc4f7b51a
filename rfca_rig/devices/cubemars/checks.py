"""CubeMars / T-Motor AK drives. One in MIT mode replies only when asked, one in servo mode sends
its status cyclically.

Listens for an AK drive in MIT mode and, on a quiet bus, asks it by the frame that disables the
motor. No frame of this mode only asks. EXIT can remove torque but never add any. It is not sent if
others use the bus, because another program may be using the drive.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import can

from rfca_rig.devices.checks import (
    LISTEN_S,
    Finding,
    Listener,
    ReceivedFrame,
    green,
    join_ids,
    mean_period_s,
    red,
    yellow,
)
from rfca_rig.devices.cubemars.codec import MitRanges, error_text, mit_ranges, servo
from rfca_rig.devices.cubemars.codec.mit import MitReply, Special, decode_reply, encode_special
from rfca_rig.devices.cubemars.codec.servo import Packet, Status, drive_of
from rfca_rig.devices.cubemars.section import CubemarsMitSection, CubemarsServoSection
from rfca_rig.errors import MalformedFrame

MIT_DRIVE = "drive"
MIT_ERROR = "drive error"
ANSWER_S = 0.1
SERVO_DRIVE = "drive"
SERVO_ERROR = "drive error"
ENCODER = "drive's encoder"
# Factors between measured and configured period: the driver refuses the first, the second gets a
# warning.
REFUSED_PERIOD_RATIO = 2.0
WARNING_PERIOD_RATIO = 1.2


@dataclass(frozen=True)
class MitSeen:
    """Observed frames. The drive is `asked` only on a quiet bus. `others` are foreign ids,
    `masters` wrong ids of its replies.
    """

    asked: bool
    reply: MitReply | None = None
    others: tuple[int, ...] = ()
    masters: tuple[int, ...] = ()
    servo: tuple[int, ...] = ()
    unreadable: str | None = None


def judge_mit(seen: MitSeen, drive_id: int) -> list[Finding]:
    if seen.unreadable is not None:
        return [
            red(
                MIT_DRIVE,
                f"drive {drive_id} cannot be understood: {seen.unreadable}",
                "set it to MIT mode in CubeMarsTool",
            )
        ]
    if seen.reply is None:
        return [_mit_silent(seen, drive_id)]
    if seen.reply.temperature_degC is None:
        temperature = ""
    else:
        temperature = f", {seen.reply.temperature_degC} degC"
    return [
        green(MIT_DRIVE, f"AK drive {drive_id} in MIT mode{temperature}"),
        _mit_error(seen.reply),
    ]


def _mit_silent(seen: MitSeen, drive_id: int) -> Finding:
    if drive_id in seen.servo:
        fix = 'set it to MIT mode in CubeMarsTool, or put device = "cubemars-servo" under [motor]'
        return red(MIT_DRIVE, f"drive {drive_id} is in servo mode", fix)
    if seen.masters:
        fix = f"set its master id to 0 or {drive_id} in CubeMarsTool"
        return red(MIT_DRIVE, f"drive {drive_id} replies under id {join_ids(seen.masters)}", fix)
    other_ids = tuple(sorted({*seen.others, *seen.servo}))
    if other_ids:
        fix = (
            f"put drive_id = {other_ids[0]} under [motor] if that is the drive, or end the "
            "program that speaks there"
        )
        if seen.asked:
            not_asked = ""
        else:
            not_asked = "; it was not asked while others speak"
        return red(
            MIT_DRIVE,
            f"heard id {join_ids(other_ids)}, the rig file says {drive_id}{not_asked}",
            fix,
        )
    fix = (
        "check its power, the wiring, a 120 ohm resistor at both ends, that it has 1 Mbit/s, "
        "and in CubeMarsTool its id and MIT mode"
    )
    return red(MIT_DRIVE, f"drive {drive_id} does not answer, and nothing else speaks", fix)


def _mit_error(reply: MitReply) -> Finding:
    if reply.error is None:
        return yellow(
            MIT_ERROR,
            "its firmware does not report errors",
            "update the firmware with CubeMarsTool to have them reported",
        )
    if reply.error:
        return red(
            MIT_ERROR,
            error_text(reply.error),
            "remove the cause, then switch the drive's power off and on",
        )
    return green(MIT_ERROR, "none")


def look_for_mit(listener: Listener, drive_id: int, ranges: MitRanges) -> MitSeen:
    listener.listen(LISTEN_S)
    asked = not listener.frames
    if asked:
        listener.ask(
            can.Message(
                arbitration_id=drive_id, data=encode_special(Special.EXIT), is_extended_id=False
            )
        )
        listener.listen(ANSWER_S)
    return observe_mit(listener.frames, drive_id, ranges, asked)


def observe_mit(
    frames: Sequence[ReceivedFrame], drive_id: int, ranges: MitRanges, asked: bool
) -> MitSeen:
    """Sorts the received frames. A command to the drive, which an adapter may echo, is not a
    reply.
    """
    reply: MitReply | None = None
    unreadable: str | None = None
    others = set[int]()
    masters = set[int]()
    servo = set[int]()
    for message in (heard.message for heard in frames):
        identifier = message.arbitration_id
        data = message.data
        if message.is_extended_id:
            if identifier >> 8 == Packet.STATUS:
                servo.add(drive_of(identifier))
        elif data and identifier in {0, drive_id} and data[0] == drive_id:
            reply, unreadable = _decode(ranges, data, reply)
        elif data and data[0] == drive_id:
            masters.add(identifier)
        elif data and identifier == 0:
            others.add(data[0])
        elif data and identifier != drive_id:
            others.add(identifier)
    return MitSeen(
        asked,
        reply,
        tuple(sorted(others)),
        tuple(sorted(masters)),
        tuple(sorted(servo)),
        unreadable,
    )


def _decode(
    ranges: MitRanges, data: bytes | bytearray, before: MitReply | None
) -> tuple[MitReply | None, str | None]:
    try:
        return decode_reply(ranges, data), None
    except MalformedFrame as error:
        return before, str(error)


@dataclass(frozen=True)
class ServoSeen:
    """Observed frames: `status` and `period_s` of the drive, ids of `others` with status frames;
    `strangers` counts other frames.
    """

    status: Status | None = None
    period_s: float | None = None
    others: tuple[int, ...] = ()
    strangers: int = 0
    unreadable: str | None = None


def judge_servo(seen: ServoSeen, drive_id: int, status_period_s: float) -> list[Finding]:
    if seen.unreadable is not None:
        return [
            red(
                SERVO_DRIVE,
                f"drive {drive_id} cannot be understood: {seen.unreadable}",
                "set it to servo mode in CubeMarsTool",
            )
        ]
    if seen.status is None:
        return [_servo_silent(seen, drive_id)]
    drive = green(
        SERVO_DRIVE, f"AK drive {drive_id} in servo mode, {seen.status.temperature_degC} degC"
    )
    return [drive, _servo_error(seen.status), _period(seen.period_s, status_period_s)]


def _servo_silent(seen: ServoSeen, drive_id: int) -> Finding:
    if seen.others:
        fix = (
            f"put drive_id = {seen.others[0]} under [motor], or set the drive's id in CubeMarsTool"
        )
        return red(
            SERVO_DRIVE, f"heard drive {join_ids(seen.others)}, the rig file says {drive_id}", fix
        )
    if seen.strangers:
        fix = 'set it to servo mode in CubeMarsTool, or put device = "cubemars-mit" under [motor]'
        return red(SERVO_DRIVE, f"heard {seen.strangers} frames, none a status of servo mode", fix)
    fix = (
        "check its power, the wiring, the bit rate (1 Mbit/s), and in CubeMarsTool that it "
        "sends its status over CAN"
    )
    return red(SERVO_DRIVE, "nothing at all heard on the bus", fix)


def _servo_error(status: Status) -> Finding:
    if status.error:
        return red(
            SERVO_ERROR,
            error_text(status.error),
            "remove the cause, then switch the drive's power off and on",
        )
    return green(SERVO_ERROR, "none")


def _period(period_s: float | None, wanted_s: float) -> Finding:
    if period_s is None:
        return red(
            ENCODER,
            "too few status frames to tell their rate",
            f"set its upload rate to {1.0 / wanted_s:.0f} Hz in CubeMarsTool",
        )
    factor = max(period_s / wanted_s, wanted_s / period_s)
    measured = f"every {1e3 * period_s:.3g} ms"
    if factor < WARNING_PERIOD_RATIO:
        return green(ENCODER, measured)
    fix = (
        f"put status_period_ms = {1e3 * period_s:.3g} under [motor], or set its upload rate "
        f"to {1.0 / wanted_s:.0f} Hz in CubeMarsTool"
    )
    finding = red if factor >= REFUSED_PERIOD_RATIO else yellow
    return finding(ENCODER, f"{measured}, the rig file says {1e3 * wanted_s:g} ms", fix)


def look_for_servo(listener: Listener, drive_id: int) -> ServoSeen:
    return observe_servo(listener.listen(LISTEN_S), drive_id)


def observe_servo(frames: Sequence[ReceivedFrame], drive_id: int) -> ServoSeen:
    """Sorts the received frames."""
    is_status = {True: list[ReceivedFrame](), False: list[ReceivedFrame]()}
    for frame in frames:
        is_status[
            frame.message.is_extended_id and frame.message.arbitration_id >> 8 == Packet.STATUS
        ].append(frame)
    drive_frames = [
        frame for frame in is_status[True] if drive_of(frame.message.arbitration_id) == drive_id
    ]
    others = tuple(
        sorted({drive_of(frame.message.arbitration_id) for frame in is_status[True]} - {drive_id})
    )
    status, unreadable = _last_status(drive_frames)
    return ServoSeen(status, mean_period_s(drive_frames), others, len(is_status[False]), unreadable)


def _last_status(drive_frames: Sequence[ReceivedFrame]) -> tuple[Status | None, str | None]:
    if not drive_frames:
        return None, None
    message = drive_frames[-1].message
    try:
        status = servo.decode(message.arbitration_id, message.data)
    except MalformedFrame as error:
        return None, str(error)
    if isinstance(status, Status):
        return status, None
    return None, None


def check_mit_drive(keys: CubemarsMitSection, listener: Listener) -> list[Finding]:
    """The findings on the drive in MIT mode that [motor] names."""
    return judge_mit(look_for_mit(listener, keys.drive_id, mit_ranges(keys.model)), keys.drive_id)


def check_servo_drive(keys: CubemarsServoSection, listener: Listener) -> list[Finding]:
    """The findings on the drive in servo mode that [motor] names."""
    return judge_servo(
        look_for_servo(listener, keys.drive_id), keys.drive_id, keys.status_period_ms / 1e3
    )
