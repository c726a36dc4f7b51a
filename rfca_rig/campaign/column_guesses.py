"""Guesses which columns of other people's recordings hold the quantities of a leg's stroke, by
their names, units, ranges and rates.

Entry points: `guess_columns` for strokes, `guess_static_columns` for the table of static stages.
Nothing is guessed that two meanings fit equally well: it stays a question mark, with the reason.
"""

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.reading import DYNAMIC, STATIC, unit_of
from rfca_rig.campaign.recorded_columns import ColumnTable
from rfca_rig.campaign.units import are_different, find_factor, measure_unit, unit_in_name
from rfca_rig.recording.layout import HINGES
from rfca_rig.toml import OPEN

Floats = NDArray[np.float64]

FORCE_WORDS = frozenset({"f", "force", "kraft", "fuerza", "load"})
MOMENT_WORDS = frozenset({"m", "t", "torque", "moment", "mom", "drehmoment", "tau", "trq"})
# One letter alone is a time or a mass, rather than the torque of a motor.
MOTOR_TORQUE_WORDS = (MOMENT_WORDS - {"m", "t"}) | {"motormoment", "motordrehmoment"}
TIME_WORDS = frozenset(
    {"t", "time", "timestamp", "zeit", "zeitstempel", "elapsed", "seconds", "temps", "tiempo"}
)
ANGLE_WORDS = frozenset(
    {
        *("angle", "theta", "phi", "winkel", "encoder", "position", "pos", "q"),
        *("drehwinkel", "wellenwinkel", "shaftangle"),
    }
)
SPEED_WORDS = frozenset(
    {
        *("speed", "velocity", "vel", "omega", "w", "dq", "qd", "drehzahl"),
        *("geschwindigkeit", "winkelgeschwindigkeit", "shaftspeed"),
    }
)
# The same words for a shaft, in any of these quantities.
SHAFT_WORDS = frozenset({"shaft", "motor", "drive", "joint", "welle", "antrieb", "leg", "bein"})
# A column with one of these words is commanded, or of something else.
OTHER_WORDS = frozenset(
    {
        *("cmd", "command", "commanded", "soll", "sollwert", "setpoint", "set", "target"),
        *("desired", "ref", "reference", "demand", "model", "sim", "temp", "temperature"),
        *("current", "strom", "voltage", "knee", "ankle", "hinge", "gelenk", "std", "host"),
        *("device", "error", "limit"),
    }
)
HINGE_WORDS = frozenset({"hinge", "gelenk"})
STATIC_WORDS = {
    "height_mm": frozenset({"height", "h", "hoehe", "höhe", "rack"}),
    "stage": frozenset({"stage", "step", "stufe", "no", "nr", "number"}),
    "direction": frozenset({"direction", "dir", "richtung"}),
}
AXES = frozenset("xyz")

# Of a stroke, in SI. At 20 Hz a valley is a sample or two; no sensor of legs samples faster than
# 50 kHz. A stroke at 0.01 rad/s takes ten minutes.
STEP_S = (2e-5, 0.05)
DURATION_S = (0.2, 650.0)
# Travel of the shaft from a short stroke to a turn and a little more, in each unit.
TRAVELS = {"rad": (0.3, 7.0), "deg": (20.0, 400.0), "turn": (0.05, 1.1)}
SPEED_UNITS = ("rad/s", "deg/s", "rpm", "turn/s")
# A recorded speed differs from the slope of the recorded angle by noise and filters.
SAME_SPEED = (0.8, 1.25)
# Share of a quantity's mean over that of its size, from which its direction over a stroke shows.
# The twin's leg has 0.44 to 1 where it touches (190 to 280 mm, 0.3 to 8 rad/s). In the air fz has
# up to 0.31 the other way, at 6 rad/s.
MIN_SHARE = 0.4
# Force along the floor over force on it, as means over strokes. The twin's leg has 0.2 to 0.9, 1.14
# at a friction of 0.8 and 8 rad/s.
MOST_DRAG = 1.3
# Direction of the mean over a stroke: the floor pushes up and back, the motor forwards.
DIRECTIONS = {"fy_N": -1, "fz_N": -1, "tx_Nm": 1, "motor_torque_Nm": 1}
STATIC_DIRECTIONS = {
    "shaft_angle_rad": 1,
    **{"fy_N": -1, "fz_N": -1, "tx_Nm": 1},
    **dict.fromkeys(HINGES, -1),
}
WHY = {
    "shaft_angle_rad": "angles count downwards from the horizontal",
    "fz_N": "z points down and the floor pushes up",
    "fy_N": "the floor drags the leg back, along -y",
    "tx_Nm": "the shaft presses the leg down, about +x",
    "motor_torque_Nm": "the motor turns the shaft forwards",
}
# An encoder that reads so little at rest may count from the start.
ZERO_RAD = np.deg2rad(1.0)
# Beyond it a leg does not start a stroke onto a floor: the angle counts from elsewhere.
STEEPEST_START_RAD = np.deg2rad(60.0)


