"""What differs from stroke to stroke, learnt from the repeats, and what it leaves in their mean.

The rack stands a tenth of a millimetre elsewhere each time and the floor grips a little more. The repeats of one condition tell how
much; their mean keeps that, divided by the root of their number, in directions that the model knows.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import PARAMETERS, Space, Supposed
from rfca_rig.analysis.fitting.scatter import USUAL, found_scatter
from rfca_rig.diagnosis.data.dataset import Dataset

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Scatter:
    """Standard deviations `std` by parameter, and `columns` (m, k): what one of them does to the rows of one condition's mean."""

    std: dict[str, float]
    columns: Floats


def estimate_scatter(evidence: Dataset, supposed: Supposed) -> Scatter:
    """The scatter around what is supposed, usual deviations where repeats are too few to tell."""
    names = tuple(USUAL)
    effect = _effects(evidence, supposed, names)
    usual = np.array([USUAL[name] for name in names])
    std = _learnt(evidence, effect, usual)
    own = effect * (std / usual)
    if evidence.flaps and all(flap.turn.start_rad is not None for flap in evidence.flaps):
        own[:, names.index("start_angle")] = 0.0  # each condition is simulated from the start that was recorded
    return Scatter(dict(zip(names, (float(s) for s in std), strict=True)), _per_condition(evidence, own))


def _effects(evidence: Dataset, supposed: Supposed, names: tuple[str, ...]) -> Floats:
    """What one usual deviation of each does to the rows, (m, k), by central differences."""
    parameters = tuple(PARAMETERS[name] for name in names)
    std = np.array([USUAL[name] for name in names])
    space = Space(tuple(replace(p, relative=False) for p in parameters), supposed, std, np.ones(len(std), dtype=bool))
    steps = np.eye(len(std))
    found = evidence.predicted_all([space.at(x) for x in (*steps, *-steps)])
    zero = np.zeros(len(evidence.rows.measured))
    ahead, behind = found[: len(std)], found[len(std) :]
    return np.column_stack([zero if a is None or b is None else 0.5 * (a - b) for a, b in zip(ahead, behind, strict=True)])


def _learnt(evidence: Dataset, effect: Floats, usual: Floats) -> Floats:
    """From how the repeats of each condition lie about their mean; the mean takes one of them away."""
    rows = evidence.rows
    residuals: list[Floats] = []
    effects: list[Floats] = []
    stroke: list[NDArray[np.intp]] = []
    for number, strokes in enumerate(part.repeats for part in evidence.parts):
        here, count = rows.condition == number, len(strokes)
        if count < 2:
            continue
        noise = np.sqrt(count) * rows.noise[here]
        for deviation in (strokes - strokes.mean(axis=0)) * np.sqrt(count / (count - 1.0)):
            stroke.append(np.full(len(noise), len(stroke)))
            residuals.append(-deviation / noise)
            effects.append(effect[here] / noise[:, None])
    if not residuals:
        return usual
    return found_scatter(usual, np.concatenate(effects), np.concatenate(residuals), np.concatenate(stroke))


def _per_condition(evidence: Dataset, effect: Floats) -> Floats:
    """One column per condition and quantity: conditions deviate independently, and less the more repeats are averaged."""
    condition = evidence.rows.condition
    columns = [
        np.where(condition == number, effect[:, k], 0.0) / np.sqrt(len(strokes))
        for number, strokes in enumerate(part.repeats for part in evidence.parts)
        for k in range(effect.shape[1])
        if np.any(effect[condition == number, k])
    ]
    return np.column_stack(columns) if columns else np.empty((len(condition), 0))
