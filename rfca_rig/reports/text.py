"""Text of the pages: numbers with typographic signs, and sentences on compared strokes."""

import re
from collections.abc import Sequence
from math import floor, isfinite, log10

from rfca_rig.analysis.compare import ComparedCondition
from rfca_rig.analysis.matched_simulation import Shaft
from rfca_rig.reports.strokes.overlay import OverlayDrawing

NOTHING = "\u2013"  # en dash
MINUS = "\u2212"
NO_BREAK = "\u00a0"
# Narrow no-break space, the separator of thousands in SI.
THIN = "\u202f"

MARK_MEANINGS = {
    "SIM": "SIM was recorded on simulated twins: nothing in it was measured.",
    "REAL": "REAL was recorded on a rig.",
    "IMPORT": "IMPORT came from files written elsewhere.",
}

SHAFT_WORDS = {
    "average": "the shaft at the average speed of the strokes, as the paper does",
    "commanded": "the shaft at the commanded speed",
    "recorded": (
        "the shaft following the recorded motion of each stroke, valleys averaged over the repeats"
    ),
}

DEFINITION = (
    "The valley is the most negative fz between touchdown, the first 30 ms of contact, "
    "and lift-off, where fz comes back to its level "
    "before the motion; its time counts from the start of the motion, and parabolas over "
    "20 ms of the trace give both, alike for "
    "measured and simulated strokes. The phases of a stroke are rest before the start, "
    "free until contact, touchdown, loading to the "
    "valley, release to lift-off, and rebound."
)

REGIONS_DEFINITION = (
    "The ruler above each picture divides the stroke into three regions. I is the free "
    "swing, from the start of the motion to the first "
    "contact. II is the loading, from there to the valley. III is the release, from the "
    "valley to lift-off. The paper compares lead and "
    "lag of its simulation in regions I to III. Its text does not define their borders; "
    "these are the borders of the phases above."
)

UNIT_WORDS = {"Nm": "N m", "pct": "%", "Ns": "N s"} | {
    unit: unit
    for unit in (
        "N",
        "m",
        "mm",
        "ppm",
        "kHz",
        "s",
        "ms",
        "kg",
        "g",
        "rad",
        "deg",
        "Hz",
        "V",
        "A",
        "W",
        "J",
        "K",
        "degC",
        "relative",
    )
}
SIGNAL_WORDS = dict.fromkeys(("shaft_angle_rad", "shaft_angle_deg"), "shaft angle less command")
POWERS = {"": "", "2": "²", "3": "³", "1p5": "^1.5"}
# speed_m_s: the only quotients that names write without "per".
SPEEDS = (["m", "s"], ["mm", "s"], ["rad", "s"], ["deg", "s"])


def number(value: float | None, digits: int) -> str:
    """A number with `digits` decimals and a typographic minus sign, without a sign where all
    digits shown are zero.
    """
    if value is None:
        return NOTHING
    return f"{round(value, digits) + 0.0:.{digits}f}".replace("-", MINUS)


def format_significant(value: float | None, digits: int = 3) -> str:
    """A value with `digits` significant digits, without an exponent; an en dash for an unknown
    one.
    """
    if value is None or not isfinite(value):
        return NOTHING
    return format_decimals(value, decimals(value, digits))


def decimals(size: float, digits: int) -> int:
    """Decimals that show `size` with so many significant digits; negative where it is rounded to
    tens or hundreds.
    """
    if size and isfinite(size):
        return digits - 1 - floor(log10(abs(size)))
    return 0


def format_decimals(value: float, places: int) -> str:
    """A value with `places` decimals; negative ones round to tens or hundreds."""
    if isfinite(value):
        return number(round(value, places), max(places, 0))
    return NOTHING


def in_thousands(text: str) -> str:
    """Groups the digits of a number by thousands, as SI recommends for more than four digits
    before the point.
    """
    # Digits after a point, or that continue a number, are excluded.
    return re.sub(
        r"(?<![\d.])\d{5,}", lambda whole: f"{int(whole[0]):,}".replace(",", THIN), text, count=1
    )


def spread(mean: float | None, std: float | None, digits: int) -> str:
    """Mean ± standard deviation; the mean alone where there is one value."""
    if std is None:
        return number(mean, digits)
    return f"{number(mean, digits)} ± {std:.{digits}f}"


def keep_units_together(text: str) -> str:
    """The text with no-break spaces between numbers and units, so that no line begins with a
    unit.
    """
    # "N" before the space is for "N m": the unit itself must not be broken either.
    return re.sub(r"(?<=[\dN]) (?=(?:N|mm|ms|m|rad/s|deg|s|%)(?![\w]))", NO_BREAK, text)


