"""Splits names that end in their unit into words and unit: half_gap_deg is "half gap" in deg, tx_Nm is "tx" in N m."""

import re

UNIT_WORDS = {"Nm": "N m", "pct": "%", "Ns": "N s"} | {
    unit: unit
    for unit in ("N", "m", "mm", "ppm", "kHz", "s", "ms", "kg", "g", "rad", "deg", "Hz", "V", "A", "W", "J", "K", "degC", "relative")
}
POWERS = {"": "", "2": "²", "3": "³", "1p5": "^1.5"}
# speed_m_s: the only quotients that names write without "per".
SPEEDS = (["m", "s"], ["mm", "s"], ["rad", "s"], ["deg", "s"])


def words_and_unit(name: str) -> tuple[str, str]:
    """The name in words and its unit, empty where it has none. The value is not converted."""
    tokens = name.split("_")
    start = len(tokens)
    # Backwards from the end, as long as parts are units; the first part is always a word, as in "s" or "m_kg".
    while start > 1 and (tokens[start - 1] == "per" or _unit(tokens[start - 1])):
        start -= 1
    if tokens[-1] == "per":
        start = len(tokens)
    words = re.sub(r"\bhinge(\d)", r"hinge \1", " ".join(tokens[:start]))
    return words, _join_units(tokens[start:])


def name_with_unit(name: str) -> str:
    """The name in words with its unit, as in "half gap, deg"."""
    words, unit = words_and_unit(name)
    return f"{words}, {unit}" if unit else words


def _unit(token: str) -> str | None:
    found = re.fullmatch(r"([A-Za-z]+)(2|3|1p5|)", token)
    return UNIT_WORDS[found[1]] + POWERS[found[2]] if found and found[1] in UNIT_WORDS else None


def _join_units(tokens: list[str]) -> str:
    if tokens in SPEEDS:
        return "/".join(tokens)
    words = [token if token == "per" else str(_unit(token)) for token in tokens]
    above, _, below = " ".join(words).partition("per")
    return f"{above.strip() or '1'}/{below.strip()}" if below else above.strip()
