"""Sizes of drive effects that a shaft which follows its command excludes: with them it would have moved otherwise."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import ModelPoint
from rfca_rig.diagnosis.config import DEFAULT_SEARCH
from rfca_rig.diagnosis.decision.detection_limits import find_detection_limits
from rfca_rig.diagnosis.inference.map_fit import without_scatter
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.inference.screening import grid_points, probe_effects, terms_of
from rfca_rig.diagnosis.leg.nuisances import nuisances_of_drive
from rfca_rig.diagnosis.leg.shaft_observations import ShaftCondition, tracking_error
from rfca_rig.diagnosis.leg.simulator import make_leg_dataset
from rfca_rig.diagnosis.result import NotSeen
from rfca_rig.diagnosis.simulator import spread
from rfca_rig.model.effect import Effect
from rfca_rig.model.parameters import RigModel


@dataclass(frozen=True)
class _TrackingError:
    """Measure of a signature for detection limits: the tracking error that it would have made."""

    shafts: Sequence[ShaftCondition]
    ramp_s: float

    def power(self, signature: NDArray[np.float64]) -> float:
        """Largest squared tracking error over all shafts, if each moved otherwise by its part of the signature (m,)."""
        ends = np.cumsum([shaft.deviation_rad.size for shaft in self.shafts])[:-1]
        deviating = [replace(shaft, repeats=away[None]) for shaft, away in zip(self.shafts, np.split(signature, ends), strict=True)]
        return max(tracking_error(shaft, self.ramp_s) for shaft in deviating) ** 2


def find_excluded_sizes(shafts: Sequence[ShaftCondition], rig: RigModel, effects: Sequence[Effect]) -> tuple[NotSeen, ...]:
    """For each of these drive effects that the nominal rig lacks, the size from which on the shaft would not have tracked its command.

    Only a few conditions are simulated. The others could only lower the limit.
    """
    candidates = [effect for effect in effects if effect.id not in {present.id for present in rig.effects}]
    shafts = [shafts[number] for number in spread(len(shafts), DEFAULT_SEARCH.coarse_conditions)]
    dataset, coordinates = make_leg_dataset(shafts), Parameterization(nuisances_of_drive(rig, ModelPoint(rig), {}))
    base = without_scatter(dataset).at(coordinates, np.zeros(coordinates.size))
    probes = [] if base is None else probe_effects(dataset, base, grid_points(term for effect in candidates for term in terms_of(effect)))
    # A tracking error of 1 is the limit of `tracks_command`, so this is the power that is needed.
    return find_detection_limits(candidates, probes, _TrackingError(shafts, rig.drive.ramp_s), rig, needed=1.0)
