"""Evaluates a CubeMars / T-Motor AK drive in MIT mode. It replies only when asked, which is done by the frame that disables it."""

from dataclasses import dataclass

from rfca_rig.codecs.cubemars_drives import error_text
from rfca_rig.codecs.cubemars_mit import MitReply
from rfca_rig.doctor.finding import Finding, green, join_ids, red, yellow

DRIVE, ERROR = "drive", "drive error"


@dataclass(frozen=True)
class MitSeen:
    """Observed frames. The drive is `asked` only on a quiet bus. `others` are foreign ids, `masters` wrong ids of its replies."""

    asked: bool
    reply: MitReply | None = None
    others: tuple[int, ...] = ()
    masters: tuple[int, ...] = ()
    servo: tuple[int, ...] = ()
    unreadable: str | None = None


def judge_mit(seen: MitSeen, drive_id: int) -> list[Finding]:
    if seen.unreadable is not None:
        return [red(DRIVE, f"drive {drive_id} cannot be understood: {seen.unreadable}", "set it to MIT mode in CubeMarsTool")]
    if seen.reply is None:
        return [_silent(seen, drive_id)]
    temperature = "" if seen.reply.temperature_degC is None else f", {seen.reply.temperature_degC} degC"
    return [green(DRIVE, f"AK drive {drive_id} in MIT mode{temperature}"), _error(seen.reply)]


def _silent(seen: MitSeen, drive_id: int) -> Finding:
    if drive_id in seen.servo:
        fix = 'set it to MIT mode in CubeMarsTool, or put device = "cubemars-servo" under [motor]'
        return red(DRIVE, f"drive {drive_id} is in servo mode", fix)
    if seen.masters:
        fix = f"set its master id to 0 or {drive_id} in CubeMarsTool"
        return red(DRIVE, f"drive {drive_id} replies under id {join_ids(seen.masters)}", fix)
    other_ids = tuple(sorted({*seen.others, *seen.servo}))
    if other_ids:
        fix = f"put drive_id = {other_ids[0]} under [motor] if that is the drive, or end the program that speaks there"
        not_asked = "" if seen.asked else "; it was not asked while others speak"
        return red(DRIVE, f"heard id {join_ids(other_ids)}, the rig file says {drive_id}{not_asked}", fix)
    fix = "check its power, the wiring, a 120 ohm resistor at both ends, that it has 1 Mbit/s, and in CubeMarsTool its id and MIT mode"
    return red(DRIVE, f"drive {drive_id} does not answer, and nothing else speaks", fix)


def _error(reply: MitReply) -> Finding:
    if reply.error is None:
        return yellow(ERROR, "its firmware does not tell errors", "update the firmware with CubeMarsTool to have them told")
    if reply.error:
        return red(ERROR, error_text(reply.error), "remove the cause, then switch the drive's power off and on")
    return green(ERROR, "none")
