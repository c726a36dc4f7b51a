"""Tables of a diagnosis, and its words and numbers as text for a reader.

Tables hold parameters with intervals, nuisance parameters, misfits before and after, detection
limits, and measured laws.
"""

from collections.abc import Mapping, Sequence
from math import isfinite

from rfca_rig.diagnosis.config import MAX_COORDINATE
from rfca_rig.diagnosis.result import (
    BeforeAfter,
    Criterion,
    Diagnosis,
    Located,
    MovedPrior,
    SignalOverlay,
    Value,
    describe_probability,
    name_parts,
)
from rfca_rig.model.catalogue import declarations
from rfca_rig.reports.diagnosis.pictures import residuals_of
from rfca_rig.reports.table import Table, TableColumn, TableRow, places
from rfca_rig.reports.table import Value as Shown
from rfca_rig.reports.text import (
    NO_BREAK,
    NOTHING,
    decimals,
    format_decimals,
    format_significant,
    keep_units_together,
    name_with_unit,
    signal_words,
    words_and_unit,
)

# Half of a 90 % interval of a normal distribution, in standard deviations.
STDS_90 = 1.645
SIGMA = "\u03c3"
UNKNOWN = "unknown"
UNLISTED = "something that the catalogue does not list"

# Times the usual error from which a difference that remains is coloured on the map, too.
MATTERS_FROM = 2.0
# Decimals of misfits at most.
MOST_PLACES = 4
ALL_DATA = "all data"
HELD_OUT = "predicted from the others"
PRIOR = "prior"

ACCEPTANCE = ("test", "required", "observed", "result")
HYPOTHESES = ("missing", "prior_probability", "probability", "log_evidence", "model_error")
MAP = ("experiment", "signal", "phase", "condition", "size", "sigmas")
SIGNALS = ("condition", "signal", "t_s", "measured", "nominal", "amended")
PARAMETERS = (
    TableColumn("effect", "Effect"),
    TableColumn("parameter", "Parameter"),
    TableColumn("value", "Value", half="half_90"),
    TableColumn("unit", "Unit"),
    TableColumn("std", role="kept"),
    TableColumn("low_90", role="kept"),
    TableColumn("high_90", role="kept"),
    TableColumn("probability", role="kept"),
)


def format_with_interval_90(value: Value) -> str:
    """Value ± half of the 90 % interval, both to the second digit of the latter; the value alone
    without a known uncertainty.
    """
    half = STDS_90 * value.std
    if not (isfinite(half) and half > 0.0 and isfinite(value.value)):
        return format_significant(value.value, 4)
    places = decimals(half, 2)
    return f"{format_decimals(value.value, places)} ± {format_decimals(half, places)}"


def format_change(figure: BeforeAfter) -> str:
    """A figure before and after, both to two digits, with an arrow between."""
    before = format_significant(figure.before, 2)
    return f"{before} \u2192 {format_significant(figure.after, 2)}"


def format_probability(probability: float) -> str:
    """A probability in percent, never shown as certain: neither 0 nor 100."""
    if isfinite(probability):
        return describe_probability(probability).replace(" ", NO_BREAK)
    return NOTHING


def with_typography(text: str) -> str:
    """A sentence of the diagnosis with arrows, and units that stay with their numbers."""
    return keep_units_together(text).replace("->", "\u2192")


def compare_with_usual_error(place: Located) -> str:
    """How large a difference is beside what noise, scatter and the usual model error make, and
    whether it matters.
    """
    times = f"{format_significant(place.sigmas, 2)} times the usual error"
    if place.sigmas < 1.0:
        return f"{times}: real, but too small to matter"
    if place.sigmas >= MATTERS_FROM:
        return f"{times}: it matters"
    return f"{times}: it may matter"


def format_p_value(p_value: float) -> str:
    """A p-value as text; small ones as "< 0.001"."""
    if p_value < 0.0005:
        return "< 0.001"
    if p_value < 0.1:
        return format_significant(p_value, 1)
    return format_significant(p_value, 2)


def describe_effect(effect_id: str) -> str:
    """What a model without this effect lacks, in the catalogue's words; empty for an id that is
    not in the catalogue.
    """
    if effect_id == UNKNOWN:
        return UNLISTED
    for declared in declarations():
        if declared.id == effect_id:
            return declared.left_out
    return ""


