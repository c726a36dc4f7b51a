"""Recorded swings of a pendulum against simulated ones, for a diagnosis that asks which effects the model lacks.

A long simulation of a pendulum near the top says nothing: the smallest difference grows hundredfold in a second. So a recording is cut
into windows, and the model starts in each from the measured state, smoothed. Angles and speeds are compared as means over short bins.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from math import factorial

import numpy as np
from numpy.typing import NDArray

from rfca_rig.campaign.pendulum import PendulumCampaign, PendulumRun
from rfca_rig.errors import BadInput
from rfca_rig.model.joint_drive import TorqueTrace, torque_trace
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.pendulum import DrivenPendulum, Pendulum, PendulumLink, driven

Floats = NDArray[np.float64]
Places = NDArray[np.intp]

SMOOTHED_S = 0.06  # to either side of a window's start
DEGREE = 5  # of the polynomial there: a cubic is too stiff for the second link of a double pendulum
BIN_S = 0.02
MARGIN_S = 0.1  # of torque before and after a window: twice the longest delay, and two of the longest lags, that are plausible


TORQUE_ERROR = 0.01  # usual error of joint torques where [known_to] has no torque_error_relative: that of a torque sensor


@dataclass(frozen=True)
class Nuisance:
    """A nominal value that may be a little off: `std` is its standard deviation, its nominal value counts as 0."""

    name: str
    std: float


@dataclass(frozen=True)
class SwingWindow:
    """A stretch of a run: what drives it, the smoothed state it starts from (n,), and what was measured.

    Times `t_s` (k,) count from the start; `bins` (b,) is where each bin of samples begins; `measured` (2, n, b) or (1, n, b) are means
    of bins of angle [rad] and speed [rad/s], `sensor_std` of the same shape. `start_effect` (2 n, ...) is what an error of one standard
    deviation in each angle and speed of the start makes of them, as the nominal pendulum has it.
    """

    run: int
    start_s: float
    trace: TorqueTrace
    angle_rad: Floats
    speed_rad_s: Floats
    t_s: Floats
    bins: Places
    measured: Floats
    sensor_std: Floats
    start_effect: Floats

    @property
    def noise_std(self) -> Floats:
        """Of the sensors and of the uncertain start together; the start's share is common to the rows of a window."""
        return np.asarray(np.sqrt(self.sensor_std**2 + (self.start_effect**2).sum(axis=0)))

    @property
    def middles_s(self) -> Floats:
        """Where the bins lie, from the start, (b,)."""
        return bin_means(self.t_s[:, None], self.bins)[:, 0]

    def predicted(self, pendulum: DrivenPendulum) -> Floats:
        """The same as `measured` of the model. Raises SimulationFailed."""
        swing = pendulum.swing(self.trace, self.angle_rad, self.speed_rad_s, self.t_s)
        channels = (swing.angle_rad, swing.speed_rad_s)[: len(self.measured)]
        return np.stack([bin_means(channel, self.bins).T for channel in channels])


