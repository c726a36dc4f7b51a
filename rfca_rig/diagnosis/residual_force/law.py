"""A measured law and its companions as plain values, which pages and files read.

The prior of a measured law is smooth, and of a plausible size. D are second differences over k
knots, and Q = D^T D / rho^2 + 1 / k. The covariance of the values is size^2 Q^-1. With rho = 0.03
the law is nearly straight, with rho = 1 it may have any course.

References: Rasmussen and Williams, Gaussian Processes for Machine Learning (2006), chapter 5; Lang
and Brezger, J. Comput. Graph. Statist. 13 (2004) 183 (random-walk priors for the coefficients of
splines).
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.inference.hypotheses import Hypothesis
from rfca_rig.model.effect import Effect
from rfca_rig.model.parameters import LawTable, PresentEffect
from rfca_rig.model.tabulated_law import TABULATED_LAW

Floats = NDArray[np.float64]

SIZES = (
    0.1,
    0.3,
    1.0,
    3.0,
    10.0,
)  # of a plausible value; a decade either way of what a rig may have
ROUGHNESS = (0.03, 0.1, 0.3, 1.0)
NONE = 1e-3  # of a law's size: nothing, where it is known to be none


@dataclass(frozen=True)
class LawArgument:
    """Argument that a force at a place may depend on, for one kind of rig.

    Parameters
    ----------
    place, name
        The place, and the argument.
    unit, value_unit
        Of the argument and of the force; "" for a share of the friction coefficient.
    plausible
        Plausible size of the force, in its unit.
    is_signed
        Whether the law may change sign with its argument, so that knots stand denser around zero.
    zero_at_zero
        Whether the force is known to be zero where the argument is 0.
    effect_of
        The effect that simulates a table of it.
    """

    place: str
    name: str
    unit: str
    value_unit: str
    plausible: float
    is_signed: bool
    zero_at_zero: bool
    effect_of: Callable[[LawTable], Effect]


@dataclass(frozen=True)
class Course:
    """One argument over one condition: `values` (m, k) at the times `t_s` (m,), k hinges or 1,
    and where each `counts`, (m, k).
    """

    t_s: Floats
    values: Floats
    counts: NDArray[np.bool_]


@dataclass(frozen=True)
class MemoryTest:
    """Both branches of a law at its k knots.

    Parameters
    ----------
    rising, falling
        (k,) the law while the argument rises, and while it falls.
    std
        (k,) standard deviation of their difference.
    log_evidence_gain
        Gain of two branches over one.
    has_memory
        Whether the branches differ by more than the band allows.
    """

    rising: Floats
    falling: Floats
    std: Floats
    log_evidence_gain: float
    has_memory: bool


@dataclass(frozen=True)
class MeasuredLaw:
    """A law as the recordings show it, beside the hypothesis `base`.

    Parameters
    ----------
    place, argument
        Where it acts and on what it depends, as in `rfca_rig.model.tabulated_law`.
    argument_unit, unit
        Of `knots` and of `values`; "" for a share of the friction coefficient.
    knots, values, std : (k,)
        The residual law with one standard deviation at each knot.
    whole, whole_std : (k,) or None
        The same plus the law that the model has there already, for example the damping of a hinge;
        None where it has none. The data determine the sum better than its division.
    visited
        Least and greatest value of the argument in the recordings, without a thousandth of the time
        at either end.
    explained
        Share of the misfit of `base` on held-out conditions that the law removes.
    log_density_gain
        Log predictive density of all conditions, each held out in turn, above that of `base`.
    log_evidence_gain
        Log evidence above that of `base`.
    hypothesis
        The base with the law in it, fitted.
    memory
        Whether the force differs between a rising and a falling argument; None where that was not
        tested.
    """

    place: str
    argument: str
    argument_unit: str
    unit: str
    knots: Floats
    values: Floats
    std: Floats
    whole: Floats | None
    whole_std: Floats | None
    visited: tuple[float, float]
    explained: float
    log_density_gain: float
    log_evidence_gain: float
    base: tuple[str, ...]
    hypothesis: Hypothesis = field(repr=False, compare=False)
    memory: MemoryTest | None = None

    @property
    def present(self) -> PresentEffect:
        """The law as an effect of the model."""
        # A friction coefficient cannot be negative.
        least = -1.0 if self.place == "floor_friction" else -np.inf
        values = tuple(max(float(value), least) for value in self.values)
        return PresentEffect(
            TABULATED_LAW,
            table=LawTable(self.place, self.argument, tuple(map(float, self.knots)), values),
        )


@dataclass(frozen=True)
class CatalogueCurve:
    """An effect of the catalogue at the fitted values: its `name`, `values` (k,) at `argument`
    (k,), in the law's unit.
    """

    name: str
    argument: Floats
    values: Floats


@dataclass(frozen=True)
class StatedLaw:
    """A measured law, the effects of the catalogue that it replaces, and the fitted law of one
    of them, where it has one.
    """

    law: MeasuredLaw
    instead_of: tuple[str, ...]
    curve: CatalogueCurve | None


def prior_root(knots: Floats, size: float, roughness: float, zero_at_zero: bool = False) -> Floats:
    """Root (k, k) of the prior covariance of the values at the knots (k,), columns from the least
    free direction to the freest.

    With `zero_at_zero` the law is known to be zero at a knot that is 0.
    """
    count = len(knots)
    bend = np.diff(np.eye(count), 2, axis=0) / roughness
    if zero_at_zero:
        known = np.diag((np.abs(knots) < 1e-9) / NONE**2)
    else:
        known = np.zeros((count, count))
    values, vectors = np.linalg.eigh(bend.T @ bend + np.eye(count) / count + known)
    return np.asarray(size * vectors / np.sqrt(values))


def describe_law(stated: StatedLaw) -> str:
    """States which effects the model had when the law was measured, and which share of the
    held-out misfit the law removes.
    """
    law = stated.law
    beside = " and ".join(law.base) or "the model without effects"
    if stated.instead_of:
        instead = f", in place of what {' and '.join(stated.instead_of)} states there"
    else:
        instead = ""
    return (
        f"measured beside {beside}{instead}. On held-out conditions it removes "
        f"{100.0 * law.explained:.0f}\u00a0% of what those leave"
    )
