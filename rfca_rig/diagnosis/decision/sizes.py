"""Sizes of effects: of stated ones with intervals that include the remaining misfit, and detection
limits of all others.

The standard deviation of a parameter has two independent parts:

1. The data: the larger one of two estimates. One is the posterior at the discrepancy scale of the
   hypothesis. The other is a delete-one jackknife over conditions (Quenouille, Biometrika 43 (1956)
   353), which is robust to errors that the observations of one condition share.
2. The law itself: a real cause departs from its law in the catalogue by LAW_SIZE_ERROR at least.
   Where held-out misfit remains, it departs by up to the share of that misfit in what the effect
   removes.

The detection limit of an effect that was not found is the smallest size that these recordings speak
against.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.config import (
    LAW_MISFIT_SHARE,
    LAW_SHAPE_ERROR,
    LAW_SIZE_ERROR,
    NEGLIGIBLE_POWER,
    OCCAM,
    USUAL_ERROR,
)
from rfca_rig.diagnosis.decision.comparison import Comparison
from rfca_rig.diagnosis.inference.hypotheses import Hypothesis
from rfca_rig.diagnosis.inference.parameterization import EffectTerm, std_of, value_of
from rfca_rig.diagnosis.inference.screening import EffectProbe
from rfca_rig.diagnosis.likelihood.marginal_likelihood import jackknife_std
from rfca_rig.diagnosis.result import NotSeen, Value
from rfca_rig.model.declarations.hinges import STIFFNESS_HARDENING
from rfca_rig.model.effect import Effect, Parameter
from rfca_rig.model.parameters import RigModel

Floats = NDArray[np.float64]


def estimate_sizes(
    comparison: Comparison, hypothesis: Hypothesis, number: int
) -> tuple[dict[str, Value], dict[str, Value]]:
    """Values and standard deviations of one effect of a hypothesis: its parameters, and the shape
    parameters of its law.

    Parameters
    ----------
    comparison
        The comparison that the hypothesis is part of.
    hypothesis
        The hypothesis with the posterior at the scale that its values are stated at.
    number
        Which of its effects.
    """
    term = hypothesis.fitted.coordinates.choices[number]
    part = hypothesis.fitted.coordinates.part(number)
    posterior = hypothesis.marginal.posterior
    std = np.maximum(
        np.sqrt(np.diag(posterior.covariance))[part], _jackknife_std(comparison, hypothesis)[part]
    )
    law = LAW_MISFIT_SHARE * comparison.law_error(comparison.scaled(hypothesis))
    parameters: dict[str, Value] = {name: Value(value, 0.0) for name, value in term.whole}
    shape: dict[str, Value] = {}
    for parameter, z, std_z in zip(
        term.free, posterior.mean[part].tolist(), std.tolist(), strict=True
    ):
        value = value_of(parameter, z)
        of_law = _law_uncertainty(term, parameter, value, law, hypothesis)
        estimate = Value(value, float(np.hypot(std_of(parameter, z, std_z), of_law)))
        if parameter in term.sizes:
            parameters[parameter.name] = estimate
        elif parameter in term.effect.shape:
            shape[parameter.name] = estimate
    return parameters, shape


def widen(
    sizes: Sequence[tuple[Mapping[str, Value], Mapping[str, Value]]], part: int
) -> dict[str, Value]:
    """The values of the first of several estimates, their standard deviations widened by how far
    the others differ from them.

    Parameters
    ----------
    sizes
        Parameters and shape parameters by name, of each estimate.
    part
        0 for the parameters, 1 for the shape parameters.
    """
    widened = {}
    for name, value in sizes[0][part].items():
        differences = [
            other[part][name].value - value.value for other in sizes if name in other[part]
        ]
        # A parameter that counts something has no standard deviation, and another count is another
        # statement.
        if value.std > 0.0:
            spread = float(np.sqrt(np.mean(np.square(differences))))
        else:
            spread = 0.0
        widened[name] = Value(value.value, float(np.hypot(value.std, spread)))
    return widened


def _law_uncertainty(
    term: EffectTerm, parameter: Parameter, value: float, law: float, hypothesis: Hypothesis
) -> float:
    """Standard deviation of a value because the law is only approximate.

    A size is counted from where the effect does nothing. Both gains of the control loop of a drive
    are sizes.
    """
    if term.effect.where == "drive":
        return max(LAW_SIZE_ERROR, law) * abs(value)
    if parameter == size_parameter(term.effect):
        return max(LAW_SIZE_ERROR, law) * abs(
            value - without_effect(term.effect, hypothesis.fitted.coordinates.space.centre.rig)
        )
    if parameter in term.sizes:
        return max(LAW_SHAPE_ERROR, law) * abs(value)
    return 0.0


def _jackknife_std(comparison: Comparison, hypothesis: Hypothesis) -> Floats:
    """Standard deviations (p,) of all unknowns by leaving one condition out at a time."""
    rows = comparison.result.dataset.rows
    return jackknife_std(
        hypothesis.fitted.linear(rows.measured), hypothesis.marginal.whitening, rows.condition
    )


def size_parameter(effect: Effect) -> Parameter:
    """The parameter that states how large an effect is: the first one that does not count
    something.
    """
    return next(parameter for parameter in effect.parameters if not parameter.whole)


# Words of units at the end of the names of parameters.
UNITS = frozenset(
    (
        "Nm",
        "N",
        "m",
        "mm",
        "s",
        "ms",
        "rad",
        "deg",
        "rad2",
        "kg",
        "g",
        "m2",
        "m3",
        "m1p5",
        "s2",
        "s3",
        "Hz",
        "per",
        "SI",
        "relative",
    )
)


def has_several_sizes(effect: Effect) -> bool:
    """Whether an effect has one size for each of several joints, actuators or sensors.

    A limit of the first size says nothing of the others, whose effects are part of the same
    signature.
    """
    first = size_parameter(effect).name.split("_")
    for parameter in effect.parameters:
        other = parameter.name.split("_")
        if parameter.whole or other == first:
            continue
        # Names are OWNER_QUANTITY_UNIT: the common end of the names of two sizes holds the
        # quantity, not only the unit.
        common = []
        for a, b in zip(reversed(first), reversed(other), strict=False):
            if a != b:
                break
            common.append(a)
        if not set(common) <= UNITS:
            return True
    return False


def without_effect(effect: Effect, rig: RigModel) -> float:
    """Value of the size parameter at which an effect does nothing.

    A stiffness in series does nothing at infinity, but is counted from 0.
    """
    size = size_parameter(effect)
    # Its size is the whole k2, so the nominal value does nothing.
    if effect.id == STIFFNESS_HARDENING.id:
        return rig.leg.k2_per_rad2
    if size.name.endswith("factor"):
        return 1.0
    return 0.0


# Measure of how clearly a signature (m,) shows, in the unit of the power that is needed.
PowerOf = Callable[[Floats], float]


def power_to_exclude(effects: int) -> float:
    """Chi-square by which the recordings must speak against an effect, one of so many, to exclude
    it.

    It is twice a log evidence: odds of 20, the choice among all effects, and the cost of one
    parameter. See docs/method.md.
    """
    return 2.0 * (3.0 + float(np.log(max(effects, 1))) + OCCAM)


def find_detection_limits(
    effects: Sequence[Effect],
    probes: Sequence[EffectProbe],
    power_of: PowerOf,
    rig: RigModel,
    needed: float,
) -> tuple[NotSeen, ...]:
    """Detection limit of each effect.

    Parameters
    ----------
    effects
        The effects that were not found.
    probes
        Their signatures (m,) at grid points.
    power_of
        Measures the power of a signature.
    rig
        The nominal model, from which sizes are counted.
    needed
        The power that is enough.

    Returns
    -------
    tuple
        One entry per effect.
    """
    return tuple(
        NotSeen(effect.id, _size(effect, probes, power_of, rig, needed)) for effect in effects
    )


def _size(
    effect: Effect, probes: Sequence[EffectProbe], power_of: PowerOf, rig: RigModel, needed: float
) -> Mapping[str, float] | None:
    if has_several_sizes(effect):
        return None
    size = size_parameter(effect)
    off = without_effect(effect, rig)
    # By distance and side of the neutral value. Rounding joins what is equal but for the last
    # digits.
    powers: dict[float, dict[bool, list[float]]] = {}
    signed_sum = 0.0
    for probe in probes:
        if probe.choice.effect.id == effect.id:
            beyond = dict(probe.choice.present(probe.z).values)[size.name] - off
            signed_sum += beyond
            powers.setdefault(round(abs(beyond), 12), {}).setdefault(beyond > 0.0, []).append(
                power_of(probe.signature)
            )
    points = []
    for distance, by_side in sorted(powers.items()):
        if distance > 0.0:
            # Several probes may have one value, for example one per hinge; their median counts. Of
            # two sides the less visible one does.
            power = min(float(np.median(of_side)) for of_side in by_side.values())
            points.append((distance, max(power, NEGLIGIBLE_POWER * needed)))
    if not any(power > NEGLIGIBLE_POWER * needed for _, power in points):
        return None
    distance, rising = _threshold(np.array(points), needed)
    # A scale that is wrong by less than the usual error is no missing physics.
    if size.name.endswith("factor"):
        distance = max(distance, USUAL_ERROR)
    if off == 0.0 or signed_sum >= 0.0:
        value = off + distance
    else:
        value = off - distance
    value = value if rising else min(value, size.high)
    if (
        (rising and value > size.high)
        or (not rising and value < size.low)
        or value < min(size.low, 0.0)
    ):
        return None
    return {size.name: float(f"{value:.3g}")}


def _threshold(points: Floats, needed: float) -> tuple[float, bool]:
    """Distance at which the power reaches `needed`, and whether power rises with distance; for a
    stiffness it falls.

    `points` (k, 2) are distance and power. The line is straight on logarithmic scales between
    points. Beyond them power grows with the square of the distance.
    """
    size = np.log(points[:, 0])
    power = np.log(points[:, 1])
    log_needed = float(np.log(needed))
    rising = bool(power[-1] >= power[0])
    if not rising:
        size = size[::-1]
        power = power[::-1]
    enough = np.flatnonzero(power >= log_needed)
    if len(enough):
        nearest = int(enough[0])
    else:
        nearest = int(np.argmax(power))
    if len(enough) and nearest > 0:
        share = (log_needed - power[nearest - 1]) / (power[nearest] - power[nearest - 1])
        return float(
            np.exp(size[nearest - 1] + share * (size[nearest] - size[nearest - 1]))
        ), rising
    # Extrapolation: a signature is proportional to a small size, so its power to the square.
    step = 0.5 * (log_needed - power[nearest])
    return float(np.exp(size[nearest] + (step if rising else -step))), rising