@dataclass(frozen=True)
class SwingProblem:
    """Everything that a campaign's swings have to say, as one vector of m rows.

    `conditions` names the groups of rows, one per run; `groups` (m,) is the place of a row's run in it. Rows of a group share their
    faults, rows of different groups do not. `windows_of_row` (m,), `signals` and `signal_of_row` (m,), `t_s` (m,) tell where in the
    runs a row lies; `measured` and `noise_std` are (m,), angles in rad and speeds in rad/s. `torque_error` is the usual error of the
    torques, recorded or of the model, as a share of what acts in the joint.
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
    def groups(self) -> Places:
        return np.repeat([window.run for window in self.windows], self._rows)

    @property
    def windows_of_row(self) -> Places:
        return np.repeat(np.arange(len(self.windows)), self._rows)

    @property
    def signals(self) -> tuple[str, ...]:
        joints = range(1, len(self.pendulum.links) + 1)
        return tuple(name for unit in ("angle{}_rad", "speed{}_rad_s") for name in (unit.format(joint) for joint in joints))

    @property
    def signal_of_row(self) -> Places:
        """The place of a row's signal in `signals`."""
        return np.concatenate([np.repeat(np.arange(w.measured[:, :, 0].size), w.measured.shape[2]) for w in self.windows])

    @property
    def t_s(self) -> Floats:
        """Times of the rows in their runs, at the middle of their bins."""
        return np.concatenate([np.tile(w.start_s + w.middles_s, w.measured[:, :, 0].size) for w in self.windows])

    def predicted(self, nuisances: Mapping[str, float], effects: Sequence[PresentEffect] = ()) -> Floats:
        """What the model says of all rows, with nominal values off by `nuisances` and the effects in it.

        A nuisance that is not named is 0. Raises BadInput for a name that is none, or values that no pendulum has, and
        SimulationFailed where the model has no answer.
        """
        ready = driven(shifted(self.pendulum, nuisances), effects)
        return self._all([window.predicted(ready) for window in self.windows])

    def _all(self, parts: Sequence[Floats]) -> Floats:
        return np.concatenate([part.ravel() for part in parts])

    @property
    def _rows(self) -> list[int]:
        return [window.measured.size for window in self.windows]


def swings_of(campaign: PendulumCampaign, window_s: float = 0.5, bin_s: float = BIN_S) -> SwingProblem:
    """All windows of all runs, cut into bins. Raises BadInput where no run is long enough for one."""
    powered = any(run.powered for run in campaign.runs)
    nuisances = tuple(
        Nuisance(f"link{place}.{key}", std)
        for place, link in enumerate(campaign.pendulum.links, start=1)
        for key, std in campaign.known_to.items()
        if key != "torque_error_relative" and (key not in OF_DRIVES or (link.driven and powered))
    )
    ready = driven(campaign.pendulum)
    windows = tuple(
        w for place, run in enumerate(campaign.runs) for w in _windows(place, run, campaign.noise_std, (window_s, bin_s), ready)
    )
    if not windows:
        raise BadInput(f"no run of {campaign.title} is longer than {window_s + 2 * SMOOTHED_S:g} s, which a window of {window_s:g} s needs")
    torque_error = campaign.known_to.get("torque_error_relative", TORQUE_ERROR)
    return SwingProblem(campaign.pendulum, nuisances, tuple(run.label for run in campaign.runs), windows, torque_error)


def shifted(pendulum: Pendulum, nuisances: Mapping[str, float]) -> Pendulum:
    """The pendulum with nominal values off by so much; keys are `link1.mass_relative` and so on, as in [known_to].

    Damping, friction and rotor end at 0. Raises BadInput for another key, and for values that no pendulum has.
    """
    links = list(pendulum.links)
    for name, value in nuisances.items():
        link, _, key = name.partition(".")
        place = int(link.removeprefix("link")) - 1 if link.removeprefix("link").isdecimal() else -1
        if key not in _SHIFTS or not 0 <= place < len(links):
            raise BadInput(f"{name!r} is no nuisance of a pendulum of {len(links)}; there are link1. and so on with {', '.join(_SHIFTS)}")
        links[place] = _SHIFTS[key](links[place], value)
    return Pendulum(tuple(links))


def _mass(link: PendulumLink, share: float) -> PendulumLink:
    return replace(link, mass_kg=link.mass_kg * (1.0 + share), inertia_kg_m2=link.inertia_kg_m2 * (1.0 + share))


def _centre(link: PendulumLink, by_m: float) -> PendulumLink:
    """The inertia about the centre of mass stays."""
    centre = link.centre_of_mass_m + by_m
    return replace(link, centre_of_mass_m=centre, inertia_kg_m2=link.inertia_kg_m2 + link.mass_kg * (centre**2 - link.centre_of_mass_m**2))


OF_DRIVES = ("torque_offset_Nm", "torque_delay_s")  # without a driven run they change nothing

