"""Names of CSV columns: known channels, known quantities in another unit or spelling, and units of extra columns."""

import re
from collections.abc import Sequence

from rfca_rig.channels import HINGES, SHAFT, UNITS, WRENCH

DYNAMIC = ("t_s", *SHAFT, *WRENCH)
STATIC_NEEDED = ("height_mm", "stage", "direction", "shaft_angle_rad", "fy_N", "fz_N", "tx_Nm")
STATIC = (*STATIC_NEEDED, *HINGES)

_SUFFIXES = {
    "rad_s2": "rad/s^2", "rad_s": "rad/s", "deg_s": "deg/s", "m_s2": "m/s^2", "m_s": "m/s", "mm_s": "mm/s", "rev_s": "rev/s",
    "rad": "rad", "mrad": "mrad", "deg": "deg", "rpm": "rpm", "s": "s", "ms": "ms", "us": "us", "min": "min",
    "N": "N", "kN": "kN", "mN": "mN", "lbf": "lbf", "g": "g", "kg": "kg", "Nm": "N m", "Nmm": "N mm", "mNm": "mN m", "kNm": "kN m",
    "m": "m", "mm": "mm", "cm": "cm", "um": "um", "A": "A", "mA": "mA", "V": "V", "mV": "mV", "W": "W", "C": "degC", "K": "K",
    "Hz": "Hz", "kHz": "kHz", "Pa": "Pa", "kPa": "kPa", "bar": "bar", "pct": "%", "counts": "counts",
}  # fmt: skip
# For comparison without case and signs, as in "FZ [kn]".
_IN_ANY_CASE = {re.sub("[^a-z0-9]", "", suffix.lower()): suffix for suffix in _SUFFIXES}
_OTHER_WORDS = {"time": "t", "sec": "s", "degrees": "deg", "radians": "rad"}


def unit_of(name: str) -> str:
    """Unit of a column: that of the known channel, else from the end of the name, else "" for none."""
    if name in UNITS:
        return UNITS[name]
    ends = [suffix for suffix in _SUFFIXES if name.endswith("_" + suffix)]
    # The longest suffix: a name in rad_s ends in s, too.
    return _SUFFIXES[max(ends, key=len)] if ends else ""


def find_name_fault(names: Sequence[str], known: Sequence[str], needed: Sequence[str]) -> str | None:
    """The fault in a table's column names, or None.

    `known` names may be present, `needed` must be. Other names are extra columns and allowed. Exception: an extra column that is a known
    quantity in another unit or spelling, while the table lacks that quantity. Keeping it as an extra would lose the channel silently.
    """
    return _nameless(names) or _twice(names) or _find_misnamed(names, known) or _missing(names, needed)


def _nameless(names: Sequence[str]) -> str | None:
    for place, name in enumerate(names, start=1):
        if not name.isprintable() or not name:
            return f"column {place} has no readable name ({name!r}); name every column or drop it"
    # A file without a header would otherwise lose its first sample.
    if all(_is_number(name) for name in names):
        return "the first line holds numbers; it must name the columns"
    return None


def _is_number(name: str) -> bool:
    try:
        float(name)
    except ValueError:
        return False
    return True


def _twice(names: Sequence[str]) -> str | None:
    for place, name in enumerate(names):
        if name in names[:place]:
            return f"column {name} is there twice, as column {names.index(name) + 1} and as column {place + 1}"
    return None


def _missing(names: Sequence[str], needed: Sequence[str]) -> str | None:
    for name in needed:
        if name not in names:
            return f"column {name} is missing; the file has {', '.join(names)}"
    return None


def _find_misnamed(names: Sequence[str], known: Sequence[str]) -> str | None:
    absent = {_quantity(name)[0]: name for name in known if name not in names}
    for name in names:
        quantity, unit = _quantity(name)
        if name in known or quantity not in absent:
            continue
        right = absent[quantity]
        if unit == _quantity(right)[1]:
            return f"column {name}: write it {right}"
        if unit:
            return f"column {name}: this quantity is known in {UNITS.get(right, 'mm')}, as {right}; convert it and rename the column"
        return f"column {name}: its name says no unit; write {right} if that is its unit, else convert it first"
    return None


def _quantity(name: str) -> tuple[str, str]:
    """("fz", "kN") from "fz_kN", "Fz (kN)" or "FZ [kn]"; the unit is "" where the name ends in none."""
    words = [_OTHER_WORDS.get(word, word) for word in re.sub("[^a-z0-9]+", " ", name.lower()).split()]
    for start in range(1, len(words)):
        unit = _IN_ANY_CASE.get("".join(words[start:]))
        if unit is not None:
            return "_".join(words[:start]), unit
    return "_".join(words), ""
