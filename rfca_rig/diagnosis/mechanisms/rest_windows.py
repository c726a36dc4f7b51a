"""Recordings that begin at rest: each condition is one window, the mean of its repeats, simulated from static equilibrium."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.swings import bin_means, bin_starts, sample_std
from rfca_rig.campaign.experiment import Experiment, MechanismRun
from rfca_rig.diagnosis.config import USUAL_ERROR
from rfca_rig.diagnosis.data import TRANSIENT_SHARE
from rfca_rig.diagnosis.mechanisms.windows import CorrectedWindow, MechanismSimulator, Window
from rfca_rig.mechanism.plant import Plant
from rfca_rig.mechanism.prescribed import fit_trajectory
from rfca_rig.mechanism.rollout import CommandTrace, Motion

Floats = NDArray[np.float64]

# Model error of a sensor, as for the strokes of a leg (`diagnosis.leg.strokes`): 1 % of the signal goes with a moment that is off by 1 ms.
# Bounces after a touchdown are five times harder to predict than slow swings, until they decay.
LATE_S = 0.1
SMALLEST_SCALE = 0.1  # of a signal's rms
JOLT, JOLT_DIES_S, BEFORE_TOUCH_S, PEAK_WITHIN_S = 5.0, 0.06, 0.010, 0.030
MOVES = 0.01  # of the largest speed: below it the mechanism has not begun to move


def group_repeats(runs: Sequence[MechanismRun]) -> list[list[MechanismRun]]:
    """The recordings of each condition, in the order of their first."""
    found: dict[str, list[MechanismRun]] = {}
    for run in runs:
        found.setdefault(run.condition, []).append(run)
    return list(found.values())


def cut_rest_window(runs: Sequence[MechanismRun], experiment: Experiment, arranged: Sequence[Floats]) -> Window | None:
    """The window of one condition: the stretch that all its repeats have, at the sample times of the first repeat.

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
    begin_s, end_s = max(run.t_s[0] for run in runs), min(run.t_s[-1] for run in runs)
    if any(np.diff(run.t_s).max() > experiment.bin_s for run in runs) or end_s - begin_s < 2.0 * experiment.bin_s:
        return None
    grid_s = runs[0].t_s[(runs[0].t_s >= begin_s) & (runs[0].t_s <= end_s)]
    signals = np.array([_resample(grid_s, run.t_s, run.signals) for run in runs])
    commands = np.mean([_resample(grid_s, run.t_s, values) for run, values in zip(runs, arranged, strict=True)], axis=0)
    prescribed = np.mean([_resample(grid_s, run.t_s, run.prescribed) for run in runs], axis=0)
    stated = [signal.noise_std for signal in experiment.signals]
    found = np.mean([sample_std(run.signals) for run in runs], axis=0)
    noise = np.array([std or of_samples for std, of_samples in zip(stated, found, strict=True)])
    t_s = grid_s[1:] - grid_s[0]
    bins = bin_starts(t_s, experiment.bin_s)
    counts = np.diff(np.append(bins, len(t_s)))
    repeats = np.array([bin_means(values[1:], bins).T for values in signals])
    trajectory = fit_trajectory(grid_s - grid_s[0], prescribed, [joint.smoothed_s for joint in experiment.prescribed])
    return Window(
        start_s=float(grid_s[0]),
        since_s=0.0,
        trace=CommandTrace(grid_s - grid_s[0], commands),
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
    found = np.empty((len(grid_s), values.shape[1]))
    for place, column in enumerate(values.T):
        found[:, place] = np.interp(grid_s, t_s, column)
    return found


def correct_rest_window(window: Window, simulator: MechanismSimulator, plant: Plant, torque: Floats, motion: Motion) -> CorrectedWindow:
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
    square = np.zeros(window.measured.shape)
    for joint in simulator.mechanism.simulated:
        more = USUAL_ERROR * torque[joint] * np.eye(joints)[joint]
        ahead, behind = (simulator.follow(replace(plant, torque_offset=plant.torque_offset + by), window) for by in (more, -more))
        square += (0.5 * (ahead - behind) / USUAL_ERROR) ** 2
    t_s = bin_means(window.t_s[:, None], window.bins)[:, 0]
    scale, jolt = np.sqrt(square), np.zeros(window.measured.shape)
    # Whether any of the joints, with speeds (k, s), moves in a bin (b,).
    speed = motion.speed[:, list(simulator.mechanism.simulated)]
    fastest = np.abs(speed) / np.maximum(np.abs(speed).max(axis=0), 1e-300)
    moves = bin_means(fastest.max(axis=1)[:, None], window.bins)[:, 0] > MOVES
    for row, column in enumerate(simulator.columns):
        # Positions and speeds stand before the sensors in the columns.
        if column < 2 * joints:
            scale[row] = np.maximum.accumulate(scale[row])  # what has grown stays grown
        else:
            values = window.measured[row]
            least = SMALLEST_SCALE * float(np.sqrt(np.mean(values**2)))
            scale[row] = np.sqrt(square[row] + values**2 + (LATE_S * np.gradient(values, t_s)) ** 2 + least**2)
            jolt[row] = _bounces(t_s, values, moves, float(motion.touch_s.min(initial=np.inf)))
    return CorrectedWindow(window, np.empty((0, *window.measured.shape)), scale, np.hypot(TRANSIENT_SHARE * scale, jolt))


def _bounces(t_s: Floats, values: Floats, moves: NDArray[np.bool_], touch_s: float) -> Floats:
    """Errors (b,) that differ from bin to bin: from the first touch on, and while the mechanism swings before it; 0 without a touch.

    `values` (b,) are the measured means at `t_s` (b,), `moves` (b,) whether a joint moves.
    """
    if not np.isfinite(touch_s):
        return np.zeros(len(t_s))
    after_s = t_s - touch_s
    near, before = (after_s > -BEFORE_TOUCH_S) & (after_s < PEAK_WITHIN_S), (after_s <= -BEFORE_TOUCH_S) & moves
    peak = float(np.abs(values[near]).max(initial=0.0))
    bounce = np.where(after_s > -BEFORE_TOUCH_S, peak * np.exp(-np.maximum(after_s, 0.0) / JOLT_DIES_S), 0.0)
    swing = np.where(before, 0.5 * float(np.ptp(values[before])) if before.any() else 0.0, 0.0)
    return JOLT * np.hypot(bounce, swing)
