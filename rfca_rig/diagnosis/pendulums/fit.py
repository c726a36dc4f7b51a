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
    """Rms errors of one signal of one run, in the unit that ends the signal's name.

    `noise` is what sensor noise alone makes; `nominal` and `fitted` are with those values; `held_out` is with the values fitted to all
    other stretches, None where the campaign has one stretch only.
    """

    run: str
    signal: str
    noise: float
    nominal: float
    fitted: float
    held_out: float | None


@dataclass(frozen=True)
class PendulumFit:
    """The pendulum with fitted nominal values, each `shift` from nominal, and the errors and overlays of each run and signal."""

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
    posterior, count = found.nothing.marginal.posterior, len(problem.nuisances)
    shifts = dict(of_pendulum(space.at(posterior.mean[:count])).off)
    std = np.sqrt(np.diag(posterior.covariance))[:count] * space.std
    fitted = tuple(FittedShift(n.name, n.std, shifts[n.name], float(s)) for n, s in zip(problem.nuisances, std, strict=True))
    errors, overlays = zip(*_compare(problem, stretches, found), strict=True)
    return PendulumFit(shifted(problem.pendulum, shifts), fitted, errors, overlays)


def _with_nuisances(problem: SwingProblem, names: Collection[str]) -> SwingProblem:
    known = {nuisance.name: nuisance for nuisance in problem.nuisances}
    if not known:
        raise BadInput("nothing to fit: [known_to] lists no value that these runs depend on; add for example mass_relative = 0.05")
    for name in names:
        if name not in known:
            raise BadInput(f"--parameters: {name!r} is none of {', '.join(known)}, which [known_to] lists and these runs depend on")
    return replace(problem, nuisances=tuple(one for one in problem.nuisances if not names or one.name in names))


def _compare(problem: SwingProblem, stretches: Sequence[Stretch], found: ModelSelectionResult) -> Iterator[tuple[SignalError, Overlay]]:
    """Of each run and each signal, its rows in order of time."""
    rows, nothing, nominal, fitted = found.dataset.rows, found.nothing, found.nominal.predicted, found.nothing.rows
    held_out = None
    if len(stretches) > 1:
        held_out = loo_residuals(nothing.fitted.linear(rows.measured), nothing.marginal.whitening, rows.condition, range(len(stretches)))
    run_of_row = np.array([stretch.windows[0].window.run for stretch in stretches])[rows.condition]
    for number, run in enumerate(problem.conditions):
        for signal in stretches[0].signals:
            here = np.flatnonzero((run_of_row == number) & (rows.signal == signal))
            if here.size:
                here = here[np.argsort(rows.t_s[here], kind="stable")]
                measured = rows.measured[here]
                errors = (rms(rows.noise[here]), rms(measured - nominal[here]), rms(measured - fitted[here]))
                apart = None if held_out is None else rms(held_out[here])
                yield (
                    SignalError(run, signal, *errors, apart),
                    Overlay(run, signal, rows.t_s[here], measured, nominal[here], fitted[here]),
                )


def fitted_known_to(campaign: PendulumCampaign, fit: PendulumFit) -> Mapping[str, float]:
    """[known_to] after the fit: of a value of several links the largest standard deviation; what was not fitted stays as stated."""
    found = dict(campaign.known_to)
    for key in {shift.name.partition(".")[2] for shift in fit.shifts}:
        found[key] = max(shift.std for shift in fit.shifts if shift.name.partition(".")[2] == key)
    return found
