"""Evaluates a moteus. It replies only when asked; reading its registers changes nothing."""

from dataclasses import dataclass

from rfca_rig.codecs.moteus_registers import Mode, fault_text, mode_text
from rfca_rig.doctor.finding import Finding, green, join_ids, red, yellow

DRIVE, ERROR = "drive", "drive error"


@dataclass(frozen=True)
class MoteusAnswer:
    """Values of its registers."""

    mode: int
    fault: int
    voltage_V: float
    temperature_degC: float


@dataclass(frozen=True)
class MoteusSeen:
    """Observed answers. `others` are ids that answered when all were asked, which is done only if the drive is silent."""

    answer: MoteusAnswer | None = None
    others: tuple[int, ...] = ()
    strangers: int = 0
    unreadable: str | None = None


def judge_moteus(seen: MoteusSeen, drive_id: int) -> list[Finding]:
    if seen.unreadable is not None:
        return [red(DRIVE, f"drive {drive_id} cannot be understood: {seen.unreadable}", "update its firmware:", _tool(drive_id, "--info"))]
    if seen.answer is None:
        return [_silent(seen, drive_id)]
    drive = f"moteus {drive_id}, {seen.answer.voltage_V:.1f} V, {seen.answer.temperature_degC:.0f} degC"
    return [green(DRIVE, drive), _error(seen.answer, drive_id)]


def _silent(seen: MoteusSeen, drive_id: int) -> Finding:
    if seen.others:
        fix = f"put drive_id = {seen.others[0]} under [motor], or give the drive its id, in tview:"
        return red(
            DRIVE, f"heard drive {join_ids(seen.others)}, the rig file says {drive_id}", fix, f"conf set id.id {drive_id}", "conf write"
        )
    if seen.strangers:
        return red(DRIVE, f"heard {seen.strangers} frames, none of a moteus", "check device and can_prefix under [motor]")
    fix = "check its power, the wiring, can_prefix under [motor], and that the interface does CAN-FD at 1 and 5 Mbit/s"
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
        return yellow(ERROR, f"no fault, but the drive is not stopped: {mode_text(answer.mode)}", fix, _tool(drive_id, "--stop"))
    return green(ERROR, f"none, {mode_text(answer.mode)}")


def _tool(drive_id: int, order: str) -> str:
    return f"python -m moteus.moteus_tool --target {drive_id} {order}"
