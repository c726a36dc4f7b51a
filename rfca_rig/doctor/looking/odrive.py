"""Listens for ODrives. Sends only requests for the version, and for the errors of parts that report some."""

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
from rfca_rig.doctor.looking.can_bus import LISTEN_S, Listener, ReceivedFrame, mean_period_s

ANSWER_S = 0.1
# Messages that only a drive sends, and sends unasked: they identify an ODrive.
IDENTIFYING_COMMANDS = frozenset({OdriveCommand.HEARTBEAT, OdriveCommand.ENCODER_ESTIMATES})


def look_for_odrive(listener: Listener, wanted: OdriveWanted) -> OdriveSeen:
    listener.listen(LISTEN_S)
    first = observe_odrive(listener.frames, wanted)
    # Only an idle drive is asked: any frame feeds the watchdog of a running one.
    if first.beat is not None and first.beat.state == AxisState.IDLE:
        listener.ask(_question(cansimple.request(wanted.node_id, OdriveCommand.VERSION)))
        for part in first.beat.failed:
            listener.ask(_question(cansimple.request(wanted.node_id, cansimple.PART_COMMANDS[part])))
        listener.listen(ANSWER_S)
    return observe_odrive(listener.frames, wanted)


def _question(frame: cansimple.Frame) -> can.Message:
    return can.Message(arbitration_id=frame[0], is_extended_id=False, is_remote_frame=True)


@dataclass
class _Observations:
    """Observations collected from frames."""

    others: set[int] = field(default_factory=set)
    strangers: int = 0
    own_frames: int = 0
    beat: Heartbeat | None = None
    encoder: list[ReceivedFrame] = field(default_factory=list)
    torques: int = 0
    firmware: str | None = None
    part_errors: dict[str, PartError] = field(default_factory=dict)
    unreadable: str | None = None


def observe_odrive(frames: Sequence[ReceivedFrame], wanted: OdriveWanted) -> OdriveSeen:
    """Sorts the received frames."""
    observed = _Observations()
    for heard in frames:
        _take(observed, heard, wanted)
    return OdriveSeen(
        others=tuple(sorted(observed.others)),
        strangers=observed.strangers,
        own_frames=observed.own_frames,
        beat=observed.beat,
        period_s=mean_period_s(observed.encoder),
        torques=observed.torques,
        firmware=observed.firmware,
        part_errors=tuple(observed.part_errors.values()),
        unreadable=observed.unreadable,
    )


def _take(observed: _Observations, heard: ReceivedFrame, wanted: OdriveWanted) -> None:
    message = heard.message
    identifier = message.arbitration_id
    # A frame of eight bytes with such a command, from another node: most likely another ODrive.
    is_telling = not message.is_extended_id and identifier & 0x1F in IDENTIFYING_COMMANDS and message.dlc == 8
    if not message.is_extended_id and cansimple.node_of(identifier) == wanted.node_id and message.dlc:
        observed.own_frames += 1
        _hear(observed, heard, _decode(observed, message, wanted.dialect), wanted)
    elif is_telling:
        observed.others.add(cansimple.node_of(identifier))
    else:
        observed.strangers += 1


def _decode(observed: _Observations, message: can.Message, dialect: OdriveFirmware) -> Message | None:
    try:
        return cansimple.decode(message.arbitration_id, message.data, dialect)
    except MalformedFrame as error:
        observed.unreadable = str(error)
        return None


def _hear(observed: _Observations, heard: ReceivedFrame, message: Message | None, wanted: OdriveWanted) -> None:
    match message:
        case EncoderEstimates():
            observed.encoder.append(heard)
        case Heartbeat():
            observed.beat = message
        case Torques():
            observed.torques += 1
        case Iq() if wanted.dialect == OdriveFirmware.V0_5:
            observed.torques += 1
        case Version():
            observed.firmware = ".".join(map(str, message.firmware))
        case PartError():
            observed.part_errors[message.part] = message
