"""Tables of a diagnosis: parameters with intervals, nuisance parameters, misfits before and after, detection limits."""

from collections.abc import Mapping
from math import isfinite

from rfca_rig.diagnosis.result import BeforeAfter, Diagnosis, Value
from rfca_rig.report.diagnosis_wording import STDS_90, describe_effect
from rfca_rig.report.named_units import words_and_unit
from rfca_rig.report.table import Table, TableColumn, TableRow, places
from rfca_rig.report.table import Value as Shown

# Decimals of misfits at most.
MOST_PLACES = 4
ALL_DATA, HELD_OUT, PRIOR = "all data", "predicted from the others", "prior"

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


def parameters_table(diagnosis: Diagnosis) -> Table:
    """Parameters of every stated effect, or of the most probable ones where none is claimed."""
    claim = "What the model lacks" if diagnosis.verdict == "named" else "Likeliest of the catalogue, not claimed"
    rows = tuple(
        TableRow({"effect": effect.id.replace("_", " "), "probability": effect.probability, **_value_cells(name, value)})
        for effect in diagnosis.effects
        for name, value in effect.parameters.items()
    )
    return Table("parameters", f"{claim}: values ± half of a 90 % interval.", PARAMETERS, rows)


def nominal_values_table(diagnosis: Diagnosis) -> Table:
    """Nuisance parameters after the fit, with their priors."""
    priors = {name: {"prior_value": value.value, "prior_std": value.std} for name, value in diagnosis.priors.items()}
    columns = (
        TableColumn("parameter", "Nuisance parameter"),
        *PARAMETERS[2:7],
        TableColumn("prior_value", "Before", over=PRIOR),
        TableColumn("prior_std", "Std.", over=PRIOR),
    )
    rows = tuple(TableRow({**_value_cells(name, value), **priors.get(name, {})}) for name, value in diagnosis.believed_values.items())
    return Table("believed", "As the recordings leave them, ± half of a 90 % interval.", columns, rows)


def _value_cells(name: str, value: Value) -> dict[str, Shown]:
    words, unit = words_and_unit(name)
    half = STDS_90 * value.std
    cells: dict[str, Shown] = {"parameter": words, "value": value.value, "unit": unit}
    # A parameter without a finite uncertainty has no interval.
    if not (isfinite(half) and half > 0.0):
        return cells
    return {**cells, "half_90": half, "std": value.std, "low_90": value.value - half, "high_90": value.value + half}


def before_after_table(diagnosis: Diagnosis) -> Table:
    """Misfits before and after: forces signal by signal, then the valley of Table II; held-out values beside fitted ones."""
    names = dict.fromkeys([*diagnosis.fit, *(name.removeprefix("held_out_") for name in diagnosis.held_out)])
    rows = [_row("signals", name, diagnosis.fit.get(name), diagnosis.held_out.get(f"held_out_{name}")) for name in names]
    rows += [_row("Table II", name, each) for name, each in diagnosis.valley.items()]
    held_out = (
        (TableColumn("held_out_before", "before", over=HELD_OUT), TableColumn("held_out_after", "after", over=HELD_OUT))
        if diagnosis.held_out
        else ()
    )
    columns = (
        TableColumn("of", role="group"),
        TableColumn("difference", "Difference, rms"),
        TableColumn("unit", "Unit"),
        TableColumn("before", over=ALL_DATA),
        TableColumn("after", over=ALL_DATA),
        *held_out,
        TableColumn("noise_floor", "Noise floor"),
    )
    caption = (
        "Measured less simulated, means over the repeats of each condition, rms over all of them. Before: the model as it was believed; "
        "after: the model that this diagnosis arrives at."
    )
    note = " Predicted: each condition left out in turn and computed from a fit to the others."
    return Table("before-after", caption + (note if diagnosis.held_out else ""), columns, tuple(rows))


def _row(of: str, name: str, fit: BeforeAfter | None, held_out: BeforeAfter | None = None) -> TableRow:
    """One line. All its numbers have as many decimals as the smallest one needs for two digits, so that they can be compared."""
    floors = [each.noise_floor for each in (fit, held_out) if each is not None and each.noise_floor is not None]
    numbers = {
        "before": fit.before if fit else None,
        "after": fit.after if fit else None,
        "noise_floor": floors[0] if floors else None,
        "held_out_before": held_out.before if held_out else None,
        "held_out_after": held_out.after if held_out else None,
    }
    words, unit = words_and_unit(name.removeprefix("rms_"))
    digits = max((places(number, 2) for number in numbers.values() if number is not None), default=0)
    return TableRow({"of": of, "difference": words, "unit": unit, **numbers}, digits=min(max(digits, 1), MOST_PLACES))


def detection_limits_table(diagnosis: Diagnosis) -> Table:
    """Detection limits: effects that were not found, with the size from which each would have been detected.

    An effect without a size could not have been detected in these data.
    """
    rows = [
        TableRow({"effect": one.id.replace("_", " "), "means": describe_effect(one.id), **size})
        for one in diagnosis.not_seen
        for size in _sizes(one.would_have_seen)
    ]
    columns = (
        TableColumn("effect", "Effect"),
        TableColumn("means", role="kept"),
        TableColumn("parameter", "Seen from"),
        TableColumn("size", "Size", set_value=True),
        TableColumn("unit", "Unit"),
    )
    caption = (
        "Effects looked for and not found, with the size from which on they would have been seen in these data; without a size: "
        "not tested by them."
    )
    return Table("ruled-out", caption, columns, tuple(rows))


def _sizes(would_have_seen: Mapping[str, float] | None) -> list[dict[str, Shown]]:
    if not would_have_seen:
        return [{}]
    named = ((*words_and_unit(name), size) for name, size in would_have_seen.items())
    return [{"parameter": words, "size": float(f"{size:.3g}"), "unit": unit} for words, unit, size in named]
