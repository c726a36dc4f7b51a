"""What the rig may be asked to do: heights, speeds and loads."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rfca_rig.analysis.fitting.parameters import Supposed
from rfca_rig.diagnosis.leg.stages import StageTable
from rfca_rig.diagnosis.leg.strokes import FlapCondition
from rfca_rig.model.stroke import SimulatedStroke
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Limits

HEIGHT_BEYOND_M = 0.020  # the rack may go this far beyond where it has been
GENTLE_RAD_S = 2.5  # for a rig that has only stood still so far
READABLE_RAD_S = 5.0  # at greater speeds a stroke's phases are not found
SPARE = 0.9  # share of a stated limit that an expectation may reach


@dataclass(frozen=True)
class FeasibleRegion:
    """Lowest and highest rack, greatest speed, greatest load that the sensor is to feel."""

    lowest_m: float
    highest_m: float
    speed_rad_s: float
    load: Load

    def allows(self, load: Load) -> bool:
        """Whether neither force nor moment is too large."""
        return load.force_N <= self.load.force_N and load.torque_Nm <= self.load.torque_Nm


def room_of(flaps: Sequence[FlapCondition], tables: Sequence[StageTable], supposed: Supposed, limits: Limits | None) -> FeasibleRegion:
    """Within the rig's limits where they are known, else within the speeds and loads that were recorded. Raises SimulationFailed."""
    heights = [*(flap.height_m for flap in flaps), *(table.height_m for table in tables)]
    lowest_m, highest_m = min(heights) - HEIGHT_BEYOND_M, max(heights) + HEIGHT_BEYOND_M
    fastest = max((flap.turn.speed_rad_s for flap in flaps), default=GENTLE_RAD_S)
    if limits is not None:
        speed = min(SPARE * limits.speed_rad_s, max(fastest, READABLE_RAD_S))
        return FeasibleRegion(lowest_m, highest_m, speed, Load(SPARE * limits.force_N, SPARE * limits.torque_Nm))
    return FeasibleRegion(lowest_m, highest_m, fastest, _borne(flaps, tables, supposed))


def _borne(flaps: Sequence[FlapCondition], tables: Sequence[StageTable], supposed: Supposed) -> Load:
    """The greatest load so far: in strokes as the model has it, in stages as measured."""
    load = Load(0.0, 0.0)
    for flap in flaps:
        load = load.with_more(load_of(flap.stroke(supposed)))
    for stage in (stage for table in tables for stage in table.stages):
        load = load.with_more(Load(float(np.hypot(stage.fy_N, stage.fz_N)), abs(stage.tx_Nm)))
    return load


def load_of(stroke: SimulatedStroke) -> Load:
    """The greatest load of a simulated stroke."""
    return Load(float(np.hypot(stroke.fy_N, stroke.fz_N).max(initial=0.0)), float(np.abs(stroke.tx_Nm).max(initial=0.0)))
