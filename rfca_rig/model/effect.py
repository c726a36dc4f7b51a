"""What an effect is: a piece of physics that a model may lack. Each stands in a file of its own, here or in a lab's folder."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rfca_rig.model.setup import Setup

Values = Mapping[str, float]


@dataclass(frozen=True)
class Parameter:
    """One number of an effect. The name carries the unit; `low` to `high` is what is plausible on a rig like this."""

    name: str
    low: float
    high: float


@dataclass(frozen=True)
class Effect:
    """One entry of the catalogue.

    `where` it enters, `left_out` in a few words what a model without it lacks, the `law` as a formula, its `source`.
    `apply(setup, values)` returns the setup with the effect in it; `values` holds one number per parameter.
    """

    id: str
    where: str
    left_out: str
    law: str
    source: str
    parameters: tuple[Parameter, ...]
    apply: "Callable[[Setup, Values], Setup]"
