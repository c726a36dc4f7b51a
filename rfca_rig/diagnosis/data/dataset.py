"""All conditions of a campaign as one vector of observations, with the simulator that predicts them."""

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.observations import Observations, stack_observations
from rfca_rig.diagnosis.simulator import ConditionData, Simulator
from rfca_rig.errors import BadInput
from rfca_rig.executors.cores import cores

Floats = NDArray[np.float64]

THREADS = cores()


@dataclass(frozen=True)
class Dataset:
    """The conditions, their rows in the same order, and the simulator that predicts them."""

    parts: tuple[ConditionData, ...]
    rows: Observations
    simulator: Simulator

    def subset(self, count: int) -> tuple["Dataset", NDArray[np.bool_]]:
        """At most `count` conditions that are enough to rank effects.

        Returns
        -------
        Dataset, (m,)
            The subset, and which of all rows belong to it.
        """
        kept = self.simulator.coarsen(self.parts, count)
        return make_dataset((self.parts[number] for number in kept), self.simulator), np.isin(self.rows.condition, kept)

    def with_parts(self, parts: tuple[ConditionData, ...]) -> "Dataset":
        """The same simulator with other conditions; the very same dataset where these are its own."""
        return self if parts is self.parts else make_dataset(parts, self.simulator)

    def predicted(self, at: Any) -> Floats | None:
        """The model's rows (m,) at an input of the simulator, conditions in parallel; None where the model has no answer."""
        with ThreadPoolExecutor(THREADS) as pool:
            return _join_or_none(pool.map(lambda part: self.simulator.simulate_or_none(at, part), self.parts))

    def predict_all(self, inputs: Sequence[Any]) -> list[Floats | None]:
        """The model's rows (m,) for each of many inputs, in parallel: a compiled model releases the interpreter lock."""
        with ThreadPoolExecutor(THREADS) as pool:
            # One thread per input: nested pools would only oversubscribe the cores.
            return list(pool.map(lambda at: _join_or_none(self.simulator.simulate_or_none(at, part) for part in self.parts), inputs))

    def predict_changes(self, at: Any, predicted: Floats, inputs: Sequence[Any]) -> list[Floats | None]:
        """Change (m,) of the model's rows from `at`, where they are `predicted` (m,), to each of many inputs; None for no answer."""
        if not self.simulator.varies_many:
            return [None if there is None else there - predicted for there in self.predict_all(inputs)]
        rows = [predicted[self.rows.condition == number] for number in range(len(self.parts))]
        with ThreadPoolExecutor(THREADS) as pool:
            by_part = pool.map(lambda part, own: self.simulator.simulate_changes(at, own, inputs, part), self.parts, rows)
            return [_join_or_none(changes) for changes in zip(*by_part, strict=True)]


def _join_or_none(rows: Iterable[Floats | None]) -> Floats | None:
    """The rows of all conditions; None where the model has no answer for one of them."""
    found = []
    for own in rows:
        if own is None:
            return None
        found.append(own)
    return np.concatenate(found)


def make_dataset(parts: Iterable[ConditionData], simulator: Simulator) -> Dataset:
    """The dataset of these conditions. Raises BadInput where there is none."""
    parts = tuple(parts)
    if not parts:
        raise BadInput("nothing to diagnose: no condition can be used")
    return Dataset(parts, stack_observations([part.rows() for part in parts]), simulator)
