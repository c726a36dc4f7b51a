"""MAP fit of nuisance parameters and of given effects to recordings in windows: values, standard
errors, errors of signals.
"""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.result import describe_pair, list_correlated_pairs
from rfca_rig.diagnosis.data import rms
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis, ModelSelectionResult
from rfca_rig.diagnosis.inference.map_fit import GaussNewton
from rfca_rig.diagnosis.inference.model_selection import Progress
from rfca_rig.diagnosis.inference.parameterization import std_of, value_of
from rfca_rig.diagnosis.inference.screening import fit_most_promising, grid_points, terms_of
from rfca_rig.diagnosis.likelihood.marginal_likelihood import jackknife_std, loo_residuals
from rfca_rig.diagnosis.result import SignalOverlay
from rfca_rig.diagnosis.result_builder import group_by_recording, make_overlays
from rfca_rig.errors import SimulationFailed
from rfca_rig.model.effect import Effect

Floats = NDArray[np.float64]

STARTS = 3  # grid points of an effect from which it is fitted: those that promise most
# prior deviations of a size beyond which its plausible range holds it, not the recordings
AT_BOUND = 3.0
# times the smallest plausible size, below which the recordings may show none at all
PERHAPS_NONE = 2.0
ALL = "all recordings"


@dataclass(frozen=True)
class FittedShift:
    """Shift of one nominal value, in the unit that ends its `name`: `prior_std` before the fit,
    `value` and `std` after.
    """

    name: str
    prior_std: float
    value: float
    std: float


@dataclass(frozen=True)
class FittedSize:
    """A parameter of an effect, in the unit that ends its `name`; `at_bound` where the plausible
    range limits it, not the recordings.

    One that counts something, for example the number of a joint, has no standard deviation.
    """

    effect: str
    name: str
    value: float
    std: float | None
    at_bound: bool


@dataclass(frozen=True)
class SignalError:
    """Rms errors of one signal of one recording, in the unit that ends the name of the signal.

    Parameters
    ----------
    noise
        Of sensor noise alone.
    nominal
        With the nominal values. They are fitted to nothing, so this is held-out, too.
    fitted
        With the fitted values.
    held_out
        With the values fitted to all other conditions; None where there is one condition only.
    """

    run: str
    signal: str
    noise: float
    nominal: float
    fitted: float
    held_out: float | None


@dataclass(frozen=True)
class WindowFit:
    """Result of a fit.

    Parameters
    ----------
    shifts
        The nuisance parameters.
    sizes
        The parameters of the effects that were given.
    correlated
        Pairs of names with their correlation, which the recordings hardly distinguish.
    errors, totals
        Of each signal of each recording, and of each signal of all recordings together.
    overlays
        The signals, in the order of `errors`.
    """

    shifts: tuple[FittedShift, ...]
    sizes: tuple[FittedSize, ...]
    correlated: tuple[tuple[str, str, float], ...]
    errors: tuple[SignalError, ...]
    totals: tuple[SignalError, ...]
    overlays: tuple[SignalOverlay, ...]

    def plain(self, file_format: str) -> dict[str, Any]:
        """Everything but the signals as plain data, for JSON of this format."""
        return {
            "format": file_format,
            "shifts": [asdict(shift) for shift in self.shifts],
            "effects": [asdict(size) for size in self.sizes],
            "correlated": [{"names": [a, b], "correlation": c} for a, b, c in self.correlated],
            "errors": [asdict(error) for error in self.errors],
            "totals": [asdict(error) for error in self.totals],
        }

    def lines(self) -> list[str]:
        """The same as lines of text; of several recordings the totals alone."""
        return [
            *(
                [
                    f"{'nominal value':<36}{'prior std':>10}{'shift':>11}"
                    f"{'std':>10}{'shift/prior':>13}"
                ]
                if self.shifts
                else []
            ),
            *(
                f"{s.name:<36}{s.prior_std:>10.3g}{s.value:>+11.4g}"
                f"{s.std:>10.2g}{s.value / s.prior_std:>+13.2f}"
                for s in self.shifts
            ),
            *([f"{'effect':<46}{'value':>11}{'std':>10}"] if self.sizes else []),
            *map(_size_line, self.sizes),
            *map(describe_pair, self.correlated),
            f"{'rms error, ' + ALL:<40}{'nominal':>10}{'fitted':>10}{'held-out':>10}{'noise':>10}",
            *map(_error_line, self.totals),
        ]


def _size_line(size: FittedSize) -> str:
    std = "" if size.std is None else f"{size.std:.2g}"
    if size.at_bound:
        bound = "  at the end of its plausible range"
    else:
        bound = ""
    return f"{f'{size.effect}.{size.name}':<46}{size.value:>11.4g}{std:>10}{bound}"


def _error_line(error: SignalError) -> str:
    held_out = "" if error.held_out is None else f"{error.held_out:.3g}"
    return (
        f"{error.signal:<40}{error.nominal:>10.3g}{error.fitted:>10.3g}"
        f"{held_out:>10}{error.noise:>10.2g}"
    )