_SHIFTS: Mapping[str, Callable[[PendulumLink, float], PendulumLink]] = {
    "mass_relative": _mass,
    "centre_of_mass_m": _centre,
    "inertia_relative": lambda link, share: replace(link, inertia_kg_m2=link.inertia_kg_m2 * (1.0 + share)),
    "joint_damping_Nm_s_per_rad": lambda link, by: replace(link, joint_damping_Nm_s_per_rad=max(0.0, link.joint_damping_Nm_s_per_rad + by)),
    "joint_friction_Nm": lambda link, by: replace(link, joint_friction_Nm=max(0.0, link.joint_friction_Nm + by)),
    "torque_offset_Nm": lambda link, by: replace(link, torque_offset_Nm=link.torque_offset_Nm + by),
    "zero_offset_rad": lambda link, by: replace(link, zero_offset_rad=link.zero_offset_rad + by),
    "torque_delay_s": lambda link, by: replace(link, torque_delay_s=link.torque_delay_s + by),
    "rotor_inertia_kg_m2": lambda link, by: replace(link, rotor_inertia_kg_m2=max(0.0, link.rotor_inertia_kg_m2 + by)),
}


def sample_noise(run: PendulumRun, noise_std: Mapping[str, float]) -> Floats:
    """Standard deviation of one sample of the angles and, where recorded, the speeds of each joint, (1 or 2, n): as stated, or found."""
    channels = [run.angle_rad] if run.speed_rad_s is None else [run.angle_rad, run.speed_rad_s]
    stated = [noise_std.get(name) for name in ("angle_rad", "speed_rad_s")]
    return np.stack([np.full(c.shape[1], s) if s else sample_std(c) for c, s in zip(channels, stated, strict=False)])


def _windows(
    place: int, run: PendulumRun, noise_std: Mapping[str, float], cut_s: tuple[float, float], ready: DrivenPendulum
) -> list[SwingWindow]:
    window_s, _ = cut_s
    noise = sample_noise(run, noise_std)
    starts = np.arange(run.t_s[0] + SMOOTHED_S, run.t_s[-1] - window_s, window_s)
    channels = [run.angle_rad] if run.speed_rad_s is None else [run.angle_rad, run.speed_rad_s]
    return [_window(place, run, float(start_s), cut_s, channels, noise, ready) for start_s in starts]


def _window(
    place: int, run: PendulumRun, start_s: float, cut_s: tuple[float, float], channels: list[Floats], noise: Floats, ready: DrivenPendulum
) -> SwingWindow:
    window_s, bin_s = cut_s
    inside = (run.t_s > start_s) & (run.t_s <= start_s + window_s)
    t_s = run.t_s[inside] - start_s
    bins = bin_starts(t_s, bin_s)
    angle, speed, angle_std, speed_std = estimate_start(run.t_s, run.angle_rad, start_s, noise[0])
    counts = np.diff(np.append(bins, len(t_s)))
    measured = np.stack([bin_means(channel[inside], bins).T for channel in channels])
    window = SwingWindow(
        run=place,
        start_s=start_s,
        trace=_trace(run, start_s, window_s),
        angle_rad=angle,
        speed_rad_s=speed,
        t_s=t_s,
        bins=bins,
        measured=measured,
        sensor_std=noise[:, :, None] / np.sqrt(counts),
        start_effect=np.empty((0, *measured.shape)),
    )
    return replace(window, start_effect=_start_effect(window, ready, angle_std, speed_std))


def _trace(run: PendulumRun, start_s: float, window_s: float) -> TorqueTrace:
    """Torques of the window with a margin on both sides, as far as the run has one, for drives that are late or early."""
    begin_s, end_s = max(run.t_s[0], start_s - MARGIN_S), min(run.t_s[-1], start_s + window_s + MARGIN_S)
    between = (run.t_s > begin_s) & (run.t_s < end_s)
    t_s = np.concatenate([[begin_s], run.t_s[between], [end_s]])
    torque = np.column_stack([np.interp(t_s, run.t_s, column) for column in run.torque_Nm.T])
    return replace(torque_trace(t_s - start_s, torque), powered=run.powered)


