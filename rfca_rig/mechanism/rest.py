"""The rest of a mechanism: the pose in which nothing accelerates, with its commands and effects acting."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from rfca_rig.errors import SimulationFailed
from rfca_rig.mechanism.contact_law import ContactArrays, push
from rfca_rig.mechanism.spring_play import PlayArrays, close_gaps

Floats = NDArray[np.float64]

UNBALANCED = 1e-7  # share of the largest torque that may remain, of weight or spring


def hang(model: Any, data: Any, simulated: NDArray[np.intp], steady: Floats, contacts: ContactArrays, play: PlayArrays) -> None:
    """Puts the simulated joints at rest in static equilibrium, where `data` has the others and the commands.

    Dry friction holds nothing in that pose: the mechanism came to rest without it.

    Parameters
    ----------
    model, data
        MuJoCo's own; `data` holds the pose from which the equilibrium is sought.
    simulated
        (s,) places of the joints that move.
    steady
        (n,) steady torques that act.
    contacts, play
        The laws beside MuJoCo's.

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
        if play.half_gap.any():  # within its gap a spring does not say where to: seek from where it engages
            data.qpos[simulated] += (np.sign(data.qpos - play.rest) * play.half_gap)[simulated]
            _balance(model, data, simulated, steady, contacts, play)
    finally:
        model.dof_frictionloss[:] = friction
    contacts.clock[:], contacts.touch_s[:], contacts.stretch[:] = 0.0, np.inf, 0.0


def _balance(model: Any, data: Any, simulated: NDArray[np.intp], steady: Floats, contacts: ContactArrays, play: PlayArrays) -> None:
    import mujoco  # noqa: PLC0415  (optional)

    largest = 0.0

    def unbalanced(pose: Floats) -> Floats:
        nonlocal largest
        data.qpos[simulated] = pose
        data.qfrc_applied[:] = steady
        close_gaps(play, data.qpos, data.qvel, data.qfrc_applied)
        mujoco.mj_forward(model, data)
        if contacts.radius.size:
            contacts.stretch[:] = 0.0
            push(contacts, 0.0)
            mujoco.mj_forward(model, data)
        largest = max(largest, float(np.abs(data.qfrc_bias).max()))
        return np.array((data.qfrc_smooth + data.qfrc_constraint)[simulated])

    found = root(unbalanced, data.qpos[simulated].copy(), tol=1e-12)
    left = float(np.abs(unbalanced(found.x)).max())
    if not left <= UNBALANCED * max(largest, 1e-3):
        raise SimulationFailed(f"no rest pose found: {left:.2g} N m or N stay unbalanced; start it estimated, or check the model")
