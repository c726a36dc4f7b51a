"""Windows of a mechanism's recordings as conditions, and the simulator that predicts them.

Of recordings that begin at rest each condition is one window, the mean of its repeats, simulated
from static equilibrium.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.samples import bin_means, bin_starts
from rfca_rig.campaign.experiment import Experiment, MechanismRun
from rfca_rig.diagnosis.config import USUAL_ERROR
from rfca_rig.diagnosis.data import (
    TRANSIENT_SHARE,
    Label,
    Observations,
    WindowRows,
    observe,
    start_gain,
)
from rfca_rig.diagnosis.mechanisms.noise import estimate_noise
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput, shift_plant
from rfca_rig.diagnosis.simulator import ScatterDirection, Simulator
from rfca_rig.mechanism.laws import make_tabulated_effect
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import Plant, make_plant, update_constants
from rfca_rig.mechanism.prescribed import PrescribedMotion, fit_trajectory
from rfca_rig.mechanism.rollout import CommandTrace, Motion, simulate_plant
from rfca_rig.model.effect import Effect

Floats = NDArray[np.float64]

MOTION_EXPERIMENT = "motions"  # name of their experiment in labels
# Correlation length of the model's error in bins. Bins are as long as the motion allows, and
# torques err with the joint's angle. A length that grew with the window would exclude errors at the
# frequency of a swing: over 2 s, nothing would then be 1e183 times less probable than dry friction,
# for a pendulum that its published model predicts to 0.4 % of its swing.
SMOOTH_BINS = 3.0


@dataclass(frozen=True)
class Window:
    """One window of a run, as it was recorded.

    Parameters
    ----------
    start_s, since_s
        Where it begins, and how long after the beginning of the recording.
    trace
        The commands around it.
    position, speed
        (n,) the state at its beginning, as read; None where it begins at rest in equilibrium.
    start_std
        (2 n,) how well positions and speeds at the beginning are known; 0 for a joint that is
        prescribed. (0,) for a start at rest.
    t_s
        (k,) times of its samples, from its beginning.
    bins
        (b,) the first sample of each bin.
    measured, sensor_std
        (s, b) means over the bins, and their standard deviations.
    prescribed
        The motion of the prescribed joints, in the time of `t_s`; None without such.
    repeats
        (r, s, b) the same means of each repeat, of which `measured` is the mean; (1, 0, 0) where it
        was recorded once.
    """

    start_s: float
    since_s: float
    trace: CommandTrace
    position: Floats | None
    speed: Floats | None
    start_std: Floats
    t_s: Floats
    bins: NDArray[np.intp]
    measured: Floats
    sensor_std: Floats
    prescribed: PrescribedMotion | None = None
    repeats: Floats = field(default_factory=lambda: np.empty((1, 0, 0)))

    @property
    def starts_at_rest(self) -> bool:
        return self.position is None


@dataclass(frozen=True)
class CorrectedWindow:
    """A window, with the effects of errors on its rows in the nominal model.

    Parameters
    ----------
    window
        The window.
    start_effect
        (k, s, b) effect of one standard deviation in each measured position and speed of the start;
        none for a start at rest.
    scale
        (s, b) effect of torques that are wrong by their full usual size.
    transient_scale
        (s, b) the size of errors that differ from bin to bin, counted like `scale`.
    """

    window: Window
    start_effect: Floats
    scale: Floats
    transient_scale: Floats

    @property
    def error_scale(self) -> Floats:
        """(s, b) smooth model errors and those that differ from bin to bin together, counted
        like `scale`.
        """
        return np.hypot(self.scale, self.transient_scale)

    @cached_property
    def gain(self) -> Floats:
        """(k, s b) matrix that estimates the errors of the start from a residual, in standard
        deviations.
        """
        return start_gain(
            self.start_effect, self.window.sensor_std**2 + (USUAL_ERROR * self.scale) ** 2
        )

    def move_start(self, simulated: Floats) -> Floats:
        """Prediction (s, b) from the start that fits best within its uncertainty; `simulated`
        (s, b) is that from the measured start.
        """
        # A start at rest is an equilibrium of the model, not a measured state with an error.
        if not len(self.start_effect):
            return simulated
        start_error = self.gain @ (self.window.measured - simulated).ravel()
        moved = start_error @ self.start_effect.reshape(len(start_error), -1)
        return np.asarray(simulated + moved.reshape(simulated.shape))

    @property
    def start_std(self) -> Floats:
        """(s, b) standard deviation of the nominal prediction from the measured start, because
        that start has errors.
        """
        return np.asarray(np.sqrt((self.start_effect**2).sum(axis=0)))

    def rows(self) -> WindowRows:
        """The measured rows."""
        recorded = self.window
        t_s = recorded.start_s + bin_means(recorded.t_s[:, None], recorded.bins)[:, 0]
        return WindowRows(
            t_s, recorded.measured, recorded.sensor_std, self.scale, self.transient_scale
        )


@dataclass(frozen=True)
class Motions:
    """A few windows of one run, which are one condition.

    Parameters
    ----------
    name, run
        In words: with its times, and without.
    recording
        The recording that it is a part of, in words.
    signals
        The signals' names, which end with their units.
    windows
        The windows.
    """

    name: str
    run: str
    recording: str
    signals: tuple[str, ...]
    windows: tuple[CorrectedWindow, ...]

    @property
    def repeats(self) -> Floats:
        """Rows (r, m) of each repeat of a motion that starts at rest; every other window is
        recorded once, (1, 0).
        """
        count = len(self.windows[0].window.repeats)
        return np.concatenate(
            [corrected.window.repeats.reshape(count, -1) for corrected in self.windows], axis=1
        )

    @property
    def start_std(self) -> Floats:
        """(m,) standard deviation of the nominal prediction of each row, because the measured
        starts have errors.
        """
        return np.concatenate([window.start_std.ravel() for window in self.windows])

    def rows(self) -> Observations:
        """The measured rows."""
        starts_s = tuple(corrected.window.start_s for corrected in self.windows)
        labels = tuple(
            Label(MOTION_EXPERIMENT, self.name, signal, recording=self.recording, starts_s=starts_s)
            for signal in self.signals
        )
        first = self.windows[0].window
        if len(first.bins) > 1:
            bin_s = float(np.median(np.diff(first.t_s[first.bins])))
        else:
            bin_s = float(first.t_s[-1])
        return observe(
            [window.rows() for window in self.windows], labels, self.run, SMOOTH_BINS * bin_s
        )


@dataclass(frozen=True)
class MechanismSimulator(Simulator):
    """A mechanism, the columns of its signals, and the effects that may be added.

    Parameters
    ----------
    mechanism
        The nominal model.
    step_s
        The integrator's step.
    columns
        (s,) the column of each signal in positions, speeds and sensors side by side, (2 n + d).
    effects
        By id.
    scatters
        By joint, the standard deviation of its position from repeat to repeat that its readings do
        not show.
    """

    mechanism: Mechanism
    step_s: float
    columns: NDArray[np.intp]
    effects: Mapping[str, Effect]
    scatters: Mapping[str, float] = field(default_factory=dict)

    @property
    def integrator(self) -> str:
        """In words."""
        if self.mechanism.is_implicit:
            return "MuJoCo's implicit integrator"
        return "Runge-Kutta"

    def plant(self, at: MechanismInput) -> Plant:
        """The plant with these nuisance parameters and effects."""
        plant = make_plant(
            self.mechanism,
            self.step_s,
            bool((self.columns >= 2 * len(self.mechanism.joints)).any()),
        )
        shift_plant(plant, at)
        for present in at.effects:
            if present.table is None:
                effect = self.effects[present.id]
            else:
                effect = make_tabulated_effect(self.mechanism, present.table)
            plant = effect.apply(plant, dict(present.values))
        # MuJoCo derives constants from masses and sizes; they must follow the changes above.
        update_constants(plant)
        return plant

    def roll(self, plant: Plant, window: Window) -> Motion:
        """The plant's motion from the measured start, or from rest. Raises SimulationFailed."""
        return simulate_plant(
            plant,
            window.trace,
            window.position,
            window.speed,
            window.t_s,
            window.since_s,
            window.prescribed,
        )

    def follow(self, plant: Plant, window: Window) -> Floats:
        """Simulated readings of that motion, (s, b). Raises SimulationFailed."""
        motion = self.roll(plant, window)
        read = np.concatenate([motion.position, motion.speed, motion.sensors], axis=1)[
            :, self.columns
        ]
        return bin_means(read, window.bins).T

    def predict(self, plant: Plant, each: CorrectedWindow) -> Floats:
        """Predicted readings (s, b) from the start that fits best within its uncertainty. Raises
        SimulationFailed.
        """
        return each.move_start(self.follow(plant, each.window))

    def scatter(
        self,
        at: MechanismInput,
        conditions: Sequence[Motions],  # noqa: ARG002
    ) -> tuple[ScatterDirection, ...]:
        """Scatter of prescribed joints that their readings do not show."""
        directions = []
        for name, std in self.scatters.items():
            joint = self.mechanism.joints.index(name)
            # The joint stands elsewhere while its reading stays the same: that is an offset of its
            # zero.
            if self.mechanism.is_slide[joint]:
                key = "zero_offset_m"
            else:
                key = "zero_offset_rad"
            above, below = (at.shift_value(key, joint, by) for by in (std, -std))
            directions.append(ScatterDirection(f"{name}.{key}", std, above, below))
        return tuple(directions)

    def simulate(self, at: MechanismInput, condition: Motions) -> Floats:
        """Predicted rows (m,) of a condition, from the starts that fit best. Raises
        SimulationFailed.
        """
        return next(self.simulate_each(at, [condition]))

    def simulate_each(self, at: MechanismInput, conditions: Sequence[Motions]) -> Iterator[Floats]:
        """Predicted rows (m,) of one condition after the other, by one plant. Raises
        SimulationFailed.
        """
        plant = self.plant(at)
        for condition in conditions:
            yield np.concatenate(
                [self.predict(plant, window).ravel() for window in condition.windows]
            )


