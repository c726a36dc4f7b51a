"""ODrives: node id, errors, report rates. Sends only requests for the version, and for the
errors of parts that report some.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

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
from rfca_rig.devices.odrive import codec
from rfca_rig.devices.odrive.messages import (
    BROADCAST_NODE,
    WATCHDOG_EXPIRED,
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
    error_text,
    part_error_text,
    state_text,
)
from rfca_rig.devices.odrive.section import OdriveSection
from rfca_rig.errors import MalformedFrame

DRIVE = "drive"
ERROR = "drive error"
ENCODER = "drive's encoder"
TORQUE = "drive's torque"
# Factors between measured and configured period: the driver refuses the first, the second gets a
# warning.
REFUSED_PERIOD_RATIO = 2.0
WARNING_PERIOD_RATIO = 1.2
SAVE = "odrv0.save_configuration()"

ANSWER_S = 0.1
# Messages that only a drive sends, and sends unasked: they identify an ODrive.
IDENTIFYING_COMMANDS = frozenset({OdriveCommand.HEARTBEAT, OdriveCommand.ENCODER_ESTIMATES})


@dataclass(frozen=True)
class OdriveWanted:
    """Expected drive, from the rig file."""

    node_id: int
    encoder_period_s: float
    dialect: OdriveFirmware = OdriveFirmware.V0_6


@dataclass(frozen=True)
class OdriveSeen:
    """Observed frames of the expected node, and `others`: further nodes that behave as ODrives.
    `period_s` is that of the encoder.

    `strangers` counts frames of other protocols. `unreadable` is why a frame of the expected node
    could not be decoded.
    """

    others: tuple[int, ...] = ()
    strangers: int = 0
    own_frames: int = 0
    beat: Heartbeat | None = None
    period_s: float | None = None
    torques: int = 0
    firmware: str | None = None
    part_errors: tuple[PartError, ...] = ()
    unreadable: str | None = None


def judge_odrive(seen: OdriveSeen, wanted: OdriveWanted) -> list[Finding]:
    if seen.own_frames == 0:
        return [_not_heard(seen, wanted)]
    if seen.unreadable is not None:
        return [
            red(
                DRIVE,
                f"node {wanted.node_id} cannot be understood: {seen.unreadable}",
                "check dialect under [motor]",
            )
        ]
    if seen.beat is None:
        return [
            red(
                DRIVE,
                f"node {wanted.node_id} speaks, but has no heartbeat",
                "set it, in odrivetool:",
                _set("heartbeat", 100, wanted),
                SAVE,
            )
        ]
    return [
        _identity(seen, wanted),
        _error(seen, seen.beat, wanted),
        _encoder(seen, wanted),
        _torque(seen, wanted),
    ]


def _not_heard(seen: OdriveSeen, wanted: OdriveWanted) -> Finding:
    # A drive at the broadcast address has not been given an address yet.
    addressed = tuple(node for node in seen.others if node != BROADCAST_NODE)
    tell = (f"odrv0.axis0.config.can.node_id = {wanted.node_id}", SAVE)
    if addressed:
        fix = f"put node_id = {addressed[0]} under [motor], or tell the drive, in odrivetool:"
        return red(
            DRIVE,
            f"heard node {join_ids(addressed)}, the rig file says {wanted.node_id}",
            fix,
            *tell,
        )
    if seen.others:
        return red(
            DRIVE, "heard a drive that has no address yet", "give it one, in odrivetool:", *tell
        )
    if seen.strangers:
        return red(
            DRIVE,
            f"heard {seen.strangers} frames, none as an ODrive speaks",
            "check device and bitrate under [motor]",
        )
    fix = (
        "check the drive's power, the CAN wiring, a 120 ohm resistor at both ends, and the "
        "drive's bit rate; in odrivetool:"
    )
    return red(DRIVE, "nothing at all heard on the bus", fix, "odrv0.can.config.baud_rate")


def _identity(seen: OdriveSeen, wanted: OdriveWanted) -> Finding:
    firmware = ""
    if seen.firmware is not None:
        firmware = f", firmware {seen.firmware}"
    others = ""
    if seen.others:
        others = f"; also heard node {join_ids(seen.others)}"
    drive = f"ODrive, node {wanted.node_id}{firmware}{others}"
    if wanted.dialect == OdriveFirmware.V0_5 and seen.firmware is not None:
        return red(
            DRIVE,
            f"{drive}: only firmware 0.6 tells its version",
            'put dialect = "0.6" under [motor]',
        )
    return green(DRIVE, drive)


def _error(seen: OdriveSeen, beat: Heartbeat, wanted: OdriveWanted) -> Finding:
    parts = {error.part: part_error_text(error.part, error.word) for error in seen.part_errors}
    errors = "; ".join(
        [
            error_text(beat.error, wanted.dialect),
            *(parts.get(part, f"{part} error") for part in beat.failed),
        ]
    )
    # An expired watchdog is the normal state after a program ended, so it is only a warning.
    if beat.error == WATCHDOG_EXPIRED[wanted.dialect] and not beat.failed:
        return yellow(
            ERROR,
            errors,
            "nothing else is wrong: the next run clears it; by hand, in odrivetool:",
            "odrv0.clear_errors()",
        )
    if beat.error or beat.failed:
        return red(
            ERROR, errors, "remove the cause, then clear it, in odrivetool:", "odrv0.clear_errors()"
        )
    if beat.state != AxisState.IDLE:
        state = f"no error, but the drive is not idle: {state_text(beat.state)}"
        return yellow(
            ERROR,
            state,
            "end the program that runs it, or in odrivetool:",
            "odrv0.axis0.requested_state = AxisState.IDLE",
        )
    return green(ERROR, f"none, {state_text(beat.state)}")


def _encoder(seen: OdriveSeen, wanted: OdriveWanted) -> Finding:
    wanted_ms = 1e3 * wanted.encoder_period_s
    commands = (_set("encoder", wanted_ms, wanted), SAVE)
    if seen.period_s is None:
        return red(
            ENCODER, "no steady encoder estimates", "set their period, in odrivetool:", *commands
        )
    factor = max(seen.period_s / wanted.encoder_period_s, wanted.encoder_period_s / seen.period_s)
    measured = f"every {1e3 * seen.period_s:.3g} ms"
    if factor < WARNING_PERIOD_RATIO:
        return green(ENCODER, measured)
    finding = red if factor >= REFUSED_PERIOD_RATIO else yellow
    fix = (
        f"put encoder_period_ms = {1e3 * seen.period_s:.3g} under [motor], or tell the drive, "
        "in odrivetool:"
    )
    return finding(ENCODER, f"{measured}, the rig file says {wanted_ms:g} ms", fix, *commands)


def _torque(seen: OdriveSeen, wanted: OdriveWanted) -> Finding:
    if seen.torques:
        return green(TORQUE, "reported")
    if wanted.dialect == OdriveFirmware.V0_5:
        message = "iq"
        fix = "set its period, in odrivetool:"
    else:
        message = "torques"
        fix = 'put dialect = "0.5" if its firmware is, else in odrivetool:'
    return red(
        TORQUE,
        f"no {message} messages",
        fix,
        _set(message, 1e3 * wanted.encoder_period_s, wanted),
        SAVE,
    )


def _set(message: str, period_ms: float, wanted: OdriveWanted) -> str:
    infix = ""
    # Firmware 0.6 renamed these settings.
    if wanted.dialect != OdriveFirmware.V0_5:
        infix = "_msg"
    return f"odrv0.axis0.config.can.{message}{infix}_rate_ms = {round(period_ms)}"


def look_for_odrive(listener: Listener, wanted: OdriveWanted) -> OdriveSeen:
    listener.listen(LISTEN_S)
    first = observe_odrive(listener.frames, wanted)
    # Only an idle drive is asked: any frame feeds the watchdog of a running one.
    if first.beat is not None and first.beat.state == AxisState.IDLE:
        listener.ask(_question(codec.request(wanted.node_id, OdriveCommand.VERSION)))
        for part in first.beat.failed:
            listener.ask(_question(codec.request(wanted.node_id, codec.PART_COMMANDS[part])))
        listener.listen(ANSWER_S)
    return observe_odrive(listener.frames, wanted)


def _question(frame: codec.Frame) -> can.Message:
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
    is_telling = (
        not message.is_extended_id
        and identifier & 0x1F in IDENTIFYING_COMMANDS
        and message.dlc == 8
    )
    if not message.is_extended_id and codec.node_of(identifier) == wanted.node_id and message.dlc:
        observed.own_frames += 1
        _note_message(observed, heard, _decode(observed, message, wanted.dialect), wanted)
    elif is_telling:
        observed.others.add(codec.node_of(identifier))
    else:
        observed.strangers += 1


def _decode(
    observed: _Observations, message: can.Message, dialect: OdriveFirmware
) -> Message | None:
    try:
        return codec.decode(message.arbitration_id, message.data, dialect)
    except MalformedFrame as error:
        observed.unreadable = str(error)
        return None


def _note_message(
    observed: _Observations, heard: ReceivedFrame, message: Message | None, wanted: OdriveWanted
) -> None:
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


def check_drive(keys: OdriveSection, listener: Listener) -> list[Finding]:
    """The findings on the drive that [motor] names."""
    wanted = OdriveWanted(keys.node_id, keys.encoder_period_ms / 1e3, OdriveFirmware(keys.dialect))
    return judge_odrive(look_for_odrive(listener, wanted), wanted)
