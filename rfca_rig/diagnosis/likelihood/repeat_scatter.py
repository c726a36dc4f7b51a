"""Scatter from repeat to repeat, estimated from the repeats, and what of it remains in their mean.

The rack stands a tenth of a millimetre elsewhere in each repeat, and the friction is a little higher. The repeats of one condition show how
much. In their mean this scatter remains, divided by the root of their number, in directions that the model predicts.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.scatter import estimate_scatter_std
from rfca_rig.diagnosis.simulator import Dataset, ScatterDirection

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RepeatScatter:
    """Standard deviations `std` by parameter, and `columns` (m, k): the effect of one of them on the rows of one condition's mean."""

    std: dict[str, float]
    columns: Floats


def estimate_scatter(dataset: Dataset, at: Any) -> RepeatScatter:
    """The scatter around this input of the simulator; usual deviations where there are too few repeats to estimate it."""
    directions = dataset.simulator.scatter(at, dataset.parts)
    effect = _effects(dataset, directions)
    usual = np.array([direction.std for direction in directions])
    std = _estimate_std(dataset, effect, usual)
    own = effect * (std / usual)
    # A quantity that is simulated from its recorded value leaves no scatter in the mean.
    own[:, [direction.is_corrected for direction in directions]] = 0.0
    return RepeatScatter({direction.name: float(s) for direction, s in zip(directions, std, strict=True)}, _per_condition(dataset, own))


def _effects(dataset: Dataset, directions: Sequence[ScatterDirection]) -> Floats:
    """Effect of one usual deviation of each quantity on the rows, (m, k), by central differences; 0 where the model has no answer."""
    found = dataset.predict_all([*(direction.above for direction in directions), *(direction.below for direction in directions)])
    columns = np.zeros((len(dataset.rows.measured), len(directions)))
    for k, (above, below) in enumerate(zip(found[: len(directions)], found[len(directions) :], strict=True)):
        if above is not None and below is not None:
            columns[:, k] = 0.5 * (above - below)
    return columns


def _estimate_std(dataset: Dataset, effect: Floats, usual: Floats) -> Floats:
    """Standard deviations (k,) from the deviations of the repeats from their mean, by expectation maximisation."""
    rows = dataset.rows
    residuals: list[Floats] = []
    effects: list[Floats] = []
    repeat: list[NDArray[np.intp]] = []
    for number, repeats in enumerate(part.repeats for part in dataset.parts):
        here, count = rows.condition == number, len(repeats)
        if count < 2:
            continue
        # The noise of the rows is that of the mean over the repeats; a single repeat has sqrt(count) times as much.
        noise = np.sqrt(count) * rows.noise[here]
        # The mean uses one degree of freedom; the factor restores the variance of a single repeat.
        for deviation in (repeats - repeats.mean(axis=0)) * np.sqrt(count / (count - 1.0)):
            repeat.append(np.full(len(noise), len(repeat)))
            residuals.append(-deviation / noise)
            effects.append(effect[here] / noise[:, None])
    if not residuals or not len(usual):
        return usual
    return estimate_scatter_std(usual, np.concatenate(effects), np.concatenate(residuals), np.concatenate(repeat))


def _per_condition(dataset: Dataset, effect: Floats) -> Floats:
    """B (m, k): one column per condition and quantity. Conditions scatter independently, and less the more repeats are averaged."""
    condition = dataset.rows.condition
    columns = [
        np.where(condition == number, effect[:, k], 0.0) / np.sqrt(len(repeats))
        for number, repeats in enumerate(part.repeats for part in dataset.parts)
        for k in range(effect.shape[1])
        if np.any(effect[condition == number, k])
    ]
    return np.column_stack(columns) if columns else np.empty((len(condition), 0))
