"""Evaluates an ATI F/T Controller on a serial port: answer, record rate, record quality."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red, yellow

ANSWER, RATE, HEALTH = "sensor", "sensor's rate", "sensor's records"
# Relative difference of the rate that the driver accepts too.
TOLERANCE = 0.03


@dataclass(frozen=True)
class ControllerSeen:
    """Observed short stream. `error` is why it failed, None if it did not; `notes` are the driver's remarks on the records."""

    path: str
    error: str | None = None
    seconds: float = 0.0
    received: int = 0
    rate_Hz: float = 0.0
    notes: tuple[str, ...] = ()


def judge_controller(seen: ControllerSeen, rate_Hz: float) -> list[Finding]:
    if seen.error is not None:
        return [red(ANSWER, seen.error, "check the controller's power, the cable (a null modem?), and bits_per_s under [force_sensor]")]
    if not seen.received:
        fix = "check record and bits_per_s under [force_sensor]"
        return [red(ANSWER, f"F/T controller on {seen.path} answers, but no record came in {seen.seconds:.1f} s", fix)]
    return [green(ANSWER, f"F/T controller on {seen.path} answers"), _rate(seen.rate_Hz, rate_Hz), _health(seen)]


def _rate(rate_Hz: float, wanted_Hz: float) -> Finding:
    if abs(rate_Hz / wanted_Hz - 1.0) > TOLERANCE:
        fix = f"put rate_Hz = {rate_Hz:.3g} under [force_sensor], or change the controller's averaging (SA) and sampling (SF)"
        return red(RATE, f"{rate_Hz:.1f} records/s, the rig file says {wanted_Hz:g}", fix)
    return green(RATE, f"{rate_Hz:.1f} records/s")


def _health(seen: ControllerSeen) -> Finding:
    if seen.notes:
        return yellow(HEALTH, "; ".join(seen.notes), "take every load off the sensor, check the transducer's cable, then look again")
    return green(HEALTH, f"{seen.received} in {seen.seconds:.1f} s, all whole")
