"""Windows of a mechanism's recordings as conditions, and the simulator that predicts them."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.swings import bin_means
from rfca_rig.diagnosis.config import USUAL_ERROR
from rfca_rig.diagnosis.data.observations import Label, Observations
from rfca_rig.diagnosis.data.windows import WindowRows, observe, start_gain
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput, shift_plant
from rfca_rig.diagnosis.simulator import Simulator
from rfca_rig.mechanism.joint_law import make_tabulated_effect
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.plant import Plant, make_plant, update_constants
from rfca_rig.mechanism.rollout import CommandTrace, Motion, roll
from rfca_rig.model.effect import Effect

Floats = NDArray[np.float64]

MECHANISMS = "motions"  # what their experiment is called
SMOOTH_OVER = 0.3  # of a window: over that share of it the model's error is alike, as torques err with the joint's angle


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
        (n,) the state at its beginning, as read.
    start_std
        (2 n,) how well positions and speeds at the beginning are known.
    t_s
        (k,) times of its samples, from its beginning.
    bins
        (b,) the first sample of each bin.
    measured, sensor_std
        (s, b) means over the bins, and their standard deviations.
    """

    start_s: float
    since_s: float
    trace: CommandTrace
    position: Floats
    speed: Floats
    start_std: Floats
    t_s: Floats
    bins: NDArray[np.intp]
    measured: Floats
    sensor_std: Floats


@dataclass(frozen=True)
class CorrectedWindow:
    """A window, and what errors do to its rows in the nominal model.

    Parameters
    ----------
    window
        The window.
    start_effect
        (2 n, s, b) what an error of one standard deviation in each position and speed of the start makes of them.
    scale
        (s, b) what torques that are wrong by their full usual size make of them.
    """

    window: Window
    start_effect: Floats
    scale: Floats

    @cached_property
    def gain(self) -> Floats:
        """(2 n, s b) the errors of the start, in standard deviations, that a misfit shows."""
        return start_gain(self.start_effect, self.window.sensor_std**2 + (USUAL_ERROR * self.scale) ** 2)

    def move_start(self, simulated: Floats) -> Floats:
        """What the model says from the start that suits it best, (s, b), where it says `simulated` from the measured one."""
        start_error = self.gain @ (self.window.measured - simulated).ravel()
        return np.asarray(simulated + np.tensordot(start_error, self.start_effect, 1))

    def rows(self) -> WindowRows:
        """What was measured."""
        recorded = self.window
        t_s = recorded.start_s + bin_means(recorded.t_s[:, None], recorded.bins)[:, 0]
        return WindowRows(t_s, recorded.measured, recorded.sensor_std, self.scale)


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
        """None: every window is recorded once."""
        return np.empty((1, 0))

    def rows(self) -> Observations:
        """What was measured here."""
        labels = tuple(Label(MECHANISMS, self.name, signal) for signal in self.signals)
        smooth_over_s = SMOOTH_OVER * float(self.windows[0].window.t_s[-1])
        return observe([window.rows() for window in self.windows], labels, self.run, smooth_over_s)


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
    """

    mechanism: Mechanism
    step_s: float
    columns: NDArray[np.intp]
    effects: Mapping[str, Effect]

    def plant(self, at: MechanismInput) -> Plant:
        """The plant with these nuisance parameters and effects."""
        plant = make_plant(self.mechanism, self.step_s, bool((self.columns >= 2 * len(self.mechanism.joints)).any()))
        shift_plant(plant, at)
        for present in at.effects:
            effect = self.effects[present.id] if present.table is None else make_tabulated_effect(self.mechanism, present.table)
            plant = effect.apply(plant, dict(present.values))
        update_constants(plant)
        return plant

    def roll(self, plant: Plant, window: Window) -> Motion:
        """The motion from the measured start. Raises SimulationFailed."""
        return roll(plant, window.trace, window.position, window.speed, window.t_s, window.since_s)

    def follow(self, plant: Plant, window: Window) -> Floats:
        """What the plant does from the measured start, (s, b). Raises SimulationFailed."""
        motion = self.roll(plant, window)
        read = np.concatenate([motion.position, motion.speed, motion.sensors], axis=1)[:, self.columns]
        return bin_means(read, window.bins).T

    def predict(self, plant: Plant, each: CorrectedWindow) -> Floats:
        """What the plant does from the start that suits it best, (s, b). Raises SimulationFailed."""
        return each.move_start(self.follow(plant, each.window))

    def simulate(self, at: MechanismInput, condition: Motions) -> Floats:
        """What the model says of a condition, (m,), from the starts that suit it best. Raises SimulationFailed."""
        plant = self.plant(at)
        return np.concatenate([self.predict(plant, each).ravel() for each in condition.windows])
