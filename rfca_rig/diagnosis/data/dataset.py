"""Everything that was recorded, as rows, and the model's answer to the same."""

from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import Supposed
from rfca_rig.crew.cores import cores
from rfca_rig.diagnosis.data.observations import Observations, stacked
from rfca_rig.diagnosis.data.stages import StageTable
from rfca_rig.diagnosis.data.strokes import FlapCondition
from rfca_rig.errors import BadInput, SimulationFailed

Floats = NDArray[np.float64]

THREADS = cores()


class ConditionData(Protocol):
    """One condition of an experiment: its rows, and the model's for the same."""

    @property
    def repeats(self) -> Floats:
        """The rows of each stroke, (r, m), whose mean was measured; (1, 0) where there is one only."""
        ...

    def rows(self) -> Observations:
        """What was measured."""
        ...

    def simulated(self, supposed: Supposed) -> Floats:
        """What the model says, (m,). Raises SimulationFailed."""
        ...


@dataclass(frozen=True)
class Dataset:
    """The conditions, and their rows in the same order."""

    parts: tuple[ConditionData, ...]
    rows: Observations

    @property
    def flaps(self) -> tuple[FlapCondition, ...]:
        """The conditions of the dynamic experiment."""
        return tuple(part for part in self.parts if isinstance(part, FlapCondition))

    @property
    def tables(self) -> tuple[StageTable, ...]:
        """The tables of the static one."""
        return tuple(part for part in self.parts if isinstance(part, StageTable))

    def subset(self, count: int) -> tuple["Dataset", NDArray[np.bool_]]:
        """At most `count` of the dynamic conditions, evenly spread in their order, and at most one of each other kind.

        Returns
        -------
        Dataset, (m,)
            The subset, and which of all rows belong to it.
        """
        kinds: dict[type, list[int]] = {}
        for number, part in enumerate(self.parts):
            kinds.setdefault(type(part), []).append(number)
        kept: set[int] = set()
        for kind, numbers in kinds.items():
            most = 1 if kind is StageTable else count
            kept |= {numbers[i] for i in np.linspace(0, len(numbers) - 1, min(most, len(numbers))).round().astype(int)}
        rows = np.isin(self.rows.condition, list(kept))
        return make_dataset(part for number, part in enumerate(self.parts) if number in kept), rows

    def predicted(self, supposed: Supposed) -> Floats | None:
        """The model's rows (m,), its conditions side by side; None where it has no answer."""
        with ThreadPoolExecutor(THREADS) as pool:
            return _joined(pool.map(lambda part: part.simulated(supposed), self.parts))

    def predicted_all(self, supposed: Sequence[Supposed]) -> list[Floats | None]:
        """The same for many, side by side: the compiled model releases the interpreter lock."""
        with ThreadPoolExecutor(THREADS) as pool:
            return list(pool.map(self._predicted_here, supposed))

    def _predicted_here(self, supposed: Supposed) -> Floats | None:
        return _joined(part.simulated(supposed) for part in self.parts)


def _joined(rows: Iterable[Floats]) -> Floats | None:
    """The rows of all conditions; None where the model has no answer for one of them."""
    try:
        return np.concatenate(list(rows))
    except (SimulationFailed, BadInput):
        return None


def make_dataset(parts: Iterable[ConditionData]) -> Dataset:
    """The evidence of these conditions. Raises BadInput where there is none."""
    parts = tuple(parts)
    if not parts:
        raise BadInput("nothing to diagnose: no stroke shows a touchdown and a valley, and there is no static table")
    return Dataset(parts, stacked([part.rows() for part in parts]))
