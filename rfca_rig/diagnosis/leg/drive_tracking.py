"""What a shaft that does what it is told rules out: drives that would have moved it otherwise, and from what size on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import Supposed
from rfca_rig.diagnosis.config import DEFAULT_SEARCH
from rfca_rig.diagnosis.decision.detection_limits import find_detection_limits
from rfca_rig.diagnosis.inference.map_fit import without_scatter
from rfca_rig.diagnosis.inference.parameterization import Parameterization
from rfca_rig.diagnosis.inference.screening import probe_effects, terms_of
from rfca_rig.diagnosis.leg.nuisances import nuisances_of_drive
from rfca_rig.diagnosis.leg.shaft_observations import ShaftCondition, tracking_error
from rfca_rig.diagnosis.leg.simulator import leg_dataset
from rfca_rig.diagnosis.result import NotSeen
from rfca_rig.diagnosis.simulator import spread
from rfca_rig.model.effect import Effect
from rfca_rig.model.parameters import RigModel

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class _Obedience:
    """Shafts that are obeyed; a signature shows where one of them would turn otherwise."""

    shafts: Sequence[ShaftCondition]
    ramp_s: float

    def power(self, signature: Floats) -> float:
        """Squared size of a signature, 1 where a drive would be looked at."""
        ends = np.cumsum([shaft.away_rad.size for shaft in self.shafts])[:-1]
        each = zip(self.shafts, np.split(signature, ends), strict=True)
        return max(tracking_error(replace(shaft, repeats=away[None]), self.ramp_s) for shaft, away in each) ** 2


def excluded_by_tracking(shafts: Sequence[ShaftCondition], rig: RigModel, effects: Sequence[Effect]) -> tuple[NotSeen, ...]:
    """For each of these drives, none of which the rig is believed to have, the size from which on it would have been looked at.

    That is asked of a few conditions: the others could only show a smaller one.
    """
    wanted = [effect for effect in effects if effect.id not in {present.id for present in rig.effects}]
    shafts = [shafts[number] for number in spread(len(shafts), DEFAULT_SEARCH.coarse_conditions)]
    evidence = leg_dataset(shafts)
    coordinates = Parameterization(nuisances_of_drive(rig, Supposed(rig)))
    base = without_scatter(evidence).at(coordinates, np.zeros(coordinates.size))
    trials = [] if base is None else probe_effects(evidence, base, [choice for effect in wanted for choice in terms_of(effect)])
    return find_detection_limits(wanted, trials, _Obedience(shafts, rig.drive.ramp_s), rig, needed=1.0)
