"""Recordings of a mechanism cut into windows, with all that does not depend on the hypothesis.

The discrepancy of the model refers to generalised forces: an error of 1 % means that the signals are off as the nominal model's are when
the torque in each joint is off by 1 % of what weight and drive make there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.swings import bin_means, estimate_start, sample_std
from rfca_rig.campaign.experiment import Experiment, MechanismRun
from rfca_rig.diagnosis.config import USUAL_ERROR
from rfca_rig.diagnosis.data.windows import group, start_gain
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput
from rfca_rig.diagnosis.mechanisms.windows import MechanismSimulator, Motions, Window
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.mechanism.effects import UsualMotion
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.rollout import CommandTrace
from rfca_rig.model.effect import Effect

Floats = NDArray[np.float64]

MARGIN_S = 0.1  # of commands before and after a window: twice the longest delay, and two of the longest lags, that are plausible
MARGIN_OF_START_S = 0.06  # of readings before a window, from which its start is estimated
STEPS_S = (4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)
STEP_ERROR = 0.1  # share of the sensors' and the usual model error together that the integrator may add, rms


@dataclass(frozen=True)
class MechanismProblem:
    """What is to be diagnosed.

    Parameters
    ----------
    mechanism
        The nominal model.
    windows
        All windows of all runs.
    runs
        Each run in words, with its repeat, and its condition, whose repeats err alike.
    signals, columns
        Names of the signals, and their columns in positions and speeds side by side.
    step_s
        The integrator's step.
    usual
        What the recordings show of each joint.
    """

    mechanism: Mechanism
    windows: tuple[Window, ...]
    runs: tuple[tuple[str, str], ...]
    signals: tuple[str, ...]
    columns: NDArray[np.intp]
    step_s: float
    usual: UsualMotion

    def simulator(self, effects: Sequence[Effect]) -> MechanismSimulator:
        """The simulator with these effects."""
        return MechanismSimulator(self.mechanism, self.step_s, self.columns, {effect.id: effect for effect in effects})

    def conditions(self) -> tuple[Motions, ...]:
        """The windows of each run, a few together."""
        found = []
        for run, (name, condition) in enumerate(self.runs):
            for part in group([window for window in self.windows if window.run == run]):
                end_s = part[-1].start_s + part[-1].t_s[-1]
                found.append(Motions(f"{name}, {part[0].start_s:.1f} to {end_s:.1f} s", condition, self.signals, tuple(part)))
        return tuple(found)


def make_problem(experiment: Experiment, mechanism: Mechanism) -> MechanismProblem:
    """The windows of all runs, with all that does not depend on the hypothesis.

    Raises
    ------
    BadInput
        Where a joint or actuator is not in the model, the position of a joint is not measured, or no run is long enough.
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    signals, columns = _signals(experiment, mechanism)
    places = [mechanism.actuator(name, str(experiment.path)) for name in experiment.actuators]
    windows = [w for number, run in enumerate(experiment.runs) for w in _cut(number, run, experiment, mechanism, columns, places)]
    if not windows:
        needed = experiment.windows.length_s + 2.0 * MARGIN_OF_START_S
        raise BadInput(
            f"{experiment.path}: no recording is longer than {needed:g} s, which a window of {experiment.windows.length_s:g} s needs"
        )
    usual = _usual_motion(mechanism, windows, bool((columns >= len(mechanism.joints)).any()))
    problem = MechanismProblem(
        mechanism, tuple(windows), tuple((run.label, run.condition) for run in experiment.runs), signals, columns, STEPS_S[-1], usual
    )
    torque = usual.torque * experiment.known_to.get("torque_error_relative", USUAL_ERROR) / USUAL_ERROR
    coarse = replace(problem, step_s=STEPS_S[2])
    problem = replace(problem, windows=tuple(_with_errors(window, coarse.simulator(()), torque) for window in windows))
    return replace(problem, step_s=choose_step(problem))


