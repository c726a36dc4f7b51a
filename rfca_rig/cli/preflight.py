"""Pre-flight check: the plan against the limits with the predicted loads, before anything moves; and its printout."""

from collections.abc import Mapping
from dataclasses import replace
from math import degrees

from rfca_rig.bench.expectation import predict_loads
from rfca_rig.cli.progress import announce_first_compile, progress
from rfca_rig.cli.run_config import RunConfig
from rfca_rig.cli.terminal import Say
from rfca_rig.protocol.check import Load, check_plan
from rfca_rig.protocol.plan import Cycles, Flap, Hold, Plan, Stage, cycle_bytes

# Standard deviations of floor friction above its prior value with which a static plan must pass too.
ROUGHER_STDS = 2.0


def condition_lines(plan: Plan, expected: Mapping[Stage, Load]) -> list[str]:
    """A line for each stroke, static stage and block of cycles; moves and rests are omitted."""
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


def check_before_run(config: RunConfig, say: Say) -> Mapping[Stage, Load]:
    """Predicted load of each stage. Raises BadInput where a load, or the plan itself, passes a limit."""
    with progress(config.quiet) as bars:
        announce_first_compile(bars, config.quiet, say)
        expected = predict_loads(config.plan, config.nominal_source.model())
    check_plan(config.plan, expected)
    _check_on_rougher_floor(config)
    return expected


def _check_on_rougher_floor(config: RunConfig) -> None:
    """Whether a leg that is turned back slides or wedges depends on little friction: the plan must pass with more of it, too."""
    known_to, rig = config.nominal_source.known_to, config.nominal_source.model()
    if not config.plan.holds or known_to is None or not known_to.friction_coefficient:
        return
    friction = rig.ground.friction_coefficient + ROUGHER_STDS * known_to.friction_coefficient
    rougher = replace(rig, ground=replace(rig.ground, friction_coefficient=friction))
    supposing = f" with a friction of {friction:.2f}, which is {ROUGHER_STDS:g} standard deviations above the nominal one"
    check_plan(config.plan, predict_loads(config.plan, rougher), supposing)


def print_plan(config: RunConfig, expected: Mapping[Stage, Load], say: Say) -> None:
    plan, limits = config.plan, config.plan.limits
    counts = f"{len(plan.flaps)} strokes, {len(plan.holds)} static stages, {len(plan.stages)} steps in all"
    say(f"{config.rig.rig.title}: {plan.title}, {counts}")
    for line in condition_lines(plan, expected):
        say(f"  {line}")
    say(
        f"  limits {limits.force_N:g} N, {limits.torque_Nm:g} N m, {limits.speed_rad_s:g} rad/s; "
        f"at most {plan.duration_s / 60:.1f} min on the rig, {recording_size(config) / 1e6:.1f} MB before compression"
    )


def recording_size(config: RunConfig) -> int:
    """Size of the recording in bytes, before compression."""
    width, height = config.eye.camera.image_size_px if config.eye else (0, 0)
    return config.plan.recorded_bytes + cycle_bytes(config.plan) + 3 * width * height * config.plan.photos
