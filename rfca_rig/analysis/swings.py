"""Residuals between recorded and simulated swings of a pendulum: the data of a diagnosis of omitted
physics.

A long free simulation of a pendulum near its upright position cannot be compared with data: a tiny
difference grows hundredfold within a second. A recording is therefore cut into windows, and the
model starts each window from the measured, smoothed state. Angles and speeds are compared as means
over short bins.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import factorial

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.pendulum import PendulumCampaign, PendulumRun
from rfca_rig.errors import BadInput
from rfca_rig.model.effects.joint_torques import TorqueTrace, torque_trace
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.pendulum import DrivenPendulum, Pendulum, PendulumLink, make_driven_pendulum

Floats = NDArray[np.float64]
Indices = NDArray[np.intp]

# Half width of the stretch around a window's start from which its state is estimated, and that of
# the next narrower one that is tried.
SMOOTHING_HALF_WIDTH_S = 0.06
NARROWER = 0.7
# A cubic is too stiff for the second link of a double pendulum.
POLYNOMIAL_DEGREE = 5
BIN_S = 0.02
# Torque before and after a window: twice the longest plausible delay, and two of the longest
# plausible lags.
MARGIN_S = 0.1


# Usual error of joint torques where [known_to] has no torque_error_relative: that of a torque
# sensor.
TORQUE_ERROR = 0.01


@dataclass(frozen=True)
class Nuisance:
    """A nominal value that may be off: `std` is its prior standard deviation, and 0 stands for
    the nominal value.
    """

    name: str
    std: float


@dataclass(frozen=True)
class SwingWindow:
    """One window of a run: the torques, the smoothed start state (n,) of n joints, and the measured
    bins.

    Times `t_s` (k,) count from the start. `bins` (b,) holds the index of the first sample of each
    bin. `measured` is (2, n, b), or (1, n,
    b) without speeds: bin means of angle [rad] and speed [rad/s]. `sensor_std` has the same shape.
       `start_effect` (2 n, ...) is the change
    of these means for an error of one standard deviation in each start angle and speed, computed
    with the nominal pendulum.
    """

    run: int
    start_s: float
    trace: TorqueTrace
    angle_rad: Floats
    speed_rad_s: Floats
    t_s: Floats
    bins: Indices
    measured: Floats
    sensor_std: Floats
    start_effect: Floats

    @property
    def noise_std(self) -> Floats:
        """Standard deviation, shape of `measured`, of sensor noise and start error together. The
        start error is common to all rows of a window.
        """
        return np.asarray(np.sqrt(self.sensor_std**2 + (self.start_effect**2).sum(axis=0)))

    @property
    def middles_s(self) -> Floats:
        """Centres of the bins from the start of the window, (b,) in s."""
        return bin_means(self.t_s[:, None], self.bins)[:, 0]

    def predicted(self, pendulum: DrivenPendulum) -> Floats:
        """The model's values of `measured`, same shape. Raises SimulationFailed."""
        swing = pendulum.swing(self.trace, self.angle_rad, self.speed_rad_s, self.t_s)
        channels = (swing.angle_rad, swing.speed_rad_s)[: len(self.measured)]
        return np.stack([bin_means(channel, self.bins).T for channel in channels])


