"""Recordings of a mechanism cut into windows, with everything that does not depend on the
hypothesis.

The discrepancy of the model refers to generalised forces. An error of 1 % means: the signals are
off as those of the nominal model are when the torque in each joint is off by 1 % of that of weight
and drive.
"""

import copy
from collections.abc import Collection, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.analysis.samples import (
    MARGIN_S,
    SMOOTHING_HALF_WIDTH_S,
    bin_means,
    bin_starts,
    estimate_start,
)
from rfca_rig.campaign.experiment import Experiment, MechanismRun
from rfca_rig.diagnosis.config import USUAL_ERROR
from rfca_rig.diagnosis.data import TRANSIENT_SHARE, group_windows, rms
from rfca_rig.diagnosis.mechanisms.limits import find_cut_commands, lift_cut_commands
from rfca_rig.diagnosis.mechanisms.noise import read_noise
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput, space_of_mechanism
from rfca_rig.diagnosis.mechanisms.windows import (
    CorrectedWindow,
    MechanismSimulator,
    Motions,
    Window,
    correct_rest_window,
    cut_rest_window,
    group_repeats,
)
from rfca_rig.diagnosis.simulator import Dataset, make_dataset, spread
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.executors.parallel import split_results
from rfca_rig.mechanism.contact_law import check_contacts
from rfca_rig.mechanism.effects import list_effects
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.nuisances import START_NUISANCES
from rfca_rig.mechanism.plant import Plant
from rfca_rig.mechanism.prescribed import fit_trajectory
from rfca_rig.mechanism.rollout import CommandTrace, Motion
from rfca_rig.mechanism.usual_motion import UsualMotion, measure_usual_motion
from rfca_rig.suggestions import suggestion

Floats = NDArray[np.float64]

STEP_OF_ERRORS_S = 1e-3  # of what errors do, which is known to some percent at best
# Steps that are tried, each half of the one before, so that the error of one shows against the
# next.
STEPS_S = (8e-3, 4e-3, 2e-3, 1e-3, 5e-4, 2.5e-4, 1.25e-4)
STEADY = 0.02  # relative difference of the readings to those with half the step
# Mean length of the windows in s up to which `most_windows` of them are used: beyond it fewer, so
# that rows and simulated time, and with them the time of a diagnosis, are limited.
LONGEST_MEAN_S = 2.0
# After a contact, until its force no longer shows in the smoothed state.
FLIGHT_MARGIN_S = 0.02
# Distance of two bodies, in the distance that a point may move to the next sample, that counts as
# a contact.
CLOSE_STEPS = 1.5
STATES_LOOKED_AT = 20  # of a motion from rest, evenly spread: enough for an rms
# share of the sensors' and the usual model error together that the integrator may add, rms
STEP_ERROR = 0.1


@dataclass(frozen=True)
class ColumnMatch:
    """How the columns of the recordings map to the model.

    Parameters
    ----------
    signals
        Name of each signal, which ends with its unit.
    columns
        (s,) the column of each signal in positions, speeds and sensors side by side.
    positions
        (n,) which signal holds the position of each joint; -1 where none does.
    actuators
        (c,) the place of the actuator of each recorded command.
    """

    signals: tuple[str, ...]
    columns: NDArray[np.intp]
    positions: NDArray[np.intp]
    actuators: NDArray[np.intp]


