"""What is probably wrong with the columns of an experiment, without a look at its model.

`check` prints it, and a diagnosis states it beside its answer.
"""

from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from rfca_rig.campaign.column_faults import (
    estimate_lag,
    find_limit,
    find_register_range,
    find_update_period,
)
from rfca_rig.campaign.experiment import Experiment, Glitch, MechanismRun
from rfca_rig.diagnosis.mechanisms.readings import pair_speeds

# Largest lag that is looked for, and the least that is stated: in seconds and in samples. Speeds
# from differences of the position are late by half a sample.
LONGEST_LAG_S = 0.05
LEAST_LAG_S = 0.002
LEAST_LAG_SAMPLES = 0.4
# share of the misfit between a speed and the derivative of its position that the lag removes
EXPLAINED_BY_LAG = 0.5


@dataclass(frozen=True)
class ColumnWarning:
    """Something in a column that is probably wrong, with what to do.

    Parameters
    ----------
    table
        "signal" or "command".
    column
        Its name in the recordings.
    words
        The fault, and what to do.
    """

    table: str
    column: str
    words: str


def check_columns(experiment: Experiment) -> list[ColumnWarning]:
    """Warnings about the columns of all recordings."""
    return [
        *_list_glitches(experiment),
        *_check_signals(experiment),
        *_check_commands(experiment),
        *_check_lags(experiment),
    ]


def _list_glitches(experiment: Experiment) -> Iterator[ColumnWarning]:
    by_column: dict[str, list[tuple[MechanismRun, Glitch]]] = defaultdict(list)
    for run in experiment.runs:
        for glitch in run.glitches:
            by_column[glitch.column].append((run, glitch))
    units = {signal.column: signal.unit for signal in experiment.described.signals}
    for column, glitches in by_column.items():
        run, first = glitches[0]
        if len(glitches) == 1:
            subject = "1 sample jumps away and comes back; it is left out:"
        else:
            subject = f"{len(glitches)} samples jump away and come back; they are left out, first"
        words = f"{subject} by {first.jump:.4g} {units[column]} at {first.t_s:.4g} s of {run.label}"
        yield ColumnWarning("signal", column, words)


def _check_signals(experiment: Experiment) -> Iterator[ColumnWarning]:
    """Unsigned registers, rare updates and limits; a warning of a kind for all recordings."""
    for index, signal in enumerate(experiment.described.signals):
        for run in experiment.runs:
            column = run.signals[:, index] / signal.factor
            faults = [*_list_faults_of_any(run, column)]
            limit = find_limit(column)
            if limit is not None:
                value, samples = limit
                faults.append(
                    f"stays at {value:.4g} {signal.unit} in {samples} samples of {run.label}, each "
                    "time in full motion: the sensor is at its limit; record in a wider range, or "
                    "leave these parts out (from_s, to_s)"
                )
            if faults:
                yield from (ColumnWarning("signal", signal.column, words) for words in faults)
                break


def _check_commands(experiment: Experiment) -> Iterator[ColumnWarning]:
    for index, command in enumerate(experiment.described.commands):
        for run in experiment.runs:
            # A command that is held was averaged over two rows, and has no steps of its own.
            if not run.driven or command.held:
                continue
            column = run.commands[:, index] / command.factor
            faults = [*_list_faults_of_any(run, column)]
            if faults:
                yield from (ColumnWarning("command", command.column, words) for words in faults)
                break


def _list_faults_of_any(run: MechanismRun, column: np.ndarray) -> Iterator[str]:
    register = find_register_range(column)
    if register is not None:
        yield (
            f"jumps across {register:.0f} in {run.label}: a register of {np.log2(register):.0f} "
            f"bits that was read without its sign; subtract {register:.0f} from values above "
            f"{0.5 * register:.0f}"
        )
    period = find_update_period(column)
    if period is not None:
        usual_s = float(np.median(np.diff(run.t_s)))
        yield (
            f"changes only every {period} samples ({period * usual_s:.3g} s) of {run.label}; "
            "record it as fast as the others, or remove it"
        )


def _check_lags(experiment: Experiment) -> Iterator[ColumnWarning]:
    """Speeds that run behind the derivatives of their positions."""
    for speed, position in pair_speeds(experiment):
        lags = []
        for run in experiment.runs:
            usual_s = float(np.median(np.diff(run.t_s)))
            derivative = np.gradient(run.signals[:, position], run.t_s)
            lag = estimate_lag(run.t_s, run.signals[:, speed], derivative, LONGEST_LAG_S)
            least_s = max(LEAST_LAG_S, LEAST_LAG_SAMPLES * usual_s)
            if lag.gain < EXPLAINED_BY_LAG or abs(lag.lag_s) < least_s:
                break
            lags.append(lag.lag_s)
        # A lag of a channel is there in every recording.
        if len(lags) == len(experiment.runs):
            described = experiment.described.signals
            lag_ms = 1e3 * float(np.median(lags))
            direction = "behind" if lag_ms > 0.0 else "ahead of"
            yield ColumnWarning(
                "signal",
                described[speed].column,
                f"runs {abs(lag_ms):.2g} ms {direction} the derivative of "
                f"{described[position].column}; remove it, or expect speed_lag in the answer",
            )
