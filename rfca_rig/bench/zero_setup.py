"""Finding the zero of a drive by hand: the leg is held at a known angle, the encoder is read, and
the rig file gets the zero that makes them agree.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from math import degrees, radians, remainder
from pathlib import Path

import can

from rfca_rig.bench.factory import make_motor, open_bench
from rfca_rig.bench.zero_check import READ_S, TWIN_READ_S, EncoderReading, read_encoder
from rfca_rig.clock import Clock, WallClock
from rfca_rig.description.rig_file import RigFile
from rfca_rig.drivers.encoder_zero import EncoderZero, ZeroPolicy
from rfca_rig.drivers.roles import ShaftMotor
from rfca_rig.errors import BadInput, DeviceError
from rfca_rig.toml import degrees_key, read_data
from rfca_rig.toml_edit import set_keys
from rfca_rig.twin_server.faults import FaultEvent

# Time for which a held leg is read, and by how much it may move meanwhile. A hand holds a leg to
# some tenths of a degree.
HOLD_S = 1.0
MAX_HELD_SPREAD_DEG = 1.0
# By how much of a motor turn the held leg may differ from a zero that is known but for whole turns.
MAX_REST_MOTOR_TURNS = 0.25
# Of the gear: beyond it a turn of the shaft shifts the zero by more than a tenth of a degree.
MAX_BROKEN_RATIO = 1e-3

# A held leg differs by so much from the angle that it is said to have, in degrees.
ANGLE_TOLERANCE_DEG = 3.0
# Motion from which the direction is judged.
MIN_TURNED_DEG = 10.0
QUARTER_DEG = 90.0


@dataclass(frozen=True)
class NewZero:
    """The zero to be written.

    Parameters
    ----------
    value
        In the unit of the reading.
    off_deg
        By how much the present zero was off, in degrees of the shaft; whole turns of the shaft do
        not count.
    motor_turns
        The same in turns of the motor; None where the zero itself was measured.
    rest_deg
        What is left between the held leg and the stated angle, in degrees of the shaft.
    """

    value: float
    off_deg: float
    motor_turns: int | None = None
    rest_deg: float = 0.0


def choose_zero(
    zero: EncoderZero,
    policy: ZeroPolicy | None,
    reading: float,
    angle_rad: float,
    is_remeasured: bool = False,
) -> NewZero:
    """The zero with which `reading` is the angle at which the leg is held.

    Behind a gear the present zero is right but for whole turns of the motor. The hand only decides
    how many there are, and the zero stays as exact as it was; `is_remeasured` takes the reading
    instead.

    Raises
    ------
    BadInput
        The held leg lies between two such zeros, or the gear has no whole ratio.
    """
    measured = zero.zero_at(reading, angle_rad)
    if policy != "behind-gear" or is_remeasured:
        return NewZero(measured, _off_deg(zero, measured))
    _refuse_broken_ratio(zero)
    value = zero.value + round((measured - zero.value) / zero.per_motor_turn) * zero.per_motor_turn
    rest = measured - value
    if abs(rest) > MAX_REST_MOTOR_TURNS * zero.per_motor_turn:
        raise BadInput(
            f"the leg is {zero.shaft_deg(rest):.1f} deg off the nearest possible zero, and a turn "
            f"of the motor is {zero.shaft_deg(zero.per_motor_turn):.1f} deg: hold it more exactly, "
            "or say --remeasure where the leg or the encoder was mounted again"
        )
    off = remainder(value - zero.value, zero.per_shaft_turn)
    return NewZero(
        value,
        _off_deg(zero, value),
        round(off / zero.per_motor_turn),
        zero.shaft_deg(rest),
    )


def _off_deg(zero: EncoderZero, value: float) -> float:
    return zero.shaft_deg(remainder(value - zero.value, zero.per_shaft_turn))


def _refuse_broken_ratio(zero: EncoderZero) -> None:
    """Where a turn of the shaft is no whole number of turns of the motor, each turn of the shaft
    leaves another zero.
    """
    gear_ratio = abs(zero.per_shaft_turn) / zero.per_motor_turn
    if abs(gear_ratio - round(gear_ratio)) > MAX_BROKEN_RATIO:
        raise BadInput(
            f"the motor makes {gear_ratio:.4g} turns per turn of the shaft, so its turns say "
            'nothing of the zero once the shaft has turned; set zero_policy = "incremental"'
        )


def refuse_moving(zero: EncoderZero, reading: EncoderReading) -> None:
    """Raises BadInput where the leg moved while it was read."""
    spread_deg = zero.shaft_deg(reading.spread)
    if spread_deg > MAX_HELD_SPREAD_DEG:
        raise BadInput(
            f"the leg moved by {spread_deg:.1f} deg while its encoder was read, "
            f"{MAX_HELD_SPREAD_DEG:g} deg are the most; hold it still"
        )


def write_zero(text: str, rig_path: Path, zero: EncoderZero, value: float) -> str:
    """The text of the rig file with that zero, in radians or degrees as it was stated."""
    key = zero.key
    in_degrees = degrees_key(key)
    if in_degrees is not None and in_degrees in read_data(rig_path).get("motor", {}):
        return set_keys(text, "motor", {in_degrees: degrees(value)}, rig_path)
    return set_keys(text, "motor", {key: value}, rig_path)


@dataclass(frozen=True)
class HeldMotor:
    """A drive whose motor stays off, and how long its held leg is read, in s."""

    motor: ShaftMotor
    clock: Clock
    zero: EncoderZero
    hold_s: float

    def read(self) -> EncoderReading:
        """Reads the leg. Raises BadInput where it moved, DeviceError where nothing comes."""
        reading = read_encoder(self.motor, self.clock, self.zero, self.hold_s)
        refuse_moving(self.zero, reading)
        return reading

    def read_left(self) -> EncoderReading:
        """Reads the leg where it is left, moving or not."""
        return read_encoder(self.motor, self.clock, self.zero, min(self.hold_s, READ_S))


@contextmanager
def open_held_motor(
    rig: RigFile, zero: EncoderZero, faults: tuple[FaultEvent, ...] = ()
) -> Iterator[HeldMotor]:
    """The rig's drive for the length of the block. Raises DeviceError where its bus cannot be
    opened.
    """
    with ExitStack() as stack:
        if not rig.is_real:
            assert rig.twin is not None  # validated with the rig file
            bench = stack.enter_context(open_bench(rig, rig.twin.seed, faults=faults))
            yield HeldMotor(bench.motor, bench.clock, zero, TWIN_READ_S)
            return
        motor = rig.motor
        clock = WallClock()
        try:
            bus = stack.enter_context(motor.open())
        # python-can raises any of these, depending on the interface.
        except (can.CanError, OSError, ValueError) as error:
            raise DeviceError(
                f"CAN bus {motor.interface} {motor.channel} cannot be opened: {error}; "
                "rfca-rig doctor --rig FILE says more"
            ) from error
        yield HeldMotor(make_motor(rig, bus, clock), clock, zero, HOLD_S)


@dataclass(frozen=True)
class HandCheck:
    """One check by hand: whether it passed, what was seen, and the key to change where it did
    not.
    """

    name: str
    is_right: bool
    seen: str
    fix: str = ""

    def line(self) -> str:
        """For the terminal."""
        if self.is_right:
            return f"right  {self.name}: {self.seen}"
        return f"wrong  {self.name}: {self.seen}; {self.fix}"


def judge_stated_angle(angle_deg: float, stated_deg: float, key: str) -> HandCheck:
    """Whether the leg is where it is said to be."""
    return HandCheck(
        "zero",
        abs(angle_deg - stated_deg) <= ANGLE_TOLERANCE_DEG,
        f"the shaft reads {angle_deg:.1f} deg, held at {stated_deg:g} deg",
        f"correct {key}: run it without --check-direction",
    )


def judge_direction(before_deg: float, after_deg: float, direction: int) -> HandCheck:
    """Whether the angle increases as the leg is turned down. Raises BadInput where it was hardly
    turned.
    """
    turned_deg = after_deg - before_deg
    if abs(turned_deg) < MIN_TURNED_DEG:
        raise BadInput(
            f"the encoder saw the leg turn by {abs(turned_deg):.1f} deg, {MIN_TURNED_DEG:g} deg "
            "are the least; turn it down further, or check that the encoder turns with the shaft"
        )
    return HandCheck(
        "direction",
        turned_deg > 0.0,
        f"turned down, the angle changed by {turned_deg:+.1f} deg",
        f"set direction = {-direction} under [motor]",
    )


def judge_quarter_turn(turned_deg: float, gear_ratio: float | None) -> HandCheck:
    """Whether a quarter turn reads 90 degrees; `gear_ratio` of the rig file, None where the drive
    itself counts turns of the shaft.
    """
    size_deg = abs(turned_deg)
    if gear_ratio is None:
        fix = "the drive's own gear setting, or its model in the rig file, is not that of this rig"
    else:
        fix = f"set gear_ratio = {gear_ratio * size_deg / QUARTER_DEG:.4g} under [motor], about"
    return HandCheck(
        "gear",
        abs(size_deg - QUARTER_DEG) <= ANGLE_TOLERANCE_DEG,
        f"a quarter turn reads {size_deg:.1f} deg",
        fix,
    )


def gear_ratio_of(rig: RigFile) -> float | None:
    """The gear that scales the reading, None where the reading is already that of the shaft."""
    if rig.motor.encoder_zero is None or rig.motor.encoder_zero.unit != "turns":
        return None
    return float(getattr(rig.motor, "gear_ratio", 1.0))


def held_angle_rad(rig: RigFile, at_deg: float | None) -> float:
    """The angle at which the leg is held: as stated, else horizontal; a twin's leg is where its
    file parks it.
    """
    if at_deg is not None:
        return radians(at_deg)
    if rig.is_real:
        return 0.0
    return rig.facts().parked_angle_rad
