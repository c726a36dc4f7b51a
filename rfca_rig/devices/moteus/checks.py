"""A moteus. It replies only when asked, and reading its registers changes nothing; if it is
silent, every other id is asked.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan

import can

from rfca_rig.devices.checks import Finding, Listener, ReceivedFrame, green, join_ids, red, yellow
from rfca_rig.devices.moteus import codec
from rfca_rig.devices.moteus.codec import (
    Mode,
    Read,
    Register,
    Reply,
    Route,
    Width,
    fault_text,
    mode_text,
)
from rfca_rig.devices.moteus.driver import OWN_ID
from rfca_rig.devices.moteus.section import MoteusSection
from rfca_rig.errors import MalformedFrame

DRIVE = "drive"
ERROR = "drive error"

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


@dataclass(frozen=True)
class MoteusAnswer:
    """Values of its registers."""

    mode: int
    fault: int
    voltage_V: float
    temperature_degC: float


@dataclass(frozen=True)
class MoteusSeen:
    """Observed answers. `others` are ids that answered when all were asked, which is done only
    if the drive is silent.
    """

    answer: MoteusAnswer | None = None
    others: tuple[int, ...] = ()
    strangers: int = 0
    unreadable: str | None = None


def judge_moteus(seen: MoteusSeen, drive_id: int) -> list[Finding]:
    if seen.unreadable is not None:
        return [
            red(
                DRIVE,
                f"drive {drive_id} cannot be understood: {seen.unreadable}",
                "update its firmware:",
                _tool(drive_id, "--info"),
            )
        ]
    if seen.answer is None:
        return [_silent(seen, drive_id)]
    drive = (
        f"moteus {drive_id}, {seen.answer.voltage_V:.1f} V, {seen.answer.temperature_degC:.0f} degC"
    )
    return [green(DRIVE, drive), _error(seen.answer, drive_id)]


def _silent(seen: MoteusSeen, drive_id: int) -> Finding:
    if seen.others:
        fix = f"put drive_id = {seen.others[0]} under [motor], or give the drive its id, in tview:"
        return red(
            DRIVE,
            f"heard drive {join_ids(seen.others)}, the rig file says {drive_id}",
            fix,
            f"conf set id.id {drive_id}",
            "conf write",
        )
    if seen.strangers:
        return red(
            DRIVE,
            f"heard {seen.strangers} frames, none of a moteus",
            "check device and can_prefix under [motor]",
        )
    fix = (
        "check its power, the wiring, can_prefix under [motor], and that the interface does "
        "CAN-FD at 1 and 5 Mbit/s"
    )
    return red(DRIVE, "no id from 1 to 126 answers", fix)


def _error(answer: MoteusAnswer, drive_id: int) -> Finding:
    if answer.mode == Mode.FAULT:
        fix = "remove the cause; the next run clears it, or by hand:"
        return red(ERROR, f"{fault_text(answer.fault)}", fix, _tool(drive_id, "--stop"))
    if answer.mode == Mode.TIMEOUT:
        fix = "nothing else is wrong: the next run clears it; by hand:"
        return yellow(ERROR, "its watchdog expired, it brakes", fix, _tool(drive_id, "--stop"))
    if answer.mode != Mode.STOPPED:
        fix = "end the program that runs it, or by hand:"
        return yellow(
            ERROR,
            f"no fault, but the drive is not stopped: {mode_text(answer.mode)}",
            fix,
            _tool(drive_id, "--stop"),
        )
    return green(ERROR, f"none, {mode_text(answer.mode)}")


def _tool(drive_id: int, order: str) -> str:
    return f"python -m moteus.moteus_tool --target {drive_id} {order}"


def look_for_moteus(
    listener: Listener, drive_id: int, prefix: int, bitrate_switch: bool
) -> MoteusSeen:
    listener.ask(_question(drive_id, prefix, bitrate_switch))
    listener.listen(ANSWER_S)
    if observe_moteus(listener.frames, drive_id, prefix).answer is None:
        for other in DRIVE_IDS:
            if other != drive_id:
                listener.ask(_question(other, prefix, bitrate_switch))
                listener.listen(SPACING_S)
        listener.listen(ANSWER_S)
    return observe_moteus(listener.frames, drive_id, prefix)


def _question(drive_id: int, prefix: int, bitrate_switch: bool) -> can.Message:
    identifier = codec.arbitration_id(Route(OWN_ID, drive_id, wants_reply=True, prefix=prefix))
    return can.Message(
        arbitration_id=identifier,
        data=codec.encode(QUERY),
        is_extended_id=identifier > 0x7FF,
        is_fd=True,
        bitrate_switch=bitrate_switch,
    )


def observe_moteus(frames: Sequence[ReceivedFrame], drive_id: int, prefix: int) -> MoteusSeen:
    """Sorts the received frames. Queries, by other programs or our own as echoes, are skipped."""
    answer: MoteusAnswer | None = None
    unreadable: str | None = None
    others = set[int]()
    strangers = 0
    for message in (heard.message for heard in frames):
        route = codec.route_of(message.arbitration_id)
        if route.wants_reply:
            continue
        if route.destination != OWN_ID or route.prefix != prefix:
            strangers += 1
        elif route.source != drive_id:
            others.add(route.source)
        else:
            answer, unreadable = _read(message.data, answer)
    # A good answer outweighs an unreadable frame before it.
    if answer is not None:
        unreadable = None
    return MoteusSeen(answer, tuple(sorted(others)), strangers, unreadable)


def _read(
    data: bytes | bytearray, before: MoteusAnswer | None
) -> tuple[MoteusAnswer | None, str | None]:
    try:
        values = {
            item.register: item.value for item in codec.decode(data) if isinstance(item, Reply)
        }
    except MalformedFrame as error:
        return before, str(error)
    if Register.MODE not in values:
        return before, "its answer lacks the mode"
    volts = values.get(Register.VOLTAGE, nan)
    degrees = values.get(Register.TEMPERATURE, nan)
    return MoteusAnswer(
        int(values[Register.MODE]), int(values.get(Register.FAULT, 0)), volts, degrees
    ), None


def check_drive(keys: MoteusSection, listener: Listener) -> list[Finding]:
    """The findings on the drive that [motor] names."""
    return judge_moteus(
        look_for_moteus(listener, keys.drive_id, keys.can_prefix, keys.bitrate_switch),
        keys.drive_id,
    )