@dataclass(frozen=True)
class ColumnGuess:
    """A column for a known quantity; OPEN where a name, unit, sign or offset cannot be guessed.

    Parameters
    ----------
    name
        Of the column in the files.
    unit
        Of the column; "" for that of the quantity, where the column's own name is known.
    sign, offset
        As in [columns].
    needs_unit
        Whether neither the file nor the name states a unit, and the samples may show it.
    reasons
        Why, a few words each.
    """

    name: str
    unit: str = ""
    sign: int | str = 1
    offset: float | str = 0.0
    needs_unit: bool = False
    reasons: tuple[str, ...] = ()

    def with_shown_unit(self, fitting: Sequence[str], reason: str) -> "ColumnGuess":
        """The same with the one unit that fits the samples; as it is where several do, or none."""
        if len(fitting) != 1:
            return self.because(f"{reason}: {' or '.join(fitting) or 'no unit fits'}")
        return self.because(f"{fitting[0]} by {reason}", unit=fitting[0], needs_unit=False)

    def because(self, reason: str, **changes: object) -> "ColumnGuess":
        """The same with one more reason, and other values."""
        return replace(self, reasons=(*self.reasons, reason), **changes)  # type: ignore[arg-type]


Guesses = dict[str, ColumnGuess]


def find_quantity(name: str, quantities: Sequence[str] = DYNAMIC) -> str | None:
    """The known quantity that a column's name says, None where it says none."""
    if name in quantities:
        return name
    words = _split_words(name)
    known = None
    if "direction" in quantities:
        known = _find_static_quantity(words)
    if known is None and not OTHER_WORDS & set(words):
        known = _find_load(words) or _find_shaft_quantity(words)
    if known in quantities:
        return known
    return None


def _find_static_quantity(words: Sequence[str]) -> str | None:
    """What only a table of static stages has: height, stage, direction, and angles of hinges."""
    for known, meant in STATIC_WORDS.items():
        if words and words[-1] in meant:
            return known
    for word, number in itertools.pairwise(words):
        if word in HINGE_WORDS and number.isdecimal():
            return f"hinge{number}_deg"
    return None


def _find_load(words: Sequence[str]) -> str | None:
    """A force or moment of the sensor, by its axis."""
    axes = [word[-1] for word in words if word in AXES or _kind_of(word[:-1]) is not None]
    axes = [axis for axis in axes if axis in AXES]
    kinds = {_kind_of(word) for word in words} | {_kind_of(word[:-1]) for word in words}
    kinds.discard(None)
    if len(axes) != 1 or len(kinds) != 1:
        return None
    if "force" in kinds:
        return f"f{axes[0]}_N"
    return f"t{axes[0]}_Nm"


