"""A recorded stretch of the motion of a pendulum as observations, and its simulation.

A stretch is a few windows of half a second, each simulated from its measured start. So only errors
that grow within a window count.

The model error refers to wrong torques. An error of 1 % means: angles and speeds are off as those
of the nominal pendulum are when the torque in each joint is off by 1 % of that of weight and drive.
Near the top, where small differences grow, that is much. Where `torque_error` states another share
than 1 %, that share counts as 1 %: the diagnosis calls 1 % usual. Neighbouring rows have correlated
errors, so they do not count as independent.

Nuisance parameters of a pendulum are the values of [known_to], of each link. `fit_pendulum` fits
them alone, with no effect in the model.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.analysis.fitting.space import FitParameter, Prior, never_below
from rfca_rig.analysis.swings import (
    SMOOTHING_HALF_WIDTH_S,
    Nuisance,
    SwingProblem,
    SwingWindow,
    apply_nuisances,
    make_swing_problem,
)
from rfca_rig.campaign.pendulum import PendulumCampaign
from rfca_rig.diagnosis.config import USUAL_ERROR
from rfca_rig.diagnosis.data import (
    Label,
    Observations,
    WindowRows,
    group_windows,
    observe,
    start_gain,
)
from rfca_rig.diagnosis.inference.model_selection import Progress, search_models
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.simulator import Dataset, Simulator, make_dataset
from rfca_rig.diagnosis.window_fit import WindowFit, summarize
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import single_threaded_blas
from rfca_rig.model.parameters import GRAVITY_M_S2
from rfca_rig.model.pendulum import DrivenPendulum, Pendulum, make_driven_pendulum, rods

NEVER_NEGATIVE = ("joint_damping_Nm_s_per_rad", "joint_friction_Nm", "rotor_inertia_kg_m2")
# Units of the nuisance parameters; those that are missing here are shares.
UNITS = {
    "centre_of_mass_m": "m",
    "joint_damping_Nm_s_per_rad": "N m s/rad",
    "joint_friction_Nm": "N m",
    "torque_offset_Nm": "N m",
    "zero_offset_rad": "rad",
    "torque_delay_s": "s",
    "rotor_inertia_kg_m2": "kg m2",
}

Floats = NDArray[np.float64]

SWING_EXPERIMENT = "swings"  # what their experiment is called
WINDOW_S = 0.5
# ten rows per window and signal: pendulums of laboratory size turn back a few times a second
BIN_S = 0.05
# of the model's error: torques err with the joint's angle, which changes that fast
SMOOTH_OVER_S = 0.15


@dataclass(frozen=True)
class PendulumInput(ModelPoint):
    """Input of one simulation of a pendulum: the effects in `rig`, and the shifts of nominal
    values, by nuisance parameter.
    """

    off: tuple[tuple[str, float], ...] = ()


def space_of_pendulum(pendulum: Pendulum, nuisances: Sequence[Nuisance]) -> Prior[PendulumInput]:
    """Space of the nuisance parameters around the nominal pendulum."""
    std = np.array([nuisance.std for nuisance in nuisances])
    parameters = tuple(_parameter(pendulum, nuisance) for nuisance in nuisances)
    return Prior(parameters, PendulumInput(rods(pendulum)), std, np.ones(len(std), dtype=bool))


def _parameter(pendulum: Pendulum, nuisance: Nuisance) -> FitParameter[PendulumInput]:
    link, _, key = nuisance.name.partition(".")
    shift: Callable[[float], float] = float
    if key in NEVER_NEGATIVE:
        shift = never_below(
            getattr(pendulum.links[int(link.removeprefix("link")) - 1], key), nuisance.std
        )

    def read(at: PendulumInput) -> float:
        return dict(at.off).get(nuisance.name, 0.0)

    def write(at: PendulumInput, value: float) -> PendulumInput:
        return replace(
            at,
            off=(
                *(pair for pair in at.off if pair[0] != nuisance.name),
                (nuisance.name, shift(value)),
            ),
        )

    return FitParameter(nuisance.name, UNITS.get(key, ""), False, nuisance.std, read, write)


def to_pendulum_input(at: ModelPoint) -> PendulumInput:
    """The input as that of a pendulum; without shifts where it has none."""
    if isinstance(at, PendulumInput):
        return at
    return PendulumInput(at.rig)


@dataclass(frozen=True)
class StartedWindow:
    """One window with c channels of n joints in b bins.

    `scale` (c, n, b) is the error scale of its rows. `gain` (2 n, c n b) estimates the errors of
    the start from a residual, in standard deviations.
    """

    window: SwingWindow
    scale: Floats
    gain: Floats

    def predicted(self, pendulum: DrivenPendulum) -> Floats:
        """Predicted rows (c, n, b) from the start that fits best within its uncertainty. Raises
        SimulationFailed.
        """
        from_measured = self.window.predicted(pendulum)
        start_error = self.gain @ (self.window.measured - from_measured).ravel()
        return np.asarray(from_measured + np.tensordot(start_error, self.window.start_effect, 1))


@dataclass(frozen=True)
class Stretch:
    """A few windows of one run, which are one condition.

    `named` is its name, `run` the condition of the run, and `recording` the run itself, both in
    words.
    """

    named: str
    run: str
    recording: str
    pendulum: Pendulum
    windows: tuple[StartedWindow, ...]

    @property
    def repeats(self) -> Floats:
        """None, as (1, 0): every stretch is recorded once."""
        return np.empty((1, 0))

    @property
    def start_std(self) -> Floats:
        """(m,) standard deviation of the nominal prediction of each row, because the measured
        starts have errors.
        """
        return np.concatenate(
            [
                np.sqrt((started_window.window.start_effect**2).sum(axis=0)).ravel()
                for started_window in self.windows
            ]
        )

    @property
    def signals(self) -> tuple[str, ...]:
        """Names of the signals, channel by channel, joint by joint."""
        channels, joints, _ = self.windows[0].window.measured.shape
        return tuple(
            f"{('angle', 'speed')[c]}{j + 1}_{('rad', 'rad_s')[c]}"
            for c in range(channels)
            for j in range(joints)
        )

    def simulated(self, supposed: PendulumInput) -> Floats:
        """Predicted rows (m,), signal by signal within window by window. Raises
        SimulationFailed, BadInput.
        """
        ready = make_driven_pendulum(
            apply_nuisances(self.pendulum, dict(supposed.off)), supposed.rig.effects
        )
        return np.concatenate([window.predicted(ready).ravel() for window in self.windows])

    def rows(self) -> Observations:
        """The measured rows."""
        starts_s = tuple(started_window.window.start_s for started_window in self.windows)
        labels = tuple(
            Label(SWING_EXPERIMENT, self.named, signal, recording=self.recording, starts_s=starts_s)
            for signal in self.signals
        )
        shape = (len(self.signals), -1)
        parts = [
            WindowRows(
                w.window.start_s + w.window.middles_s,
                w.window.measured.reshape(shape),
                w.window.sensor_std.reshape(shape),
                w.scale.reshape(shape),
            )
            for w in self.windows
        ]
        return observe(parts, labels, self.run, SMOOTH_OVER_S)


class PendulumSimulator(Simulator):
    """A driven chain of links without scatter; a stretch depends on nothing before it."""

    def simulate(self, at: PendulumInput, condition: Stretch) -> Floats:
        """Predicted rows (m,) of a stretch. Raises SimulationFailed, BadInput."""
        return condition.simulated(at)


def make_pendulum_dataset(stretches: Iterable[Stretch]) -> Dataset:
    """The dataset of these stretches. Raises BadInput where there is none."""
    return make_dataset(stretches, PendulumSimulator())


@dataclass(frozen=True)
class PendulumProblem:
    """The runs of a campaign, cut into windows; `lengths_s` is the length of those of each run."""

    campaign: PendulumCampaign
    swings: SwingProblem
    lengths_s: tuple[float, ...]
    chooses_lengths = True

    @property
    def recordings(self) -> tuple[str, ...]:
        """Names of the runs."""
        return self.swings.conditions

    @property
    def recordings_s(self) -> tuple[float, ...]:
        """The time of each run that windows can cover."""
        return tuple(
            float(run.t_s[-1] - run.t_s[0]) - SMOOTHING_HALF_WIDTH_S for run in self.campaign.runs
        )

    @cached_property
    def stretches(self) -> tuple[Stretch, ...]:
        """The stretches of all runs."""
        return cut_stretches(self.swings)

    @cached_property
    def dataset(self) -> Dataset:
        """The stretches with the simulator that predicts them. Raises BadInput where there is
        none.
        """
        return make_pendulum_dataset(self.stretches)

    @property
    def start_std(self) -> Floats:
        """(m,) standard deviation of the nominal prediction of each row, because the measured
        starts have errors.
        """
        return np.concatenate([stretch.start_std for stretch in self.stretches])

    @property
    def space(self) -> Prior[PendulumInput]:
        """The nuisance parameters."""
        return space_of_pendulum(self.swings.pendulum, self.swings.nuisances)

    def cut_again(self, lengths_s: Sequence[float]) -> "PendulumProblem":
        """The same runs in windows of other lengths. Raises SimulationFailed."""
        return PendulumProblem(
            self.campaign, make_swing_problem(self.campaign, lengths_s, BIN_S), tuple(lengths_s)
        )


def make_pendulum_problem(campaign: PendulumCampaign) -> PendulumProblem:
    """The runs of a campaign in windows of WINDOW_S. Raises BadInput where no run is long enough
    for one window.
    """
    return PendulumProblem(
        campaign, make_swing_problem(campaign, WINDOW_S, BIN_S), (WINDOW_S,) * len(campaign.runs)
    )


def cut_stretches(problem: SwingProblem) -> tuple[Stretch, ...]:
    """The stretches of all runs, in their order."""
    return tuple(s for run in range(len(problem.conditions)) for s in _of_run(problem, run))


def _of_run(problem: SwingProblem, run: int) -> list[Stretch]:
    windows = [window for window in problem.windows if window.run == run]
    if not windows:
        return []
    torque_Nm = usual_torque_Nm(problem.pendulum, windows) * problem.torque_error / USUAL_ERROR
    started = [_start_window(window, problem.pendulum, torque_Nm) for window in windows]
    return [
        _stretch(problem, run, part)
        for part in group_windows(started, float(started[0].window.t_s[-1]))
    ]


def _stretch(problem: SwingProblem, run: int, windows: Sequence[StartedWindow]) -> Stretch:
    begin_s = windows[0].window.start_s
    last = windows[-1].window
    name = problem.conditions[run]
    times = f"{begin_s:.1f} to {last.start_s + last.t_s[-1]:.1f} s"
    return Stretch(f"{name}, {times}", _condition(name), name, problem.pendulum, tuple(windows))


def _condition(run: str) -> str:
    """The condition of a run: the errors of its repeats are alike."""
    return run.rpartition(", repeat ")[0] or run


def usual_torque_Nm(pendulum: Pendulum, windows: Sequence[SwingWindow]) -> Floats:
    """Rms over the windows of the torques of weight and drive in each joint, added without
    regard to sign, (n,).
    """
    square = sum(
        np.mean(_weight_Nm(pendulum, w.measured[0]) ** 2, axis=1)
        + np.mean(w.trace.torque_Nm**2, axis=0)
        for w in windows
    )
    return np.asarray(np.sqrt(square / len(windows)))


def _weight_Nm(pendulum: Pendulum, angle_rad: Floats) -> Floats:
    """The torque (n, b) of the weight in each joint, at joint angles (n, b)."""
    aside = np.sin(np.cumsum(angle_rad, axis=0))
    # Each joint carries its own link, and at the end of that link all links beyond.
    beyond = np.append(np.cumsum([link.mass_kg for link in pendulum.links[::-1]])[::-1][1:], 0.0)
    moment = [
        link.mass_kg * link.centre_of_mass_m + far * link.length_m
        for link, far in zip(pendulum.links, beyond, strict=True)
    ]
    link_torque = GRAVITY_M_S2 * np.array(moment)[:, None] * aside
    # The torque in a joint is the sum over its own link and all links beyond.
    return np.asarray(np.cumsum(link_torque[::-1], axis=0)[::-1])


def _start_window(window: SwingWindow, pendulum: Pendulum, torque_Nm: Floats) -> StartedWindow:
    scale = _scale(window, pendulum, torque_Nm)
    return StartedWindow(
        window,
        scale,
        start_gain(window.start_effect, window.sensor_std**2 + (USUAL_ERROR * scale) ** 2),
    )


def _scale(window: SwingWindow, pendulum: Pendulum, torque_Nm: Floats) -> Floats:
    """Effect of a steady torque of the usual size in each joint, (c, n, b); an error that has
    grown does not count as shrinking.
    """
    # Every joint is made drivable, so that the error torque can act in passive joints, too.
    free = make_driven_pendulum(
        Pendulum(tuple(replace(link, driven=True) for link in pendulum.links))
    )
    square = np.zeros_like(window.measured)
    for more in USUAL_ERROR * np.diag(torque_Nm):
        ahead, behind = (
            replace(
                window, trace=replace(window.trace, torque_Nm=window.trace.torque_Nm + sign * more)
            ).predicted(free)
            for sign in (1.0, -1.0)
        )
        square += (0.5 * (ahead - behind) / USUAL_ERROR) ** 2
    return np.asarray(np.maximum.accumulate(np.sqrt(square), axis=2))


PENDULUM_FIT = "rfca-pendulum-fit/1"


@dataclass(frozen=True)
class PendulumFit:
    """The fit, and the pendulum with fitted nominal values."""

    fit: WindowFit
    pendulum: Pendulum


@single_threaded_blas()
def fit_pendulum(
    campaign: PendulumCampaign, progress: Progress, names: Collection[str] = ()
) -> PendulumFit:
    """The nominal values of [known_to] fitted to all runs, each with its stated uncertainty as
    prior.

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
    problem = _with_nuisances(make_swing_problem(campaign, WINDOW_S, BIN_S), names)
    stretches = cut_stretches(problem)
    space = space_of_pendulum(problem.pendulum, problem.nuisances)
    search = search_models(make_pendulum_dataset(stretches), Parameterization(space), [], progress)
    fit = summarize(search, search.nothing)
    shifts = dict(to_pendulum_input(space.at(search.nothing.marginal.posterior.mean)).off)
    return PendulumFit(fit, apply_nuisances(problem.pendulum, shifts))


