"""The smallest size of every effect that was not named at which these recordings would have shown it."""

from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rfca_rig.diagnosis.config import OCCAM, UNSEEN
from rfca_rig.diagnosis.inference.screening import EffectProbe
from rfca_rig.diagnosis.result import NotSeen
from rfca_rig.model.effect import Effect, Parameter
from rfca_rig.model.parameters import RigModel

Floats = NDArray[np.float64]


class Shows(Protocol):
    """How plainly a signature shows."""

    def power(self, signature: Floats) -> float:
        """Its squared size, in whatever `needed` counts."""
        ...


def find_detection_limits(
    effects: Sequence[Effect], probes: Sequence[EffectProbe], shows: Shows, rig: RigModel, needed: float | None = None
) -> tuple[NotSeen, ...]:
    """For each effect the size at which its signatures would have shown: at which it would have earned its name, if `needed` is not given
    and its power is that beyond noise and nuisances.
    """
    if needed is None:
        needed = 2.0 * (3.0 + float(np.log(max(len(effects), 1))) + OCCAM)
    return tuple(NotSeen(effect.id, _size(effect, probes, shows, rig, needed)) for effect in effects)


def size_parameter(effect: Effect) -> Parameter:
    """The parameter that tells how large an effect is: the first that does not count something."""
    return next(parameter for parameter in effect.parameters if not parameter.whole)


def without_effect(effect: Effect, rig: RigModel) -> float:
    """The value of the size parameter at which an effect does nothing; infinite for a stiffness in series, which is counted from 0."""
    size = size_parameter(effect)
    if effect.id == "stiffness_hardening":
        return rig.leg.k2_per_rad2
    if size.name.endswith("factor"):
        return 1.0
    return 0.0


def _size(effect: Effect, probes: Sequence[EffectProbe], shows: Shows, rig: RigModel, needed: float) -> Mapping[str, float] | None:
    size, off = size_parameter(effect), without_effect(effect, rig)
    powers: dict[float, list[float]] = {}
    below = 0.0
    for trial in probes:
        if trial.choice.effect.id == effect.id:
            value = dict(trial.choice.present(trial.z).values)[size.name]
            below += value - off
            powers.setdefault(round(abs(value - off), 12), []).append(shows.power(trial.signature))
    points = sorted((distance, max(float(np.median(p)), UNSEEN * needed)) for distance, p in powers.items() if distance > 0.0)
    if not any(power > UNSEEN * needed for _, power in points):
        return None
    distance, rising = _threshold(np.array(points), needed)
    value = off + distance if off == 0.0 or below >= 0.0 else off - distance
    value = value if rising else min(value, size.high)
    if (rising and value > size.high) or (not rising and value < size.low) or value < min(size.low, 0.0):
        return None
    return {size.name: float(f"{value:.3g}")}


def _threshold(points: Floats, needed: float) -> tuple[float, bool]:
    """Where power over distance crosses what is needed, and whether it rises: for a stiffness it falls.

    Between two points on logarithmic scales, beyond them with the square of the distance.
    """
    size, power, wanted = np.log(points[:, 0]), np.log(points[:, 1]), float(np.log(needed))
    rising = bool(power[-1] >= power[0])
    if not rising:
        size, power = size[::-1], power[::-1]
    enough = np.flatnonzero(power >= wanted)
    nearest = int(enough[0]) if len(enough) else int(np.argmax(power))
    if len(enough) and nearest > 0:
        share = (wanted - power[nearest - 1]) / (power[nearest] - power[nearest - 1])
        return float(np.exp(size[nearest - 1] + share * (size[nearest] - size[nearest - 1]))), rising
    step = 0.5 * (wanted - power[nearest])
    return float(np.exp(size[nearest] + (step if rising else -step))), rising
