"""The plan before anything moves: held against the limits with what the model expects of it, and printed."""

from collections.abc import Mapping
from dataclasses import replace

from rfca_rig.bench.expectation import expected_loads
from rfca_rig.cli.condition_lines import condition_lines
from rfca_rig.cli.first_compile import tell_first_compile
from rfca_rig.cli.order import Order
from rfca_rig.cli.progress import progress
from rfca_rig.cli.terminal import Say
from rfca_rig.protocol.check import Load, check_plan
from rfca_rig.protocol.cycles import cycle_bytes
from rfca_rig.protocol.plan import Stage

ROUGHER_STDS = 2.0


def examined(order: Order, say: Say) -> Mapping[Stage, Load]:
    """What the model expects of each stage. Raises BadInput where that, or the plan itself, passes a limit."""
    with progress(order.quiet) as bars:
        tell_first_compile(bars, order.quiet, say)
        expected = expected_loads(order.plan, order.believes.model())
    check_plan(order.plan, expected)
    _check_on_rougher_floor(order)
    return expected


def _check_on_rougher_floor(order: Order) -> None:
    """Whether a leg that is turned back slides or wedges hangs on little friction: the plan must pass with what may be there, too."""
    known_to, rig = order.believes.known_to, order.believes.model()
    if not order.plan.holds or known_to is None or not known_to.friction_coefficient:
        return
    friction = rig.ground.friction_coefficient + ROUGHER_STDS * known_to.friction_coefficient
    rougher = replace(rig, ground=replace(rig.ground, friction_coefficient=friction))
    supposing = f" with a friction of {friction:.2f}, which is {ROUGHER_STDS:g} standard deviations above the believed"
    check_plan(order.plan, expected_loads(order.plan, rougher), supposing)


def print_plan(order: Order, expected: Mapping[Stage, Load], say: Say) -> None:
    plan, limits = order.plan, order.plan.limits
    say(f"{order.rig.rig.title}: {plan.title}, {len(plan.flaps)} strokes, {len(plan.holds)} static stages, {len(plan.stages)} steps in all")
    for line in condition_lines(plan, expected):
        say(f"  {line}")
    say(
        f"  limits {limits.force_N:g} N, {limits.torque_Nm:g} N m, {limits.speed_rad_s:g} rad/s; "
        f"at most {plan.duration_s / 60:.1f} min on the rig, {recorded_bytes(order) / 1e6:.1f} MB before compression"
    )


def recorded_bytes(order: Order) -> int:
    """What the run records, before compression."""
    width, height = order.eye.camera.image_size_px if order.eye else (0, 0)
    return order.plan.recorded_bytes + cycle_bytes(order.plan) + 3 * width * height * order.plan.photos
