"""`check_experiment`: whether recordings of a mechanism can be used, and what is probably wrong
with them, one line each.

Positions, speeds and accelerations of the joints at moments of the recordings follow from the
recorded positions alone.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.samples import (
    SMOOTHING_HALF_WIDTH_S,
    local_polynomial,
    smallest_step,
)
from rfca_rig.campaign.column_faults import find_register_range
from rfca_rig.campaign.experiment import Experiment, MechanismRun
from rfca_rig.campaign.layout import ExperimentFile
from rfca_rig.campaign.opening import open_experiment
from rfca_rig.diagnosis.config import FEWEST_CONDITIONS
from rfca_rig.diagnosis.data import WINDOWS_OF_CONDITION, rms
from rfca_rig.diagnosis.inference.map_fit import without_scatter
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.likelihood.marginal_likelihood import laplace_posterior
from rfca_rig.diagnosis.mechanisms.column_checks import check_columns
from rfca_rig.diagnosis.mechanisms.limits import find_limit_conflicts
from rfca_rig.diagnosis.mechanisms.noise import estimate_noise
from rfca_rig.diagnosis.mechanisms.nuisances import MechanismInput, space_of_mechanism
from rfca_rig.diagnosis.mechanisms.prepared import (
    PreparedMechanism,
    arrange_commands,
    assign_roles,
    list_windows,
    match_columns,
    prepare_mechanism,
    shortest_recording_s,
    window_starts,
)
from rfca_rig.diagnosis.mechanisms.readings import (
    FOLLOWS,
    Correction,
    SpeedRatio,
    compare_speeds,
    find_corrections,
    find_wraps,
    is_one,
    list_fixes,
    name_of,
)
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.mechanism.inverse_dynamics import States, TorqueBalance, balance_torques
from rfca_rig.mechanism.load import Mechanism
from rfca_rig.mechanism.nuisances import COMMAND_NUISANCES, NUISANCES, find_places

Floats = NDArray[np.float64]

COARSE = 50  # steps of an encoder over the whole range, below which they hide the motion
# times the noise that the samples show: beyond, the stated one is probably in another unit
MUCH_NOISE = 5.0
LITTLE_NOISE = 0.05

MOST_STATES = 400  # of all recordings together: enough for an rms and a picture

# Delays of the commands that are tried, the least that is stated, and the share of the missing
# torque that may be left with it. Friction and delays of less look alike.
DELAYS_S = np.linspace(-0.05, 0.05, 51)
LEAST_DELAY_S = 0.004
LEFT_BY_DELAY = 0.6

# Conditions that are enough to tell which values the recordings show, and the posterior standard
# deviation, in prior ones, from which a value counts as hidden.
CONDITIONS_LOOKED_AT = 4
HIDDEN_STD = 0.9

BALANCED = 0.3  # imbalance of a joint up to which its sign is right
UNBALANCED = 0.5  # half of the torques have no counterpart: something in the model is wrong


@dataclass(frozen=True)
class CheckLine:
    """One finding of a check.

    Parameters
    ----------
    about, name
        The kind of thing, for example "signal", and which one.
    words
        The finding; for a warning also the fix.
    is_warning
        Whether something is probably wrong.
    values
        The numbers in the words.
    """

    about: str
    name: str
    words: str
    is_warning: bool = False
    values: Mapping[str, float] = field(default_factory=dict)


def check_signals(
    described: ExperimentFile, experiment: Experiment, ratios: Mapping[int, SpeedRatio]
) -> Iterator[CheckLine]:
    """A line per signal, and warnings; `ratios` are those of `compare_speeds`."""
    noises = np.array([estimate_noise(run) for run in experiment.runs])
    for index, signal in enumerate(described.signals):
        columns = [run.signals[:, index] / signal.factor for run in experiment.runs]
        noise = rms(noises[:, index]) / abs(signal.factor)
        step = min((step for column in columns if (step := smallest_step(column))), default=0.0)
        low, high = _range_of(columns)
        values = {"low": low, "high": high, "noise": signal.noise_std or noise}
        words = f"{signal.words}: {low:.4g} to {high:.4g} {signal.unit}, "
        words += (
            f"noise {signal.noise_std:.3g} (stated)"
            if signal.noise_std
            else f"noise {noise:.2g} (found)"
        )
        # Steps below the noise do not matter: the noise hides them.
        if step > noise:
            values["step"] = step
            words += f", steps of {step:.3g}"
        if index in ratios:
            values["ratio"] = ratios[index].ratio
            words += (
                f", {ratios[index].ratio:.3f} times the derivative of "
                f"{described.signals[ratios[index].position].column}"
            )
        yield CheckLine("signal", signal.column, words, values=values)
        is_dead, what_is_constant = _constant(signal.column, columns, experiment.runs)
        if what_is_constant:
            if is_dead:
                ask = "was it measured? If the joint is locked, remove it from the model"
            else:
                ask = "was it recorded there?"
            yield CheckLine("signal", signal.column, f"{what_is_constant}; {ask}", is_warning=True)
        elif step > noise and step * COARSE > high - low:
            message = (
                f"only {(high - low) / step:.0f} steps over the whole range; state a finer "
                "column, or expect wide intervals"
            )
            yield CheckLine("signal", signal.column, message, is_warning=True)
        if (
            signal.noise_std
            and not is_dead
            and not LITTLE_NOISE * noise <= signal.noise_std <= MUCH_NOISE * noise
        ):
            message = (
                f"noise_std = {signal.noise_std:g} is stated and the samples scatter by "
                f"{noise:.2g} {signal.unit}; "
            )
            message += (
                "it is in the unit of the column: set it in "
                f"{name_of('signals', index, signal)}, or remove it"
            )
            yield CheckLine("signal", signal.column, message, is_warning=True)
        jumps = (
            (run, wraps[0])
            for run, column in zip(experiment.runs, columns, strict=True)
            if (wraps := find_wraps(experiment, run, index)).size
            and find_register_range(column) is None
        )
        # One warning is enough: the fix is the same for all jumps.
        for run, sample in islice(jumps, 1):
            size = abs(
                float(run.signals[sample + 1, index] - run.signals[sample, index]) / signal.factor
            )
            message = (
                f"jumps by {size:.4g} {signal.unit} at {run.t_s[sample + 1]:.4g} s of "
                f"{run.label}; export the angle unwrapped"
            )
            yield CheckLine("signal", signal.column, message, is_warning=True)


def _range_of(columns: Sequence[Floats]) -> tuple[float, float]:
    return min(float(column.min()) for column in columns), max(
        float(column.max()) for column in columns
    )


def _constant(
    name: str, columns: Sequence[Floats], runs: Sequence[MechanismRun]
) -> tuple[bool, str]:
    """Whether a column never changes at all, and in words where it is constant."""
    dead = [run.label for run, column in zip(runs, columns, strict=True) if np.ptp(column) == 0.0]
    if len(dead) == len(runs):
        return True, f"column {name} is {columns[0][0]:g} in all samples"
    return False, f"column {name} never changes in {'; '.join(dead)}" if dead else ""


def check_speeds(
    described: ExperimentFile,
    ratios: Mapping[int, SpeedRatio],
    factors: Mapping[str, float],
    balanced: Collection[str],
) -> Iterator[CheckLine]:
    """A warning for every speed that is not the derivative of its position.

    Parameters
    ----------
    described
        The description.
    ratios
        Those of `compare_speeds`.
    factors
        On the positions of joints, those of the corrections that were found.
    balanced
        Joints whose torques balance, so that the sign of their position is right.
    """
    for speed_ratio in ratios.values():
        speed = described.signals[speed_ratio.speed]
        position = described.signals[speed_ratio.position]
        joint = speed.joint or ""
        # A correction of the position changes the ratio already; only the remainder is a fault of
        # the speed.
        ratio = speed_ratio.ratio / factors[joint]
        if abs(speed_ratio.correlation) < FOLLOWS:
            message = (
                f"does not follow the derivative of {position.column} (correlation "
                f"{speed_ratio.correlation:.2f}); is it of another joint?"
            )
            yield CheckLine("signal", speed.column, message, is_warning=True)
        elif not speed_ratio.agrees and not is_one(ratio):
            fixes = list_fixes(described, speed_ratio, ratio, position_is_right=joint in balanced)
            if fixes:
                ask = f"set {', or '.join(fixes)}"
            else:
                ask = "a gear ratio or counts_per_turn is probably wrong in one of both"
            yield CheckLine(
                "signal",
                speed.column,
                f"is {ratio:.4g} times the derivative of {position.column}; {ask}",
                is_warning=True,
            )


def check_commands(
    described: ExperimentFile, experiment: Experiment, gains: Sequence[tuple[float, float]]
) -> Iterator[CheckLine]:
    """A line per command, and warnings.

    Parameters
    ----------
    described, experiment
        The description, and the experiment that it describes.
    gains
        Of each command, the factor on it that balances the torques best, and its correlation with
        the torque that the motion needs.
    """
    # Without drive a command may hold anything.
    driven = [run for run in experiment.runs if run.driven]
    for index, (command, (gain, correlation)) in enumerate(
        zip(described.commands, gains, strict=True)
    ):
        columns = [run.commands[:, index] / command.factor for run in driven]
        if not columns:
            yield CheckLine(
                "command", command.column, f"of {command.actuator}: no recording is driven"
            )
            continue
        low, high = _range_of(columns)
        values = {"low": low, "high": high}
        words = f"of {command.actuator}: {low:.4g} to {high:.4g} {command.unit}"
        if np.isfinite(gain):
            values |= {"gain": gain, "correlation": correlation}
            words += (
                f"; the model needs {gain:.3g} times it for the motion (correlation "
                f"{correlation:.2f})"
            )
        yield CheckLine("command", command.column, words, values=values)
        _, what_is_constant = _constant(command.column, columns, driven)
        if what_is_constant:
            message = (
                f"{what_is_constant}; is it of {command.actuator}? Set driven = false in "
                "recordings where the actuators were off"
            )
            yield CheckLine("command", command.column, message, is_warning=True)


def check_delay(
    experiment: Experiment, mechanism: Mechanism, states: States
) -> Iterator[CheckLine]:
    """A warning where the torques balance far better with later commands, or earlier ones."""
    if not experiment.actuators or not len(states.position):
        return
    moments_s = _list_moments(experiment, mechanism)
    misses = []
    for delay_s in DELAYS_S:
        commands = read_commands(experiment, mechanism, moments_s, float(delay_s))
        balance = balance_torques(mechanism, replace(states, command=commands))
        misses.append(_measure_unexplained(balance, states))
    # Squares are closer to a parabola.
    delay_s, square = locate_minimum(DELAYS_S, np.array(misses) ** 2)
    least = float(np.sqrt(max(square, 0.0)))
    now = misses[int(np.argmin(np.abs(DELAYS_S)))]
    sample_s = float(np.median(np.concatenate([np.diff(run.t_s) for run in experiment.runs])))
    if abs(delay_s) < max(LEAST_DELAY_S, sample_s) or least > LEFT_BY_DELAY * now:
        return
    direction = "later" if delay_s > 0.0 else "earlier"
    words = f"they act about {1e3 * abs(delay_s):.0f} ms {direction} than recorded"
    yield CheckLine(
        "command",
        "all commands",
        f"{words}: torques of the model then miss the motion by {100.0 * least:.2g} % instead of "
        f"{100.0 * now:.2g} %; shift the commands in the recordings, or state "
        "command_delay_s in [known_to]",
        is_warning=True,
        values={"delay_s": delay_s, "before": now, "after": least},
    )


def _measure_unexplained(balance: TorqueBalance, states: States) -> float:
    """Rms of the torques that friction and inertia of the joints do not explain either, over that
    of the actuators: both change with a delay, and must not be taken for one.
    """
    missing = 0.0
    driven_joints = 0
    for joint in range(states.position.shape[1]):
        speed = states.speed[:, joint]
        laws = np.column_stack(
            [speed, np.sign(speed), states.acceleration[:, joint], np.ones(len(speed))]
        )
        torque = balance.by_actuator[:, :, joint].sum(axis=1)
        if not torque.any():
            continue
        remainder = balance.remainder[:, joint] / rms(torque)
        fitted = laws @ np.linalg.lstsq(laws, remainder, rcond=None)[0]
        missing += float(np.mean((remainder - fitted) ** 2))
        driven_joints += 1
    return float(np.sqrt(missing / max(driven_joints, 1)))


def locate_minimum(places: Floats, values: Floats) -> tuple[float, float]:
    """Place and value of the least of some values (k,) at even places (k,), between them by a
    parabola.
    """
    least = int(np.argmin(values))
    if least in (0, len(values) - 1):
        return float(places[least]), float(values[least])
    before, here, after = values[least - 1 : least + 2]
    bend = before - 2.0 * here + after
    if bend <= 0.0:
        return float(places[least]), float(here)
    shift = 0.5 * (before - after) / bend
    step = float(places[1] - places[0])
    return float(places[least] + shift * step), float(here - 0.25 * (before - after) * shift)


def check_corrections(corrections: Sequence[Correction]) -> Iterator[CheckLine]:
    """A warning for every sign or unit with which the torques balance far better."""
    for correction in corrections:
        values = {"before": correction.before, "after": correction.after}
        yield CheckLine(
            "reading",
            "signs and units",
            describe_correction(correction),
            is_warning=True,
            values=values,
        )


def describe_correction(one: Correction) -> str:
    """What to write instead, and by how much better the torques balance with it."""
    words = ", or ".join(reading.words for reading in (one.reading, *one.alternatives))
    better = (
        f"torques of the model then miss the recorded motion by {100.0 * one.after:.0f} % "
        f"instead of {100.0 * one.before:.0f} %"
    )
    return f"set {words}; {better}"


def can_balance(mechanism: Mechanism) -> bool:
    """Whether the torques of recorded states balance in the model: every state is known, and no
    force acts beside MuJoCo's.
    """
    return not (mechanism.unmeasured or mechanism.prescribed or mechanism.contacts)


def estimate_states(experiment: Experiment, mechanism: Mechanism) -> States:
    """States at moments spread evenly over all recordings, from the recorded positions.

    Parameters
    ----------
    experiment
        The recordings.
    mechanism
        The nominal mechanism with n joints.

    Returns
    -------
    States
        (k, n) positions, speeds and accelerations; none within a gap, and none at all unless the
        mechanism `can_balance`.

    Raises
    ------
    BadInput
        As `match_columns`.
    """
    match = match_columns(experiment, mechanism)
    moments_s = _list_moments(experiment, mechanism)
    derivatives: list[list[Floats]] = []
    for run, of_run_s in zip(experiment.runs, moments_s, strict=True):
        recorded = run.signals[:, match.positions]
        for at_s in of_run_s:
            local = local_polynomial(run.t_s, recorded, at_s)
            derivatives.append([local.derivative(order) for order in range(3)])
    shape = (len(derivatives), 3, len(mechanism.joints))
    position, speed, acceleration = np.moveaxis(np.array(derivatives).reshape(shape), 1, 0)
    return States(
        position, speed, acceleration, read_commands(experiment, mechanism, moments_s, 0.0)
    )


def read_commands(
    experiment: Experiment, mechanism: Mechanism, moments_s: Sequence[Floats], delay_s: float
) -> Floats:
    """Commands (k, u) of all actuators that act at these moments of each recording, k in all, if
    they are late by `delay_s`.
    """
    match = match_columns(experiment, mechanism)
    commands = [np.empty((0, len(mechanism.actuators)))]
    for run, of_run_s in zip(experiment.runs, moments_s, strict=True):
        acting = np.empty((len(of_run_s), len(mechanism.actuators)))
        for actuator, column in enumerate(arrange_commands(run, mechanism, match).T):
            acting[:, actuator] = np.interp(of_run_s - delay_s, run.t_s, column)
        commands.append(acting)
    return np.concatenate(commands)


def _list_moments(experiment: Experiment, mechanism: Mechanism) -> list[Floats]:
    """Moments spread evenly over each recording, none within a gap; none at all unless the
    mechanism `can_balance`.
    """
    if not can_balance(mechanism):
        return [np.empty(0) for _ in experiment.runs]
    total_s = sum(float(run.t_s[-1] - run.t_s[0]) for run in experiment.runs)
    apart_s = max(experiment.bin_s, total_s / MOST_STATES)
    moments_s = []
    for run in experiment.runs:
        of_run_s = []
        for at_s in np.arange(
            run.t_s[0] + SMOOTHING_HALF_WIDTH_S, run.t_s[-1] - SMOOTHING_HALF_WIDTH_S, apart_s
        ):
            # A local polynomial over a gap would invent the motion there.
            near_s = run.t_s[np.abs(run.t_s - at_s) <= SMOOTHING_HALF_WIDTH_S]
            if near_s.size > 1 and np.diff(near_s).max() <= experiment.bin_s:
                of_run_s.append(float(at_s))
        moments_s.append(np.array(of_run_s))
    return moments_s


def check_experiment(folder: Path, allow_outside: bool = False) -> Iterator[CheckLine]:
    """Check the description, the model and the recordings in a folder; one line per finding.

    Parameters
    ----------
    folder
        With experiment.toml or pendulum.toml.

    Yields
    ------
    CheckLine
        What was found, and what is probably wrong.

    Raises
    ------
    BadInput
        For the first thing that cannot be used.
    """
    experiment = open_experiment(folder, allow_outside)
    described = experiment.described
    loaded = experiment.load_model()
    mechanism = assign_roles(experiment, loaded)
    yield _describe_model(mechanism)
    for part in mechanism.dropped:
        yield CheckLine("model", mechanism.path.name, f"left out: {part}")
    for conflict in find_limit_conflicts(experiment, loaded):
        yield CheckLine(
            conflict.table,
            conflict.column,
            conflict.words,
            is_warning=True,
            values={"share": conflict.share},
        )
    yield from _check_windows(experiment, mechanism)
    ratios = compare_speeds(experiment)
    yield from check_signals(described, experiment, ratios)
    for warning in check_columns(experiment):
        yield CheckLine(warning.table, warning.column, warning.words, is_warning=True)
    states = estimate_states(experiment, mechanism)
    balance = balance_torques(mechanism, states)
    shares = _imbalances(mechanism, balance)
    if not can_balance(mechanism):
        words = (
            "not checked: it needs the state of every joint, no prescribed joint, and "
            "MuJoCo's own contacts"
        )
        yield CheckLine("balance", "all joints", words)
    corrections: Sequence[Correction] = ()
    if not experiment.frames:
        corrections = find_corrections(described, mechanism, states, ratios)
    for name, share in shares.items():
        # A wrong sign or unit is one warning, which names the fix.
        is_model = not corrections and all(ratio.agrees for ratio in ratios.values())
        yield _describe_balance(name, share, is_model)
    yield from check_corrections(corrections)
    # Later checks use corrected states, so that one wrong sign is not reported as several mistakes.
    factors = np.ones(len(mechanism.joints))
    for correction in corrections:
        states = correction.reading.apply(states)
        factors = factors * correction.reading.position
        balance = balance_torques(mechanism, states)
    corrected = {
        name for name, share in _imbalances(mechanism, balance).items() if share < BALANCED
    }
    yield from check_speeds(
        described, ratios, dict(zip(mechanism.joints, factors, strict=True)), corrected
    )
    yield from check_commands(
        described, experiment, list(_gains(experiment, mechanism, balance, corrections))
    )
    if not corrections:
        yield from check_delay(experiment, mechanism, states)
    yield from _check_priors(experiment, mechanism)
    try:
        problem = prepare_mechanism(experiment, mechanism)
        # A bad prediction is blamed on the model of a joint only if its columns are read correctly.
        is_read_right = not corrections and all(ratio.agrees for ratio in ratios.values())
        upset = [name for name, share in shares.items() if share >= BALANCED and is_read_right]
        yield from _check_prediction(problem, described, experiment, upset)
        yield from _check_identifiability(problem)
    except SimulationFailed as error:
        # The path stands in front of the whole message already.
        message = str(error).removeprefix(f"{experiment.model}: ")
        raise BadInput(
            f"{experiment.model}: the nominal model cannot be simulated from the recorded "
            f"states: {message}"
        ) from None
    step_s = problem.simulator.step_s
    words = (
        f"{problem.simulator.integrator} with steps of {1e3 * step_s:g} ms, whose error is "
        "below a tenth of noise and usual model error"
    )
    yield CheckLine("integrator", "step", words, values={"step_s": step_s})
    yield _check_conditions(problem, experiment)


def _describe_balance(name: str, share: float, is_model: bool) -> CheckLine:
    """How well the torques of a joint balance; a warning where the model is a poor one, and not a
    column.
    """
    digits = 1
    if share >= 0.1:
        digits = 0
    words = (
        "inertia, weight and drive of the model balance in the recorded motion to "
        f"{100.0 * share:.{digits}f} %"
    )
    is_poor = is_model and share > UNBALANCED
    if is_poor:
        words += (
            "; look at the zero and the sign of the joint (ref, axis), at gravcomp, range, springs "
            "and damping in the model, and at the units of the columns"
        )
    return CheckLine("balance", name, words, is_poor, {"imbalance": share})


def refuse_misread_columns(experiment: Experiment, mechanism: Mechanism) -> None:
    """Refuse recordings of which a column probably has another sign or unit than stated.

    Raises
    ------
    BadInput
        With what to write instead, where the torques of the nominal model balance far better with
        it.
    """
    for run in experiment.runs:
        for conflict in run.conflicts:
            raise BadInput(
                f"{experiment.path}: column {conflict.column} of {run.label}: {conflict.words}, "
                "or take it with --as-is"
            )
    for limit in find_limit_conflicts(experiment, mechanism):
        if not limit.is_cut:
            raise BadInput(f"{experiment.model}: {limit.words}, or take it with --as-is")
    # The file of a pendulum states no signs or units that could be corrected.
    # Nor do the joints of a free body.
    if experiment.mjcf or experiment.frames:
        return
    described = experiment.described
    roles = assign_roles(experiment, mechanism)
    corrections = find_corrections(
        described, roles, estimate_states(experiment, roles), compare_speeds(experiment)
    )
    if corrections:
        if len(corrections) > 1:
            more = f" ({len(corrections) - 1} more: rfca-rig check {experiment.path.parent})"
        else:
            more = ""
        raise BadInput(
            f"{experiment.path}: {describe_correction(corrections[0])}{more}; correct it, "
            "or take it with --as-is"
        )


def _describe_model(mechanism: Mechanism) -> CheckLine:
    joints = [
        f"{'slide' if slides else 'hinge'} {name}"
        for name, slides in zip(mechanism.joints, mechanism.is_slide, strict=True)
    ]
    masses = mechanism.model.body_mass[1:]
    bodies = [
        f"{name} {mass:.3g} kg"
        for name, mass in zip(mechanism.bodies, masses, strict=True)
        if mass > 0.0
    ]
    words = (
        f"{', '.join(joints)}; actuators {', '.join(mechanism.actuators) or 'none'}; bodies "
        f"{', '.join(bodies)}"
    )
    return CheckLine("model", mechanism.path.name, words, values={"mass_kg": float(masses.sum())})


def _check_windows(experiment: Experiment, mechanism: Mechanism) -> Iterator[CheckLine]:
    """A line per recording, and a warning where a part of it cannot be used."""
    match = match_columns(experiment, mechanism)
    for run in experiment.runs:
        steps_s = np.diff(run.t_s)
        all_windows = len(window_starts(run, experiment, experiment.window_s))
        cut = list_windows(
            replace(experiment, runs=(run,)), mechanism, match, (experiment.window_s,)
        )
        used = sum(len(run_windows) for run_windows in cut)
        length_s = float(run.t_s[-1] - run.t_s[0])
        rate_Hz = 1.0 / float(np.median(steps_s))
        gap_s = float(steps_s.max())
        words = f"{length_s:.4g} s at {rate_Hz:.4g} Hz, largest gap {1e3 * gap_s:.3g} ms, "
        if experiment.starts_at_rest:
            words += f"{'can' if used else 'cannot'} be used as a whole, from rest"
        else:
            words += f"{used} of {all_windows} windows of {experiment.window_s:g} s can be used"
        words += "" if run.driven or not experiment.actuators else ", not driven"
        values = {
            "length_s": length_s,
            "rate_Hz": rate_Hz,
            "largest_gap_s": gap_s,
            "windows": all_windows,
            "usable_windows": used,
        }
        yield CheckLine("recording", run.label, words, values=values)
        for note in run.notes:
            yield CheckLine("recording", run.label, note)
        for conflict in run.conflicts:
            yield CheckLine("signal", conflict.column, conflict.words, is_warning=True)
        if not all_windows:
            message = (
                f"too short for a window, which needs {shortest_recording_s(experiment):g} s; "
                "it is not used"
            )
            yield CheckLine("recording", run.label, message, is_warning=True)
        elif used < all_windows and not mechanism.frames:
            message = (
                f"{all_windows - used} windows hold or touch a gap of more than bin_s = "
                f"{experiment.bin_s:g} s and are not used; "
            )
            yield CheckLine(
                "recording",
                run.label,
                f"{message}a longer bin_s in [windows] allows gaps",
                is_warning=True,
            )


def _imbalances(mechanism: Mechanism, balance: TorqueBalance) -> dict[str, float]:
    """Imbalance of the torques of each joint, as a share; none without states."""
    if len(balance.inertial):
        return dict(zip(mechanism.joints, balance.imbalance.tolist(), strict=True))
    return {}


def _gains(
    experiment: Experiment,
    mechanism: Mechanism,
    balance: TorqueBalance,
    corrections: Sequence[Correction],
) -> Iterator[tuple[float, float]]:
    """Gain and correlation of each command as it is stated; the balance is that of corrected
    states.
    """
    for name in experiment.actuators:
        actuator = mechanism.actuators.index(name)
        # The gain was found for the corrected command; it is converted back to the column as
        # stated.
        factor = float(
            np.prod([correction.reading.command[actuator] for correction in corrections])
        )
        gain, correlation = balance.gain(actuator)
        yield gain * factor, correlation * float(np.sign(factor))


def _check_priors(experiment: Experiment, mechanism: Mechanism) -> Iterator[CheckLine]:
    """How many nuisance parameters [known_to] makes, and the keys that make none."""
    is_driven = any(run.driven for run in experiment.runs)
    sensors = [signal.name for signal in experiment.signals if signal.quantity == "sensor"]
    count = len(space_of_mechanism(mechanism, experiment.known_to, is_driven, sensors).parameters)
    yield CheckLine(
        "known_to", "priors", f"{count} nuisance parameters", values={"parameters": count}
    )
    for key in experiment.known_to:
        if key in NUISANCES and not find_places(mechanism, NUISANCES[key].objects):
            yield CheckLine(
                "known_to",
                key,
                f"the model has no {NUISANCES[key].objects}; remove it",
                is_warning=True,
            )
        elif key in COMMAND_NUISANCES and not is_driven:
            yield CheckLine(
                "known_to",
                key,
                "no recording is driven, so that it changes nothing; remove it",
                is_warning=True,
            )


def _check_prediction(
    problem: PreparedMechanism,
    described: ExperimentFile,
    experiment: Experiment,
    upset: Collection[str],
) -> Iterator[CheckLine]:
    """Rms error of the nominal model in each signal.

    A warning follows where the error is larger than the change of the signal, for positions of the
    joints in `upset`.
    """
    plant = problem.simulator.plant(MechanismInput())
    windows = [corrected for condition in problem.conditions for corrected in condition.windows]
    misses = [
        corrected.window.measured - problem.simulator.predict(plant, corrected)
        for corrected in windows
    ]
    changes = [
        corrected.window.measured - corrected.window.measured[:, :1] for corrected in windows
    ]
    if experiment.starts_at_rest:
        where = "motions from rest"
    else:
        where = f"windows of {experiment.window_s:g} s"
    for index, signal in enumerate(described.signals):
        miss = rms(np.concatenate([values[index] for values in misses])) / abs(signal.factor)
        change = rms(np.concatenate([values[index] for values in changes])) / abs(signal.factor)
        words = f"the nominal model misses it by {miss:.3g} {signal.unit} (rms) over {where}, "
        words += f"in which it changes by {change:.3g} {signal.unit}"
        is_wrong = miss > change and signal.quantity == "position" and signal.joint in upset
        if miss > change and not is_wrong:
            words += (
                "; it misses by more than the signal changes: check its sign, unit and zero "
                "before the diagnosis"
            )
        yield CheckLine("prediction", signal.column, words, values={"miss": miss, "change": change})
        if is_wrong:
            message = (
                "that is worse than no motion at all; correct the model of this joint, or "
                "its columns"
            )
            yield CheckLine("prediction", signal.column, message, is_warning=True)


def _check_identifiability(problem: PreparedMechanism) -> Iterator[CheckLine]:
    """Which values of [known_to] the recordings show, by the nominal model."""
    names = problem.space.names
    if not names:
        return
    subset, _ = problem.dataset.subset(CONDITIONS_LOOKED_AT)
    optimizer = without_scatter(subset)
    coordinates = Parameterization(problem.space)
    nominal = optimizer.at(coordinates, np.zeros(coordinates.size))
    if nominal is None:
        return
    linear = nominal.linear(subset.rows.measured)
    posterior = laplace_posterior(linear, optimizer.likelihood.usual)
    std = np.sqrt(np.diag(posterior.covariance))
    hidden = [name for name, share in zip(names, std, strict=True) if share > HIDDEN_STD]
    words = f"these recordings show {len(names) - len(hidden)} of {len(names)} values"
    if hidden:
        words += f", but not {', '.join(hidden)}: they stay as uncertain as stated"
    values = dict(zip(names, std.tolist(), strict=True))
    yield CheckLine("known_to", "identifiability", words, values=values)


def _check_conditions(problem: PreparedMechanism, experiment: Experiment) -> CheckLine:
    """Whether there are enough stretches for a diagnosis."""
    count = len(problem.conditions)
    values = {"conditions": len(problem.conditions)}
    if experiment.starts_at_rest:
        of = "motions from rest"
    else:
        of = f"stretches of about {WINDOWS_OF_CONDITION} windows"
    words = f"{count} {of}, each predicted from the others"
    if count < FEWEST_CONDITIONS:
        return CheckLine(
            "diagnosis",
            "conditions",
            f"{words}; diagnose needs {FEWEST_CONDITIONS}: record more",
            True,
            values,
        )
    return CheckLine("diagnosis", "conditions", words, values=values)