def _find_shaft_quantity(words: Sequence[str]) -> str | None:
    """The time, or what is measured of the shaft."""
    if AXES & set(words):
        return None
    plain = [word for word in words if word not in SHAFT_WORDS]
    meanings = []
    if set(plain) & MOTOR_TORQUE_WORDS:
        meanings.append("motor_torque_Nm")
    if set(plain) & SPEED_WORDS:
        meanings.append("shaft_speed_rad_s")
    if set(plain) & ANGLE_WORDS:
        meanings.append("shaft_angle_rad")
    if set(plain) & TIME_WORDS:
        meanings.append("t_s")
    # "Winkelgeschwindigkeit" and "angle velocity" are speeds.
    if "shaft_speed_rad_s" in meanings and "shaft_angle_rad" in meanings:
        meanings.remove("shaft_angle_rad")
    if len(meanings) == 1:
        return meanings[0]
    return None


def _kind_of(word: str) -> str | None:
    """Whether a word says force or moment."""
    if word in FORCE_WORDS:
        return "force"
    if word in MOMENT_WORDS:
        return "moment"
    return None


def _split_words(name: str) -> list[str]:
    """Words of a name without its unit: "ShaftAngle (deg)" gives shaft, angle."""
    stem, _ = unit_in_name(name)
    stem = re.sub(r"([a-zäöü])([A-Z])", r"\1 \2", stem)
    stem = re.sub(r"([^\W\d_])(\d)", r"\1 \2", stem)
    return re.sub(r"[\W_]+", " ", stem.lower()).split()


def guess_columns(tables: Sequence[ColumnTable]) -> Guesses:
    """The columns of strokes that have the same names and units, by the known quantity.

    Parameters
    ----------
    tables
        The strokes' files, one or more.
    """
    guesses = _guess_names(tables[0], DYNAMIC)
    time = guesses.get("t_s")
    if time is None:
        rising = [name for name in tables[0].extras if _rises(tables[0], name)]
        if len(rising) == 1:
            guesses["t_s"] = _with_unit(
                tables[0], "t_s", ColumnGuess(rising[0], reasons=("the only one that rises",))
            )
    guesses = {known: guesses[known] for known in DYNAMIC if known in guesses}
    if "t_s" not in guesses or guesses["t_s"].name == OPEN:
        return guesses
    named = {known: guess for known, guess in guesses.items() if guess.name != OPEN}
    samples = [_read(table, named) for table in tables]
    guesses["t_s"] = _guess_time_unit(guesses["t_s"], [sample["t_s"] for sample in samples])
    if guesses["t_s"].unit == OPEN:
        return guesses
    strokes = [
        StrokeColumns(named_in_s(guesses["t_s"], sample["t_s"]), sample) for sample in samples
    ]
    for guess in (_guess_angle, _guess_speed, _guess_signs, _question_axes, _name_open_units):
        guesses = guess(guesses, strokes)
    return guesses


def _name_open_units(guesses: Guesses, _strokes: Sequence["StrokeColumns"]) -> Guesses:
    """With a reason at each unit that nothing shows."""
    named = {}
    for known, guess in guesses.items():
        named[known] = guess
        if guess.needs_unit:
            named[known] = guess.because(f"no unit is stated; {unit_of(known)}?")
    return named


def named_in_s(guess: ColumnGuess, values: Floats) -> Floats:
    """Times (m,) in s from those of a file (m,), by the guess of their unit."""
    return float(find_factor(guess.unit or "s", "s") or 1.0) * values


@dataclass(frozen=True)
class StrokeColumns:
    """One stroke: times (m,) in s, and columns (m,) as they stand in the file, by the known
    quantity.
    """

    t_s: Floats
    values: Mapping[str, Floats]


def _read(table: ColumnTable, guesses: Guesses) -> dict[str, Floats]:
    """The named columns of a file, by the known quantity."""
    order = ["t_s", *(known for known in guesses if known != "t_s")]
    names = [guesses[known].name for known in order]
    return dict(zip(order, table.read(names).T, strict=True))


def _rises(table: ColumnTable, name: str) -> bool:
    return bool((np.diff(table.read([name])[:, 0]) > 0.0).all())


