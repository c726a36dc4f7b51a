"""Where a run may be ended without hurting the leg: in the air, before the floor or beyond it."""

from collections.abc import Sequence
from itertools import takewhile

from rfca_rig.protocol.cycles import StiffnessCheck
from rfca_rig.protocol.plan import MoveShaft, Rest, SetHeight, Stage


def way_to_safety(done: Sequence[Stage], to_come: Sequence[Stage]) -> Sequence[Stage]:
    """The stages that still have to be gone through before the motor may let go, none where nothing has moved since the rack was set.

    A leg bent on the ground must go on in the direction of its stroke; that is what the plan's next move forwards does. From the start
    angle the shaft turns to where it waits without torque, as it does at the end of every height.
    """
    if not done or isinstance(done[-1], SetHeight):
        return ()
    moves = [stage for stage in takewhile(lambda stage: not isinstance(stage, SetHeight), to_come) if isinstance(stage, MoveShaft)]
    onwards = [] if _is_in_the_air(done) else [move for move in moves if move.forwards][:1]
    waiting = [move for move in moves[-1:] if not move.forwards]
    return (*onwards, *waiting)


def _is_in_the_air(done: Sequence[Stage]) -> bool:
    """Nothing is done, or what was done last leads to the start angle: the way there, and resting there."""
    moved = [stage for stage in done if not isinstance(stage, Rest | StiffnessCheck)]
    if not moved or isinstance(moved[-1], SetHeight):
        return True
    last, before = moved[-1], moved[-2:-1]
    return isinstance(last, MoveShaft) and (last.forwards or not before or isinstance(before[0], SetHeight))
