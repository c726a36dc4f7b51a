"""Units as people and programs write them, also at the end of names, compared by pint."""

import re
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pint

# What pint reads otherwise than engineers, or does not know. "Nm" is its newton less the multiple
# sign: a number of metres.
SPELLINGS = {
    "Nm": "N*m",
    "kNm": "kN*m",
    "mNm": "mN*m",
    "Nmm": "N*mm",
    "Ncm": "N*cm",
    "m/s2": "m/s**2",
    "m/s^2": "m/s**2",
    "N-m": "N*m",
    "N\N{MIDDLE DOT}m": "N*m",
    "kN\N{MIDDLE DOT}m": "kN*m",
    "\N{DEGREE SIGN}/s": "deg/s",
    "Grad": "deg",
    "Grad/s": "deg/s",
    "rad_s": "rad/s",
    "rev": "turn",
    "rev/s": "turn/s",
    "revolutions": "turn",
    "dps": "deg/s",
    "r/min": "rpm",
    "1/min": "rpm",
    "U/min": "rpm",
    "RPM": "rpm",
    "sec": "s",
    "turn": "turn",
    "turns": "turn",
    "kgf": "kgf",
    "ns": "ns",
    "\N{DEGREE SIGN}": "deg",
    "-": "",
    "1": "",
}
COUNT = "count"
# Units at the end of a name, as fz_kN, and how they are written elsewhere.
SUFFIXES = {
    "rad_s2": "rad/s^2",
    "rad_s": "rad/s",
    "deg_s": "deg/s",
    "m_s2": "m/s^2",
    "m_s": "m/s",
    "mm_s": "mm/s",
    "rev_s": "rev/s",
    "rad": "rad",
    "mrad": "mrad",
    "deg": "deg",
    "rpm": "rpm",
    "s": "s",
    "ms": "ms",
    "us": "us",
    "min": "min",
    "N": "N",
    "kN": "kN",
    "mN": "mN",
    "lbf": "lbf",
    "g": "g",
    "kg": "kg",
    "Nm": "N m",
    "Nmm": "N mm",
    "mNm": "mN m",
    "kNm": "kN m",
    "m": "m",
    "mm": "mm",
    "cm": "cm",
    "um": "um",
    "A": "A",
    "mA": "mA",
    "V": "V",
    "mV": "mV",
    "W": "W",
    "C": "degC",
    "K": "K",
    "Hz": "Hz",
    "kHz": "kHz",
    "Pa": "Pa",
    "kPa": "kPa",
    "bar": "bar",
    "pct": "%",
    "counts": "counts",
}
# For comparison without case and signs, as in "FZ [kn]".
IN_ANY_CASE = {re.sub("[^a-z0-9]", "", suffix.lower()): suffix for suffix in SUFFIXES}
# A unit at the end of a name: in brackets, behind "in" or a slash.
_IN_BRACKETS = re.compile(r"(.*\S)\s*(?:\[([^\[\]]+)\]|\(([^()]+)\)|\{([^{}]+)\})")
_BEHIND_IN = re.compile(r"(.*\S)\s+in\s+(\S.*)")
_BEHIND_SLASH = re.compile(r"(.*?\S)\s*/\s*([^\W\d]\w*(?:/\w+)?|\N{DEGREE SIGN}(?:/\w+)?)")
# Of forces it is either of two, a factor of 1e9 apart.
_MEGA_OR_MILLI = "MN"


@cache
def _registry() -> "pint.UnitRegistry[float]":
    # Half a second, for files that state units.
    import pint  # noqa: PLC0415

    return pint.UnitRegistry()


@cache
def measure_unit(unit: str) -> tuple[str, float] | None:
    """What a unit measures, as its dimensions in a fixed order, and its size in base units; None
    for a unit that is not known.
    """
    import pint  # noqa: PLC0415

    text = unit.strip()
    text = SPELLINGS.get(text, text)
    try:
        parsed = _registry().parse_units(text)
        size = _registry().Quantity(1.0, parsed).to_base_units()
    # Any text may stand in a file; pint raises these for what is no unit.
    except (pint.PintError, AttributeError, TypeError, ValueError, SyntaxError, AssertionError):
        return None
    if str(parsed) == COUNT:
        # Counts are no radians, though neither has a dimension.
        return COUNT, 1.0
    # The same dimensions may be listed in another order.
    dimensions = sorted(f"{name} {power:g}" for name, power in parsed.dimensionality.items())
    return ", ".join(dimensions), float(size.magnitude)


def are_different(unit: str, other: str) -> bool:
    """Whether two units are known and are not the same one, as rad and deg."""
    if unit == other:
        return False
    first = measure_unit(unit)
    second = measure_unit(other)
    if first is None or second is None:
        return False
    return first[0] != second[0] or abs(first[1] - second[1]) > 1e-9 * abs(first[1])


def find_factor(unit: str, of: str) -> float | None:
    """Factor from one unit to another; None where one is not known, or they measure different
    things.
    """
    first = measure_unit(unit)
    second = measure_unit(of)
    if first is None or second is None or first[0] != second[0]:
        return None
    return first[1] / second[1]


def unit_in_name(name: str) -> tuple[str, str]:
    """A column's name without its unit, and the unit: ("Fz", "kN") from "Fz [kN]", "Fz/kN" or
    "fz_kN"; "" where it has none.
    """
    match = _IN_BRACKETS.fullmatch(name)
    if match is not None:
        unit = next(text for text in match.groups()[1:] if text is not None).strip()
        # An index of an array is no unit.
        if re.search(r"[^\W\d]|\N{DEGREE SIGN}", unit) and measure_unit(unit) is not None:
            return match[1], unit
        return name, ""
    match = _BEHIND_IN.fullmatch(name)
    if match is not None and measure_unit(match[2]) is not None:
        return match[1], match[2]
    for start in (sign.end() for sign in re.finditer(r"[\s_]+", name)):
        # The longest suffix first: a name in rad_s ends in s, too.
        unit = read_suffix(name[start:])
        if unit and start > 1:
            return re.sub(r"[\s_]+$", "", name[:start]), unit
    match = _BEHIND_SLASH.fullmatch(name)
    if match is not None and read_suffix(match[2]):
        return match[1], read_suffix(match[2])
    return name, ""


def read_suffix(text: str) -> str:
    """The unit that the end of a name says; "" for none."""
    if text in SUFFIXES:
        return SUFFIXES[text]
    # A number at the end of a name is no unit, though it may be one in a row of units.
    is_word = bool(SPELLINGS.get(text, text))
    if is_word and text in (*SUFFIXES.values(), *SPELLINGS):
        return text
    key = re.sub("[^a-z0-9]", "", text.lower())
    if len(key) > 1 and key in IN_ANY_CASE and text != _MEGA_OR_MILLI:
        return SUFFIXES[IN_ANY_CASE[key]]
    return ""
