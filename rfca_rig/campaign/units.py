"""Units as people and programs write them, compared by pint."""

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
    "rev": "turn",
    "rev/s": "turn/s",
    "revolutions": "turn",
    "dps": "deg/s",
    "r/min": "rpm",
    "1/min": "rpm",
    "sec": "s",
    "-": "",
    "1": "",
}
COUNT = "count"


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
    except (pint.PintError, AttributeError, TypeError, ValueError, SyntaxError):
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