def choose_step(problem: MechanismProblem) -> float:
    """The longest step whose error, against half of it, is negligible in the nominal model.

    Raises
    ------
    SimulationFailed
        Where no step is short enough.
    """
    sample = problem.windows[:: max(1, len(problem.windows) // 8)]

    def simulate_all(step_s: float) -> Floats | None:
        simulator = replace(problem.simulator(()), step_s=step_s)
        plant = simulator.plant(MechanismInput())
        try:
            return np.concatenate([simulator.follow(plant, window).ravel() for window in sample])
        except SimulationFailed:
            return None

    allowed = np.concatenate([np.hypot(w.sensor_std, USUAL_ERROR * w.scale).ravel() for w in sample])
    coarse = simulate_all(STEPS_S[0])
    for step_s, finer_s in pairwise(STEPS_S):
        fine = simulate_all(finer_s)
        if coarse is not None and fine is not None and np.sqrt(np.mean(((coarse - fine) / allowed) ** 2)) < STEP_ERROR:
            return step_s
        coarse = fine
    raise SimulationFailed(
        f"{problem.mechanism.path}: steps of {1e3 * STEPS_S[-1]:g} ms still change the motion; "
        "look for a slipped decimal point, or a contact or spring that is far too stiff"
    )


def _signals(experiment: Experiment, mechanism: Mechanism) -> tuple[tuple[str, ...], NDArray[np.intp]]:
    """Names and columns. Raises BadInput."""
    names, columns = [], []
    for signal in experiment.signals:
        joint = mechanism.joint(signal.joint, str(experiment.path))
        slides = bool(mechanism.is_slide[joint])
        if signal.is_distance != slides:
            expected = "a slide: give m or mm" if slides else "a hinge: give rad, deg, turn or count"
            raise BadInput(f"{experiment.path}: the unit of a signal of joint {signal.joint!r} does not suit {expected}")
        unit = ("m" if slides else "rad") + ("_s" if signal.is_speed else "")
        names.append(f"{signal.joint}_{'speed' if signal.is_speed else 'position'}_{unit}")
        columns.append(joint + len(mechanism.joints) * signal.is_speed)
    missing = [name for place, name in enumerate(mechanism.joints) if place not in columns]
    if missing:
        raise BadInput(
            f"{experiment.path}: no signal holds the position of joint {missing[0]!r}; every joint of the model must be measured"
        )
    return tuple(names), np.array(columns)


def _cut(
    number: int, run: MechanismRun, experiment: Experiment, mechanism: Mechanism, columns: NDArray[np.intp], places: Sequence[int]
) -> list[Window]:
    """The windows of one run, without the errors of their starts."""
    length_s, bin_s = experiment.windows.length_s, experiment.windows.bin_s
    stated = [signal.noise_std for signal in experiment.signals]
    noise = np.array([std or found for std, found in zip(stated, sample_std(run.signals), strict=True)])
    of_joint = [int(np.flatnonzero(columns == joint)[0]) for joint in range(len(mechanism.joints))]
    position, position_noise = run.signals[:, of_joint], noise[of_joint]
    commands = np.zeros((len(run.t_s), len(mechanism.actuators)))
    commands[:, list(places)] = run.commands
    windows = []
    for start_s in np.arange(run.t_s[0] + MARGIN_OF_START_S, run.t_s[-1] - length_s, length_s):
        inside = (run.t_s > start_s) & (run.t_s <= start_s + length_s)
        around = (run.t_s > start_s - MARGIN_S) & (run.t_s < start_s + length_s + MARGIN_S)
        t_s = run.t_s[inside] - start_s
        if t_s.size == 0 or np.diff(run.t_s[around]).max(initial=0.0) > bin_s:
            continue  # a gap: a bin would be empty
        bins = np.flatnonzero(np.diff(np.ceil(t_s / bin_s - 1e-6), prepend=0.0))
        at, speed, at_std, speed_std = estimate_start(run.t_s, position, float(start_s), position_noise)
        counts = np.diff(np.append(bins, len(t_s)))
        measured = bin_means(run.signals[inside], bins).T
        windows.append(
            Window(
                run=number,
                start_s=float(start_s),
                trace=CommandTrace(run.t_s[around] - start_s, commands[around]),
                position=at,
                speed=speed,
                t_s=t_s,
                bins=bins,
                measured=measured,
                sensor_std=noise[:, None] / np.sqrt(counts),
                start_effect=np.concatenate([at_std, speed_std]),  # `_with_errors` puts the effects in their place
                scale=np.empty((0, 0)),
                gain=np.empty((0, 0)),
            )
        )
    return windows


def _with_errors(window: Window, simulator: MechanismSimulator, torque: Floats) -> Window:
    """The window with what errors of its start and of the torques do to its rows, in the nominal model."""
    joints, stds = len(simulator.mechanism.joints), window.start_effect
    plant, found = simulator.plant(MechanismInput()), []
    for place, std in enumerate(stds):
        shift = std * (np.arange(2 * joints) == place)
        either = (
            replace(window, position=window.position + sign * shift[:joints], speed=window.speed + sign * shift[joints:])
            for sign in (1.0, -1.0)
        )
        ahead, behind = (simulator.follow(plant, shifted) for shifted in either)
        found.append(0.5 * (ahead - behind))
    start_effect = np.stack(found)
    square = np.zeros_like(window.measured)
    for more in USUAL_ERROR * np.diag(torque):
        plants = (replace(plant, torque_offset=plant.torque_offset + sign * more) for sign in (1.0, -1.0))
        ahead, behind = (simulator.follow(pushed, window) for pushed in plants)
        square += (0.5 * (ahead - behind) / USUAL_ERROR) ** 2
    scale = np.maximum.accumulate(np.sqrt(square), axis=1)  # what has grown stays grown
    gain = start_gain(start_effect, window.sensor_std**2 + (USUAL_ERROR * scale) ** 2)
    return replace(window, start_effect=start_effect, scale=scale, gain=gain)


def _usual_motion(mechanism: Mechanism, windows: Sequence[Window], has_speeds: bool) -> UsualMotion:
    """Rms over the starts of all windows, and of the commands within them."""
    import mujoco  # noqa: PLC0415  (optional)

    model, data = mechanism.model, mujoco.MjData(mechanism.model)
    square, inertia = np.zeros(model.nv), np.zeros(model.nv)
    column = np.empty(model.nv)
    for window in windows:
        data.qpos[:], data.qvel[:], data.ctrl[:] = window.position, 0.0, 0.0
        mujoco.mj_forward(model, data)
        square += data.qfrc_bias**2
        for joint, unit in enumerate(np.eye(model.nv)):
            mujoco.mj_mulM(model, data, column, unit)
            inertia[joint] += column[joint]
        commands = window.trace.command[:: max(1, len(window.trace.command) // 20)]
        for command in commands:
            data.ctrl[:] = command
            mujoco.mj_forward(model, data)
            square += data.qfrc_actuator**2 / len(commands)
    inertia /= len(windows)
    speed = np.sqrt(np.mean([window.speed**2 for window in windows], axis=0))
    position = np.array([window.position for window in windows])
    travel = np.sqrt(np.mean((position - position.mean(axis=0)) ** 2, axis=0))
    torque = np.sqrt(square / len(windows))
    if not torque.any():  # nothing pulls and nothing drives: what brakes the motion within a window
        torque = inertia * speed / windows[0].t_s[-1]
    command = np.max([np.abs(window.trace.command).max(axis=0, initial=0.0) for window in windows], axis=0)
    slides = mechanism.is_slide
    torque, speed, travel, inertia = (_not_small(values, slides) for values in (torque, speed, travel, inertia))
    return UsualMotion(torque, speed, travel, inertia, command, has_speeds)


def _not_small(values: Floats, slides: NDArray[np.bool_]) -> Floats:
    """A joint that hardly moves or bears counts as a tenth of the largest of its kind; hinges and slides have other units."""
    largest = [float(values[slides == kind].max()) for kind in slides]
    return np.maximum(values, np.maximum(0.1 * np.array(largest), 1e-12))