def _guess_names(table: ColumnTable, quantities: Sequence[str]) -> Guesses:
    """A column for each quantity that the names say, with the unit that name or file state."""
    candidates: dict[str, list[str]] = {}
    impossible: dict[str, list[str]] = {}
    for name in dict.fromkeys(table.names):
        known = find_quantity(table.label(name), quantities)
        if known is not None and _is_unit_possible(table, known, name):
            candidates.setdefault(known, []).append(name)
        elif known is not None:
            impossible.setdefault(known, []).append(name)
    guesses = {}
    for known, names in candidates.items():
        if known in names or len(names) == 1:
            name = known if known in names else names[0]
            guess = ColumnGuess(name, reasons=("by its name",))
            guesses[known] = _with_unit(table, known, guess)
        else:
            reason = f"one of {', '.join(names)}: write which"
            guesses[known] = ColumnGuess(OPEN, OPEN, reasons=(reason,))
    for known, names in impossible.items():
        if known not in guesses:
            reason = (
                f"{', '.join(names)} is this by its name, and not by its unit: write the column "
                "and a unit of this quantity, or remove the line"
            )
            guesses[known] = ColumnGuess(OPEN, OPEN, reasons=(reason,))
    return guesses


def _is_unit_possible(table: ColumnTable, known: str, name: str) -> bool:
    """Whether the unit that the file states, if any, can be one of the quantity."""
    expected = unit_of(known)
    stated = [table.units.get(name, ""), unit_in_name(table.label(name))[1]]
    known_units = [unit for unit in stated if unit and measure_unit(unit) is not None]
    if not expected or not known_units:
        return True
    return any(find_factor(unit, expected) is not None for unit in known_units)


def _with_unit(table: ColumnTable, known: str, guess: ColumnGuess) -> ColumnGuess:
    """The guess with the unit that the file or the column's name states; OPEN where neither does,
    or they differ.
    """
    expected = unit_of(known)
    if not expected:
        return guess
    in_file = table.units.get(guess.name, "")
    if in_file and find_factor(in_file, expected) is None:
        in_file = ""
    _, in_name = unit_in_name(table.label(guess.name))
    if in_name and find_factor(in_name, expected) is None:
        in_name = ""
    if in_file and in_name and are_different(in_file, in_name):
        return guess.because(
            f"the file states the unit {in_file}, the name {in_name}: write which", unit=OPEN
        )
    if in_file:
        return guess.because(f"the file states the unit {in_file}", unit=in_file)
    if guess.name == known:
        return guess
    if in_name:
        return guess.because(f"the name states the unit {in_name}", unit=in_name)
    return replace(guess, unit=OPEN, needs_unit=True)


def _guess_time_unit(guess: ColumnGuess, times: Sequence[Floats]) -> ColumnGuess:
    """The unit of the time by its steps, and by the duration of a stroke."""
    if not guess.needs_unit:
        return guess
    step = float(np.median([np.median(np.diff(column)) for column in times]))
    duration = float(np.median([column[-1] - column[0] for column in times]))
    fitting = []
    for unit in ("s", "ms", "us", "ns", "min"):
        factor = float(find_factor(unit, "s") or 1.0)
        fits = STEP_S[0] <= factor * step <= STEP_S[1]
        if fits and DURATION_S[0] <= factor * duration <= DURATION_S[1]:
            fitting.append(unit)
    return guess.with_shown_unit(fitting, f"its steps of {step:.4g}")


def _guess_angle(guesses: Guesses, strokes: Sequence[StrokeColumns]) -> Guesses:
    """The unit of the angle by its travel, its sign by the direction of the motion, its offset by
    its value at rest.
    """
    guess = guesses.get("shaft_angle_rad")
    if guess is None or guess.name == OPEN:
        return guesses
    columns = [stroke.values["shaft_angle_rad"] for stroke in strokes]
    if guess.needs_unit:
        travel = float(np.median([np.ptp(column) for column in columns]))
        fitting = [unit for unit, (low, high) in TRAVELS.items() if low <= travel <= high]
        guess = guess.with_shown_unit(fitting, f"its travel of {travel:.4g}")
    sign = _common_sign([_farthest_move(column) for column in columns])
    if sign == 0:
        guess = guess.because("it turns one way in some files, the other way in others", sign=OPEN)
    elif sign < 0:
        guess = guess.because("it falls while the shaft turns", sign=-1)
    else:
        guess = guess.because("it rises while the shaft turns")
    return {**guesses, "shaft_angle_rad": _guess_offset(guess, columns)}