@dataclass(frozen=True)
class SwingProblem:
    """All windows of a campaign as one data vector of m rows.

    `conditions` names the groups of rows, one per run; `groups` (m,) is the index of a row's run.
    Rows of one group share their systematic errors, rows of different groups do not.
    `windows_of_row` (m,), `signals`, `signal_of_row` (m,) and `t_s` (m,) locate a row in the runs.
    `measured` and `noise_std` are (m,), angles in rad and speeds in rad/s. `torque_error` is the
    usual relative error of the recorded or modelled torque in a joint.
    """

    pendulum: Pendulum
    nuisances: tuple[Nuisance, ...]
    conditions: tuple[str, ...]
    windows: tuple[SwingWindow, ...]
    torque_error: float = TORQUE_ERROR

    @property
    def measured(self) -> Floats:
        return self._all([window.measured for window in self.windows])

    @property
    def noise_std(self) -> Floats:
        return self._all([window.noise_std for window in self.windows])

    @property
    def groups(self) -> Indices:
        return np.repeat([window.run for window in self.windows], self._rows)

    @property
    def windows_of_row(self) -> Indices:
        return np.repeat(np.arange(len(self.windows)), self._rows)

    @property
    def signals(self) -> tuple[str, ...]:
        joints = range(1, len(self.pendulum.links) + 1)
        return tuple(
            name
            for unit in ("angle{}_rad", "speed{}_rad_s")
            for name in (unit.format(joint) for joint in joints)
        )

    @property
    def signal_of_row(self) -> Indices:
        """Index of each row's signal in `signals`, (m,)."""
        return np.concatenate(
            [
                np.repeat(np.arange(w.measured[:, :, 0].size), w.measured.shape[2])
                for w in self.windows
            ]
        )

    @property
    def t_s(self) -> Floats:
        """Times of the rows in their runs, at the centres of their bins, (m,) in s."""
        return np.concatenate(
            [np.tile(w.start_s + w.middles_s, w.measured[:, :, 0].size) for w in self.windows]
        )

    def predicted(
        self, nuisances: Mapping[str, float], effects: Sequence[PresentEffect] = ()
    ) -> Floats:
        """Predict all rows, (m,), with nominal values shifted by `nuisances` and with the given
        effects.

        Parameters
        ----------
        nuisances : shift of each nominal value by name, in its own unit; a missing name counts as 0
        effects : effects that are added to the model

        Raises
        ------
        BadInput : for an unknown name, or values that no pendulum can have
        SimulationFailed : where the model cannot be computed
        """
        ready = make_driven_pendulum(apply_nuisances(self.pendulum, nuisances), effects)
        return self._all([window.predicted(ready) for window in self.windows])

    def _all(self, parts: Sequence[Floats]) -> Floats:
        return np.concatenate([part.ravel() for part in parts])

    @property
    def _rows(self) -> list[int]:
        return [window.measured.size for window in self.windows]


def make_swing_problem(
    campaign: PendulumCampaign, window_s: float | Sequence[float] = 0.5, bin_s: float = BIN_S
) -> SwingProblem:
    """Cut all runs of a campaign into bins and windows, all of one length or those of each run of
    its own.

    Raises BadInput where no run is long enough for one window.
    """
    lengths_s = [window_s] * len(campaign.runs) if isinstance(window_s, float) else window_s
    powered = any(run.powered for run in campaign.runs)
    nuisances = tuple(
        Nuisance(f"link{number}.{key}", std)
        for number, link in enumerate(campaign.pendulum.links, start=1)
        for key, std in campaign.known_to.items()
        # The torque error belongs to the whole problem, not to one link. Drive values change
        # nothing without a driven run.
        if key != "torque_error_relative"
        and (key not in DRIVE_NUISANCES or (link.driven and powered))
    )
    ready = make_driven_pendulum(campaign.pendulum)
    windows = tuple(
        window
        for index, (run, length_s) in enumerate(zip(campaign.runs, lengths_s, strict=True))
        for window in _windows(index, run, campaign.noise_std, (length_s, bin_s), ready)
    )
    if not windows:
        raise BadInput(
            f"no run of {campaign.title} is longer than "
            f"{min(lengths_s) + 2 * SMOOTHING_HALF_WIDTH_S:g} s, "
            f"which a window of {min(lengths_s):g} s needs"
        )
    torque_error = campaign.known_to.get("torque_error_relative", TORQUE_ERROR)
    return SwingProblem(
        campaign.pendulum,
        nuisances,
        tuple(run.label for run in campaign.runs),
        windows,
        torque_error,
    )


def apply_nuisances(pendulum: Pendulum, nuisances: Mapping[str, float]) -> Pendulum:
    """The pendulum with shifted nominal values; keys are `link1.mass_relative` and so on, as in
    [known_to].

    Damping, friction and rotor inertia are cut off at 0. Raises BadInput for an unknown key, and
    for values that no pendulum can have.
    """
    links = list(pendulum.links)
    for name, value in nuisances.items():
        link, _, key = name.partition(".")
        if link.removeprefix("link").isdecimal():
            index = int(link.removeprefix("link")) - 1
        else:
            index = -1
        if key not in _SHIFTS or not 0 <= index < len(links):
            raise BadInput(
                f"{name!r} is no nuisance of a pendulum of {len(links)}; there are link1. "
                f"and so on with {', '.join(_SHIFTS)}"
            )
        links[index] = _SHIFTS[key](links[index], value)
    return Pendulum(tuple(links))


