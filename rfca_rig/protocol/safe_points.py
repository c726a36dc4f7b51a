"""Safe points: where a run may end without harm to the leg, in the air before or beyond the ground."""

from collections.abc import Sequence
from itertools import takewhile

from rfca_rig.protocol.cycles import StiffnessCheck
from rfca_rig.protocol.plan import MoveShaft, Rest, SetHeight, Stage


def stages_to_safe_point(done: Sequence[Stage], to_come: Sequence[Stage]) -> Sequence[Stage]:
    """Stages still to be run before the motor may be disabled; none where nothing has moved since the rack was set.

    A leg bent on the ground must go on in the direction of its stroke: the plan's next move forwards does that. From the start angle the
    shaft turns to where it waits without torque, as at the end of every height.
    """
    if not done or isinstance(done[-1], SetHeight):
        return ()
    # Only up to the next setting of the rack: moves beyond it belong to another height.
    moves = [stage for stage in takewhile(lambda stage: not isinstance(stage, SetHeight), to_come) if isinstance(stage, MoveShaft)]
    out_of_ground = [] if _is_in_the_air(done) else [move for move in moves if move.forwards][:1]
    to_parking = [move for move in moves[-1:] if not move.forwards]
    return (*out_of_ground, *to_parking)


def _is_in_the_air(done: Sequence[Stage]) -> bool:
    """Whether the last motion led to the start angle; resting there and checks in between do not count."""
    moved = [stage for stage in done if not isinstance(stage, Rest | StiffnessCheck)]
    if not moved or isinstance(moved[-1], SetHeight):
        return True
    last, before = moved[-1], moved[-2:-1]
    return isinstance(last, MoveShaft) and (last.forwards or not before or isinstance(before[0], SetHeight))