@dataclass(frozen=True)
class LocalPolynomial:
    """Positions near one moment as a polynomial in the time from there over `half_s`.

    `coefficients` (DEGREE + 1, n) have standard deviations `std` (DEGREE + 1,) per unit of noise; `missed` (n,) is the rms that the
    polynomial does not follow.
    """

    coefficients: Floats
    std: Floats
    missed: Floats
    half_s: float

    def derivative(self, order: int) -> Floats:
        """(n,) at the moment itself: position, speed and acceleration for 0, 1 and 2."""
        return np.asarray(factorial(order) * self.coefficients[order] / self.half_s**order)


def local_polynomial(t_s: Floats, position: Floats, at_s: float) -> LocalPolynomial:
    """The polynomial that fits the positions (m, n) around `at_s` best.

    Where too few samples lie around it, as many as the polynomial needs are taken.
    """
    half_s = max(SMOOTHED_S, 0.5 * (DEGREE + 2) * float(np.median(np.diff(t_s))))
    near = np.abs(t_s - at_s) <= half_s * (1.0 + 1e-9)
    design = np.vander((t_s[near] - at_s) / half_s, DEGREE + 1, increasing=True)
    solution = np.linalg.lstsq(design, position[near], rcond=None)[0]
    missed = np.sqrt(np.mean((design @ solution - position[near]) ** 2, axis=0))
    std = np.sqrt(np.diag(np.linalg.pinv(design.T @ design)))
    return LocalPolynomial(np.asarray(solution, dtype=np.float64), std, missed, half_s)


def estimate_start(t_s: Floats, position: Floats, start_s: float, noise: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Position and speed (n,) at `start_s` by the polynomial that fits the positions (m, n) around it best, and how well they are known.

    What the polynomial does not follow, as where dry friction reverses, counts as noise too.
    """
    local = local_polynomial(t_s, position, start_s)
    spread = local.std[:, None] * np.maximum(noise, local.missed)
    return local.derivative(0), local.derivative(1), spread[0], spread[1] / local.half_s


def _start_effect(window: SwingWindow, ready: DrivenPendulum, angle_std: Floats, speed_std: Floats) -> Floats:
    """What an uncertain start makes of angles and speeds later on, as the nominal pendulum has it."""
    found = []
    for joint in range(len(angle_std)):
        angle, speed = (std * np.eye(len(std))[joint] for std in (angle_std, speed_std))
        for by_angle, by_speed in ((angle, 0.0 * speed), (0.0 * angle, speed)):
            ahead, behind = (
                replace(window, angle_rad=window.angle_rad + sign * by_angle, speed_rad_s=window.speed_rad_s + sign * by_speed)
                for sign in (1.0, -1.0)
            )
            found.append(0.5 * (ahead.predicted(ready) - behind.predicted(ready)))
    return np.stack(found)


def bin_starts(t_s: Floats, bin_s: float) -> Places:
    """The first sample of each bin, of samples at times (k,) above zero; one on the edge ends its bin."""
    return np.flatnonzero(np.diff(np.ceil(t_s / bin_s - 1e-6), prepend=0.0))


def bin_means(values: Floats, bins: Places) -> Floats:
    """Means (b, n) of samples (k, n)."""
    counts = np.diff(np.append(bins, len(values)))
    return np.asarray(np.add.reduceat(values, bins) / counts[:, None])


def sample_std(values: Floats) -> Floats:
    """Of one sample of each column of (m, n): from second differences, or from the steps in which an encoder counts, whichever is more."""
    from_neighbours = np.sqrt(np.mean(np.diff(values, 2, axis=0) ** 2, axis=0) / 6.0)
    steps = np.array([smallest_step(column) for column in values.T])
    return np.asarray(np.maximum(np.maximum(from_neighbours, steps / np.sqrt(12.0)), 1e-9))


def smallest_step(values: Floats) -> float:
    """The smallest step between neighbouring samples, the count of an encoder; 0 where nothing ever moves."""
    steps = np.abs(np.diff(values))
    moved = steps[steps > 0.0]
    return float(moved.min()) if moved.size else 0.0
