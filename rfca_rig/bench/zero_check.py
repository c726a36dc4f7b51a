"""Whether the zero of the rig file still holds: a drive's encoder may count from elsewhere after a
power-up.

`rfca-rig setup zero` stores when the zero was checked, and what the drive told then, in a file
beside the rig file. Each run compares the drive with it before anything is energised, and stores
where it left the drive. A drive that tells how long it has been on shows every power-up. Of the
others only the reading speaks: one that stands where it was left, and where no power-up would put
it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Literal

import numpy as np

from rfca_rig.clock import Clock
from rfca_rig.description.rig_file import RigFile
from rfca_rig.drivers.encoder_zero import EncoderZero, ZeroPolicy
from rfca_rig.drivers.roles import MotorStatus, ShaftMotor
from rfca_rig.engine.interfaces import Bench
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.toml import Section, format_value, read_text

ENDING = ".zero.json"

# Time for which the encoder is read before a run. A twin's leg is not held: it swings as soon
# as time passes, so it is read at once.
READ_S = 0.2
TWIN_READ_S = 0.01
# Within the time of a reading a leg that stands still moves by less than this: a tenth of what
# counts as moved. A leg that the motor let go swings for seconds; the longest time is assumed.
STILL_DEG = 0.5
SWINGS_S = 15.0
# A drive is asked, or told to stay off, so often; and the longest time without its first report.
ASK_EVERY_S = 0.02
POLL_S = 2e-3
ANSWER_S = 1.0

# A leg that hangs from a drive without torque comes back to within a few degrees, by friction.
MAX_MOVED_DEG = 5.0
# A wrong turn of the motor must stay far outside of what counts as not moved.
MAX_MOVED_MOTOR_TURNS = 0.25
# Time within which a reading near that of a power-up is still taken for the one that was left: the
# time from the check to the first run.
FRESH_S = 900.0
# Difference between the clocks of host and drive: a step of the host's, and the rate of a drive
# that counts by an RC oscillator (drives trim their own in steps of 0.25 %).
CLOCK_STEP_S = 2.0
CLOCK_DRIFT = 0.01

UNFINISHED = "the last run did not end in order"


@dataclass(frozen=True)
class EncoderReading:
    """What the drive told of its encoder, with the motor off.

    Parameters
    ----------
    value, spread
        Mean and largest difference of the readings, in the unit of the zero.
    count
        How many readings.
    uptime_s
        Time since the drive was powered up; None where it does not tell.
    at
        When.
    zero_lost
        Why the driver no longer trusts its angles, or None.
    """

    value: float
    spread: float
    count: int
    uptime_s: float | None
    at: datetime
    zero_lost: str | None = None


class ZeroCheck(Section):
    """The last check of a zero, as stored. `left_reading` is where the encoder was last seen with
    the motor off, at `left_at`; None while that is not known, for the reason in `doubt`.
    """

    format: Literal["rfca-zero/1"] = "rfca-zero/1"
    source: Literal["REAL", "SIM"]
    device: str
    zero: float
    per_shaft_turn: float
    checked_at: str
    reading: float
    left_reading: float | None
    left_at: str
    uptime_s: float | None
    doubt: str = ""


def zero_of(rig: RigFile) -> EncoderZero:
    """The zero of the rig's drive. Raises BadInput for a drive whose section does not state how its
    reading becomes an angle.
    """
    zero = rig.motor.encoder_zero
    if zero is None:
        raise BadInput(
            f"{rig.rig.title}: the section of {rig.motor.title} does not state how its reading "
            "becomes an angle; override encoder_zero in it (docs/add-a-motor.md)"
        )
    return zero


def needs_check(policy: ZeroPolicy | None) -> bool:
    """Whether a power-up may have changed the zero. Of a policy that is not stated nothing is
    known, and nothing is checked.
    """
    return policy in {"behind-gear", "incremental"}


def read_encoder(
    motor: ShaftMotor, clock: Clock, zero: EncoderZero, for_s: float
) -> EncoderReading:
    """Reads the encoder for that time, with the motor off. Raises DeviceError where nothing comes.

    Drives that report only when they are addressed answer the frames that keep them off.
    """
    # What came while a person moved the leg is not of the leg as it stands.
    motor.read()
    angles_rad: list[float] = []
    began_s = clock.now_s()
    first_s = None
    asked_s = -np.inf
    while first_s is None or clock.now_s() - first_s < for_s:
        if clock.now_s() - asked_s >= ASK_EVERY_S:
            motor.disable()
            asked_s = clock.now_s()
        clock.wait_until(clock.now_s() + POLL_S)
        angles_rad += motor.read().angle_rad.tolist()
        if first_s is None and angles_rad:
            first_s = clock.now_s()
        if first_s is None and clock.now_s() - began_s > ANSWER_S:
            raise DeviceError(
                f"no reading of the drive's encoder within {ANSWER_S:g} s; "
                "rfca-rig doctor --rig FILE says more"
            )
    return summarize_readings(zero, angles_rad, motor.status(), clock)


def read_still_encoder(motor: ShaftMotor, clock: Clock, zero: EncoderZero) -> EncoderReading:
    """Reads the encoder when the leg stands still: one that the motor let go swings for seconds.
    After SWINGS_S it is read as it moves. Raises DeviceError as `read_encoder`.
    """
    until_s = clock.now_s() + SWINGS_S
    while True:
        reading = read_encoder(motor, clock, zero, READ_S)
        if zero.shaft_deg(reading.spread) <= STILL_DEG or clock.now_s() > until_s:
            return reading


def summarize_readings(
    zero: EncoderZero, angles_rad: Sequence[float], status: MotorStatus, clock: Clock
) -> EncoderReading:
    """The reading behind the angles of a driver with that zero, and its status after them."""
    readings = [zero.reading(angle_rad) for angle_rad in angles_rad]
    return EncoderReading(
        value=float(np.mean(readings)),
        spread=max(readings) - min(readings),
        count=len(readings),
        uptime_s=status.uptime_s,
        at=clock.wall_time(),
        zero_lost=status.zero_lost,
    )


def state_file(rig_path: Path) -> Path:
    """The file beside the rig file that holds the last check."""
    return rig_path.with_name(rig_path.stem + ENDING)


def read_check(rig_path: Path) -> ZeroCheck | None:
    """The last check, None where there was none. Raises BadInput for a damaged file."""
    path = state_file(rig_path)
    if not path.is_file():
        return None
    try:
        return ZeroCheck.model_validate_json(read_text(path))
    except ValueError:
        raise BadInput(
            f"{path}: is no record of a zero check; remove it, then type {setup_command(rig_path)}"
        ) from None


def write_check(rig_path: Path, check: ZeroCheck) -> None:
    """Stores the check. Raises RigError where the folder takes no file."""
    text = check.model_dump_json(indent=1) + "\n"
    write_atomically(state_file(rig_path), text.encode("utf-8"))


def new_check(rig: RigFile, reading: EncoderReading, left: EncoderReading) -> ZeroCheck:
    """The check of a zero that the rig file has now: `reading` with the leg at a known angle,
    `left` as the leg was left.
    """
    zero = zero_of(rig)
    return ZeroCheck(
        source=rig.source,
        device=rig.motor.device,
        zero=zero.value,
        per_shaft_turn=zero.per_shaft_turn,
        checked_at=reading.at.isoformat(timespec="seconds"),
        reading=reading.value,
        left_reading=left.value,
        left_at=left.at.isoformat(),
        uptime_s=left.uptime_s,
    )


def setup_command(rig_path: Path | None) -> str:
    """What to type."""
    return f"rfca-rig setup zero --rig {rig_path or 'FILE'}"


def find_stale_check(rig: RigFile, check: ZeroCheck | None) -> str | None:
    """Why a check says nothing of the rig file as it is now, or None. Asks no drive."""
    zero = zero_of(rig)
    if check is None:
        return "its zero was never checked"
    if check.source != rig.source:
        return f"its zero was checked on a rig of another kind ({check.source})"
    if check.device != rig.motor.device or check.per_shaft_turn != zero.per_shaft_turn:
        return "device, direction or gear_ratio changed since its zero was checked"
    if check.zero != zero.value:
        return (
            f"{zero.key} is {format_value(zero.value)}, and {format_value(check.zero)} "
            "was what was checked"
        )
    if check.doubt and not (check.doubt == UNFINISHED and check.uptime_s is not None):
        return check.doubt
    return None


def find_doubt(
    zero: EncoderZero, policy: ZeroPolicy | None, check: ZeroCheck, now: EncoderReading
) -> str | None:
    """Why the drive may have been powered up since the check, or its zero be lost otherwise; None
    where that can be excluded.
    """
    if now.zero_lost is not None:
        return now.zero_lost
    elapsed_s = (now.at - datetime.fromisoformat(check.left_at)).total_seconds()
    if check.uptime_s is not None and now.uptime_s is not None:
        # Of a drive that was on for less than the clocks may differ, its uptime says nothing.
        clocks_s = CLOCK_STEP_S + CLOCK_DRIFT * abs(elapsed_s)
        if abs(now.uptime_s - check.uptime_s - elapsed_s) > clocks_s:
            return f"the drive was powered up {describe_span(now.uptime_s)} ago, after the check"
        if check.uptime_s > clocks_s:
            return None
    if check.left_reading is None:
        return check.doubt or UNFINISHED
    return _find_doubt_of_reading(zero, policy, check.left_reading, now.value, elapsed_s)


def _find_doubt_of_reading(
    zero: EncoderZero, policy: ZeroPolicy | None, left: float, now: float, elapsed_s: float
) -> str | None:
    still = min(zero.of_degrees(MAX_MOVED_DEG), MAX_MOVED_MOTOR_TURNS * zero.per_motor_turn)
    moved = now - left
    if abs(moved) > still:
        return (
            f"its encoder reads {now:.3f} {zero.unit} and was left at {left:.3f}, "
            f"{zero.shaft_deg(moved):.0f} deg of the shaft away: it was powered up, "
            "or the leg was moved"
        )
    # Where a power-up puts the reading: at zero, or within one turn of the motor.
    start = 0.0
    if policy == "behind-gear":
        start = zero.per_motor_turn
    if abs(now) <= start + 2.0 * still and not 0.0 <= elapsed_s <= FRESH_S:
        return (
            f"its encoder reads {now:.3f} {zero.unit}, as it may after a power-up, and the drive "
            f"does not tell how long it is on; it was last seen {describe_span(elapsed_s)} ago"
        )
    return None


def describe_span(span_s: float) -> str:
    """A time in the unit that suits it."""
    if abs(span_s) < 120.0:
        return f"{span_s:.0f} s"
    if abs(span_s) < 7200.0:
        return f"{span_s / 60.0:.0f} min"
    return f"{span_s / 3600.0:.1f} h"


def describe_evidence(check: ZeroCheck, now: EncoderReading) -> str:
    """For the recording: what excludes a power-up since the check."""
    if check.uptime_s is not None and now.uptime_s is not None:
        return f"the drive was on for {describe_span(now.uptime_s)}"
    left_s = (now.at - datetime.fromisoformat(check.left_at)).total_seconds()
    return f"the encoder stands where it was left {describe_span(left_s)} ago"


class ZeroOfRun:
    """The zero of one run: asked before the rig is armed, compared before the drive is energised,
    and stored when the motor is off.
    """

    def __init__(self, rig: RigFile, rig_path: Path | None) -> None:
        self._rig = rig
        self._path = rig_path
        self._policy = rig.motor.zero_policy
        self._check: ZeroCheck | None = None

    def check_before_arming(self) -> None:
        """Raises BadInput where the stored check does not hold for the rig file as it is."""
        if not needs_check(self._policy):
            return
        if self._path is not None:
            self._check = read_check(self._path)
        self._refuse_if(find_stale_check(self._rig, self._check))

    def check_drive(self, bench: Bench) -> dict[str, str]:
        """What is recorded of the zero. Raises BadInput where the drive may have been powered up
        since the check. The motor is off.
        """
        if self._policy is None:
            # As ever on a twin, whose recordings stay the same to the last byte.
            if not bench.is_real:
                return {}
            return {"zero_policy": "not stated"}
        if self._check is None or self._path is None:
            return {"zero_policy": self._policy}
        zero = zero_of(self._rig)
        now = self._read(bench)
        self._refuse_if(find_doubt(zero, self._policy, self._check, now))
        facts = {
            "zero_policy": self._policy,
            "zero_checked_at": self._check.checked_at,
            "zero_reading": f"{now.value:.6f} {zero.unit}",
            "zero_evidence": describe_evidence(self._check, now),
        }
        # Where the run leaves the encoder is not known before it has ended in order.
        if bench.is_real:
            self._store({"left_reading": None, "doubt": UNFINISHED})
        return facts

    def store_end(self, bench: Bench) -> None:
        """Stores where the run leaves the encoder, or that its zero is lost. The motor is off."""
        if self._check is None:
            return
        lost = bench.motor.status().zero_lost
        if lost is not None:
            self._store({"left_reading": None, "doubt": lost})
        # A twin in this process is set up again for each run, where its file parks it.
        elif bench.is_real:
            now = self._read(bench)
            self._store(
                {
                    "left_reading": now.value,
                    "left_at": now.at.isoformat(),
                    "uptime_s": now.uptime_s,
                    "doubt": now.zero_lost or "",
                }
            )

    def _read(self, bench: Bench) -> EncoderReading:
        zero = zero_of(self._rig)
        if not bench.is_real:
            return read_encoder(bench.motor, bench.clock, zero, TWIN_READ_S)
        return read_still_encoder(bench.motor, bench.clock, zero)

    def _store(self, changes: Mapping[str, object]) -> None:
        assert self._check is not None and self._path is not None
        self._check = self._check.model_copy(update=changes)
        write_check(self._path, self._check)

    def _refuse_if(self, doubt: str | None) -> None:
        if doubt is not None:
            raise BadInput(
                f"{self._path or self._rig.rig.title}: the drive's angles may be wrong: {doubt}; "
                f"type {setup_command(self._path)}"
            )