def hypothesis(ids: Sequence[str]) -> str:
    """Name of a hypothesis: the ids of its effects."""
    if not ids:
        return "nothing missing"
    return " and ".join(dict.fromkeys(UNLISTED if name == UNKNOWN else name for name in ids))


def describe_moved_prior(one: MovedPrior) -> str:
    """Sentence on a nuisance parameter that moved beyond its prior."""
    words, unit_of_name = words_and_unit(one.name)
    unit = f"{NO_BREAK}{one.unit or unit_of_name}".rstrip(NO_BREAK)
    now = f"{format_significant(one.now.value)}{unit}"
    prior = f"{format_significant(one.prior.value)} ± {format_significant(one.prior.std, 2)}{unit}"
    if abs(one.deviations) > MAX_COORDINATE:
        beyond = f" (extrapolated: the fit stops at {MAX_COORDINATE:g})"
    else:
        beyond = ""
    distance = f"{abs(one.deviations):.1f} prior standard deviations"
    return (
        f"{words} moved to {now}, {distance} from {prior}{beyond}: it is wrong, or something "
        "acts like it"
    )


def sizes(values: Mapping[str, float]) -> str:
    """Values by name in words, as in "half gap 0.12 deg, rate 0.2 N/s"."""
    return ", ".join(_size(name, value) for name, value in values.items())


def _size(name: str, value: float) -> str:
    words, unit = words_and_unit(name)
    if unit == "relative":
        return f"{words} {_percent(value)}"
    if name == "factor":
        change = _percent(value - 1.0)
        if value > 1.0:
            change = f"+{change}"
        return f"{words} {format_significant(value)} ({change})"
    return f"{words} {format_significant(value)}{NO_BREAK}{unit.replace(' ', NO_BREAK)}".rstrip(
        NO_BREAK
    )


def _percent(ratio: float) -> str:
    return f"{format_significant(100.0 * ratio)}{NO_BREAK}%"


def entries(values: Mapping[str, object]) -> list[tuple[str, str]]:
    """Pairs (name, value) in words of a mapping that may be nested; an inner entry has both
    names, as in "outer: inner".
    """
    pairs: list[tuple[str, str]] = []
    for name, value in values.items():
        if isinstance(value, Mapping) and value:
            pairs += [
                (f"{name_with_unit(str(name))}: {inner}", text) for inner, text in entries(value)
            ]
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
        if isinstance(value, bool):
            return {True: "yes", False: "no"}[value]
        return value
    if isinstance(value, int | float):
        if isfinite(value):
            return f"{value:.6g}".replace("-", "\u2212")
        return NOTHING
    if hasattr(value, "__iter__"):
        return ", ".join(format_value(item) for item in value)
    return str(value)


def parameters_table(diagnosis: Diagnosis) -> Table:
    """Parameters of every stated effect, or of the most probable ones where none is claimed."""
    if diagnosis.verdict == "named":
        claim = "What the model lacks"
    else:
        claim = "Likeliest of the catalogue, not claimed"
    rows = tuple(
        TableRow(
            {
                "effect": effect.id.replace("_", " "),
                "probability": effect.probability,
                **_value_cells(name, value),
            }
        )
        for effect in diagnosis.effects
        for name, value in effect.parameters.items()
    )
    return Table("parameters", f"{claim}: values ± half of a 90 % interval.", PARAMETERS, rows)


def nominal_values_table(diagnosis: Diagnosis) -> Table:
    """Nuisance parameters after the fit, with their priors."""
    priors = {
        name: {"prior_value": value.value, "prior_std": value.std}
        for name, value in diagnosis.priors.items()
    }
    columns = (
        TableColumn("parameter", "Nuisance parameter"),
        *PARAMETERS[2:7],
        TableColumn("prior_value", "Before", over=PRIOR),
        TableColumn("prior_std", "Std.", over=PRIOR),
    )
    rows = tuple(
        TableRow(
            {**_value_cells(name, value, nuisance_unit(diagnosis, name)), **priors.get(name, {})}
        )
        for name, value in diagnosis.believed_values.items()
    )
    return Table(
        "believed", "As the recordings leave them, ± half of a 90 % interval.", columns, rows
    )


