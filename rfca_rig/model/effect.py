"""Data model of an effect: a piece of physics that a model may lack. Each is one file, here or
in a lab's folder.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import inf, isfinite
from typing import Any

Values = Mapping[str, float]

OF_PENDULUMS = "pendulum-like rigs"  # where an effect enters that a leg cannot have


@dataclass(frozen=True)
class Parameter:
    """One number of an effect. The name carries the unit; `low` to `high` is the plausible range on
    a rig like this.

    Values outside of the range are allowed, within limits: a value is finite, not below zero where
    `low` is not, not zero unless `may_be_zero`, smaller in magnitude than `below`, and an integer
    where it counts something (`whole`). `starts` are values from which a search begins, where steps
    over the plausible range would miss the effect. `neutral` is the value of a shape parameter, or
    of one of `begins`, that is used where no value is given.
    """

    name: str
    low: float
    high: float
    may_be_zero: bool = True
    below: float = inf
    whole: bool = False
    starts: tuple[float, ...] = ()
    neutral: float = 0.0

    def why_not(self, value: float) -> str | None:
        """Reason, in words, why the value is not allowed; None if it is."""
        if not isfinite(value):
            return "must be a finite number"
        if value < 0.0 <= self.low or (value == 0.0 and not self.may_be_zero):
            if self.may_be_zero:
                return "must be 0 or more"
            return "must be above 0"
        if self.whole and not value.is_integer():
            return "must be a whole number"
        if abs(value) >= self.below:
            return f"must stay below {self.below:g} in magnitude"
        return None


@dataclass(frozen=True)
class EqualLimit:
    """A limit in which the law of an effect becomes that of another one, so that no data
    distinguish the two.

    `other` is the id of that one, `words` the limit. `holds` says whether values of parameters and
    shape are so near to it that the other law, fitted again, differs by less than a fifth of the
    effect. A fifth is the usual error of a law.
    """

    other: str
    words: str
    holds: Callable[[Values], bool]


@dataclass(frozen=True)
class Effect:
    """One entry of the catalogue.

    `where` it enters, `left_out` in a few words what a model without it lacks, the `law` as a
    formula, its `source`. `apply(setup, values)` returns the setup with the effect in it, in the
    form of its simulator: `setup.Setup` for a leg. `values` holds one number per parameter, one per
    parameter of `shape`, and one for each of `begins`. `begins` are initial states where a
    recording begins, 0 for at rest; they are no property of the rig and are never reported. `shape`
    are nuisance parameters of the law, which describe its form and not its size. They are optional
    in a file, where their neutral values apply; a diagnosis fits them together with the effect.
    Raises ValueError where the neutral value of a shape parameter lies outside of its plausible
    range. `same_as` names the nominal value, as `fit` calls it, whose error acts exactly like the
    effect: only the prior of that value distinguishes the two. `variant_of` names the most general
    effect of which this one is a special case, as dry friction is of Stribeck's. `equal_limits` are
    those in which its law becomes that of another effect: a diagnosis then reports both as one set.
    `family` is the id of a family of the catalogue whose laws act alike, for an effect that the
    catalogue does not list there. `needs_order`: its law counts the strokes that the leg has made
    before. It is tried only where recordings state their order. `needs_k2`: its law is written in
    k0 and k2 of the spring, so that it has no meaning in a leg with a measured curve.
    """

    id: str
    where: str
    left_out: str
    law: str
    source: str
    parameters: tuple[Parameter, ...]
    apply: Callable[[Any, Values], Any]
    begins: tuple[Parameter, ...] = ()
    same_as: str = ""
    shape: tuple[Parameter, ...] = ()
    variant_of: str = ""
    needs_k2: bool = False
    needs_order: bool = False
    equal_limits: tuple[EqualLimit, ...] = ()
    family: str = ""

    def __post_init__(self) -> None:
        for parameter in self.shape:
            if not parameter.low <= parameter.neutral <= parameter.high:
                raise ValueError(
                    f"effect {self.id}: shape parameter {parameter.name} has its neutral "
                    f"value {parameter.neutral:g} outside of "
                    f"{parameter.low:g} to {parameter.high:g}"
                )
