"""Units of the pages that people read: angles in degrees, relative values in per cent. Files beside a page keep those of their keys."""

import re
from collections.abc import Mapping
from dataclasses import replace
from math import degrees

from rfca_rig.diagnosis.result import BeforeAfter, Diagnosis, Located, MapCell, MovedPrior, Value
from rfca_rig.diagnosis.result import SignalOverlay as Overlay
from rfca_rig.diagnosis.window_fit import FittedShift, SignalError, WindowFit
from rfca_rig.reports.text import decimals, words_and_unit

DEGREES = "deg"
# Unit of a name: the unit of the page's name, and the factor to it.
SHOWN = {"rad": (DEGREES, degrees(1.0)), "relative": ("pct", 100.0)}
# An angle in a sentence, perhaps with its uncertainty; "rad/s" and "N m/rad" are not.
ANGLE = re.compile(r"(?<![\w.,/\u2212-])([-\u2212]?\d+(?:\.\d+)?)(?:( ± )(\d+(?:\.\d+)?))?([ \u00a0])rad(?![\w/²])")


def shown_name(name: str) -> tuple[str, float]:
    """Name and factor with which a page shows a quantity: angles in degrees, relative values in per cent, all others unchanged.

    A quotient by an angle, as of a stiffness, is no angle.
    """
    unit = words_and_unit(name)[1]
    ending, factor = SHOWN.get(unit, (unit, 1.0))
    return (f"{name.removesuffix(unit)}{ending}", factor) if factor != 1.0 else (name, 1.0)


def text_in_degrees(text: str) -> str:
    """The text with its angles in degrees, with as many significant digits as it states."""
    return ANGLE.sub(_angle, text)


def _angle(found: re.Match[str]) -> str:
    value, joint, half, space = found.groups()
    known = half if half is not None else value
    places = max(0, decimals(degrees(_number(known)), max(2, len(known.replace(".", "").lstrip("-\u22120")))))
    numbers = [
        f"{degrees(_number(each)):.{places}f}".replace("-", value[0] if value[0] in "-\u2212" else "-") for each in (value, half) if each
    ]
    return f"{(joint or '').join(numbers)}{space}{DEGREES}"


def _number(text: str) -> float:
    return float(text.replace("\u2212", "-"))


def _scaled(one: Value, factor: float) -> Value:
    return Value(factor * one.value, factor * one.std)


def _values(values: Mapping[str, Value], units: Mapping[str, str] | None = None) -> dict[str, Value]:
    """Values by the names shown; where a name carries no unit, that of `units` counts."""
    found = {}
    for name, one in values.items():
        shown, factor = shown_name(name)
        found[shown] = _scaled(one, SHOWN.get((units or {}).get(name, ""), ("", factor))[1])
    return found


def _misfits(misfits: Mapping[str, BeforeAfter]) -> dict[str, BeforeAfter]:
    found = {}
    for name, one in misfits.items():
        shown, k = shown_name(name)
        found[shown] = BeforeAfter(k * one.before, k * one.after, None if one.noise_floor is None else k * one.noise_floor)
    return found


def _limits(limits: Mapping[str, float] | None) -> Mapping[str, float] | None:
    # A page gives relative limits in per cent anyhow.
    return limits and {shown_name(name)[0]: shown_name(name)[1] * size for name, size in limits.items()}


def _place(place: Located) -> Located:
    signal, factor = shown_name(place.signal)
    return replace(place, signal=signal, size=factor * place.size, unit=DEGREES) if factor != 1.0 else place


def _cell(cell: MapCell) -> MapCell:
    signal, factor = shown_name(cell.signal)
    return replace(cell, signal=signal, size=factor * cell.size)


def _moved(one: MovedPrior) -> MovedPrior:
    name, factor = shown_name(one.name)
    unit, factor = SHOWN.get(one.unit, (one.unit, factor))
    return replace(one, name=name, unit=unit.replace("pct", "%"), prior=_scaled(one.prior, factor), now=_scaled(one.now, factor))


def overlay_as_shown(one: Overlay) -> Overlay:
    """The signal (m,) with both models in the unit of a page."""
    signal, factor = shown_name(one.signal)
    measured, before, after = (factor * values for values in (one.measured, one.before, one.after))
    return replace(one, signal=signal, measured=measured, before=before, after=after)


def diagnosis_as_shown(found: Diagnosis) -> Diagnosis:
    """The same answer in the units of a page: numbers with their names, and angles in sentences."""
    units = found.nuisance_units
    return replace(
        found,
        sentence=text_in_degrees(found.sentence),
        located=tuple(map(_place, found.located)),
        remaining=tuple(map(_place, found.remaining)),
        cells=tuple(map(_cell, found.cells)),
        effects=tuple(replace(one, parameters=_values(one.parameters), wording=text_in_degrees(one.wording)) for one in found.effects),
        criteria=tuple(replace(one, found=text_in_degrees(one.found), required=text_in_degrees(one.required)) for one in found.criteria),
        not_seen=tuple(replace(one, would_have_seen=_limits(one.would_have_seen)) for one in found.not_seen),
        fit=_misfits(found.fit),
        held_out=_misfits(found.held_out),
        valley=_misfits(found.valley),
        unexplained=tuple(map(text_in_degrees, found.unexplained)),
        remarks=tuple(map(text_in_degrees, found.remarks)),
        believed_values=_values(found.believed_values, units),
        priors=_values(found.priors, units),
        nuisance_units={shown_name(name)[0]: SHOWN.get(unit, (unit, 1.0))[0] for name, unit in units.items()},
        moved_priors=tuple(map(_moved, found.moved_priors)),
        overlays=tuple(map(overlay_as_shown, found.overlays)),
    )


def _error(error: SignalError) -> SignalError:
    signal, k = shown_name(error.signal)
    held_out = None if error.held_out is None else k * error.held_out
    return replace(error, signal=signal, noise=k * error.noise, nominal=k * error.nominal, fitted=k * error.fitted, held_out=held_out)


def _shift(shift: FittedShift) -> FittedShift:
    name, k = shown_name(shift.name)
    return replace(shift, name=name, prior_std=k * shift.prior_std, value=k * shift.value, std=k * shift.std)


def fit_as_shown(fit: WindowFit) -> WindowFit:
    """The same fit in the units of a page."""
    return replace(
        fit,
        shifts=tuple(map(_shift, fit.shifts)),
        errors=tuple(map(_error, fit.errors)),
        totals=tuple(map(_error, fit.totals)),
        overlays=tuple(map(overlay_as_shown, fit.overlays)),
    )