@dataclass(frozen=True)
class PreparedMechanism:
    """What is to be diagnosed.

    Parameters
    ----------
    simulator
        The mechanism, with the effects that it may lack.
    space
        The nuisance parameters.
    conditions
        A few windows of each run together.
    usual
        What the recordings show of each joint.
    torque
        (n,) the torques of which USUAL_ERROR is the usual error of the model in each joint.
    recorded_windows
        How many windows the recordings have; the conditions may have fewer.
    experiment, match
        The recordings, and how their columns map to the model.
    lengths_s
        Length of the windows of each recording.
    window_share
        About this share of the windows of each recording is used, evenly spread; all from 1 on.
    """

    simulator: MechanismSimulator
    space: Prior[MechanismInput]
    conditions: tuple[Motions, ...]
    usual: UsualMotion
    torque: Floats
    recorded_windows: int
    experiment: Experiment
    match: ColumnMatch
    lengths_s: tuple[float, ...]
    window_share: float

    @property
    def windows(self) -> int:
        """How many windows the conditions have together."""
        return sum(len(condition.windows) for condition in self.conditions)

    @property
    def chooses_lengths(self) -> bool:
        """Whether the experiment leaves the length of the windows to the diagnosis."""
        return self.experiment.chooses_windows

    @property
    def recordings(self) -> tuple[str, ...]:
        """Names of the recordings."""
        return tuple(run.label for run in self.experiment.runs)

    @property
    def recordings_s(self) -> tuple[float, ...]:
        """The time of each recording that windows can cover."""
        return tuple(
            float(run.t_s[-1] - run.t_s[0]) - SMOOTHING_HALF_WIDTH_S for run in self.experiment.runs
        )

    @cached_property
    def dataset(self) -> Dataset:
        """The conditions with the simulator that predicts them."""
        return make_dataset(self.conditions, self.simulator)

    @property
    def start_std(self) -> Floats:
        """(m,) standard deviation of the nominal prediction of each row, because the measured
        starts have errors.
        """
        return np.concatenate([condition.start_std for condition in self.conditions])

    def cut_again(
        self, lengths_s: Sequence[float], window_share: float | None = None
    ) -> "PreparedMechanism":
        """The same recordings in windows of other lengths; effects and nuisance parameters keep
        their ranges.

        Parameters
        ----------
        lengths_s
            Length of the windows of each recording.
        window_share
            Which share of them is used, where it is not that of [windows].

        Raises
        ------
        BadInput
            Where every such window has a gap.
        SimulationFailed
            Where the nominal model cannot be simulated over such a window.
        """
        cut, recorded, share = _cut_and_thin(
            self.experiment, self.simulator.mechanism, self.match, lengths_s, window_share
        )
        if not any(cut):
            raise BadInput(
                f"{self.experiment.path}: every window of {max(lengths_s):.3g} s has a "
                "gap; give a shorter length_s in [windows]"
            )
        simulator = replace(self.simulator, step_s=STEP_OF_ERRORS_S)
        plant = simulator.plant(MechanismInput())
        corrected_windows = [
            correct_window(window, simulator, plant, self.torque)
            for window in chain.from_iterable(cut)
        ]
        corrected = split_results(corrected_windows, map(len, cut))
        step_s = choose_step(simulator, corrected_windows)
        return replace(
            self,
            simulator=replace(self.simulator, step_s=step_s),
            conditions=_group_conditions(self.experiment, self.match, corrected),
            recorded_windows=recorded,
            lengths_s=tuple(lengths_s),
            window_share=share,
        )

    def check_effects(self, option: str, names: Collection[str]) -> None:
        """Raise BadInput for a name, given with this option, that is no effect of the mechanism."""
        for name in names:
            if name not in self.simulator.effects:
                known = suggestion(name, sorted(self.simulator.effects))
                raise BadInput(f"{option}: {name!r} is no effect of this mechanism; {known}")