def fit_effects(
    found: ModelSelectionResult, effects: Sequence[Effect], progress: Progress
) -> Hypothesis:
    """The MAP fit with these effects beside the nuisance parameters.

    Parameters
    ----------
    found
        The search without effects, from whose fit this one begins.
    effects
        The effects; each is added where it promises most beside those before it.
    progress
        Called with what is being done and the share that is done.

    Raises
    ------
    SimulationFailed
        Where the model cannot be simulated with an effect of any plausible size.
    """
    if not effects:
        return found.nothing
    optimizer = GaussNewton(found.dataset, found.likelihood)
    fit = found.nothing.fitted
    for number, effect in enumerate(effects):
        progress(f"fitting {effect.id}", 0.5 + 0.4 * number / len(effects))
        more = fit_most_promising(optimizer, fit, grid_points(terms_of(effect)), STARTS)
        if more is None:
            raise SimulationFailed(
                f"the model cannot be simulated with {effect.id} of any plausible size"
            )
        fit = more
    progress("fitting all together", 0.9)
    # Effects were added one after the other, so the first ones were fitted without the later ones.
    fit = optimizer.converge(fit)
    return Hypothesis(fit.ids, fit, optimizer.evaluate(fit), found.nothing.log_prior)


def summarize(found: ModelSelectionResult, fitted: Hypothesis) -> WindowFit:
    """A fit as plain values.

    Parameters
    ----------
    found
        The search without effects.
    fitted
        The fit, as `fit_effects` gives it.
    """
    errors, totals, overlays = _compare(found, fitted)
    std_x = np.sqrt(np.diag(fitted.marginal.posterior.covariance))
    rows = found.dataset.rows
    # The larger of two estimates: the jackknife is robust to errors that the rows of one condition
    # share.
    std_x = np.maximum(
        std_x,
        jackknife_std(
            fitted.fitted.linear(rows.measured), fitted.marginal.whitening, rows.condition
        ),
    )
    coordinates = fitted.fitted.coordinates
    names = [
        *coordinates.space.names,
        *(f"{term.effect.id}.{p.name}" for term in coordinates.choices for p in term.free),
    ]
    return WindowFit(
        shifts=tuple(_list_shifts(fitted, std_x)),
        sizes=tuple(_list_sizes(fitted, std_x)),
        correlated=tuple(list_correlated_pairs(names, fitted.marginal.posterior.covariance)),
        errors=errors,
        totals=totals,
        overlays=overlays,
    )


def _list_shifts(fitted: Hypothesis, std_x: Floats) -> Iterator[FittedShift]:
    space = fitted.fitted.coordinates.space
    mean = fitted.marginal.posterior.mean
    at = space.at(mean[: len(space.std)])
    for index, parameter in enumerate(space.parameters):
        prior_std = float(space.std[index])
        yield FittedShift(
            parameter.name, prior_std, float(parameter.read(at)), prior_std * float(std_x[index])
        )


def _list_sizes(fitted: Hypothesis, std_x: Floats) -> Iterator[FittedSize]:
    coordinates = fitted.fitted.coordinates
    mean = fitted.marginal.posterior.mean
    for number, term in enumerate(coordinates.choices):
        part = coordinates.part(number)
        yield from (
            FittedSize(term.effect.id, name, value, None, False) for name, value in term.whole
        )
        for parameter, z, std_z in zip(
            term.free, mean[part].tolist(), std_x[part].tolist(), strict=True
        ):
            value = value_of(parameter, z)
            # A scale near its smallest plausible value may as well be zero.
            is_far = abs(z) > AT_BOUND or value < PERHAPS_NONE * parameter.low
            yield FittedSize(
                term.effect.id, parameter.name, value, std_of(parameter, z, std_z), is_far
            )


def _compare(
    search: ModelSelectionResult, fitted: Hypothesis
) -> tuple[tuple[SignalError, ...], tuple[SignalError, ...], tuple[SignalOverlay, ...]]:
    """Errors and overlays of each signal of each recording, rows in order of time, and errors of
    each signal of all.
    """
    rows = search.dataset.rows
    nominal = search.nominal.predicted
    after = fitted.rows
    held_out = None
    conditions = len(search.dataset.parts)
    if conditions > 1:
        linear = fitted.fitted.linear(rows.measured)
        held_out = loo_residuals(
            linear, fitted.marginal.whitening, rows.condition, range(conditions)
        )

    def error(name: str, signal: str, here: NDArray[np.intp]) -> SignalError:
        held_out_rms = None if held_out is None else rms(held_out[here])
        measured = rows.measured[here]
        return SignalError(
            name,
            signal,
            rms(rows.noise[here]),
            rms(measured - nominal[here]),
            rms(measured - after[here]),
            held_out_rms,
        )

    signals = dict.fromkeys(label.signal for label in rows.labels)
    errors = [
        error(name, signal, indices)
        for (name, signal), (_, indices) in group_by_recording(rows).items()
    ]
    totals = [error(ALL, signal, np.flatnonzero(rows.signal == signal)) for signal in signals]
    return tuple(errors), tuple(totals), make_overlays(search, fitted)
