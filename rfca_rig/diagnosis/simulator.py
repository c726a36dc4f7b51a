"""Interface between a kind of rig and `inference`, `likelihood` and `decision`.

A kind of rig is diagnosed if it provides four things:

1. Parameters with priors: an `analysis.fitting.space.Space`, whose points are a `SimulatorInput` of the simulator's own type.
2. Effects that may be missing: `model.effect.Effect` with the place, the parameters and `apply`, which the simulator calls.
3. Conditions, each with its observations. Their `scale` says how a relative error of 1 % of the generalised force shows in each signal.
4. A `Simulator`, which predicts these observations.

The core passes inputs and conditions on and never looks inside. Only `Simulator.simulate` is required; every other method of a simulator
has a neutral default.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.data.observations import Observations
from rfca_rig.errors import BadInput, SimulationFailed
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


class ConditionData(Protocol):
    """One condition of an experiment, as it was recorded."""

    @property
    def repeats(self) -> Floats:
        """The observations of each repeat, of which the rows are the mean, (r, m); (1, 0) for a single repeat."""
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
        Whether each condition is simulated from the recorded value, so that none of the scatter is left in the mean over repeats.
    """

    name: str
    std: float
    above: Any
    below: Any
    is_corrected: bool = False


class Simulator(ABC):
    """One kind of rig: predicts the observations of its conditions.

    `Any` stands for the simulator's own types of input (a `SimulatorInput`) and of condition (a `ConditionData`).
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

    @property
    def varies_many(self) -> bool:
        """Whether `simulate_changes` simulates many inputs faster than one after the other."""
        return False

    def simulate_changes(self, at: Any, rows: Floats, inputs: Sequence[Any], condition: Any) -> list[Floats | None]:  # noqa: ARG002
        """The change of the predicted observations from one input to each of others; by default, one is simulated after the other.

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
        return [None if (there := self.simulate_or_none(each, condition)) is None else there - rows for each in inputs]

    def simulate_or_none(self, at: Any, condition: Any) -> Floats | None:
        """The observations (m,) of `simulate`, or None where the model has no answer."""
        try:
            return self.simulate(at, condition)
        # The search stays away from such inputs.
        except (SimulationFailed, BadInput):
            return None

    def coarsen(self, conditions: Sequence[Any], count: int) -> list[int]:
        """Which conditions are enough to rank effects, ascending: at most `count`, evenly spread in their order."""
        return spread(len(conditions), count)

    def scatter(self, at: Any, conditions: Sequence[Any]) -> tuple[ScatterDirection, ...]:  # noqa: ARG002
        """The quantities that differ from repeat to repeat, around parameters and effects; none by default."""
        return ()

    def forget_history(self, conditions: tuple[Any, ...]) -> tuple[Any, ...]:
        """The conditions before their approach is inferred; the same tuple where there is nothing to infer."""
        return conditions

    def infer_history(self, conditions: tuple[Any, ...], input_at: Callable[[Floats], Any], x: Floats) -> tuple[Any, ...]:  # noqa: ARG002
        """The conditions with the most probable approach path; the same tuple where that does not differ from the assumed one.

        Parameters
        ----------
        conditions
            All conditions.
        input_at, x
            The input of the simulator as a function of all unknowns (p,), and their values in the best explanation.
        """
        return conditions


def spread(number: int, count: int) -> list[int]:
    """At most `count` of the numbers 0 to `number` - 1, evenly spread, ascending."""
    # Rounding may hit one number twice; the set removes it.
    return sorted({int(i) for i in np.linspace(0, number - 1, min(count, number)).round()})
