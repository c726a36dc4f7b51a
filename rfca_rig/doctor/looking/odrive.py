"""Listens for ODrives. What is sent: a question for the version, and for the errors of parts that report some."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import can

from rfca_rig.codecs import cansimple
from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.codecs.odrive_messages import (
    AxisState,
    EncoderEstimates,
    Heartbeat,
    Iq,
    Message,
    OdriveCommand,
    OdriveFirmware,
    PartError,
    Torques,
    Version,
)
from rfca_rig.doctor.judging.odrive import OdriveSeen, OdriveWanted
from rfca_rig.doctor.looking.can_bus import LISTEN_S, HeardFrame, Listener, period_s

ANSWER_S = 0.1
TELLING = frozenset({OdriveCommand.HEARTBEAT, OdriveCommand.ENCODER_ESTIMATES})  # what only a drive says, and says unasked


def look_for_odrive(listener: Listener, wanted: OdriveWanted) -> OdriveSeen:
    listener.listen(LISTEN_S)
    first = odrive_seen(listener.frames, wanted)
    if first.beat is not None and first.beat.state == AxisState.IDLE:  # any frame feeds the watchdog of a drive that runs
        listener.ask(_question(cansimple.request(wanted.node_id, OdriveCommand.VERSION)))
        for part in first.beat.failed:
            listener.ask(_question(cansimple.request(wanted.node_id, cansimple.PART_COMMANDS[part])))
        listener.listen(ANSWER_S)
    return odrive_seen(listener.frames, wanted)


def _question(frame: cansimple.Frame) -> can.Message:
    return can.Message(arbitration_id=frame[0], is_extended_id=False, is_remote_frame=True)


@dataclass
class _Ears:
    """What is gathered on the way."""

    others: set[int] = field(default_factory=set)
    strangers: int = 0
    own_frames: int = 0
    beat: Heartbeat | None = None
    encoder: list[HeardFrame] = field(default_factory=list)
    torques: int = 0
    firmware: str | None = None
    part_errors: dict[str, PartError] = field(default_factory=dict)
    unreadable: str | None = None


def odrive_seen(frames: Sequence[HeardFrame], wanted: OdriveWanted) -> OdriveSeen:
    """What these frames say."""
    ears = _Ears()
    for heard in frames:
        _take(ears, heard, wanted)
    return OdriveSeen(
        others=tuple(sorted(ears.others)),
        strangers=ears.strangers,
        own_frames=ears.own_frames,
        beat=ears.beat,
        period_s=period_s(ears.encoder),
        torques=ears.torques,
        firmware=ears.firmware,
        part_errors=tuple(ears.part_errors.values()),
        unreadable=ears.unreadable,
    )


def _take(ears: _Ears, heard: HeardFrame, wanted: OdriveWanted) -> None:
    message = heard.message
    identifier = message.arbitration_id
    is_telling = not message.is_extended_id and identifier & 0x1F in TELLING and message.dlc == 8
    if not message.is_extended_id and cansimple.node_of(identifier) == wanted.node_id and message.dlc:
        ears.own_frames += 1
        _hear(ears, heard, _decoded(ears, message, wanted.dialect), wanted)
    elif is_telling:
        ears.others.add(cansimple.node_of(identifier))
    else:
        ears.strangers += 1


def _decoded(ears: _Ears, message: can.Message, dialect: OdriveFirmware) -> Message | None:
    try:
        return cansimple.decode(message.arbitration_id, message.data, dialect)
    except MalformedFrame as error:
        ears.unreadable = str(error)
        return None


def _hear(ears: _Ears, heard: HeardFrame, message: Message | None, wanted: OdriveWanted) -> None:
    match message:
        case EncoderEstimates():
            ears.encoder.append(heard)
        case Heartbeat():
            ears.beat = message
        case Torques():
            ears.torques += 1
        case Iq() if wanted.dialect == OdriveFirmware.V0_5:
            ears.torques += 1
        case Version():
            ears.firmware = ".".join(map(str, message.firmware))
        case PartError():
            ears.part_errors[message.part] = message