def _mass(link: PendulumLink, share: float) -> PendulumLink:
    # A heavier link of the same shape: its inertia grows in proportion.
    return replace(
        link, mass_kg=link.mass_kg * (1.0 + share), inertia_kg_m2=link.inertia_kg_m2 * (1.0 + share)
    )


def _centre(link: PendulumLink, by_m: float) -> PendulumLink:
    """Shifts the centre of mass; the inertia about the centre of mass stays."""
    # Steiner's theorem: inertia_kg_m2 is about the joint, so it changes by m (c_new^2 - c_old^2).
    centre = link.centre_of_mass_m + by_m
    return replace(
        link,
        centre_of_mass_m=centre,
        inertia_kg_m2=link.inertia_kg_m2 + link.mass_kg * (centre**2 - link.centre_of_mass_m**2),
    )


# Without a driven run these change nothing.
DRIVE_NUISANCES = ("torque_offset_Nm", "torque_delay_s")

_SHIFTS: Mapping[str, Callable[[PendulumLink, float], PendulumLink]] = {
    "mass_relative": _mass,
    "centre_of_mass_m": _centre,
    "inertia_relative": lambda link, share: replace(
        link, inertia_kg_m2=link.inertia_kg_m2 * (1.0 + share)
    ),
    "joint_damping_Nm_s_per_rad": lambda link, by: replace(
        link, joint_damping_Nm_s_per_rad=max(0.0, link.joint_damping_Nm_s_per_rad + by)
    ),
    "joint_friction_Nm": lambda link, by: replace(
        link, joint_friction_Nm=max(0.0, link.joint_friction_Nm + by)
    ),
    "torque_offset_Nm": lambda link, by: replace(link, torque_offset_Nm=link.torque_offset_Nm + by),
    "zero_offset_rad": lambda link, by: replace(link, zero_offset_rad=link.zero_offset_rad + by),
    "torque_delay_s": lambda link, by: replace(link, torque_delay_s=link.torque_delay_s + by),
    "rotor_inertia_kg_m2": lambda link, by: replace(
        link, rotor_inertia_kg_m2=max(0.0, link.rotor_inertia_kg_m2 + by)
    ),
}


def sample_noise(run: PendulumRun, noise_std: Mapping[str, float]) -> Floats:
    """Standard deviation of one sample, (1, n) for angles or (2, n) with speeds: as stated in
    the campaign, or estimated from the run.
    """
    channels = [run.angle_rad] if run.speed_rad_s is None else [run.angle_rad, run.speed_rad_s]
    stated = [noise_std.get(name) for name in ("angle_rad", "speed_rad_s")]
    return np.stack(
        [
            np.full(c.shape[1], s) if s else sample_std(c)
            for c, s in zip(channels, stated, strict=False)
        ]
    )


def _windows(
    index: int,
    run: PendulumRun,
    noise_std: Mapping[str, float],
    cut_s: tuple[float, float],
    ready: DrivenPendulum,
) -> list[SwingWindow]:
    window_s, _ = cut_s
    noise = sample_noise(run, noise_std)
    # The first window begins late enough that its start state can be smoothed from both sides.
    # The tolerance keeps the last window of a run that is divided evenly.
    starts = np.arange(run.t_s[0] + SMOOTHING_HALF_WIDTH_S, run.t_s[-1] - window_s + 1e-9, window_s)
    channels = [run.angle_rad] if run.speed_rad_s is None else [run.angle_rad, run.speed_rad_s]
    return [
        _window(index, run, float(start_s), cut_s, channels, noise, ready) for start_s in starts
    ]


