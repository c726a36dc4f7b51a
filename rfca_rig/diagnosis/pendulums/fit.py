"""Nominal values of a pendulum fitted to its recordings, with no effect in the model."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.swings import SwingProblem, shifted, swings_of
from rfca_rig.campaign.pendulum import PendulumCampaign
from rfca_rig.crew.cores import algebra_on_one_thread
from rfca_rig.diagnosis.data.observations import rms
from rfca_rig.diagnosis.inference.hypotheses import ModelSelectionResult
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.likelihood.cross_validation import loo_residuals
from rfca_rig.diagnosis.pendulums.nuisances import of_pendulum, space_of_pendulum
from rfca_rig.diagnosis.pendulums.windows import BIN_S, WINDOW_S, Stretch, pendulum_dataset, stretches_of
from rfca_rig.diagnosis.result import Overlay
from rfca_rig.errors import BadInput
from rfca_rig.model.pendulum import Pendulum

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class FittedShift:
    """By how much one nominal value is off, in the unit that its `name` ends with: `prior_std` before the fit, `value` and `std` after."""

    name: str
    prior_std: float
    value: float
    std: float


@dataclass(frozen=True)
class SignalError:
    """Rms errors of one signal of one run, in `unit`.

    Parameters
    ----------
    run
        The run's label.
    signal
        Name of the signal with its unit, for example "angle1_rad".
    noise
        What sensor noise alone makes.
    nominal
        With the nominal values.
    fitted
        With the fitted values.
    held_out
        With the values fitted to all other stretches; None where the campaign has one stretch only.
    """

    run: str
    signal: str
    noise: float
    nominal: float
    fitted: float
    held_out: float | None


@dataclass(frozen=True)
class PendulumFit:
    """What a fit of a pendulum's nominal values found.

    Parameters
    ----------
    pendulum
        The pendulum with the fitted values.
    shifts
        Each fitted value, as a shift from nominal.
    errors
        One for each run and signal.
    overlays
        Measured, nominal and fitted signals of each run.
    """

    pendulum: Pendulum
    shifts: tuple[FittedShift, ...]
    errors: tuple[SignalError, ...]
    overlays: tuple[Overlay, ...]

    def plain(self) -> dict[str, Any]:
        """Everything but the signals as plain data, for JSON."""
        return {
            "format": "rfca-pendulum-fit/1",
            "shifts": [asdict(shift) for shift in self.shifts],
            "errors": [asdict(error) for error in self.errors],
        }

    def lines(self) -> list[str]:
        """The same for a person."""
        return [
            f"{'nominal value':<36}{'prior std':>10}{'shift':>11}{'std':>10}{'shift/prior':>13}",
            *(f"{s.name:<36}{s.prior_std:>10.3g}{s.value:>+11.4g}{s.std:>10.2g}{s.value / s.prior_std:>+13.2f}" for s in self.shifts),
            *(_error_line(error) for error in self.errors),
        ]


def _error_line(error: SignalError) -> str:
    held_out = "" if error.held_out is None else f", held-out {error.held_out:.3g}"
    return f"{error.run}, {error.signal}: rms {error.nominal:.3g} -> {error.fitted:.3g}{held_out}, noise {error.noise:.3g}"


@algebra_on_one_thread()
def fit_pendulum(campaign: PendulumCampaign, progress: Progress, names: Collection[str] = ()) -> PendulumFit:
    """The nominal values of [known_to] fitted to all runs, each with its stated uncertainty as prior.

    Parameters
    ----------
    campaign
        The recordings and the nominal pendulum.
    progress
        Called with what is being done and the share that is done.
    names
        What to fit, for example "link1.mass_relative"; all that [known_to] lists if empty.

    Raises
    ------
    BadInput
        Where nothing is to be fitted, a name is unknown, or no run is long enough.
    SimulationFailed
        Where the nominal pendulum cannot be simulated.
    """
    problem = _with_nuisances(swings_of(campaign, WINDOW_S, BIN_S), names)
    stretches = stretches_of(problem)
    space = space_of_pendulum(problem.pendulum, problem.nuisances)
    found = search_models(pendulum_dataset(stretches), Parameterization(space), [], progress)
    posterior, count = found.nothing.judgement.posterior, len(problem.nuisances)
    shifts = dict(of_pendulum(space.at(posterior.mean[:count])).off)
    std = np.sqrt(np.diag(posterior.covariance))[:count] * space.std
    return PendulumFit(
        pendulum=shifted(problem.pendulum, shifts),
        shifts=tuple(FittedShift(n.name, n.std, shifts[n.name], float(s)) for n, s in zip(problem.nuisances, std, strict=True)),
        errors=tuple(_errors(problem, stretches, found)),
        overlays=tuple(_overlays(problem, stretches, found)),
    )


def _with_nuisances(problem: SwingProblem, names: Collection[str]) -> SwingProblem:
    known = {nuisance.name: nuisance for nuisance in problem.nuisances}
    if not known:
        raise BadInput("nothing to fit: [known_to] lists no value that these runs depend on; add for example mass_relative = 0.05")
    for name in names:
        if name not in known:
            raise BadInput(f"--parameters: {name!r} is none of {', '.join(known)}, which [known_to] lists and these runs depend on")
    return replace(problem, nuisances=tuple(one for one in problem.nuisances if not names or one.name in names))


def _rows_of_runs(problem: SwingProblem, stretches: Sequence[Stretch], found: ModelSelectionResult) -> Iterator[tuple[str, str, Any]]:
    """(run, signal, its rows' places in order of time) for each run and each signal."""
    rows = found.evidence.rows
    run_of_stretch = np.array([problem.conditions[stretch.windows[0].window.run] for stretch in stretches])
    run_of_row = run_of_stretch[rows.condition]
    for run in problem.conditions:
        for signal in stretches[0].signals:
            here = np.flatnonzero((run_of_row == run) & (rows.signal == signal))
            if here.size:
                yield run, signal, here[np.argsort(rows.t_s[here], kind="stable")]


def _errors(problem: SwingProblem, stretches: Sequence[Stretch], found: ModelSelectionResult) -> Iterator[SignalError]:
    rows, nothing = found.evidence.rows, found.nothing
    apart = None
    if len(stretches) > 1:
        apart = loo_residuals(nothing.fitted.linear(rows.measured), nothing.judgement.whitening, rows.condition, range(len(stretches)))
    nominal, fitted = rows.measured - found.believed.predicted, rows.measured - nothing.rows
    for run, signal, here in _rows_of_runs(problem, stretches, found):
        held_out = None if apart is None else rms(apart[here])
        yield SignalError(run, signal, rms(rows.noise[here]), rms(nominal[here]), rms(fitted[here]), held_out)


def _overlays(problem: SwingProblem, stretches: Sequence[Stretch], found: ModelSelectionResult) -> Iterator[Overlay]:
    rows, nominal, fitted = found.evidence.rows, found.believed.predicted, found.nothing.rows
    for run, signal, here in _rows_of_runs(problem, stretches, found):
        yield Overlay(run, signal, rows.t_s[here], rows.measured[here], nominal[here], fitted[here])


def fitted_known_to(campaign: PendulumCampaign, fit: PendulumFit) -> Mapping[str, float]:
    """[known_to] after the fit: of a value of several links the largest standard deviation; what was not fitted stays as stated."""
    found = dict(campaign.known_to)
    for key in {shift.name.partition(".")[2] for shift in fit.shifts}:
        found[key] = max(shift.std for shift in fit.shifts if shift.name.partition(".")[2] == key)
    return found
