"""Words and numbers of a diagnosis as text for a reader: rounding, intervals, probabilities, names."""

from collections.abc import Mapping, Sequence
from math import floor, isfinite, log10

from rfca_rig.diagnosis.result import MovedPrior, Value
from rfca_rig.model.catalogue import catalogue
from rfca_rig.report.named_units import name_with_unit, words_and_unit
from rfca_rig.report.text import NO_BREAK, NOTHING, number

# Half of a 90 % interval of a normal distribution, in standard deviations.
STDS_90 = 1.645
SIGMA = "\u03c3"
UNKNOWN = "unknown"
UNLISTED = "something that the catalogue does not list"


def format_significant(value: float | None, digits: int = 3) -> str:
    """A value with `digits` significant digits, without an exponent; an en dash for an unknown one."""
    if value is None or not isfinite(value):
        return NOTHING
    return format_decimals(value, decimals(value, digits))


def decimals(size: float, digits: int) -> int:
    """Decimals that show `size` with so many significant digits; negative where it is rounded to tens or hundreds."""
    return digits - 1 - floor(log10(abs(size))) if size and isfinite(size) else 0


def format_decimals(value: float, places: int) -> str:
    """A value with `places` decimals; negative ones round to tens or hundreds."""
    return number(round(value, places), max(places, 0)) if isfinite(value) else NOTHING


def format_with_interval_90(value: Value) -> str:
    """Value ± half of the 90 % interval, both to the second digit of the latter; the value alone without a known uncertainty."""
    half = STDS_90 * value.std
    if not (isfinite(half) and half > 0.0 and isfinite(value.value)):
        return format_significant(value.value, 4)
    places = decimals(half, 2)
    return f"{format_decimals(value.value, places)} ± {format_decimals(half, places)}"


def format_probability(probability: float) -> str:
    """A probability in percent, never shown as certain: neither 0 nor 100."""
    text = f"{100.0 * probability:.0f}"
    if probability < 0.0005:
        text = "< 0.1"
    elif probability >= 0.9995:
        text = "> 99.9"
    elif not 0.01 <= probability < 0.99:
        text = f"{100.0 * probability:.1f}"
    return f"{text} %".replace(" ", NO_BREAK) if isfinite(probability) else NOTHING


def format_p_value(p_value: float) -> str:
    """A p-value as text; small ones as "< 0.001"."""
    return "< 0.001" if p_value < 0.0005 else format_significant(p_value, 1 if p_value < 0.1 else 2)


def describe_effect(effect_id: str) -> str:
    """What a model without this effect lacks, in the catalogue's words; empty for an id that is not in the catalogue."""
    if effect_id == UNKNOWN:
        return UNLISTED
    effect = catalogue().get(effect_id)
    return effect.left_out if effect else ""


def hypothesis(ids: Sequence[str]) -> str:
    """Name of a hypothesis: the ids of its effects."""
    if not ids:
        return "nothing missing"
    return " and ".join(dict.fromkeys(UNLISTED if name == UNKNOWN else name for name in ids))


def describe_moved_prior(one: MovedPrior) -> str:
    """Sentence on a nuisance parameter that moved beyond its prior."""
    words, unit = one.name.replace("_", " "), f"{NO_BREAK}{one.unit}" if one.unit else ""
    now, prior = (
        f"{format_significant(one.now.value)}{unit}",
        f"{format_significant(one.prior.value)} ± {format_significant(one.prior.std, 2)}{unit}",
    )
    return f"{words} moved to {now}, {abs(one.deviations):.1f} prior deviations from {prior}: it is wrong, or something acts like it"


def sizes(values: Mapping[str, float]) -> str:
    """Values by name in words, as in "half gap 0.12 deg, rate 0.2 N/s"."""
    return ", ".join(_size(name, value) for name, value in values.items())


def _size(name: str, value: float) -> str:
    words, unit = words_and_unit(name)
    return f"{words} {format_significant(value)}{NO_BREAK}{unit.replace(' ', NO_BREAK)}".rstrip(NO_BREAK)


def entries(values: Mapping[str, object]) -> list[tuple[str, str]]:
    """Pairs (name, value) in words of a mapping that may be nested; an inner entry has both names, as in "outer: inner"."""
    pairs: list[tuple[str, str]] = []
    for name, value in values.items():
        if isinstance(value, Mapping) and value:
            pairs += [(f"{name_with_unit(str(name))}: {inner}", text) for inner, text in entries(value)]
        else:
            pairs.append((name_with_unit(str(name)), format_value(value)))
    return pairs


def format_value(value: object) -> str:
    """Any value as text: numbers to six digits, lists with commas."""
    if value is None or (isinstance(value, Mapping) and not value):
        return NOTHING
    if isinstance(value, Mapping):
        return "; ".join(f"{name} {text}" for name, text in entries(value))
    if isinstance(value, bool | str):
        return {True: "yes", False: "no"}[value] if isinstance(value, bool) else value
    if isinstance(value, int | float):
        return f"{value:.6g}".replace("-", "\u2212") if isfinite(value) else NOTHING
    return ", ".join(format_value(each) for each in value) if hasattr(value, "__iter__") else str(value)