def nuisance_unit(diagnosis: Diagnosis, name: str) -> str:
    """Unit of a nuisance parameter whose name does not carry it, else empty."""
    return diagnosis.nuisance_units.get(name, "").replace("m1.5", "m^1.5")


def acceptance_table(diagnosis: Diagnosis) -> Table:
    """Acceptance tests with what they require and what was observed; a marked row was failed."""
    rows = tuple(_acceptance_row(criterion) for criterion in diagnosis.criteria)
    columns = tuple(
        TableColumn(key, head)
        for key, head in zip(ACCEPTANCE, ("Test", "Required", "Observed", "Result"), strict=True)
    )
    return Table("acceptance-tests", "What an identified effect must pass.", columns, rows)


def _acceptance_row(criterion: Criterion) -> TableRow:
    observed = criterion.found
    if criterion.required:
        observed = observed.removesuffix(f", {criterion.required}")
    return TableRow(
        {
            "test": criterion.name,
            "required": criterion.required,
            "observed": observed,
            "result": "passed" if criterion.passed else "failed",
        },
        marked=not criterion.passed,
    )


def hypotheses_table(diagnosis: Diagnosis) -> Table:
    """All hypotheses that the diagnosis lists, with prior and posterior probability, and log
    evidence relative to the best.
    """
    best = max((rival.log_evidence for rival in diagnosis.rivals), default=0.0)
    rows = tuple(
        TableRow(
            {
                "missing": hypothesis(rival.ids),
                "prior_probability": rival.prior,
                "probability": rival.probability,
                "log_evidence": rival.log_evidence - best,
                "model_error": rival.model_error,
            }
        )
        for rival in diagnosis.rivals
    )
    return Table("hypotheses", "", tuple(TableColumn(key) for key in HYPOTHESES), rows)


def residual_map_table(diagnosis: Diagnosis) -> Table:
    """Cells of the map: rms difference to the nominal model, in the unit of the signal's name,
    and relative to the expected one.
    """
    rows = []
    for cell in diagnosis.cells:
        rows.append(TableRow({key: getattr(cell, key) for key in MAP}))
    return Table("residual-map", "", tuple(TableColumn(key) for key in MAP), tuple(rows))


def signals_table(diagnosis: Diagnosis) -> Table:
    """All curves of the page: means over the repeats, with the nominal and the amended model, in
    the unit of the signal's name.
    """
    rows = list_signal_rows(diagnosis.overlays, SIGNALS)
    return Table("signals", "", tuple(TableColumn(key) for key in SIGNALS), rows)


def list_signal_rows(
    overlays: Sequence[SignalOverlay], keys: Sequence[str]
) -> tuple[TableRow, ...]:
    """A row for each time of each overlay.

    `keys` are those of condition, signal, time, measured value and value of either model, and where
    the overlays have a floor, of that.
    """
    rows = []
    for overlay in overlays:
        curves = [overlay.t_s, overlay.measured, overlay.before, overlay.after]
        if overlay.floor.size:
            curves.append(overlay.floor)
        for values in zip(*(curve.tolist() for curve in curves), strict=True):
            cells = (overlay.condition, overlay.signal, *values)
            rows.append(TableRow(dict(zip(keys, cells, strict=True))))
    return tuple(rows)


def _value_cells(name: str, value: Value, unit: str = "") -> dict[str, Shown]:
    """Cells of a value; `unit` where its name does not carry it."""
    words, carried = words_and_unit(name)
    half = STDS_90 * value.std
    cells: dict[str, Shown] = {"parameter": words, "value": value.value, "unit": unit or carried}
    # A parameter without a finite uncertainty has no interval.
    if not (isfinite(half) and half > 0.0):
        return cells
    return {
        **cells,
        "half_90": half,
        "std": value.std,
        "low_90": value.value - half,
        "high_90": value.value + half,
    }