def prepare_mechanism(experiment: Experiment, mechanism: Mechanism) -> PreparedMechanism:
    """The windows of all runs, with everything that does not depend on the hypothesis.

    Raises
    ------
    BadInput
        Where a joint or actuator is not in the model, the position of a joint is not measured, or
        no run is long enough.
    SimulationFailed
        Where the nominal model cannot be simulated.
    """
    mechanism = assign_roles(experiment, mechanism)
    match = match_columns(experiment, mechanism)
    lengths_s = (experiment.window_s,) * len(experiment.runs)
    cut, recorded, share = _cut_and_thin(experiment, mechanism, match, lengths_s)
    windows = [window for run_windows in cut for window in run_windows]
    if not windows:
        raise BadInput(f"{experiment.path}: {_describe_no_window(experiment)}")
    # Without effects: ranges of the effects follow from the usual motion, which the plain model
    # gives for starts at rest.
    plain = MechanismSimulator(mechanism, STEP_OF_ERRORS_S, match.columns, {})
    if experiment.starts_at_rest:
        plain = replace(plain, step_s=_find_steady_step(plain, windows))
    motions = [
        plain.roll(plain.plant(MechanismInput()), window) if window.starts_at_rest else None
        for window in windows
    ]
    usual = _measure_usual(experiment, mechanism, windows, motions)
    # USUAL_ERROR of `torque` is then the stated torque error, whatever share that is.
    torque = (
        usual.torque * experiment.known_to.get("torque_error_relative", USUAL_ERROR) / USUAL_ERROR
    )
    effects = {effect.id: effect for effect in list_effects(mechanism, usual)}
    scatters = {
        joint.name: joint.scatter_std
        for joint in experiment.prescribed
        if joint.scatter_std is not None
    }
    simulator = replace(plain, effects=effects, scatters=scatters)
    plant = simulator.plant(MechanismInput())
    corrected_windows = []
    for window, motion in zip(windows, motions, strict=True):
        if motion is None:
            corrected_window = correct_window(window, simulator, plant, torque)
        else:
            corrected_window = correct_rest_window(window, simulator, plant, torque, motion)
        corrected_windows.append(corrected_window)
    corrected = split_results(corrected_windows, map(len, cut))
    # The step is chosen last: its error is compared with the error scales of the corrected windows.
    step_s = choose_step(simulator, corrected_windows)
    conditions = _group_conditions(experiment, match, corrected)
    space = space_of_mechanism(mechanism, experiment.known_to, usual.is_driven, usual.sensors)
    simulator = replace(simulator, step_s=step_s)
    return PreparedMechanism(
        simulator=simulator,
        space=space,
        conditions=conditions,
        usual=usual,
        torque=torque,
        recorded_windows=recorded,
        experiment=experiment,
        match=match,
        lengths_s=lengths_s,
        window_share=share,
    )


def _cut_and_thin(
    experiment: Experiment,
    mechanism: Mechanism,
    match: ColumnMatch,
    lengths_s: Sequence[float],
    share: float | None = None,
) -> tuple[list[list[Window]], int, float]:
    """The windows of each recording that are used, how many there are in all, and the share that is
    used: that of [windows] where none is given. `lengths_s` is that of each recording's windows.
    """
    cut = list_windows(experiment, mechanism, match, lengths_s)
    recorded = sum(len(run_windows) for run_windows in cut)
    recorded_s = sum(float(window.t_s[-1]) for run_windows in cut for window in run_windows)
    if share is None:
        share = min(
            experiment.most_windows / max(recorded, 1),
            experiment.most_windows * LONGEST_MEAN_S / max(recorded_s, 1e-9),
        )
    used = []
    for run_windows in cut:
        count = max(1, round(share * len(run_windows)))
        used.append([run_windows[index] for index in spread(len(run_windows), count)])
    return used, recorded, share


def _group_conditions(
    experiment: Experiment, match: ColumnMatch, corrected: Sequence[Sequence[CorrectedWindow]]
) -> tuple[Motions, ...]:
    """A few windows of one recording after the other as conditions; `corrected` holds the
    windows of each recording.
    """
    conditions = []
    firsts = (
        [runs[0] for runs in group_repeats(experiment.runs)]
        if experiment.starts_at_rest
        else experiment.runs
    )
    for run, run_windows in zip(firsts, corrected, strict=True):
        for part in group_windows(
            run_windows, float(run_windows[0].window.t_s[-1]) if run_windows else 0.0
        ):
            first = part[0].window
            last = part[-1].window
            if experiment.starts_at_rest:
                label = run.condition
            else:
                label = run.label
            name = f"{label}, {first.start_s:.1f} to {last.start_s + last.t_s[-1]:.1f} s"
            conditions.append(Motions(name, run.condition, label, match.signals, tuple(part)))
    return tuple(conditions)


