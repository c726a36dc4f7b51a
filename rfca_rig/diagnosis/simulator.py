"""Interface between a kind of rig and `inference`, `likelihood` and `decision`.

A kind of rig is diagnosed if it provides four things:

1. Parameters with priors: an `analysis.fitting.space.Space`, whose points are a `SimulatorInput` of
   the simulator's own type.
2. Effects that may be missing: `model.effect.Effect` with the place, the parameters and `apply`,
   which the simulator calls.
3. Conditions, each with its observations. Their `scale` says how a relative error of 1 % of the
   generalised force shows in each signal.
4. A `Simulator`, which predicts these observations.

The core passes inputs and conditions on and never looks inside. Only `Simulator.simulate` is
required; every other method of a simulator has a neutral default. A `Dataset` joins all conditions
of a campaign with the simulator that predicts them.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data import Observations, stack_observations
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.executors.cores import cores
from rfca_rig.executors.parallel import (
    map_in_processes,
    map_in_threads,
    split_evenly,
    split_results,
)
from rfca_rig.model.parameters import PresentEffect

Floats = NDArray[np.float64]


class SimulatorInput(Protocol):
    """The parameters and effects of one simulation, immutable."""

    def with_effects(self, effects: tuple[PresentEffect, ...]) -> Self:
        """The same parameters with these effects added to those that are there.

        Parameters
        ----------
        effects
            Ids with one value per parameter, in the units of the parameters' names.
        """
        ...

    @property
    def effects(self) -> tuple[PresentEffect, ...]:
        """The effects."""
        ...

    def replace_effects(self, effects: tuple[PresentEffect, ...]) -> Self:
        """The same parameters with these effects instead."""
        ...

    @property
    def unchanged(self) -> Self | None:
        """The same before values changed since a reference; None where none has."""
        ...


class ConditionData(Protocol):
    """One condition of an experiment, as it was recorded."""

    @property
    def repeats(self) -> Floats:
        """The observations of each repeat, of which the rows are the mean, (r, m); (1, 0) for a
        single repeat.
        """
        ...

    def rows(self) -> Observations:
        """The measured rows, m of them; the name of each signal ends with its unit."""
        ...


@dataclass(frozen=True)
class ScatterDirection:
    """A quantity that differs from repeat to repeat.

    Parameters
    ----------
    name
        Its name, that of a parameter where it is one.
    std
        Its usual standard deviation, in the unit of that parameter.
    above, below
        The input of the simulator with the quantity one such deviation up and down.
    is_corrected
        Whether each condition is simulated from the recorded value, so that none of the scatter is
        left in the mean over repeats.
    """

    name: str
    std: float
    above: Any
    below: Any
    is_corrected: bool = False


class Simulator(ABC):
    """One kind of rig: predicts the observations of its conditions.

    `Any` stands for the simulator's own types of input (a `SimulatorInput`) and of condition (a
    `ConditionData`).
    """

    @abstractmethod
    def simulate(self, at: Any, condition: Any) -> Floats:
        """The observations that the model predicts.

        Parameters
        ----------
        at
            Parameters and effects.
        condition
            What is simulated.

        Returns
        -------
        (m,)
            In the order and the units of the condition's rows.

        Raises
        ------
        SimulationFailed, BadInput
            Where the model has no answer. The search then stays away from this input.
        """

    def simulate_each(self, at: Any, conditions: Sequence[Any]) -> Iterator[Floats]:
        """The observations (m,) of one condition after the other, as `simulate`.

        A simulator that prepares an input for long does it here once for all conditions.
        """
        for condition in conditions:
            yield self.simulate(at, condition)

    @property
    def varies_many(self) -> bool:
        """Whether `simulate_changes` simulates many inputs faster than one after the other."""
        return False

    def simulate_changes(
        self,
        at: Any,  # noqa: ARG002
        rows: Floats,
        inputs: Sequence[Any],
        condition: Any,
    ) -> list[Floats | None]:
        """The change of the predicted observations from one input to each of others.

        By default the inputs are simulated one after the other.

        Parameters
        ----------
        at, rows
            Parameters and effects, and the observations (m,) that `simulate` predicts there.
        inputs
            Parameters and effects that vary from it.
        condition
            What is simulated.

        Returns
        -------
        list
            Change (m,) for each input; None where the model has no answer.
        """
        changes: list[Floats | None] = []
        for varied in inputs:
            predicted = self.simulate_or_none(varied, condition)
            if predicted is None:
                changes.append(None)
            else:
                changes.append(predicted - rows)
        return changes

    def simulate_or_none(self, at: Any, condition: Any) -> Floats | None:
        """The observations (m,) of `simulate`, or None where the model has no answer."""
        try:
            return self.simulate(at, condition)
        # The search stays away from such inputs.
        except (SimulationFailed, BadInput):
            return None

    def coarsen(self, conditions: Sequence[Any], count: int) -> list[int]:
        """Which conditions are enough to rank effects, ascending: at most `count`, evenly spread
        in their order.
        """
        return spread(len(conditions), count)

    def scatter(self, at: Any, conditions: Sequence[Any]) -> tuple[ScatterDirection, ...]:  # noqa: ARG002
        """The quantities that differ from repeat to repeat, around parameters and effects; none
        by default.
        """
        return ()

    def known_scatter(self, conditions: Sequence[Any]) -> Floats:
        """Directions (m, k), in each of which the observations of all these conditions together may
        vary by one standard deviation; none by default.
        """
        return np.empty((sum(len(part.rows().measured) for part in conditions), 0))

    def forget_history(self, conditions: tuple[Any, ...]) -> tuple[Any, ...]:
        """The conditions before their approach is inferred; the same tuple where there is
        nothing to infer.
        """
        return conditions

    def infer_history(
        self,
        conditions: tuple[Any, ...],
        input_at: Callable[[Floats], Any],  # noqa: ARG002
        x: Floats,  # noqa: ARG002
    ) -> tuple[Any, ...]:
        """The conditions with the most probable approach path; the same tuple where that does not
        differ from the assumed one.

        Parameters
        ----------
        conditions
            All conditions.
        input_at, x
            The input of the simulator as a function of all unknowns (p,), and their values in the
            best explanation.
        """
        return conditions


def spread(number: int, count: int) -> list[int]:
    """At most `count` of the numbers 0 to `number` - 1, evenly spread, ascending."""
    # Rounding may hit one number twice; the set removes it.
    return sorted({int(i) for i in np.linspace(0, number - 1, min(count, number)).round()})


# From so many simulations on, copies of the process are worth their price of up to 0.1 s: a stroke
# takes about 1 ms.
MANY_SIMULATIONS = 200
INPUTS_AT_ONCE = 28
# In the SI unit of any signal: a simulation that predicts more diverges, and its squares overflow.
MOST_PREDICTED = 1e9


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
        subset = make_dataset([self.parts[number] for number in kept], self.simulator)
        return subset, np.isin(self.rows.condition, kept)

    def with_parts(self, parts: tuple[ConditionData, ...]) -> "Dataset":
        """The same simulator with other conditions; the very same dataset where these are its
        own.
        """
        if parts is self.parts:
            return self
        return make_dataset(parts, self.simulator)

    def predicted(self, at: Any) -> Floats | None:
        """The model's rows (m,) at an input of the simulator, conditions in parallel; None where
        the model has no answer.
        """
        groups = split_evenly(self.parts, cores())
        return _join_or_none(map_in_threads(lambda parts: self._predict(at, parts), groups))

    def predict_all(self, inputs: Sequence[Any]) -> list[Floats | None]:
        """The model's rows (m,) for each of many inputs, in parallel: a compiled model releases
        the interpreter lock.
        """

        def predict(at: Any) -> Floats | None:
            return self._predict(at, self.parts)

        # One task per input: nested pools would only oversubscribe the cores.
        apply = map_in_processes if self._is_long(inputs) else map_in_threads
        return apply(predict, inputs)

    def predict_changes(
        self, at: Any, predicted: Floats, inputs: Sequence[Any]
    ) -> list[Floats | None]:
        """Change (m,) of the model's rows from `at`, where they are `predicted` (m,), to each of
        many inputs; None for no answer.
        """
        if not self.simulator.varies_many:
            changes: list[Floats | None] = []
            for rows in self.predict_all(inputs):
                changes.append(None if rows is None else rows - predicted)
            return changes
        # Each block of inputs is simulated beside `at`, so blocks should not be smaller than what
        # is simulated at once.
        is_long = self._is_long(inputs)
        size = INPUTS_AT_ONCE if is_long else max(len(inputs), 1)
        blocks = [inputs[first : first + size] for first in range(0, len(inputs), size)]
        tasks = [(block, number) for block in blocks for number in range(len(self.parts))]

        def predict_block(task: tuple[Sequence[Any], int]) -> list[Floats | None]:
            block, number = task
            rows = predicted[self.rows.condition == number]
            return self.simulator.simulate_changes(at, rows, block, self.parts[number])

        apply = map_in_processes if is_long else map_in_threads
        of_blocks = split_results(apply(predict_block, tasks), [len(self.parts)] * len(blocks))
        joined: list[Floats | None] = []
        for of_parts in of_blocks:
            # Each part has its changes for all inputs of the block.
            joined += [_join_or_none(of_input) for of_input in zip(*of_parts, strict=True)]
        return joined

    def _predict(self, at: Any, parts: Sequence[Any]) -> Floats | None:
        """The model's rows of these conditions; None where it has no answer for one of them."""
        try:
            return _join_or_none(self.simulator.simulate_each(at, parts))
        except (SimulationFailed, BadInput):
            return None

    def _is_long(self, inputs: Sequence[Any]) -> bool:
        return len(inputs) * len(self.parts) >= MANY_SIMULATIONS


def _join_or_none(rows: Iterable[Floats | None]) -> Floats | None:
    """The rows of all conditions; None where the model has no answer for one of them, or diverges
    there.
    """
    answered = []
    for of_condition in rows:
        # The comparison is false for NaN, too.
        if of_condition is None or not np.abs(of_condition).max(initial=0.0) <= MOST_PREDICTED:
            return None
        answered.append(of_condition)
    return np.concatenate(answered)


def make_dataset(parts: Iterable[ConditionData], simulator: Simulator) -> Dataset:
    """The dataset of these conditions. Raises BadInput where there is none."""
    parts = tuple(parts)
    if not parts:
        raise BadInput("nothing to diagnose: no condition can be used")
    return Dataset(parts, stack_observations([part.rows() for part in parts]), simulator)