def count_noun(count: int, singular: str, plural: str | None = None) -> str:
    """A count with its noun, as in "1 stroke", "27 strokes"."""
    if count == 1:
        return f"{count} {singular}"
    return f"{count} {plural or singular + 's'}"


def number_equal_names(names: Sequence[str]) -> list[str]:
    """The names; those that occur more than once are numbered in their order, as in "run (2)"."""
    numbered = []
    for index, name in enumerate(names):
        if names.count(name) > 1:
            numbered.append(f"{name} ({names[: index + 1].count(name)})")
        else:
            numbered.append(name)
    return numbered


def repeats_sentence(compared: ComparedCondition) -> str:
    """Sentence on the number of strokes that are drawn."""
    return f"fz over time, {count_noun(len(compared.repeats), 'repeat')}, each drawn by itself."


def shaft_sentence(compared: ComparedCondition, shaft: Shaft) -> str:
    """Sentence on the motion of the simulated shaft, with its speed."""
    speeds = [model.shaft_speed_rad_s for model in compared.simulated]
    mean = f"{sum(speeds) / len(speeds):.3f} rad/s"
    taken_from = " and ".join(sorted({model.shaft_taken_from for model in compared.simulated}))
    if shaft == "recorded":
        return f"Simulated along the recorded motion ({taken_from}; {mean} on average)."
    if taken_from == "command":
        return f"Simulated at {mean} (commanded)."
    return f"Simulated at {mean} (average, from the recorded {taken_from})."


def regions_sentence(compared: ComparedCondition, overlay: OverlayDrawing) -> str:
    """Sentence on the regions drawn, with their ends and the strokes that the borders come from."""
    if len(overlay.regions) < 2:
        return "No regions II and III: neither a repeat nor the model touches the ground."
    first, *others = overlay.regions
    later = ", ".join(f"{region.name} to {region.end_s:.3f} s" for region in others)
    if compared.contact_is_measured:
        whose = "mean over the repeats"
    else:
        whose = "by the simulated stroke, for no repeat shows its contact"
    return f"Regions: {first.name} to {first.end_s:.3f} s, {later} ({whose})."


def rms_sentence(compared: ComparedCondition) -> str:
    """Sentence on the root mean square of the residual in each phase."""
    rms = compared.rms_N()
    if not rms:
        return "There is no residual: fz was not recorded."
    return (
        "Residual (measured minus simulated), rms: "
        + ", ".join(f"{phase} {value:.2f} N" for phase, value in rms.items())
        + "."
    )


def scales_sentence(overlay: OverlayDrawing) -> str:
    """Sentence on the two scales, which a reader might otherwise compare, and on what exceeds
    the residual's.
    """
    wide = overlay.force_span_N
    narrow = 2.0 * overlay.residual_limit_N
    sentence = (
        f"The axis of the residual spans ±{overlay.residual_limit_N:g} N, {wide / narrow:.0f} "
        "times finer than the force axis."
    )
    if wide / narrow < 1.5:
        sentence = f"The axis of the residual spans ±{overlay.residual_limit_N:g} N."
    if overlay.beyond_N is None:
        return sentence
    return (
        f"{sentence} After the first valley the residual goes beyond it, to "
        f"{overlay.beyond_N:.1f} N."
    )


def words_and_unit(name: str) -> tuple[str, str]:
    """The name in words and its unit, empty where it has none. The value is not converted."""
    tokens = name.split("_")
    start = len(tokens)
    # Backwards from the end, as long as parts are units; the first part is always a word, as in "s"
    # or "m_kg".
    while start > 1 and (tokens[start - 1] == "per" or _unit(tokens[start - 1])):
        start -= 1
    if tokens[-1] == "per":
        start = len(tokens)
    words = re.sub(r"\bhinge(\d)", r"hinge \1", " ".join(tokens[:start]))
    return words, _join_units(tokens[start:])


def signal_words(signal: str) -> str:
    """A signal in words. The shaft's is compared as its deviation from the command, and must say
    so.
    """
    return SIGNAL_WORDS.get(signal) or words_and_unit(signal)[0]


def name_with_unit(name: str) -> str:
    """The name in words with its unit, as in "half gap, deg"."""
    words, unit = words_and_unit(name)
    if unit:
        return f"{words}, {unit}"
    return words


def _unit(token: str) -> str | None:
    match = re.fullmatch(r"([A-Za-z]+)(2|3|1p5|)", token)
    if match and match[1] in UNIT_WORDS:
        return UNIT_WORDS[match[1]] + POWERS[match[2]]
    return None


def _join_units(tokens: list[str]) -> str:
    if tokens in SPEEDS:
        return "/".join(tokens)
    words = [token if token == "per" else str(_unit(token)) for token in tokens]
    above, _, below = " ".join(words).partition("per")
    if below:
        return f"{above.strip() or '1'}/{below.strip()}"
    return above.strip()
