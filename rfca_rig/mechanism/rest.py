"""Finds the rest pose of a mechanism, in which no joint accelerates under its commands and effects.

Also the play before the spring of a joint engages: within half the gap to either side of its rest position the spring does nothing.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from rfca_rig.errors import SimulationFailed
from rfca_rig.mechanism.contact_law import ContactArrays, apply_contact_forces
from rfca_rig.model.kernel.compiled import jit

Floats = NDArray[np.float64]

UNBALANCED = 1e-7  # share of the largest torque that may remain, of weight or spring


class PlayArrays(NamedTuple):
    """Half the gap (n,) of each joint in rad or m, its rest position (n,), and coefficients (3, n) of x, x |x| and x^3 of its spring.

    The torque is that at `ahead_s` after a step's beginning: the mean over the step under Runge-Kutta; an implicit step takes its springs
    at its beginning.
    """

    half_gap: Floats
    rest: Floats
    spring: Floats
    ahead_s: float


@jit
def add_spring_play(arrays: PlayArrays, q: Floats, w: Floats, applied: Floats) -> None:
    """Adds torques to `applied` (n,) that turn MuJoCo's springs into springs with play; `q` and `w` are (n,)."""
    # MuJoCo computes the spring without play; its torque is cancelled, and that of the reduced deflection is applied instead.
    for i in range(arrays.half_gap.size):
        if arrays.half_gap[i] > 0.0:
            full = q[i] + arrays.ahead_s * w[i] - arrays.rest[i]
            engaged = np.sign(full) * max(abs(full) - arrays.half_gap[i], 0.0)
            one, two, three = arrays.spring[0, i], arrays.spring[1, i], arrays.spring[2, i]
            applied[i] += full * (one + abs(full) * two + full * full * three)
            applied[i] -= engaged * (one + abs(engaged) * two + engaged * engaged * three)


def find_rest_pose(model: Any, data: Any, simulated: NDArray[np.intp], steady: Floats, contacts: ContactArrays, play: PlayArrays) -> None:
    """Puts the simulated joints into static equilibrium; `data` has the positions of the others and the commands.

    Dry friction is neglected: its force at rest would depend on how the mechanism came to rest.

    Parameters
    ----------
    model, data
        MuJoCo's own; `data` holds the pose from which the equilibrium is sought.
    simulated
        (s,) indices of the joints that move.
    steady
        (n,) constant torques.
    contacts, play
        The laws that MuJoCo does not have.

    Raises
    ------
    SimulationFailed
        Where no equilibrium is found.
    """
    friction = model.dof_frictionloss.copy()
    model.dof_frictionloss[:] = 0.0
    data.qvel[:] = 0.0
    try:
        _balance(model, data, simulated, steady, contacts, play._replace(half_gap=np.zeros_like(play.half_gap)))
        # Within its gap a spring gives no direction, so the search begins where it engages, on the side of the first solution.
        if play.half_gap.any():
            data.qpos[simulated] += (np.sign(data.qpos - play.rest) * play.half_gap)[simulated]
            _balance(model, data, simulated, steady, contacts, play)
    finally:
        model.dof_frictionloss[:] = friction
    contacts.clock[:], contacts.touch_s[:], contacts.stretch[:] = 0.0, np.inf, 0.0


def _balance(model: Any, data: Any, simulated: NDArray[np.intp], steady: Floats, contacts: ContactArrays, play: PlayArrays) -> None:
    import mujoco  # noqa: PLC0415  (optional)

    largest = 0.0

    def compute_imbalance(pose: Floats) -> Floats:
        nonlocal largest
        data.qpos[simulated] = pose
        data.qfrc_applied[:] = steady
        add_spring_play(play, data.qpos, data.qvel, data.qfrc_applied)
        mujoco.mj_forward(model, data)
        # The contact law needs positions and velocities, and MuJoCo the forces of the law: two passes.
        if contacts.radius.size:
            contacts.stretch[:] = 0.0
            apply_contact_forces(contacts, 0.0)
            mujoco.mj_forward(model, data)
        largest = max(largest, float(np.abs(data.qfrc_bias).max()))
        return np.array((data.qfrc_smooth + data.qfrc_constraint)[simulated])

    solution = root(compute_imbalance, data.qpos[simulated].copy(), tol=1e-12)
    # The residual decides, not the solver's own status; `not <=` also catches NaN. The call leaves `data` in the pose found.
    residual = float(np.abs(compute_imbalance(solution.x)).max())
    if not residual <= UNBALANCED * max(largest, 1e-3):
        raise SimulationFailed(f"no rest pose found: {residual:.2g} N m or N stay unbalanced; start it estimated, or check the model")
