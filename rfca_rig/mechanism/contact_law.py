"""Contact law of a sphere on a plane: Hertz with damping, and Coulomb friction with stick.

MuJoCo's contacts are soft constraints: their force grows with the mass of the bodies. The force of
this law depends on depth and speed alone. It replaces MuJoCo's contact between the two geoms.

References
----------
Hunt and Crossley, Journal of Applied Mechanics 42 (1975) 440; Dahl 1968 for the presliding, here
linear up to Coulomb's limit.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.kernel.compiled import jit, jit_internal

Floats = NDArray[np.float64]
Places = NDArray[np.intp]

STIFFNESS, DAMPING, FRICTION, PRESLIDING, DRAG, USUAL_DEPTH, MORE_POWER = range(
    7
)  # columns of `ContactArrays.law`
# Drag grows in proportion to the normal force up to this value, as in
# `rfca_rig.model.kernel.contact`.
FULL_DRAG_N = 1.0


@dataclass(frozen=True)
class SphereOnPlane:
    """One contact: normal force N = stiffness depth^1.5 (1 + damping depth'), never below 0, and
    friction at the sphere's lowest point.

    An effect may change the power of the depth about a usual depth d_0: N = stiffness depth^1.5
    (depth / d_0)^p (1 + damping depth').

    A force sensor under the plane reads the reaction.

    Parameters
    ----------
    sphere, plane
        Names of the geoms; MuJoCo's planes stand still.
    stiffness_N_per_m1p5, damping_s_per_m
        Of the normal force.
    friction
        Coulomb's coefficient.
    presliding_m
        Displacement of a sticking point, in proportion to the force, at which it begins to slide.
    drag_N_s_per_m
        A viscous force against the sliding speed in addition to friction, in full from a normal
        force of 1 N on.
    """

    sphere: str
    plane: str
    stiffness_N_per_m1p5: float
    damping_s_per_m: float
    friction: float
    presliding_m: float
    drag_N_s_per_m: float

    def list_numbers(self, usual_N: float) -> tuple[float, ...]:
        """The numbers in the order of the columns of `ContactArrays.law`, with the usual depth
        under this force.
        """
        usual_m = (usual_N / self.stiffness_N_per_m1p5) ** (2.0 / 3.0)
        return (
            self.stiffness_N_per_m1p5,
            self.damping_s_per_m,
            self.friction,
            self.presliding_m,
            self.drag_N_s_per_m,
            usual_m,
            0.0,
        )


def check_contacts(model: Any, contacts: Sequence[SphereOnPlane], where: str) -> None:
    """Raises BadInput, which begins with `where`, for a contact that names no sphere or no plane
    of MuJoCo's model, or comes twice.
    """
    import mujoco  # noqa: PLC0415  (optional)

    kinds = {model.geom(geom).name: int(model.geom_type[geom]) for geom in range(model.ngeom)}
    for index, contact in enumerate(contacts):
        for name, kind, word in (
            (contact.sphere, mujoco.mjtGeom.mjGEOM_SPHERE, "sphere"),
            (contact.plane, mujoco.mjtGeom.mjGEOM_PLANE, "plane"),
        ):
            if kinds.get(name) != int(kind):
                known = (
                    ", ".join(known for known, of in kinds.items() if of == int(kind) and known)
                    or "none with a name"
                )
                raise BadInput(
                    f"{where}: contacts: {name!r} is no {word} of the model; it has {known}"
                )
        if any(
            (contact.sphere, contact.plane) == (other.sphere, other.plane)
            for other in contacts[:index]
        ):
            raise BadInput(
                f"{where}: contacts: {contact.sphere!r} on {contact.plane!r} comes twice"
            )


class ContactArrays(NamedTuple):
    """Arrays of c contacts for the compiled loop.

    `law` (c, 7), `radius` (c,), geoms (c,) of sphere and plane, their bodies (c,), and the `root`
    of each body. `stretch` (c, 3) is the displacement of the lowest point from where it sticks,
    `normal` (c,) the force in the last step, `clock` (1,) the time, and `touch_s` (c,) the time of
    each first contact; `work` is (3, 3). The others are MuJoCo's own arrays.
    """

    law: Floats
    radius: Floats
    sphere: Places
    plane: Places
    body: Places
    plane_body: Places
    root: Places
    stretch: Floats
    normal: Floats
    clock: Floats
    touch_s: Floats
    work: Floats
    geom_xpos: Floats
    geom_xmat: Floats
    xipos: Floats
    subtree_com: Floats
    cvel: Floats
    xfrc_applied: Floats


@jit_internal
def velocity_at(arrays: ContactArrays, body: int, point: Floats, out: Floats) -> None:
    """Writes the velocity of a point (3,) that moves with a body into `out` (3,)."""
    # MuJoCo gives each body's velocity, first rotational then linear, at the centre of mass of its
    # kinematic tree.
    twist = arrays.cvel[body]
    origin = arrays.subtree_com[arrays.root[body]]
    x = point[0] - origin[0]
    y = point[1] - origin[1]
    z = point[2] - origin[2]
    out[0] = twist[3] + twist[1] * z - twist[2] * y
    out[1] = twist[4] + twist[2] * x - twist[0] * z
    out[2] = twist[5] + twist[0] * y - twist[1] * x


@jit_internal
def add_force(arrays: ContactArrays, body: int, point: Floats, force: Floats) -> None:
    """Adds a force (3,) at a point (3,) to the external wrench on a body."""
    # MuJoCo applies `xfrc_applied`, first force then torque, at the body's centre of mass.
    wrench = arrays.xfrc_applied[body]
    centre = arrays.xipos[body]
    x = point[0] - centre[0]
    y = point[1] - centre[1]
    z = point[2] - centre[2]
    for i in range(3):
        wrench[i] += force[i]
    wrench[3] += y * force[2] - z * force[1]
    wrench[4] += z * force[0] - x * force[2]
    wrench[5] += x * force[1] - y * force[0]


@jit_internal
def add_contact_force(arrays: ContactArrays, c: int, h: float) -> None:
    """Adds the force of contact `c` to MuJoCo's external forces, and updates its sticking point
    over a step of `h` [s].
    """
    point = arrays.work[0]
    normal = arrays.work[1]
    slip = arrays.work[2]
    sphere = arrays.sphere[c]
    plane = arrays.plane[c]
    height = 0.0
    for i in range(3):
        # The plane's normal is the third column of its rotation matrix.
        normal[i] = arrays.geom_xmat[plane, 3 * i + 2]
        height += normal[i] * (arrays.geom_xpos[sphere, i] - arrays.geom_xpos[plane, i])
    depth = arrays.radius[c] - height
    before_N = arrays.normal[c]
    arrays.normal[c] = 0.0
    if depth <= 0.0:
        arrays.stretch[c, :] = 0.0
        return
    for i in range(3):
        point[i] = arrays.geom_xpos[sphere, i] - arrays.radius[c] * normal[i]
    velocity_at(arrays, arrays.body[c], point, slip)
    rate = 0.0
    for i in range(3):
        rate -= normal[i] * slip[i]
    law = arrays.law[c]
    N = law[STIFFNESS] * depth * np.sqrt(depth) * max(1.0 + law[DAMPING] * rate, 0.0)
    if law[MORE_POWER] != 0.0:
        N *= (depth / law[USUAL_DEPTH]) ** law[MORE_POWER]
    arrays.normal[c] = N
    arrays.touch_s[c] = min(arrays.touch_s[c], arrays.clock[0])
    # Under a growing N a tie keeps its force, so its stretch shrinks; otherwise it would create
    # energy.
    kept = min(1.0, before_N / N) if N > 0.0 else 1.0
    length = 0.0
    for i in range(3):
        slip[i] += rate * normal[i]
        arrays.stretch[c, i] = kept * arrays.stretch[c, i] + 0.5 * (1.0 + kept) * h * slip[i]
        length += arrays.stretch[c, i] ** 2
    drag = law[DRAG] * min(1.0, N / FULL_DRAG_N)
    # A stretch beyond the presliding has slipped: the sticking point follows.
    if length > law[PRESLIDING] ** 2:
        reach = law[PRESLIDING] / np.sqrt(length)
    else:
        reach = 1.0
    for i in range(3):
        arrays.stretch[c, i] *= reach
        slip[i] = (
            N * normal[i]
            - law[FRICTION] * N * arrays.stretch[c, i] / law[PRESLIDING]
            - drag * slip[i]
        )
    add_force(arrays, arrays.body[c], point, slip)
    for i in range(3):
        slip[i] = -slip[i]
    add_force(arrays, arrays.plane_body[c], point, slip)


@jit
def apply_contact_forces(arrays: ContactArrays, h: float) -> None:
    """Writes the forces of all contacts as MuJoCo's external forces, and updates the sticking
    points over a step of `h` [s].
    """
    # Several contacts may share a body, so all wrenches are cleared first.
    for c in range(arrays.radius.size):
        arrays.xfrc_applied[arrays.body[c], :] = 0.0
        arrays.xfrc_applied[arrays.plane_body[c], :] = 0.0
    for c in range(arrays.radius.size):
        add_contact_force(arrays, c, h)
    arrays.clock[0] += h
