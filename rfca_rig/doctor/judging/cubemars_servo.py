"""Evaluates a CubeMars / T-Motor AK drive in servo mode, which sends its status cyclically."""

from dataclasses import dataclass

from rfca_rig.codecs.cubemars_drives import error_text
from rfca_rig.codecs.cubemars_servo import Status
from rfca_rig.doctor.finding import Finding, green, join_ids, red, yellow

DRIVE, ERROR, ENCODER = "drive", "drive error", "drive's encoder"
# Factors between measured and configured period: the driver refuses the first, the second gets a warning.
REFUSED_PERIOD_RATIO, WARNING_PERIOD_RATIO = 2.0, 1.2


@dataclass(frozen=True)
class ServoSeen:
    """Observed frames: `status` and `period_s` of the drive, ids of `others` with status frames; `strangers` counts other frames."""

    status: Status | None = None
    period_s: float | None = None
    others: tuple[int, ...] = ()
    strangers: int = 0
    unreadable: str | None = None


def judge_servo(seen: ServoSeen, drive_id: int, status_period_s: float) -> list[Finding]:
    if seen.unreadable is not None:
        return [red(DRIVE, f"drive {drive_id} cannot be understood: {seen.unreadable}", "set it to servo mode in CubeMarsTool")]
    if seen.status is None:
        return [_silent(seen, drive_id)]
    drive = green(DRIVE, f"AK drive {drive_id} in servo mode, {seen.status.temperature_degC} degC")
    return [drive, _error(seen.status), _period(seen.period_s, status_period_s)]


def _silent(seen: ServoSeen, drive_id: int) -> Finding:
    if seen.others:
        fix = f"put drive_id = {seen.others[0]} under [motor], or set the drive's id in CubeMarsTool"
        return red(DRIVE, f"heard drive {join_ids(seen.others)}, the rig file says {drive_id}", fix)
    if seen.strangers:
        fix = 'set it to servo mode in CubeMarsTool, or put device = "cubemars-mit" under [motor]'
        return red(DRIVE, f"heard {seen.strangers} frames, none a status of servo mode", fix)
    fix = "check its power, the wiring, the bit rate (1 Mbit/s), and in CubeMarsTool that it sends its status over CAN"
    return red(DRIVE, "nothing at all heard on the bus", fix)


def _error(status: Status) -> Finding:
    if status.error:
        return red(ERROR, error_text(status.error), "remove the cause, then switch the drive's power off and on")
    return green(ERROR, "none")


def _period(period_s: float | None, wanted_s: float) -> Finding:
    if period_s is None:
        return red(ENCODER, "too few status frames to tell their rate", f"set its upload rate to {1.0 / wanted_s:.0f} Hz in CubeMarsTool")
    factor = max(period_s / wanted_s, wanted_s / period_s)
    measured = f"every {1e3 * period_s:.3g} ms"
    if factor < WARNING_PERIOD_RATIO:
        return green(ENCODER, measured)
    fix = f"put status_period_ms = {1e3 * period_s:.3g} under [motor], or set its upload rate to {1.0 / wanted_s:.0f} Hz in CubeMarsTool"
    finding = red if factor >= REFUSED_PERIOD_RATIO else yellow
    return finding(ENCODER, f"{measured}, the rig file says {1e3 * wanted_s:g} ms", fix)
