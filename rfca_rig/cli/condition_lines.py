"""A plan in a few lines: each condition once, with how often it is run and what the model expects of it."""

from collections.abc import Mapping
from math import degrees

from rfca_rig.protocol.check import Load
from rfca_rig.protocol.cycles import Cycles
from rfca_rig.protocol.plan import Flap, Hold, Plan, Stage


def condition_lines(plan: Plan, expected: Mapping[Stage, Load]) -> list[str]:
    """Strokes, static stages and cycles; moves and rests are left out."""
    lines: dict[str, int] = {}
    for stage in plan.stages:
        load = expected.get(stage)
        force = "" if load is None else f", model expects up to {load.force_N:.0f} N and {load.torque_Nm:.1f} N m"
        match stage:
            case Flap():
                line = f"{1e3 * stage.height_m:.1f} mm, {stage.speed_rad_s:g} rad/s{force}"
            case Hold() if plan.experiment == "fatigue":
                line = f"check at {degrees(stage.angle_rad):.1f} deg, {1e3 * stage.height_m:.1f} mm{force}"
            case Hold():
                line = f"{stage.label}{force}"
            case Cycles():
                line = f"{1e3 * stage.height_m:.1f} mm, {stage.speed_rad_s:g} rad/s on and on{force}"
            case _:
                continue
        lines[line] = lines.get(line, 0) + getattr(stage, "count", 1)
    return [f"{line}, {count} times" if count > 1 else line for line, count in lines.items()]