def _farthest_move(column: Floats) -> float:
    """By how much a column (m,) moves away from its first sample at most, with its sign."""
    moves = column - column[0]
    return float(moves[np.argmax(np.abs(moves))])


def _guess_offset(guess: ColumnGuess, columns: Sequence[Floats]) -> ColumnGuess:
    """Whether the angle counts from the horizontal, by its values at rest."""
    factor = find_factor(guess.unit or "rad", "rad")
    if guess.unit == OPEN or not isinstance(guess.sign, int) or factor is None:
        return guess
    rest_rad = float(np.median([guess.sign * factor * column[0] for column in columns]))
    if abs(rest_rad) < ZERO_RAD:
        return guess.because(
            "it reads 0 at rest, so it may count from the start: offset is the angle of the start "
            "below the horizontal in rad, 0.0 if the leg starts level",
            offset=OPEN,
        )
    if abs(rest_rad) > STEEPEST_START_RAD:
        return guess.because(
            f"it reads {np.rad2deg(rest_rad):.0f} deg at rest, so it does not count from the "
            "horizontal: offset is what is missing, in rad",
            offset=OPEN,
        )
    return guess.because(f"{np.rad2deg(rest_rad):.1f} deg at rest")


def _guess_speed(guesses: Guesses, strokes: Sequence[StrokeColumns]) -> Guesses:
    """Unit and sign of the speed, by the slope of the angle; its sign by its mean where the angle
    is not known.
    """
    guess = guesses.get("shaft_speed_rad_s")
    if guess is None or guess.name == OPEN:
        return guesses
    ratios = _compare_with_slope(guesses.get("shaft_angle_rad"), strokes)
    reason = "it is negative while the angle rises"
    if not ratios:
        ratios = [float(np.mean(stroke.values["shaft_speed_rad_s"])) for stroke in strokes]
        reason = "its mean is negative"
    elif guess.needs_unit:
        ratio = abs(float(np.median(ratios)))
        fitting = []
        for unit in SPEED_UNITS:
            in_unit = ratio * float(find_factor(unit, "rad/s") or 1.0)
            if SAME_SPEED[0] <= in_unit <= SAME_SPEED[1]:
                fitting.append(unit)
        guess = guess.with_shown_unit(fitting, "the slope of the angle")
    sign = _common_sign(ratios)
    if sign == 0:
        guess = guess.because("its direction differs between files", sign=OPEN)
    elif sign < 0:
        guess = guess.because(reason, sign=-1)
    return {**guesses, "shaft_speed_rad_s": guess}


def _compare_with_slope(angle: ColumnGuess | None, strokes: Sequence[StrokeColumns]) -> list[float]:
    """The recorded speed of each stroke over the slope of its angle in rad/s; none where the angle
    is not known.
    """
    if angle is None or OPEN in (angle.name, angle.unit, angle.sign):
        return []
    factor = float(angle.sign) * float(find_factor(angle.unit or "rad", "rad") or 1.0)
    ratios = []
    for stroke in strokes:
        slope = np.gradient(factor * stroke.values["shaft_angle_rad"], stroke.t_s)
        column = stroke.values["shaft_speed_rad_s"]
        # Of both over the whole motion, so that noise of the slope does not count.
        ratios.append(float(np.sum(column * slope) / np.sum(slope * slope)))
    return ratios


def _guess_signs(guesses: Guesses, strokes: Sequence[StrokeColumns]) -> Guesses:
    """Signs of forces and torques, by their means over strokes that touch the floor."""
    signed = dict(guesses)
    for known, direction in DIRECTIONS.items():
        guess = guesses.get(known)
        if guess is None or guess.name == OPEN:
            continue
        shares = []
        for stroke in strokes:
            rows = _list_forwards(guesses, stroke)
            shares.append(share_of_mean(stroke.t_s[rows], stroke.values[known][rows]))
        share = float(np.median(shares))
        if abs(share) < MIN_SHARE:
            signed[known] = guess.because(
                "its mean over the strokes shows no direction, as without touching the floor: 1, "
                f"or -1 where it is against {WHY[known]}",
                sign=OPEN,
            )
        elif share * direction < 0.0:
            signed[known] = guess.because(f"turned, as {WHY[known]}", sign=-1)
        else:
            signed[known] = guess.because(f"not turned: {WHY[known]}")
    for known in ("fx_N", "ty_Nm", "tz_Nm"):
        if known in signed and signed[known].name != OPEN:
            signed[known] = signed[known].because("its sign is not known, and no analysis uses it")
    return signed