def list_windows(
    experiment: Experiment, mechanism: Mechanism, match: ColumnMatch, lengths_s: Sequence[float]
) -> list[list[Window]]:
    """Windows of each recording, of these lengths. Where motions start at rest, those of each
    condition: none or one.
    """
    if not experiment.starts_at_rest:
        with_lengths = zip(experiment.runs, lengths_s, strict=True)
        return [
            cut_windows(run, experiment, mechanism, match, length_s)
            for run, length_s in with_lengths
        ]
    windows = []
    for runs in group_repeats(experiment.runs):
        window = cut_rest_window(
            runs, experiment, [arrange_commands(run, mechanism, match) for run in runs]
        )
        windows.append([] if window is None else [window])
    return windows


def _measure_usual(
    experiment: Experiment,
    mechanism: Mechanism,
    windows: Sequence[Window],
    motions: Sequence[Motion | None],
) -> UsualMotion:
    """Usual motion of each joint: from the windows' starts, or from the nominal motion where
    windows start at rest.
    """
    position = []
    speed = []
    commands = []
    for window, motion in zip(windows, motions, strict=True):
        if motion is None:
            position.append(window.position)
            speed.append(window.speed)
            commands.append(window.trace.command)
        else:
            looked_at = spread(len(window.t_s), STATES_LOOKED_AT)
            position += list(motion.position[looked_at])
            speed += list(motion.speed[looked_at])
            commands += [window.trace.command[index + 1 : index + 2] for index in looked_at]
    sensors = {}
    for k, signal in enumerate(experiment.signals):
        if signal.quantity == "sensor":
            sensors[signal.name] = rms(np.concatenate([window.measured[k] for window in windows]))
    return measure_usual_motion(
        mechanism,
        position=np.array(position),
        speed=np.array(speed),
        commands=commands,
        seconds=float(windows[0].t_s[-1]),
        has_speeds=any(signal.quantity == "speed" for signal in experiment.signals),
        sensors=sensors,
    )


def _find_steady_step(simulator: MechanismSimulator, windows: Sequence[Window]) -> float:
    """Step in s for the effects of errors: the longest whose readings agree with those of half the
    step to STEADY.

    Raises
    ------
    SimulationFailed
        Where no step is short enough.
    """
    coarse: Floats | None = None
    for step_s in (
        2.0 * STEP_OF_ERRORS_S,
        *(step_s for step_s in STEPS_S if step_s <= STEP_OF_ERRORS_S),
    ):
        fine = None
        coarse_was = coarse
        stepping = replace(simulator, step_s=step_s)
        # A step that is too long may diverge; a shorter one is tried next.
        with suppress(SimulationFailed):
            fine = stepping.follow(stepping.plant(MechanismInput()), windows[0])
        if (
            coarse_was is not None
            and fine is not None
            and rms(coarse_was - fine) < STEADY * rms(fine)
        ):
            return step_s * 2.0
        coarse = fine
    stepping = replace(simulator, step_s=STEPS_S[-1])
    # No pair of steps agreed: the shortest one is used if it can be simulated at all.
    stepping.follow(stepping.plant(MechanismInput()), windows[0])  # says why where it fails
    return STEPS_S[-1]


