"""Where a run may be ended without hurting the leg: in the air, before the floor or beyond it."""

from collections.abc import Sequence

from rfca_rig.protocol.cycles import StiffnessCheck
from rfca_rig.protocol.plan import MoveShaft, Rest, SetHeight, Stage


def way_to_safety(done: Sequence[Stage], to_come: Sequence[Stage]) -> Sequence[Stage]:
    """The stages that still have to be gone through before the motor may let go, none where the leg is in the air already.

    A leg bent on the ground must go on in the direction of its stroke; that is what the plan's next move forwards does.
    """
    if _is_in_the_air(done):
        return ()
    for stage in to_come:
        if isinstance(stage, SetHeight):
            return ()
        if isinstance(stage, MoveShaft) and stage.forwards:
            return (stage,)
    return ()


def _is_in_the_air(done: Sequence[Stage]) -> bool:
    """Nothing is done, or what was done last leads to the start angle: the way there, and resting there."""
    moved = [stage for stage in done if not isinstance(stage, Rest | StiffnessCheck)]
    if not moved or isinstance(moved[-1], SetHeight):
        return True
    last, before = moved[-1], moved[-2:-1]
    return isinstance(last, MoveShaft) and (last.forwards or not before or isinstance(before[0], SetHeight))
