"""Reads registers of a moteus and, if it is silent, of every other id. Reading changes nothing in a drive."""

from collections.abc import Iterable, Sequence
from math import nan

import can

from rfca_rig.codecs import moteus
from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.codecs.moteus import Read, Reply, Route
from rfca_rig.codecs.moteus_registers import Register, Width
from rfca_rig.doctor.judging.moteus import MoteusAnswer, MoteusSeen
from rfca_rig.doctor.looking.can_bus import Listener, ReceivedFrame
from rfca_rig.drivers.motors.moteus_replies import OWN_ID

# Time for an answer, and the interval between two ids so that the bus is not flooded, in s.
ANSWER_S = 0.1
SPACING_S = 2e-3
DRIVE_IDS = range(1, 127)
QUERY = (
    Read(Register.MODE, Width.INT8),
    Read(Register.VOLTAGE, Width.INT16),
    Read(Register.TEMPERATURE, Width.INT16),
    Read(Register.FAULT, Width.INT16),
)


def look_for_moteus(listener: Listener, drive_id: int, prefix: int, bitrate_switch: bool) -> MoteusSeen:
    listener.ask(_question(drive_id, prefix, bitrate_switch))
    listener.listen(ANSWER_S)
    if observe_moteus(listener.frames, drive_id, prefix).answer is None:
        _ask_all((other for other in DRIVE_IDS if other != drive_id), listener, prefix, bitrate_switch)
    return observe_moteus(listener.frames, drive_id, prefix)


def _ask_all(ids: Iterable[int], listener: Listener, prefix: int, bitrate_switch: bool) -> None:
    for other in ids:
        listener.ask(_question(other, prefix, bitrate_switch))
        listener.listen(SPACING_S)
    listener.listen(ANSWER_S)


def _question(drive_id: int, prefix: int, bitrate_switch: bool) -> can.Message:
    identifier = moteus.arbitration_id(Route(OWN_ID, drive_id, wants_reply=True, prefix=prefix))
    return can.Message(
        arbitration_id=identifier,
        data=moteus.encode(QUERY),
        is_extended_id=identifier > 0x7FF,
        is_fd=True,
        bitrate_switch=bitrate_switch,
    )


def observe_moteus(frames: Sequence[ReceivedFrame], drive_id: int, prefix: int) -> MoteusSeen:
    """Sorts the received frames. Queries, by other programs or our own as echoes, are skipped."""
    answer: MoteusAnswer | None = None
    unreadable: str | None = None
    others, strangers = set[int](), 0
    for message in (heard.message for heard in frames):
        route = moteus.route_of(message.arbitration_id)
        if route.wants_reply:
            continue
        if route.destination != OWN_ID or route.prefix != prefix:
            strangers += 1
        elif route.source != drive_id:
            others.add(route.source)
        else:
            answer, unreadable = _read(message.data, answer)
    # A good answer outweighs an unreadable frame before it.
    return MoteusSeen(answer, tuple(sorted(others)), strangers, unreadable if answer is None else None)


def _read(data: bytes | bytearray, before: MoteusAnswer | None) -> tuple[MoteusAnswer | None, str | None]:
    try:
        values = {item.register: item.value for item in moteus.decode(data) if isinstance(item, Reply)}
    except MalformedFrame as error:
        return before, str(error)
    if Register.MODE not in values:
        return before, "its answer lacks the mode"
    volts, degrees = values.get(Register.VOLTAGE, nan), values.get(Register.TEMPERATURE, nan)
    return MoteusAnswer(int(values[Register.MODE]), int(values.get(Register.FAULT, 0)), volts, degrees), None