# Model error of a sensor, as for the strokes of a leg (`diagnosis.leg.strokes`): 1 % of the signal
# goes with a moment that is off by 1 ms. Bounces after a touchdown are five times harder to predict
# than slow swings, until they decay.
LATE_S = 0.1
SMALLEST_SCALE = 0.1  # of a signal's rms
TRANSIENT_FACTOR = 5.0
TRANSIENT_DECAY_S = 0.06
BEFORE_TOUCHDOWN_S = 0.010
PEAK_WITHIN_S = 0.030
MIN_SPEED_SHARE = 0.01  # of the largest speed: below it the mechanism has not begun to move


def group_repeats(runs: Sequence[MechanismRun]) -> list[list[MechanismRun]]:
    """The recordings of each condition, in the order of their first."""
    groups: dict[str, list[MechanismRun]] = {}
    for run in runs:
        groups.setdefault(run.condition, []).append(run)
    return list(groups.values())


def cut_rest_window(
    runs: Sequence[MechanismRun], experiment: Experiment, arranged: Sequence[Floats]
) -> Window | None:
    """The window of one condition: the stretch that all its repeats have, at the sample times of
    the first repeat.

    Parameters
    ----------
    runs
        The repeats.
    experiment
        The experiment that they belong to.
    arranged
        For each repeat the commands (m, u) of all actuators.

    Returns
    -------
    Window or None
        None where a repeat has a gap longer than a bin, or all together are too short for two bins.
    """
    begin_s = max(run.t_s[0] for run in runs)
    end_s = min(run.t_s[-1] for run in runs)
    if (
        any(np.diff(run.t_s).max() > experiment.bin_s for run in runs)
        or end_s - begin_s < 2.0 * experiment.bin_s
    ):
        return None
    grid_s = runs[0].t_s[(runs[0].t_s >= begin_s) & (runs[0].t_s <= end_s)]
    signals = np.array([_resample(grid_s, run.t_s, run.signals) for run in runs])
    commands = np.mean(
        [_resample(grid_s, run.t_s, values) for run, values in zip(runs, arranged, strict=True)],
        axis=0,
    )
    prescribed = np.mean([_resample(grid_s, run.t_s, run.prescribed) for run in runs], axis=0)
    stated = [signal.noise_std for signal in experiment.signals]
    estimates = np.mean([estimate_noise(run) for run in runs], axis=0)
    noise = np.array([std or of_samples for std, of_samples in zip(stated, estimates, strict=True)])
    t_s = grid_s[1:] - grid_s[0]
    bins = bin_starts(t_s, experiment.bin_s)
    counts = np.diff(np.append(bins, len(t_s)))
    repeats = np.array([bin_means(values[1:], bins).T for values in signals])
    trajectory = fit_trajectory(
        grid_s - grid_s[0], prescribed, [joint.smoothed_s for joint in experiment.prescribed]
    )
    return Window(
        start_s=float(grid_s[0]),
        since_s=0.0,
        trace=CommandTrace(grid_s - grid_s[0], commands, any(run.driven for run in runs)),
        position=None,
        speed=None,
        start_std=np.empty(0),
        t_s=t_s,
        bins=bins,
        measured=repeats.mean(axis=0),
        sensor_std=noise[:, None] / np.sqrt(counts * len(runs)),
        prescribed=trajectory if experiment.prescribed else None,
        repeats=repeats if len(runs) > 1 else np.empty((1, 0, 0)),
    )


