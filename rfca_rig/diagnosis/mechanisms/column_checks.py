"""Checks of single columns of recordings: ranges, noise, encoder steps, and what is probably wrong with them."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.swings import sample_std, smallest_step
from rfca_rig.campaign.experiment import Experiment, MechanismRun
from rfca_rig.campaign.layout import ExperimentFile
from rfca_rig.diagnosis.data import rms
from rfca_rig.diagnosis.mechanisms.readings import FOLLOWS, Correction, SpeedRatio, find_wraps, is_one, list_fixes, name_of

Floats = NDArray[np.float64]

COARSE = 50  # steps of an encoder over the whole range, below which they hide the motion
MUCH_NOISE, LITTLE_NOISE = 5.0, 0.05  # times the noise that the samples show: beyond, the stated one is probably in another unit


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


def check_signals(described: ExperimentFile, experiment: Experiment, ratios: Mapping[int, SpeedRatio]) -> Iterator[CheckLine]:
    """A line per signal, and warnings; `ratios` are those of `compare_speeds`."""
    for place, signal in enumerate(described.signals):
        columns = [run.signals[:, place] / signal.factor for run in experiment.runs]
        noise = rms(np.array([float(sample_std(column[:, None])[0]) for column in columns]))
        step = min((step for column in columns if (step := smallest_step(column))), default=0.0)
        low, high = _range_of(columns)
        values = {"low": low, "high": high, "noise": signal.noise_std or noise}
        words = f"{signal.words}: {low:.4g} to {high:.4g} {signal.unit}, "
        words += f"noise {signal.noise_std:.3g} (stated)" if signal.noise_std else f"noise {noise:.2g} (found)"
        # Steps below the noise do not matter: the noise hides them.
        if step > noise:
            values["step"] = step
            words += f", steps of {step:.3g}"
        if place in ratios:
            values["ratio"] = ratios[place].ratio
            words += f", {ratios[place].ratio:.3f} times the derivative of {described.signals[ratios[place].position].column}"
        yield CheckLine("signal", signal.column, words, values=values)
        is_dead, what_is_constant = _constant(signal.column, columns, experiment.runs)
        if what_is_constant:
            ask = "was it measured? If the joint is locked, remove it from the model" if is_dead else "was it recorded there?"
            yield CheckLine("signal", signal.column, f"{what_is_constant}; {ask}", is_warning=True)
        elif step > noise and step * COARSE > high - low:
            message = f"only {(high - low) / step:.0f} steps over the whole range; state a finer column, or expect wide intervals"
            yield CheckLine("signal", signal.column, message, is_warning=True)
        if signal.noise_std and not is_dead and not LITTLE_NOISE * noise <= signal.noise_std <= MUCH_NOISE * noise:
            message = f"noise_std = {signal.noise_std:g} is stated and the samples scatter by {noise:.2g} {signal.unit}; "
            message += f"it is in the unit of the column: set it in {name_of('signals', place, signal)}, or remove it"
            yield CheckLine("signal", signal.column, message, is_warning=True)
        found = ((run, wraps[0]) for run in experiment.runs if (wraps := find_wraps(experiment, run, place)).size)
        # One warning is enough: the fix is the same for all jumps.
        for run, sample in islice(found, 1):
            size = abs(float(run.signals[sample + 1, place] - run.signals[sample, place]) / signal.factor)
            message = f"jumps by {size:.4g} {signal.unit} at {run.t_s[sample + 1]:.4g} s of {run.label}; export the angle unwrapped"
            yield CheckLine("signal", signal.column, message, is_warning=True)


def _range_of(columns: Sequence[Floats]) -> tuple[float, float]:
    return min(float(column.min()) for column in columns), max(float(column.max()) for column in columns)


def _constant(name: str, columns: Sequence[Floats], runs: Sequence[MechanismRun]) -> tuple[bool, str]:
    """Whether a column never changes at all, and in words where it is constant."""
    dead = [run.label for run, column in zip(runs, columns, strict=True) if np.ptp(column) == 0.0]
    if len(dead) == len(runs):
        return True, f"column {name} is {columns[0][0]:g} in all samples"
    return False, f"column {name} never changes in {'; '.join(dead)}" if dead else ""


def check_speeds(
    described: ExperimentFile, ratios: Mapping[int, SpeedRatio], factors: Mapping[str, float], balanced: Collection[str]
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
    for found in ratios.values():
        speed, position = described.signals[found.speed], described.signals[found.position]
        joint = speed.joint or ""
        # A correction of the position changes the ratio already; only the remainder is a fault of the speed.
        ratio = found.ratio / factors[joint]
        if abs(found.correlation) < FOLLOWS:
            message = f"does not follow the derivative of {position.column} (correlation {found.correlation:.2f}); is it of another joint?"
            yield CheckLine("signal", speed.column, message, is_warning=True)
        elif not found.agrees and not is_one(ratio):
            fixes = list_fixes(described, found, ratio, position_is_right=joint in balanced)
            ask = f"set {', or '.join(fixes)}" if fixes else "a gear ratio or counts_per_turn is probably wrong in one of both"
            yield CheckLine("signal", speed.column, f"is {ratio:.4g} times the derivative of {position.column}; {ask}", is_warning=True)


def check_commands(described: ExperimentFile, experiment: Experiment, gains: Sequence[tuple[float, float]]) -> Iterator[CheckLine]:
    """A line per command, and warnings.

    Parameters
    ----------
    described, experiment
        The description, and the experiment that it describes.
    gains
        Of each command, the factor on it that balances the torques best, and its correlation with the torque that the motion needs.
    """
    # Without drive a command may hold anything.
    driven = [run for run in experiment.runs if run.driven]
    for place, (command, (gain, correlation)) in enumerate(zip(described.commands, gains, strict=True)):
        columns = [run.commands[:, place] / command.factor for run in driven]
        if not columns:
            yield CheckLine("command", command.column, f"of {command.actuator}: no recording is driven")
            continue
        low, high = _range_of(columns)
        values = {"low": low, "high": high}
        words = f"of {command.actuator}: {low:.4g} to {high:.4g} {command.unit}"
        if np.isfinite(gain):
            values |= {"gain": gain, "correlation": correlation}
            words += f"; the model needs {gain:.3g} times it for the motion (correlation {correlation:.2f})"
        yield CheckLine("command", command.column, words, values=values)
        _, what_is_constant = _constant(command.column, columns, driven)
        if what_is_constant:
            message = f"{what_is_constant}; is it of {command.actuator}? Set driven = false in recordings where the actuators were off"
            yield CheckLine("command", command.column, message, is_warning=True)


def check_corrections(corrections: Sequence[Correction]) -> Iterator[CheckLine]:
    """A warning for every sign or unit with which the torques balance far better."""
    for one in corrections:
        values = {"before": one.before, "after": one.after}
        yield CheckLine("reading", "signs and units", describe_correction(one), is_warning=True, values=values)


def describe_correction(one: Correction) -> str:
    """What to write instead, and by how much better the torques balance with it."""
    words = ", or ".join(reading.words for reading in (one.reading, *one.alternatives))
    better = f"torques of the model then miss the recorded motion by {100.0 * one.after:.0f} % instead of {100.0 * one.before:.0f} %"
    return f"set {words}; {better}"
