"""Free joints as three slides and three hinges, so that a free body has joints as any other.

The hinges turn one after the other, each in the frame that the former ones have turned. Their
angles are singular where the middle one is 90 degrees. A `FreeFrame` keeps it small: its first axis
lies along the rotation that dominates in the recordings, and all angles are zero at one of their
orientations.

References
----------
Shuster, A survey of attitude representations, J. Astronaut. Sci. 41 (1993) 439.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]

POSITIONS = ("x", "y", "z")
ANGLES = ("a", "b", "c")
# Largest middle angle: there, an error of the orientation turns the other two angles by twice as
# much. Samples beyond are left out.
MAX_MIDDLE_ANGLE_RAD = float(np.radians(60.0))


@dataclass(frozen=True)
class FreeFrame:
    """The axes of the joints that stand in for a free joint.

    Parameters
    ----------
    joint
        Name of the free joint.
    orientation
        (3, 3) orientation of the body where all angles are zero.
    axes
        (3, 3) the axes of the hinges as columns, in the body's frame there.
    """

    joint: str
    orientation: Floats
    axes: Floats

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the six joints."""
        return tuple(f"{self.joint}.{name}" for name in (*POSITIONS, *ANGLES))

    def read_angles(self, rotations: Rotation) -> Floats:
        """Angles (m, 3) of orientations in the order of time, without jumps by a turn."""
        relative = Rotation.from_matrix(self.orientation).inv() * rotations
        axes = Rotation.from_matrix(self.axes)
        angles = (axes.inv() * relative * axes).as_euler("XYZ")
        return np.asarray(np.unwrap(angles, axis=0))


def choose_frame(joint: str, recorded: Sequence[Rotation]) -> FreeFrame:
    """The frame of a free joint for its recorded orientations, each recording in order of time."""
    turns = [(after * before.inv()).as_rotvec() for before, after in _pair(recorded)]
    steps = np.concatenate(turns) if turns else np.zeros((1, 3))
    # The direction of most of the rotation, in the world; without any, some direction.
    first = np.linalg.eigh(steps.T @ steps)[1][:, -1]
    middle = recorded[0][len(recorded[0]) // 2].as_matrix()
    # Any two further axes make a right-handed frame.
    start = np.eye(3)[np.argmin(np.abs(first))]
    second = np.cross(first, start)
    second = second / np.linalg.norm(second)
    world = np.column_stack([first, second, np.cross(first, second)])
    return FreeFrame(joint, middle, middle.T @ world)


def _pair(recorded: Sequence[Rotation]) -> list[tuple[Rotation, Rotation]]:
    return [(rotations[:-1], rotations[1:]) for rotations in recorded if len(rotations) > 1]


def expand_free_joints(spec: Any, frames: Sequence[FreeFrame], where: str) -> None:
    """Replace free joints in MuJoCo's specification of a model by six joints each.

    Raises BadInput, which begins with `where`, for a frame whose joint is none.
    """
    import mujoco  # noqa: PLC0415  (optional)

    for frame in frames:
        free = [
            joint
            for joint in spec.joints
            if joint.name == frame.joint and joint.type == mujoco.mjtJoint.mjJNT_FREE
        ]
        if not free:
            raise BadInput(f"{where}: {frame.joint!r} is no free joint of the model")
        body = free[0].parent
        spec.delete(free[0])
        body.pos = np.zeros(3)
        x, y, z, w = Rotation.from_matrix(frame.orientation).as_quat()
        body.quat = (w, x, y, z)
        # Axes of joints are in the body's frame; the slides run along those of the world.
        for name, axis in zip(frame.joints[:3], frame.orientation, strict=True):
            body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=axis)
        for name, axis in zip(frame.joints[3:], frame.axes.T, strict=True):
            body.add_joint(name=name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=axis)
