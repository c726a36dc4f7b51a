"""Names, values and equations of a sweep as text for a reader."""

from rfca_rig.report.named_units import words_and_unit
from rfca_rig.report.text import MINUS
from rfca_rig.sweep.quantities import Value

DIGITS = 4
# Replaced in this order: longer spellings come before their parts ("phi_i" before "phi").
SIGNS = {
    "integral of ": "∫ ",
    "tau w": "τ ω",
    "tau": "τ",
    "dphi_i": "dφᵢ",
    "phi_i": "φᵢ",
    "phi": "φ",
    "sum ": "Σ ",
    "N_k": "Nₖ",
    "F_k": "Fₖ",
    "^2": "²",
    " - ": f" {MINUS} ",
}


def name_and_unit(name: str) -> tuple[str, str]:
    """Words and unit: strip.thickness_mm is "strip thickness" in mm, static_torque_Nm@60deg is "static torque at 60°" in N m."""
    plain, at, angle = name.partition("@")
    of, dot, last = plain.rpartition(".")
    words, unit = words_and_unit(last)
    text = f"{of.replace('_', ' ')} {words}" if dot else words
    return (f"{text} at {angle.removesuffix('deg')}°" if at else text), unit


def axis_label(name: str) -> str:
    """Label of an axis, as in "height (mm)"."""
    words, unit = name_and_unit(name)
    return f"{words} ({unit})" if unit else words


def with_unit(name: str, value: Value) -> str:
    """Name with value and unit, as in "height 215 mm", "strip material CFSP"."""
    words, unit = name_and_unit(name)
    return f"{words} {value_text(value)}{f' {unit}' if unit else ''}"


def value_text(value: Value) -> str:
    """A value with four digits and a typographic minus sign."""
    return value if isinstance(value, str) else f"{value:.{DIGITS}g}".replace("-", MINUS)


def formula(text: str) -> str:
    """An equation in mathematical signs, for a page."""
    for typed, sign in SIGNS.items():
        text = text.replace(typed, sign)
    return f"{MINUS}{text[1:]}" if text.startswith("-") else text
