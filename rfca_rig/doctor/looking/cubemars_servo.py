"""Listens for AK drives in servo mode; sends nothing."""

from collections.abc import Sequence

from rfca_rig.codecs import cubemars_servo
from rfca_rig.codecs.cubemars_servo import Packet, Status
from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.doctor.judging.cubemars_servo import ServoSeen
from rfca_rig.doctor.looking.can_bus import LISTEN_S, Listener, ReceivedFrame, mean_period_s


def look_for_servo(listener: Listener, drive_id: int) -> ServoSeen:
    return observe_servo(listener.listen(LISTEN_S), drive_id)


def observe_servo(frames: Sequence[ReceivedFrame], drive_id: int) -> ServoSeen:
    """Sorts the received frames."""
    is_status = {True: list[ReceivedFrame](), False: list[ReceivedFrame]()}
    for frame in frames:
        is_status[frame.message.is_extended_id and frame.message.arbitration_id >> 8 == Packet.STATUS].append(frame)
    own = [frame for frame in is_status[True] if _drive(frame) == drive_id]
    others = tuple(sorted({_drive(frame) for frame in is_status[True]} - {drive_id}))
    status, unreadable = _last_status(own)
    return ServoSeen(status, mean_period_s(own), others, len(is_status[False]), unreadable)


def _drive(frame: ReceivedFrame) -> int:
    return cubemars_servo.drive_of(frame.message.arbitration_id)


def _last_status(own: Sequence[ReceivedFrame]) -> tuple[Status | None, str | None]:
    if not own:
        return None, None
    message = own[-1].message
    try:
        status = cubemars_servo.decode(message.arbitration_id, message.data)
    except MalformedFrame as error:
        return None, str(error)
    return (status if isinstance(status, Status) else None), None
