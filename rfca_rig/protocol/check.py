"""The check of a whole plan before anything moves."""

from collections.abc import Mapping

import numpy as np

from rfca_rig.errors import BadInput
from rfca_rig.protocol.plan import Flap, Hold, MoveShaft, Plan, Stage


def check_plan(plan: Plan, expected_force_N: Mapping[Stage, float]) -> None:
    """Raises BadInput, naming the stage, where the plan passes a limit.

    `expected_force_N` is the largest force the model predicts in a stage, where it was asked.
    """
    if not plan.flaps and not plan.holds:
        raise BadInput(f"{plan.title}: nothing to record; give at least one condition, or one shaft angle")
    for stage in plan.stages:
        _check_speed(stage, plan)
        _check_angle(stage)
        _check_force(stage, plan, expected_force_N.get(stage))


def _check_speed(stage: Stage, plan: Plan) -> None:
    if isinstance(stage, Flap | MoveShaft) and stage.speed_rad_s > plan.limits.speed_rad_s:
        raise BadInput(
            f"{stage.label}: {stage.speed_rad_s:g} rad/s is above the rig's limit of {plan.limits.speed_rad_s:g} rad/s; "
            "choose a lower speed, or raise [limits] speed_rad_s in the rig file if the rig can take it"
        )


def _check_angle(stage: Stage) -> None:
    if isinstance(stage, Hold) and not 0.0 <= stage.angle_rad <= np.pi:
        raise BadInput(f"{stage.label}: static shaft angles lie between 0 and 180 degrees; beyond, the leg leaves the ground")


def _check_force(stage: Stage, plan: Plan, expected_N: float | None) -> None:
    if expected_N is not None and expected_N > plan.limits.force_N:
        raise BadInput(
            f"{stage.label}: the model expects {expected_N:.0f} N, above the rig's limit of {plan.limits.force_N:g} N; "
            "raise the rack, go slower, or raise [limits] force_N in the rig file if sensor and frame can take it"
        )