def _question_axes(guesses: Guesses, strokes: Sequence[StrokeColumns]) -> Guesses:
    """A question where the floor would drag more than it pushes: the sensor's axes are then others
    than their names say here.
    """
    sizes = {}
    for known in ("fy_N", "fz_N"):
        guess = guesses.get(known)
        if guess is None or OPEN in (guess.name, guess.unit, guess.sign):
            return guesses
        factor = float(find_factor(guess.unit or "N", "N") or 1.0)
        changes = []
        for stroke in strokes:
            column = stroke.values[known]
            changes.append(factor * float(np.mean(np.abs(column - column[0]))))
        sizes[known] = np.array(changes)
    if np.median(sizes["fy_N"] / np.maximum(sizes["fz_N"], 1e-12)) < MOST_DRAG:
        return guesses
    questioned = dict(guesses)
    for known in ("fy_N", "fz_N"):
        guess = guesses[known]
        questioned[known] = replace(guess, name=OPEN).because(
            f"{guess.name} by its name, but forces along y are larger than along z, which points "
            "down here: write the columns of the rig's axes, and check the signs"
        )
    return questioned


def _list_forwards(guesses: Guesses, stroke: StrokeColumns) -> slice:
    """The samples up to the farthest angle: on the way back forces have other directions."""
    angle = guesses.get("shaft_angle_rad")
    if angle is None or angle.name == OPEN or not isinstance(angle.sign, int):
        return slice(None)
    farthest = int(np.argmax(angle.sign * stroke.values["shaft_angle_rad"]))
    return slice(0, max(farthest, 2))


def share_of_mean(t_s: Floats, values: Floats) -> float:
    """Mean of a column (m,), from its value at rest, over the mean of its size: -1 to 1."""
    first = max(int(np.searchsorted(t_s, t_s[0] + 0.05)), 1)
    change = values - np.mean(values[:first])
    size = float(np.trapezoid(np.abs(change), t_s))
    if size == 0.0:
        return 0.0
    return float(np.trapezoid(change, t_s)) / size


def _common_sign(values: Sequence[float]) -> int:
    """The sign that all of them have; 0 where it differs."""
    signs = {int(np.sign(value)) for value in values}
    if len(signs) == 1:
        return signs.pop()
    return 0


def is_static(table: ColumnTable) -> bool:
    """Whether a table of text holds static stages, by its names."""
    known = {find_quantity(table.label(name), STATIC) for name in table.names}
    return {"direction", "height_mm", "stage"} <= known or {"hinge2_deg", "hinge3_deg"} <= known


def guess_static_columns(table: ColumnTable) -> Guesses:
    """The columns of the static stages, by the known quantity."""
    guesses = _name_open_units(_guess_names(table, STATIC), ())
    for known, direction in STATIC_DIRECTIONS.items():
        guess = guesses.get(known)
        if guess is None or guess.name == OPEN:
            continue
        values = table.read([guess.name])[:, 0]
        share = float(np.sum(values) / max(np.sum(np.abs(values)), 1e-300))
        why = WHY.get(known, "the floor bends the hinges back")
        if abs(share) < MIN_SHARE:
            guesses[known] = guess.because("its mean shows no direction: 1 or -1", sign=OPEN)
        elif share * direction < 0.0:
            guesses[known] = guess.because(f"turned, as {why}", sign=-1)
        else:
            guesses[known] = guess.because(f"not turned: {why}")
    return {known: guesses[known] for known in STATIC if known in guesses}