def choose_step(simulator: MechanismSimulator, windows: Sequence[CorrectedWindow]) -> float:
    """The longest integrator step whose error, estimated with half of it, is negligible in the
    nominal model.

    Raises
    ------
    SimulationFailed
        Where no step is short enough.
    """
    # Some eight windows, spread over all recordings, are enough to judge a step.
    sample = windows[:: max(1, len(windows) // 8)]

    def simulate_all(step_s: float) -> Floats | None:
        stepping = replace(simulator, step_s=step_s)
        plant = stepping.plant(MechanismInput())
        try:
            return np.concatenate(
                [stepping.follow(plant, corrected.window).ravel() for corrected in sample]
            )
        except SimulationFailed:
            return None

    allowed = np.concatenate(
        [
            np.hypot(corrected.window.sensor_std, USUAL_ERROR * corrected.error_scale).ravel()
            for corrected in sample
        ]
    )
    coarse = simulate_all(STEPS_S[0])
    for step_s, finer_s in pairwise(STEPS_S):
        fine = simulate_all(finer_s)
        if (
            coarse is not None
            and fine is not None
            and np.sqrt(np.mean(((coarse - fine) / allowed) ** 2)) < STEP_ERROR
        ):
            return step_s
        coarse = fine
    raise SimulationFailed(
        f"{simulator.mechanism.path}: steps of {1e3 * STEPS_S[-1]:g} ms still change the motion; "
        "look for a slipped decimal point, or a contact or spring that is far too stiff"
    )


def match_columns(experiment: Experiment, mechanism: Mechanism) -> ColumnMatch:
    """Map the columns of the recordings to the model.

    Raises
    ------
    BadInput
        Where a joint, sensor or actuator is not in the model, a unit does not suit, or the position
        of a joint is not measured.
    """
    where = str(experiment.path)
    joints = len(mechanism.joints)
    names = []
    columns = []
    for signal in experiment.signals:
        if signal.quantity == "sensor":
            index, unit = mechanism.sensor_value(signal.name, where)
            expected = unit
            column = 2 * joints + index
        else:
            index = mechanism.joint(signal.name, where)
            expected = ("m" if mechanism.is_slide[index] else "rad") + (
                "/s" if signal.quantity == "speed" else ""
            )
            column = index + joints * (signal.quantity == "speed")
        if signal.unit != expected:
            words = f"the unit of the {signal.quantity} {signal.name!r}"
            raise BadInput(
                f"{where}: {words} does not suit: the model has it in {expected}, not in "
                f"{signal.unit}"
            )
        names.append(
            f"{signal.name}_{signal.quantity}_{expected.replace(' ', '').replace('/', '_')}"
        )
        columns.append(column)
    positions = [columns.index(joint) if joint in columns else -1 for joint in range(joints)]
    actuators = [mechanism.actuator(name, where) for name in experiment.actuators]
    return ColumnMatch(
        tuple(names), np.array(columns), np.array(positions), np.array(actuators, dtype=np.intp)
    )


def assign_roles(experiment: Experiment, mechanism: Mechanism) -> Mechanism:
    """The mechanism with the roles of its joints and contacts as the experiment states them.

    Raises
    ------
    BadInput
        Where a name is not in the model, a joint has two roles, or a joint without a position
        signal would have to start in motion.
    """
    where = str(experiment.path)
    prescribed = tuple(mechanism.joint(joint.name, where) for joint in experiment.prescribed)
    measured = {
        mechanism.joint(signal.name, where)
        for signal in experiment.signals
        if signal.quantity == "position"
    }
    _check_prescribed(experiment, mechanism, prescribed)
    simulated = [joint for joint in range(len(mechanism.joints)) if joint not in prescribed]
    if not simulated:
        raise BadInput(
            f"{where}: every joint is prescribed, so that nothing is simulated; remove a "
            "[[prescribed]] table"
        )
    unmeasured = tuple(joint for joint in simulated if joint not in measured)
    if unmeasured and not experiment.starts_at_rest:
        name = mechanism.joints[unmeasured[0]]
        coupled = mechanism.couplings.get(name)
        if coupled is not None:
            raise BadInput(f"{where}: no signal holds the position of joint {name!r}; {coupled}")
        raise BadInput(
            f"{where}: no signal holds the position of joint {name!r}, so its start "
            "cannot be estimated; "
            'measure it, or record from rest and state = "at rest" in [start]'
        )
    if not experiment.starts_at_rest and (
        key := next((key for key in START_NUISANCES if key in experiment.known_to), None)
    ):
        raise BadInput(
            f'{where}: known_to.{key} is of motions from rest; remove it, or state = "at '
            'rest" in [start]'
        )
    _check_alike(experiment, mechanism)
    check_contacts(mechanism.model, experiment.contacts, where)
    cut = list(find_cut_commands(experiment, mechanism))
    return replace(
        lift_cut_commands(mechanism, cut),
        prescribed=prescribed,
        unmeasured=unmeasured,
        alike=experiment.alike,
        contacts=experiment.contacts,
        has_contacts=mechanism.has_contacts or bool(experiment.contacts),
    )


def _check_prescribed(
    experiment: Experiment, mechanism: Mechanism, prescribed: tuple[int, ...]
) -> None:
    where = str(experiment.path)
    for index, joint in zip(prescribed, experiment.prescribed, strict=True):
        expected = "m" if mechanism.is_slide[index] else "rad"
        if joint.unit != expected:
            raise BadInput(
                f"{where}: the unit of prescribed joint {joint.name!r} does not suit: the "
                f"model has it in {expected}, not in {joint.unit}"
            )
        if any(
            signal.name == joint.name
            for signal in experiment.signals
            if signal.quantity != "sensor"
        ):
            raise BadInput(
                f"{where}: joint {joint.name!r} is prescribed and a signal; remove one: "
                "what is given is not compared"
            )
        if mechanism.driven[index]:
            raise BadInput(
                f"{where}: joint {joint.name!r} is prescribed and has an actuator; remove "
                "the actuator, or simulate the joint"
            )


def _check_alike(experiment: Experiment, mechanism: Mechanism) -> None:
    where = str(experiment.path)
    names = {*mechanism.joints, *mechanism.bodies, *mechanism.actuators}
    members = [member for group in experiment.alike.values() for member in group]
    for index, member in enumerate(members):
        if member not in names:
            raise BadInput(
                f"{where}: alike: {member!r} is no joint, body or actuator of the model; "
                f"{suggestion(member, sorted(names))}"
            )
        if member in members[:index]:
            raise BadInput(f"{where}: alike: {member!r} is in two groups, or twice in one")


def arrange_commands(run: MechanismRun, mechanism: Mechanism, match: ColumnMatch) -> Floats:
    """Commands (m, u) of all actuators of the model; 0 where none was recorded."""
    commands = np.zeros((len(run.t_s), len(mechanism.actuators)))
    commands[:, match.actuators] = run.commands
    return commands


def shortest_recording_s(experiment: Experiment) -> float:
    """Least duration of a recording that has one window, in s."""
    if experiment.starts_at_rest:
        return 2.0 * experiment.bin_s
    # The state at a start is estimated from samples on both sides of it.
    return experiment.window_s + 2.0 * SMOOTHING_HALF_WIDTH_S


def window_starts(run: MechanismRun, experiment: Experiment, length_s: float) -> Floats:
    """Start times (w,) in s of the windows of a run, those with gaps among them."""
    if experiment.starts_at_rest:
        if run.t_s[-1] - run.t_s[0] >= shortest_recording_s(experiment):
            return run.t_s[:1]
        return run.t_s[:0]
    # The tolerance keeps the last window of a recording that is divided evenly.
    return np.arange(run.t_s[0] + SMOOTHING_HALF_WIDTH_S, run.t_s[-1] - length_s + 1e-9, length_s)


def _describe_no_window(experiment: Experiment) -> str:
    """Why no recording has a window that can be used."""
    needed_s = shortest_recording_s(experiment)
    longest_s = max(float(run.t_s[-1] - run.t_s[0]) for run in experiment.runs)
    ask = "in [windows], or is the unit of the time another?"
    if longest_s <= needed_s:
        needs = (
            f"no recording is longer than {needed_s:g} s, which a window of "
            f"{experiment.window_s:g} s needs"
        )
        return f"{needs}; the longest has {longest_s:.3g} s: give a shorter length_s {ask}"
    usual_s = min(float(np.median(np.diff(run.t_s))) for run in experiment.runs)
    gap = (
        f"every window has a gap longer than bin_s = {experiment.bin_s:g} s, as samples are "
        f"{usual_s:.3g} s apart"
    )
    return f"{gap}: give a longer bin_s {ask}"


def cut_windows(
    run: MechanismRun,
    experiment: Experiment,
    mechanism: Mechanism,
    match: ColumnMatch,
    length_s: float,
) -> list[Window]:
    """Windows of one run without a gap; the effects of errors of their starts are not known yet."""
    bin_s = experiment.bin_s
    noise = read_noise(experiment, run)
    read = np.array(sorted(set(range(len(mechanism.joints))) - set(mechanism.prescribed)))
    position = run.signals[:, match.positions[read]]
    position_noise = noise[match.positions[read]]
    trajectory = fit_trajectory(
        run.t_s, run.prescribed, [joint.smoothed_s for joint in experiment.prescribed]
    )
    commands = arrange_commands(run, mechanism, match)
    windows = []
    if mechanism.frames and mechanism.has_contacts and not experiment.holds_impacts:
        starts_s = _list_flight_starts(run, mechanism, match, length_s)
    else:
        starts_s = window_starts(run, experiment, length_s)
    for start_s in starts_s:
        inside = (run.t_s > start_s) & (run.t_s <= start_s + length_s)
        begin_s = max(run.t_s[0], start_s - MARGIN_S)
        end_s = min(run.t_s[-1], start_s + length_s + MARGIN_S)
        around = (run.t_s > start_s - MARGIN_S) & (run.t_s < start_s + length_s + MARGIN_S)
        if np.diff([begin_s, *run.t_s[around], end_s]).max() > bin_s:
            # a gap in it, or one that reaches into it: a bin would be empty, or its start unknown
            continue
        t_s = run.t_s[inside] - start_s
        bins = bin_starts(t_s, bin_s)
        at, speed, at_std, speed_std = np.zeros((4, len(mechanism.joints)))
        at[read], speed[read], at_std[read], speed_std[read] = estimate_start(
            run.t_s, position, float(start_s), position_noise
        )
        follows = trajectory.since(float(start_s))
        prescribed = list(mechanism.prescribed)
        # A prescribed joint starts on its smoothed trajectory, and that start has no error.
        at[prescribed], speed[prescribed] = (values[0] for values in follows.sample(np.zeros(1)))
        counts = np.diff(np.append(bins, len(t_s)))
        measured = bin_means(run.signals[inside], bins).T
        sensor_std = noise[:, None] / np.sqrt(counts)
        if run.noise_factors is not None:
            sensor_std = sensor_std * bin_means(run.noise_factors[inside], bins).T
        windows.append(
            Window(
                start_s=float(start_s),
                since_s=float(start_s - run.t_s[0]),
                trace=CommandTrace(run.t_s[around] - start_s, commands[around], run.driven),
                position=at,
                speed=speed,
                start_std=np.concatenate([at_std, speed_std]),
                t_s=t_s,
                bins=bins,
                measured=measured,
                sensor_std=sensor_std,
                prescribed=follows if prescribed else None,
            )
        )
    return windows


def _list_flight_starts(
    run: MechanismRun, mechanism: Mechanism, match: ColumnMatch, length_s: float
) -> Floats:
    """Start times (w,) in s of windows in which the recorded bodies touch nothing, one after the
    other in each flight.
    """
    touches = find_contacts(mechanism, run.signals[:, match.positions])
    starts_s: list[float] = []
    next_s = float(run.t_s[0]) + SMOOTHING_HALF_WIDTH_S
    for t_s, touching in zip(run.t_s, touches, strict=True):
        if touching:
            # The state at a start is estimated from samples on both sides of it.
            next_s = float(t_s) + FLIGHT_MARGIN_S
        elif t_s - next_s >= length_s:
            starts_s.append(next_s)
            next_s += length_s
    return np.array(starts_s)


def find_contacts(mechanism: Mechanism, position: Floats) -> NDArray[np.bool_]:
    """Whether any two bodies touch, or come as close as they move in a sample, at each of these
    positions (m, n) of the joints, (m,): an impact may fall between two samples.
    """
    import mujoco  # noqa: PLC0415  (optional)

    model = copy.copy(mechanism.model)
    touches = np.zeros(len(position), dtype=bool)
    data = mujoco.MjData(model)
    margins_m = CLOSE_STEPS * _measure_steps(mechanism, position)
    for sample, (at, margin_m) in enumerate(zip(position, margins_m, strict=True)):
        data.qpos[:] = at
        model.geom_margin[:] = mechanism.model.geom_margin + margin_m
        model.pair_margin[:] = mechanism.model.pair_margin + margin_m
        mujoco.mj_fwdPosition(model, data)
        touches[sample] = data.ncon > 0
    return touches


def _measure_steps(mechanism: Mechanism, position: Floats) -> Floats:
    """Distances (m,) that a point of any body moves at most from one sample to the next, at
    positions (m, n).
    """
    steps = np.abs(np.diff(position, axis=0, append=position[-1:]))
    slides = mechanism.is_slide
    # A point as far from the joint as the largest geometry reaches; planes have no end.
    reach_m = float(mechanism.model.geom_rbound.max(initial=0.0))
    return np.asarray(steps[:, slides].sum(axis=1) + reach_m * steps[:, ~slides].sum(axis=1))


def correct_window(
    window: Window, simulator: MechanismSimulator, plant: Plant, torque: Floats
) -> CorrectedWindow:
    """The window with the effects of errors of its start and of the torques on its rows.

    Parameters
    ----------
    window, simulator
        The window, and what predicts it.
    plant
        The nominal plant.
    torque
        (n,) the torques of which USUAL_ERROR is the usual error.
    """
    joints = len(simulator.mechanism.joints)

    def half_difference(ahead: Floats, behind: Floats) -> Floats:
        return np.asarray(0.5 * (ahead - behind))

    def shift(by: Floats) -> Floats:
        if window.position is None or window.speed is None:
            return simulator.follow(plant, window)
        moved = replace(
            window, position=window.position + by[:joints], speed=window.speed + by[joints:]
        )
        return simulator.follow(plant, moved)

    # The torques may be wrong where the actuators are off, too.
    powered = replace(window, trace=replace(window.trace, is_powered=True))

    def push(more: Floats) -> Floats:
        return simulator.follow(replace(plant, torque_offset=plant.torque_offset + more), powered)

    # Central differences of one standard deviation; prescribed values have none and are skipped.
    start_effect = np.stack(
        [half_difference(shift(by), shift(-by)) for by in np.diag(window.start_std) if by.any()]
    )
    pushes = USUAL_ERROR * np.diag(torque)[list(simulator.mechanism.simulated)]
    square = sum((half_difference(push(more), push(-more)) / USUAL_ERROR) ** 2 for more in pushes)
    # The error torques of the joints are independent, so their effects add in squares.
    scale = np.maximum.accumulate(np.sqrt(square), axis=1)  # what has grown stays grown
    return CorrectedWindow(window, start_effect, scale, TRANSIENT_SHARE * scale)
