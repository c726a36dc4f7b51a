"""Motor twin protocol, and interpolation of the shaft's motion within a step."""

from collections.abc import Iterator, Sequence
from typing import Protocol

from rfca_rig.twins.plant import ShaftDrive, ShaftState


class MotorTwin(Protocol):
    """The drive's side of the bus, advanced in steps: `take_frames`, `drive`, then, after the plant has moved, `passed`."""

    def take_frames(self, now_s: float) -> None:
        """Executes frames received since the last step."""
        ...

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        """Torque law on the shaft until the next step; `shaft` is its present state."""
        ...

    def passed(self, elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState, law: ShaftDrive) -> None:
        """Takes in a step of the plant under `law` that ended at `now_s`, and sends the reports that became due in it."""
        ...


def interpolate_motion(
    due_s: Sequence[float], elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState
) -> Iterator[tuple[float, float]]:
    """Yields angle and speed at the times `due_s` within a step that ended at `now_s`.

    Cubic Hermite interpolation through angle and speed at both ends of the step.
    """
    turned_rad = after.angle_rad - before.angle_rad
    left_rad, right_rad = before.speed_rad_s * elapsed_s, after.speed_rad_s * elapsed_s
    # Coefficients in x = 0..1 over the step; speeds are scaled by its length.
    square, cube = 3.0 * turned_rad - 2.0 * left_rad - right_rad, left_rad + right_rad - 2.0 * turned_rad
    for moment_s in due_s:
        x = 1.0 + (moment_s - now_s) / elapsed_s
        yield (
            before.angle_rad + x * (left_rad + x * (square + x * cube)),
            before.speed_rad_s + x * (2.0 * square + 3.0 * x * cube) / elapsed_s,
        )
