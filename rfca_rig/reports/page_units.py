"""Units of what people read, on pages and in the terminal: angles in degrees, relative values in
per cent. Files keep their units.
"""

import re
from collections.abc import Mapping
from dataclasses import replace
from math import degrees

from rfca_rig.diagnosis.result import (
    BeforeAfter,
    Diagnosis,
    Located,
    MapCell,
    MovedPrior,
    NotSeen,
    Value,
)
from rfca_rig.diagnosis.result import SignalOverlay as Overlay
from rfca_rig.diagnosis.window_fit import FittedShift, SignalError, WindowFit
from rfca_rig.reports.text import MINUS, decimals, words_and_unit

DEGREES = "deg"
# Unit of a name: the unit of the page's name, and the factor to it.
SHOWN = {"rad": (DEGREES, degrees(1.0)), "relative": ("pct", 100.0)}
# An angle in a sentence, perhaps with its uncertainty; "rad/s" and "N m/rad" are not.
ANGLE = re.compile(
    r"(?<![\w.,/\u2212-])([-\u2212]?\d+(?:\.\d+)?)(?:( ± )(\d+(?:\.\d+)?))?([ \u00a0])rad(?![\w/²])"
)


def page_name(name: str) -> tuple[str, float]:
    """Name and factor with which a page shows a quantity: angles in degrees, relative values in per
    cent, all others unchanged.

    A quotient by an angle, as of a stiffness, is no angle.
    """
    unit = words_and_unit(name)[1]
    ending, factor = SHOWN.get(unit, (unit, 1.0))
    if factor != 1.0:
        return (f"{name.removesuffix(unit)}{ending}", factor)
    return (name, 1.0)


def text_in_degrees(text: str) -> str:
    """The text with its angles in degrees, with as many significant digits as it states."""
    return ANGLE.sub(_angle, text)


def _angle(match: re.Match[str]) -> str:
    value, joint, half, space = match.groups()
    given = [float(number.replace(MINUS, "-")) for number in (value, half) if number]
    # As many significant digits as the last number states, and two at least.
    digits = max(2, len(re.sub(r"^[-\u22120.]+|\.", "", half or value)))
    places = max(0, decimals(degrees(given[-1]), digits))
    text = (
        f"{(joint or '').join(f'{degrees(angle):.{places}f}' for angle in given)}{space}{DEGREES}"
    )
    if MINUS in value:
        return text.replace("-", MINUS)
    return text


def _scale(value: Value, factor: float) -> Value:
    return Value(factor * value.value, factor * value.std)


def _values(
    values: Mapping[str, Value], units: Mapping[str, str] | None = None
) -> dict[str, Value]:
    """Values by the names shown; where a name carries no unit, that of `units` counts."""
    page_values = {}
    for name, value in values.items():
        shown, factor = page_name(name)
        page_values[shown] = _scale(value, SHOWN.get((units or {}).get(name, ""), ("", factor))[1])
    return page_values


def _misfits(misfits: Mapping[str, BeforeAfter]) -> dict[str, BeforeAfter]:
    page_misfits = {}
    for name, misfit in misfits.items():
        shown, k = page_name(name)
        page_misfits[shown] = BeforeAfter(
            k * misfit.before, k * misfit.after, _scale_known(k, misfit.noise_floor)
        )
    return page_misfits


def _scale_known(k: float, value: float | None) -> float | None:
    """The value in the unit of the page; None where it is not known."""
    if value is None:
        return None
    return k * value


def _limits(effect: NotSeen) -> NotSeen:
    limits = {page_name(name): size for name, size in (effect.would_have_seen or {}).items()}
    return replace(
        effect,
        would_have_seen=effect.would_have_seen
        and {name: factor * size for (name, factor), size in limits.items()},
    )


def _place(place: Located) -> Located:
    signal, factor = page_name(place.signal)
    if factor != 1.0:
        return replace(place, signal=signal, size=factor * place.size, unit=DEGREES)
    return place


def _cell(cell: MapCell) -> MapCell:
    signal, factor = page_name(cell.signal)
    return replace(cell, signal=signal, size=factor * cell.size)


def _prior(moved_prior: MovedPrior) -> MovedPrior:
    name, factor = page_name(moved_prior.name)
    unit, factor = SHOWN.get(moved_prior.unit, (moved_prior.unit, factor))
    return replace(
        moved_prior,
        name=name,
        unit=unit.replace("pct", "%"),
        prior=_scale(moved_prior.prior, factor),
        now=_scale(moved_prior.now, factor),
    )


def convert_overlay(one: Overlay) -> Overlay:
    """The signal (m,) with both models in the unit of a page."""
    signal, factor = page_name(one.signal)
    measured, before, after = (factor * values for values in (one.measured, one.before, one.after))
    return replace(one, signal=signal, measured=measured, before=before, after=after)


def convert_diagnosis(found: Diagnosis) -> Diagnosis:
    """The same answer in the units of a page: numbers with their names, and angles in sentences."""
    units = found.nuisance_units
    return replace(
        found,
        sentence=text_in_degrees(found.sentence),
        located=tuple(map(_place, found.located)),
        remaining=tuple(map(_place, found.remaining)),
        cells=tuple(map(_cell, found.cells)),
        effects=tuple(
            replace(
                effect,
                parameters=_values(effect.parameters),
                wording=text_in_degrees(effect.wording),
            )
            for effect in found.effects
        ),
        criteria=tuple(
            replace(
                criterion,
                found=text_in_degrees(criterion.found),
                required=text_in_degrees(criterion.required),
            )
            for criterion in found.criteria
        ),
        not_seen=tuple(map(_limits, found.not_seen)),
        fit=_misfits(found.fit),
        held_out=_misfits(found.held_out),
        valley=_misfits(found.valley),
        unexplained=tuple(map(text_in_degrees, found.unexplained)),
        remarks=tuple(map(text_in_degrees, found.remarks)),
        believed_values=_values(found.believed_values, units),
        priors=_values(found.priors, units),
        nuisance_units={
            page_name(name)[0]: SHOWN.get(unit, (unit, 1.0))[0] for name, unit in units.items()
        },
        nuisance_keys={page_name(name)[0]: key for name, key in found.nuisance_keys.items()},
        moved_priors=tuple(map(_prior, found.moved_priors)),
        overlays=tuple(map(convert_overlay, found.overlays)),
    )


def _error(error: SignalError) -> SignalError:
    signal, k = page_name(error.signal)
    return replace(
        error,
        signal=signal,
        noise=k * error.noise,
        nominal=k * error.nominal,
        fitted=k * error.fitted,
        held_out=_scale_known(k, error.held_out),
    )


def _shift(shift: FittedShift) -> FittedShift:
    name, k = page_name(shift.name)
    return replace(
        shift, name=name, prior_std=k * shift.prior_std, value=k * shift.value, std=k * shift.std
    )


def convert_fit(fit: WindowFit) -> WindowFit:
    """The same fit in the units of a page."""
    return replace(
        fit,
        shifts=tuple(map(_shift, fit.shifts)),
        errors=tuple(map(_error, fit.errors)),
        totals=tuple(map(_error, fit.totals)),
        overlays=tuple(map(convert_overlay, fit.overlays)),
    )
