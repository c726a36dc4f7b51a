"""A motor twin as a world carries it along, and the shaft's motion inside a step."""

from collections.abc import Iterator, Sequence
from typing import Protocol

from rfca_rig.twins.plant import ShaftDrive, ShaftState


class MotorTwin(Protocol):
    """The drive's side of the wire; brought forward step by step: `take_frames`, `drive`, then, after the plant moved, `passed`."""

    def take_frames(self, now_s: float) -> None:
        """Obeys what has come in since the last step."""
        ...

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        """The torque on the shaft until the next step; `shaft` is how it stands now."""
        ...

    def passed(self, elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState, law: ShaftDrive) -> None:
        """Takes in a step of the plant under `law` that ended at `now_s`, and reports what became due in it."""
        ...


def moments_between(
    due_s: Sequence[float], elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState
) -> Iterator[tuple[float, float]]:
    """Angle and speed at the moments of a step that ended at `now_s`: the cubic through angle and speed at its ends."""
    turned_rad = after.angle_rad - before.angle_rad
    left_rad, right_rad = before.speed_rad_s * elapsed_s, after.speed_rad_s * elapsed_s
    square, cube = 3.0 * turned_rad - 2.0 * left_rad - right_rad, left_rad + right_rad - 2.0 * turned_rad
    for moment_s in due_s:
        x = 1.0 + (moment_s - now_s) / elapsed_s
        yield (
            before.angle_rad + x * (left_rad + x * (square + x * cube)),
            before.speed_rad_s + x * (2.0 * square + 3.0 * x * cube) / elapsed_s,
        )