def _window(
    index: int,
    run: PendulumRun,
    start_s: float,
    cut_s: tuple[float, float],
    channels: list[Floats],
    noise: Floats,
    ready: DrivenPendulum,
) -> SwingWindow:
    window_s, bin_s = cut_s
    inside = (run.t_s > start_s) & (run.t_s <= start_s + window_s)
    t_s = run.t_s[inside] - start_s
    bins = bin_starts(t_s, bin_s)
    angle, speed, angle_std, speed_std = estimate_start(run.t_s, run.angle_rad, start_s, noise[0])
    counts = np.diff(np.append(bins, len(t_s)))
    measured = np.stack([bin_means(channel[inside], bins).T for channel in channels])
    window = SwingWindow(
        run=index,
        start_s=start_s,
        trace=_trace(run, start_s, window_s),
        angle_rad=angle,
        speed_rad_s=speed,
        t_s=t_s,
        bins=bins,
        measured=measured,
        # Noise of a mean of independent samples.
        sensor_std=noise[:, :, None] / np.sqrt(counts),
        start_effect=np.empty((0, *measured.shape)),
    )
    return replace(window, start_effect=_start_effect(window, ready, angle_std, speed_std))


def _trace(run: PendulumRun, start_s: float, window_s: float) -> TorqueTrace:
    """Torques of the window with a margin on both sides, as far as the run has one, so that a
    drive may act late or early.
    """
    begin_s = max(run.t_s[0], start_s - MARGIN_S)
    end_s = min(run.t_s[-1], start_s + window_s + MARGIN_S)
    between = (run.t_s > begin_s) & (run.t_s < end_s)
    t_s = np.concatenate([[begin_s], run.t_s[between], [end_s]])
    torque = np.column_stack([np.interp(t_s, run.t_s, column) for column in run.torque_Nm.T])
    return replace(torque_trace(t_s - start_s, torque), powered=run.powered)


@dataclass(frozen=True)
class LocalPolynomial:
    """Positions near one moment as a polynomial in the time from that moment, divided by `half_s`.

    `coefficients` (POLYNOMIAL_DEGREE + 1, n) have standard deviations `std` (POLYNOMIAL_DEGREE +
    1,) per unit of noise. `missed` (n,) is the standard deviation of the misfit.
    """

    coefficients: Floats
    std: Floats
    missed: Floats
    half_s: float

    def derivative(self, order: int) -> Floats:
        """Derivative (n,) at the moment itself: position, speed and acceleration for `order` 0,
        1 and 2.
        """
        return np.asarray(factorial(order) * self.coefficients[order] / self.half_s**order)


def local_polynomial(t_s: Floats, position: Floats, at_s: float) -> LocalPolynomial:
    """Least-squares polynomial through the positions (m, n) around `at_s`, for ascending times
    `t_s` (m,).

    The stretch is widened where fewer samples lie in it than the polynomial needs.
    """
    return _fit_polynomial(
        t_s, position, at_s, max(SMOOTHING_HALF_WIDTH_S, _narrowest_half_width(t_s))
    )


def _fit_polynomial(t_s: Floats, position: Floats, at_s: float, half_s: float) -> LocalPolynomial:
    # The tolerance keeps samples at the border in, whatever the rounding of their times.
    near = np.abs(t_s - at_s) <= half_s * (1.0 + 1e-9)
    design = np.vander((t_s[near] - at_s) / half_s, POLYNOMIAL_DEGREE + 1, increasing=True)
    solution = np.linalg.lstsq(design, position[near], rcond=None)[0]
    degrees_of_freedom = max(np.count_nonzero(near) - POLYNOMIAL_DEGREE - 1, 1)
    missed = np.sqrt(np.sum((design @ solution - position[near]) ** 2, axis=0) / degrees_of_freedom)
    # Covariance of the coefficients for noise of standard deviation 1.
    std = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)))
    return LocalPolynomial(np.asarray(solution, dtype=np.float64), std, missed, half_s)


def _narrowest_half_width(t_s: Floats) -> float:
    """Half width in s of a stretch with one sample more than the polynomial has coefficients."""
    return 0.5 * (POLYNOMIAL_DEGREE + 2) * float(np.median(np.diff(t_s)))


