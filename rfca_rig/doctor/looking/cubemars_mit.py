"""Listens for an AK drive in MIT mode and, on a quiet bus, asks it by the frame that disables the motor.

The mode has no frame that only asks. EXIT can remove torque but never add any. It is not sent if others use the bus, because another
program may be using the drive.
"""

from collections.abc import Sequence

import can

from rfca_rig.codecs import cubemars_servo
from rfca_rig.codecs.cubemars_drives import MitRanges
from rfca_rig.codecs.cubemars_mit import MitReply, Special, decode_reply, encode_special
from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.doctor.judging.cubemars_mit import MitSeen
from rfca_rig.doctor.looking.can_bus import LISTEN_S, Listener, ReceivedFrame

ANSWER_S = 0.1


def look_for_mit(listener: Listener, drive_id: int, ranges: MitRanges) -> MitSeen:
    listener.listen(LISTEN_S)
    asked = not listener.frames
    if asked:
        listener.ask(can.Message(arbitration_id=drive_id, data=encode_special(Special.EXIT), is_extended_id=False))
        listener.listen(ANSWER_S)
    return observe_mit(listener.frames, drive_id, ranges, asked)


def observe_mit(frames: Sequence[ReceivedFrame], drive_id: int, ranges: MitRanges, asked: bool) -> MitSeen:
    """Sorts the received frames. A command to the drive, which an adapter may echo, is not a reply."""
    reply: MitReply | None = None
    unreadable: str | None = None
    others, masters, servo = set[int](), set[int](), set[int]()
    for message in (heard.message for heard in frames):
        identifier, data = message.arbitration_id, message.data
        if message.is_extended_id:
            if identifier >> 8 == cubemars_servo.Packet.STATUS:
                servo.add(cubemars_servo.drive_of(identifier))
        elif data and identifier in {0, drive_id} and data[0] == drive_id:
            reply, unreadable = _decode(ranges, data, reply)
        elif data and data[0] == drive_id:
            masters.add(identifier)
        elif data and identifier != drive_id:
            others.add(data[0] if identifier == 0 else identifier)
    return MitSeen(asked, reply, tuple(sorted(others)), tuple(sorted(masters)), tuple(sorted(servo)), unreadable)


def _decode(ranges: MitRanges, data: bytes | bytearray, before: MitReply | None) -> tuple[MitReply | None, str | None]:
    try:
        return decode_reply(ranges, data), None
    except MalformedFrame as error:
        return before, str(error)