def before_after_table(diagnosis: Diagnosis) -> Table:
    """Misfits before and after: forces signal by signal, then the valley of Table II; held-out
    values beside fitted ones.
    """
    fit = all_misfits(diagnosis)
    names = dict.fromkeys([*fit, *(name.removeprefix("held_out_") for name in diagnosis.held_out)])
    rows = [
        _row("signals", name, fit.get(name), diagnosis.held_out.get(f"held_out_{name}"))
        for name in names
    ]
    # Valleys are those of conditions that were left out, with the shaft as commanded.
    rows += [_row("Table II", name, None, misfit) for name, misfit in diagnosis.valley.items()]
    columns = [
        TableColumn("of", role="group"),
        TableColumn("difference", "Difference, rms"),
        TableColumn("unit", "Unit"),
        TableColumn("before", over=ALL_DATA),
        TableColumn("after", over=ALL_DATA),
    ]
    if diagnosis.is_of_stretches:
        of_what = "rms over all stretches"
    else:
        of_what = "means over the repeats of each condition, rms over all of them"
    caption = (
        f"Measured less simulated, {of_what}. Before: the nominal model; after: the model "
        "that this diagnosis arrives at."
    )
    if diagnosis.settings.get("shaft") == "as recorded":
        caption += (
            " The signals are simulated along the recorded turn of the shaft, where forces fit "
            "before an effect of the drive is added; Table II has the shaft as commanded."
        )
    if diagnosis.held_out or diagnosis.valley:
        columns += [
            TableColumn("held_out_before", "before", over=HELD_OUT),
            TableColumn("held_out_after", "after", over=HELD_OUT),
        ]
        caption += name_parts(
            " Predicted: each condition left out in turn and computed from a fit to the others.",
            diagnosis.is_of_stretches,
        )
    columns.append(TableColumn("noise_floor", "Noise floor"))
    return Table("before-after", caption, tuple(columns), tuple(rows))


def all_misfits(diagnosis: Diagnosis) -> dict[str, BeforeAfter]:
    """Rms misfits by signal; those of signals that are only drawn, as the shaft's, are taken
    from their curves.
    """
    misfits = dict(diagnosis.fit)
    for signal in dict.fromkeys(overlay.signal for overlay in diagnosis.overlays):
        name = f"rms_{signal}"
        if name not in diagnosis.fit:
            drawn = [overlay for overlay in diagnosis.overlays if overlay.signal == signal]
            misfits[name] = residuals_of(drawn)
    return misfits


def _row(
    of: str, name: str, fit: BeforeAfter | None, held_out: BeforeAfter | None = None
) -> TableRow:
    """One line. All its numbers have as many decimals as the smallest one needs for two digits,
    so that they can be compared.
    """
    floors = [
        misfit.noise_floor
        for misfit in (fit, held_out)
        if misfit is not None and misfit.noise_floor is not None
    ]
    numbers: dict[str, float | None] = dict.fromkeys(
        ("before", "after", "noise_floor", "held_out_before", "held_out_after")
    )
    if fit is not None:
        numbers["before"] = fit.before
        numbers["after"] = fit.after
    if floors:
        numbers["noise_floor"] = floors[0]
    if held_out is not None:
        numbers["held_out_before"] = held_out.before
        numbers["held_out_after"] = held_out.after
    words = signal_words(name.removeprefix("rms_"))
    unit = words_and_unit(name)[1]
    digits = max(
        (places(number, 2) for number in numbers.values() if number is not None), default=0
    )
    return TableRow(
        {"of": of, "difference": words, "unit": unit, **numbers},
        digits=min(max(digits, 1), MOST_PLACES),
    )


def detection_limits_table(diagnosis: Diagnosis) -> Table:
    """Detection limits: effects that were not found, with the size from which each would have been
    detected.

    An effect without a size could not have been detected in these data.
    """
    rows = [
        TableRow(
            {"effect": effect.id.replace("_", " "), "means": describe_effect(effect.id), **size}
        )
        for effect in diagnosis.not_seen
        for size in _sizes(effect.would_have_seen)
    ]
    columns = (
        TableColumn("effect", "Effect"),
        TableColumn("means", role="kept"),
        TableColumn("parameter", "Seen from"),
        TableColumn("size", "Size", set_value=True),
        TableColumn("unit", "Unit"),
    )
    caption = (
        "Effects looked for and not found, with the size from which on these data exclude "
        "them; without a size: not tested by them."
    )
    return Table("ruled-out", caption, columns, tuple(rows))


def _sizes(would_have_seen: Mapping[str, float] | None) -> list[dict[str, Shown]]:
    if not would_have_seen:
        return [{}]
    named = ((*words_and_unit(name), size) for name, size in would_have_seen.items())
    return [
        {"parameter": words, "size": float(f"{size:.3g}"), "unit": unit}
        for words, unit, size in named
    ]