def _with_nuisances(problem: SwingProblem, names: Collection[str]) -> SwingProblem:
    known = {nuisance.name: nuisance for nuisance in problem.nuisances}
    if not known:
        raise BadInput(
            "nothing to fit: [known_to] lists no value that these runs depend on; add "
            "for example mass_relative = 0.05"
        )
    for name in names:
        # A misspelt name must not silently leave a value out of the fit.
        if name not in known:
            raise BadInput(
                f"--parameters: {name!r} is none of {', '.join(known)}, which [known_to] "
                "lists and these runs depend on"
            )
    return replace(
        problem,
        nuisances=tuple(
            nuisance for nuisance in problem.nuisances if not names or nuisance.name in names
        ),
    )


def update_known_to(campaign: PendulumCampaign, fit: WindowFit) -> Mapping[str, float]:
    """[known_to] after the fit; what was not fitted stays as stated.

    One key holds for several links, so the largest of their standard deviations is kept.
    """
    known_to = dict(campaign.known_to)
    # A shift is named LINK.KEY, and [known_to] has one value per KEY.
    for key in {shift.name.partition(".")[2] for shift in fit.shifts}:
        known_to[key] = max(
            shift.std for shift in fit.shifts if shift.name.partition(".")[2] == key
        )
    return known_to