def _resample(grid_s: Floats, t_s: Floats, values: Floats) -> Floats:
    """Columns (m, k) interpolated at other times."""
    # Equal times need no interpolation, so that a single recording stays exactly as it is.
    if grid_s.shape == t_s.shape and np.array_equal(grid_s, t_s):
        return values
    columns = np.empty((len(grid_s), values.shape[1]))
    for index, column in enumerate(values.T):
        columns[:, index] = np.interp(grid_s, t_s, column)
    return columns


def correct_rest_window(
    window: Window, simulator: MechanismSimulator, plant: Plant, torque: Floats, motion: Motion
) -> CorrectedWindow:
    """The window with the effects of errors of the torques on its rows.

    Parameters
    ----------
    window, simulator
        The window, and what predicts it.
    plant
        The nominal plant.
    torque
        (n,) the torques of which USUAL_ERROR is the usual error.
    motion
        The nominal motion at the window's samples.
    """
    joints = len(torque)
    # The torques may be wrong where the actuators are off, too.
    powered = replace(window, trace=replace(window.trace, is_powered=True))
    square = np.zeros(window.measured.shape)
    for joint in simulator.mechanism.simulated:
        more = USUAL_ERROR * torque[joint] * np.eye(joints)[joint]
        ahead, behind = (
            simulator.follow(replace(plant, torque_offset=plant.torque_offset + by), powered)
            for by in (more, -more)
        )
        square += (0.5 * (ahead - behind) / USUAL_ERROR) ** 2
    t_s = bin_means(window.t_s[:, None], window.bins)[:, 0]
    scale = np.sqrt(square)
    jolt = np.zeros(window.measured.shape)
    # Whether any of the joints, with speeds (k, s), moves in a bin (b,).
    speed = motion.speed[:, list(simulator.mechanism.simulated)]
    fastest = np.abs(speed) / np.maximum(np.abs(speed).max(axis=0), 1e-300)
    moves = bin_means(fastest.max(axis=1)[:, None], window.bins)[:, 0] > MIN_SPEED_SHARE
    for row, column in enumerate(simulator.columns):
        # Positions and speeds stand before the sensors in the columns.
        if column < 2 * joints:
            scale[row] = np.maximum.accumulate(scale[row])  # what has grown stays grown
        else:
            values = window.measured[row]
            least = SMALLEST_SCALE * float(np.sqrt(np.mean(values**2)))
            scale[row] = np.sqrt(
                square[row] + values**2 + (LATE_S * np.gradient(values, t_s)) ** 2 + least**2
            )
            jolt[row] = _bounces(t_s, values, moves, float(motion.touch_s.min(initial=np.inf)))
    return CorrectedWindow(
        window,
        np.empty((0, *window.measured.shape)),
        scale,
        np.hypot(TRANSIENT_SHARE * scale, jolt),
    )


def _bounces(t_s: Floats, values: Floats, moves: NDArray[np.bool_], touch_s: float) -> Floats:
    """Errors (b,) that differ from bin to bin: from the first touch on, and while the mechanism
    swings before it; 0 without a touch.

    `values` (b,) are the measured means at `t_s` (b,), `moves` (b,) whether a joint moves.
    """
    if not np.isfinite(touch_s):
        return np.zeros(len(t_s))
    after_s = t_s - touch_s
    near = (after_s > -BEFORE_TOUCHDOWN_S) & (after_s < PEAK_WITHIN_S)
    before = (after_s <= -BEFORE_TOUCHDOWN_S) & moves
    peak = float(np.abs(values[near]).max(initial=0.0))
    bounce = np.where(
        after_s > -BEFORE_TOUCHDOWN_S,
        peak * np.exp(-np.maximum(after_s, 0.0) / TRANSIENT_DECAY_S),
        0.0,
    )
    swing = np.where(before, 0.5 * float(np.ptp(values[before])) if before.any() else 0.0, 0.0)
    return TRANSIENT_FACTOR * np.hypot(bounce, swing)