def estimate_start(
    t_s: Floats, position: Floats, start_s: float, noise: Floats
) -> tuple[Floats, Floats, Floats, Floats]:
    """Position and speed at `start_s` from a local polynomial, each with its standard deviation:
    four arrays (n,).

    Parameters
    ----------
    t_s : (m,) ascending, in s
    position : (m, n) in rad
    start_s : moment of the estimate, in s
    noise : (n,) standard deviation of one sample, in rad

    Notes
    -----
    The misfit of the polynomial counts as noise too, for instance where dry friction reverses. Of
    several half widths, each joint takes the one with the least standard deviation of the speed:
    the widest one in smooth motion, a narrower one near an impact.
    """
    # A stretch needs twice the samples of the narrowest one; with fewer, the misfit itself is
    # hardly known.
    narrowest_s = _narrowest_half_width(t_s)
    halves_s = [max(SMOOTHING_HALF_WIDTH_S, narrowest_s)]
    while (half_s := NARROWER * halves_s[-1]) >= 2.0 * narrowest_s:
        halves_s.append(half_s)
    fits = [_fit_polynomial(t_s, position, start_s, half_s) for half_s in halves_s]
    # (widths, 2, n): of position and of speed.
    std = np.array(
        [
            fit.std[:2, None] * np.maximum(noise, fit.missed) / np.array([[1.0], [fit.half_s]])
            for fit in fits
        ]
    )
    best = std[:, 1].argmin(axis=0)
    joints = np.arange(position.shape[1])
    at, speed = (
        np.array([fit.derivative(order) for fit in fits])[best, joints] for order in (0, 1)
    )
    return at, speed, std[best, 0, joints], std[best, 1, joints]


def _start_effect(
    window: SwingWindow, ready: DrivenPendulum, angle_std: Floats, speed_std: Floats
) -> Floats:
    """Change of `measured` for one standard deviation of each start angle and speed, by central
    differences with the nominal pendulum.
    """
    effects = []
    for joint in range(len(angle_std)):
        angle, speed = (std * np.eye(len(std))[joint] for std in (angle_std, speed_std))
        for by_angle, by_speed in ((angle, 0.0 * speed), (0.0 * angle, speed)):
            ahead, behind = (
                replace(
                    window,
                    angle_rad=window.angle_rad + sign * by_angle,
                    speed_rad_s=window.speed_rad_s + sign * by_speed,
                )
                for sign in (1.0, -1.0)
            )
            effects.append(0.5 * (ahead.predicted(ready) - behind.predicted(ready)))
    return np.stack(effects)


def bin_starts(t_s: Floats, bin_s: float) -> Indices:
    """Index of the first sample of each bin, (b,), for sample times (k,) above zero; a sample on
    an edge ends its bin.
    """
    # The small offset puts a sample on a bin's edge into the bin that ends there, in spite of
    # rounding.
    return np.flatnonzero(np.diff(np.ceil(t_s / bin_s - 1e-6), prepend=0.0))


def bin_means(values: Floats, bins: Indices) -> Floats:
    """Means (b, n) of samples (k, n) over bins that begin at indices `bins` (b,)."""
    counts = np.diff(np.append(bins, len(values)))
    return np.asarray(np.add.reduceat(values, bins) / counts[:, None])


def sample_std(values: Floats) -> Floats:
    """Noise of one sample, (n,), of each column of values (m, n).

    The larger of two estimates: from second differences, and from the smallest step of an encoder.
    """
    # A second difference 1, -2, 1 of white noise has sqrt(6) times its deviation, and a smooth
    # motion leaves it small.
    from_neighbours = np.sqrt(np.mean(np.diff(values, 2, axis=0) ** 2, axis=0) / 6.0)
    steps = np.array([smallest_step(column) for column in values.T])
    # A uniform rounding error over one step has the deviation step / sqrt(12). The floor keeps
    # weights finite for simulated data.
    return np.asarray(np.maximum(np.maximum(from_neighbours, steps / np.sqrt(12.0)), 1e-9))


def smallest_step(values: Floats) -> float:
    """The smallest step between neighbouring samples (m,), which is the resolution of an
    encoder; 0 where the value never changes.
    """
    steps = np.abs(np.diff(values))
    moved = steps[steps > 0.0]
    if moved.size:
        return float(moved.min())
    return 0.0
