"""Checks a whole plan before anything moves."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rfca_rig.errors import BadInput
from rfca_rig.protocol.plan import Approach, Cycles, Flap, Hold, MoveShaft, Plan, Stage, cycles_in


@dataclass(frozen=True)
class Load:
    """The largest force (along the ground and upwards combined) and moment about the shaft's
    axis at the sensor.
    """

    force_N: float
    torque_Nm: float

    def max_with(self, other: "Load") -> "Load":
        """The larger of each component."""
        return Load(max(self.force_N, other.force_N), max(self.torque_Nm, other.torque_Nm))


def check_plan(plan: Plan, expected: Mapping[Stage, Load], supposing: str = "") -> None:
    """Raises BadInput, naming the stage, where the plan passes a limit.

    Parameters
    ----------
    plan : Plan
        Stages and limits.
    expected : mapping of Stage to Load
        Predicted load of a stage, where known.
    supposing : str
        For the message: how the model differs from the nominal one.
    """
    if not plan.flaps and not plan.holds and not cycles_in(plan):
        raise BadInput(
            f"{plan.title}: nothing to record; give at least one condition, or one shaft angle"
        )
    for stage in plan.stages:
        if (
            isinstance(stage, Approach | Cycles | Flap | MoveShaft)
            and stage.speed_rad_s > plan.limits.speed_rad_s
        ):
            raise BadInput(
                f"{stage.label}: {stage.speed_rad_s:g} rad/s is above the rig's limit of "
                f"{plan.limits.speed_rad_s:g} rad/s; "
                "choose a lower speed, or raise [limits] speed_rad_s in the rig file if "
                "the rig can take it"
            )
        # Shaft angles are positive downwards, so the leg points at the ground between 0 and 180
        # degrees.
        if isinstance(stage, Hold) and not 0.0 <= stage.angle_rad <= np.pi:
            raise BadInput(
                f"{stage.label}: static shaft angles lie between 0 and 180 degrees; "
                "beyond, the leg leaves the ground"
            )
        if stage in expected:
            load = expected[stage]
            limits = plan.limits
            # Written so that a load that is no number passes the limit.
            if not (load.force_N <= limits.force_N and load.torque_Nm <= limits.torque_Nm):
                turns = isinstance(stage, Approach | Cycles | Flap)
                # Slower helps only where speed makes the load; in static moves it is a bent leg
                # that is pushed back and wedges.
                if turns:
                    way_out = "go slower"
                else:
                    way_out = "turn the shaft back less: a bent leg that is pushed back wedges"
                raise BadInput(
                    f"{stage.label}: the model expects {load.force_N:.0f} N and "
                    f"{load.torque_Nm:.1f} N m{supposing}, the rig's limits "
                    f"are {limits.force_N:g} N and {limits.torque_Nm:g} N m; raise the "
                    f"rack or {way_out}, "
                    "or raise [limits] if the rig can take it"
                )
