"""Computes the static experiment as a quasi-static path: the shaft is turned in stages and held,
friction depends on the path.

The ground is that of `contact`: Hertz under every link end, and a tie to an anchor that carries mu
N at the presliding stretch and slips beyond, acting at the lowest point of the end's circle. At
rest it has neither damping nor drag. Inertia enters only where no equilibrium continues the path,
for instance where a link end snaps off the floor. The speed of the shaft between the stages has no
influence here; in reality it has one at 1 rad/s (see `static_stages`).
"""

from collections.abc import Sequence

import numpy as np

from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.chain import Tolerance, advance, allocate_samples, find_rest_state, make_chain
from rfca_rig.model.kernel.compiled import jit_allocating
from rfca_rig.model.kernel.contact import drag_anchors, store_ends
from rfca_rig.model.kernel.forces import assemble_once, assemble_stiffness
from rfca_rig.model.kernel.integrator import FIRST_STEP_S
from rfca_rig.model.kernel.stage import allocate_workspace, solve
from rfca_rig.model.kernel.state import NO_LAWS, Chain, Floats, Laws, State, Work
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.static_stages import StaticState, make_static_state

NEWTON_LIMIT = 25
CONVERGED_RAD = 1e-11
STEP_RAD = np.radians(
    0.25
)  # keeps Newton on the path; a fifth of it gives the same states to 1e-12 N
SHORTEST_STEP_RAD = np.radians(1e-4)
# Sum of the changes of one step. A link that turns by more has come to another equilibrium, which
# does not continue the path.
FARTHEST_TURN_RAD = 0.15

JUMP_S = 0.05  # for the shaft's small step past the end of a path
LOOK_S = 0.25  # interval of the checks whether a jumping leg is at rest
LONGEST_JUMP_S = 20.0
AT_REST_RAD_S = 1e-5


@jit_allocating
def balance(
    chain: Chain, laws: Laws, state: State, q: Floats, angle: float, nothing: Floats, work: Work
) -> bool:
    """Solves for the equilibrium with the shaft at `angle` and the anchors of `state`, by Newton
    from `q` (n,); True when found nearby.

    `nothing` (n,) are zeros: at rest the ground has neither damping nor drag. The first iteration
    goes along the tangent of the path, because row 0 requires the new shaft angle. A slipping end
    keeps |F| = mu N, which the derivative includes, so it is not symmetric.
    """
    turned = 0.0
    for _ in range(NEWTON_LIMIT):
        assemble_stiffness(chain, laws, state, 0.0, q, nothing, nothing, work)
        # Row 0, the torque of the shaft, is replaced by the condition that the shaft has its angle.
        work.R[0] = q[0] - angle
        work.J[0, :] = 0.0
        work.J[0, 0] = 1.0
        if not solve(work.J, work.R):
            return False
        q -= work.R
        change = np.max(np.abs(work.R))
        turned += change
        # Written so that NaN ends the iteration, too.
        if not turned < FARTHEST_TURN_RAD:
            return False
        if change < CONVERGED_RAD:
            return True
    return False


@jit_allocating
def turn_shaft(
    chain: Chain, laws: Laws, state: State, angle: float, nothing: Floats, work: Work
) -> bool:
    """Turns the shaft to `angle` in small steps, and `state` with it; False where the path ends
    before. `nothing` (n,) are zeros.

    A step that finds no equilibrium nearby is repeated at half the length. After each step the
    anchors follow slipping ends, so that friction depends on the path.
    """
    q = state.q
    step = STEP_RAD
    trial = q.copy()
    # An infinite limit: at the beginning the force of each tie follows from its stretch alone.
    work.limit[2] = np.inf
    assemble_stiffness(chain, laws, state, 0.0, q, nothing, nothing, work)
    work.ends[:] = work.place
    work.limit[2] = work.limit[0]
    while q[0] != angle:
        remaining = angle - q[0]
        if abs(remaining) <= step:
            goal = angle
        else:
            goal = q[0] + np.sign(remaining) * step
        trial[:] = q
        if balance(chain, laws, state, trial, goal, nothing, work):
            # Exactly the goal, so that the loop can end by equality.
            trial[0] = goal
            assemble_stiffness(chain, laws, state, 0.0, trial, nothing, nothing, work)
            drag_anchors(chain, state, trial, work)
            store_ends(chain, state, trial, work)
            work.limit[2] = work.limit[0]
            q[:] = trial
            step = min(2.0 * step, STEP_RAD)
        else:
            step *= 0.5
            if step < SHORTEST_STEP_RAD:
                return False
    return True


def follow_static_path(
    rig: RigModel,
    height_m: float,
    shaft_angles_rad: Sequence[float] | Floats,
    begin_angle_rad: float | None = None,
) -> list[StaticState]:
    """Follows the equilibrium of the leg through a sequence of shaft angles.

    Parameters
    ----------
    rig
        Without effects; `static_stages` simulates those.
    height_m
        Height of the shaft above the ground.
    shaft_angles_rad
        (s,) in the order of the path, which may turn back.
    begin_angle_rad
        Where the path begins at rest; the leg's start angle if None. The leg should be in the air
        there: one that touches begins without friction.

    Returns
    -------
    list of StaticState
        One per angle.

    Raises
    ------
    SimulationFailed
        Where the leg finds no rest.
    BadInput
        For a rig with effects.
    """
    if rig.effects:
        raise BadInput(
            f"effect {rig.effects[0].id}: the quasi-static path knows the plain leg and "
            "ground only; take the effects out, "
            "or follow the stages in time"
        )
    chain = make_chain(rig, height_m)
    state = find_rest_state(
        chain, rig.leg.start_angle_rad if begin_angle_rad is None else begin_angle_rad
    )
    states = []
    for angle in shaft_angles_rad:
        jumped = _go_to(chain, state, float(angle))
        states.append(_measure(rig, chain, state, jumped))
    return states


def _go_to(chain: Chain, state: State, angle: float) -> bool:
    work = allocate_workspace(state.q.size, state.q.size)
    zeros = np.zeros(state.q.size)
    jumped = False
    while not turn_shaft(chain, NO_LAWS, state, angle, zeros, work):
        _jump(chain, state, angle)
        jumped = True
    return jumped


def _jump(chain: Chain, state: State, angle: float) -> None:
    """Moves the leg past the end of a path: the dynamic model carries it to its next rest, the
    shaft one small step further.
    """
    before = float(state.q[0])
    after = before + float(np.clip(angle - before, -STEP_RAD, STEP_RAD))
    speed = (after - before) / JUMP_S
    breaks = np.array([0.0, JUMP_S, LONGEST_JUMP_S])
    motion = ShaftMotion(
        breaks, np.array([[before, speed, 0.0, 0.0], [after, 0.0, 0.0, 0.0]]), breaks[:2]
    )
    # q and the anchors are shared with `state`, so that the motion carries them along.
    moving = state._replace(w=np.zeros_like(state.q), a=np.zeros_like(state.q))
    _wait_for_rest(chain, motion, moving)
    work = allocate_workspace(state.q.size, state.q.size)
    zeros = np.zeros(state.q.size)
    # The leg still moves a little; Newton finds the equilibrium itself, with the anchors that the
    # motion has left.
    if not balance(chain, NO_LAWS, state, state.q, after, zeros, work):
        raise _no_rest(chain, after)
    state.q[0] = after


def _wait_for_rest(chain: Chain, motion: ShaftMotion, state: State) -> None:
    no_samples = allocate_samples(np.empty(0), state.q.size)
    step_s = FIRST_STEP_S
    t = 0.0
    while t < LONGEST_JUMP_S:
        step_s = advance(
            chain, motion.shaft(), state, (t, t + LOOK_S), step_s, Tolerance(), no_samples
        ).next_s
        t += LOOK_S
        if np.abs(state.w).max() < AT_REST_RAD_S:
            return
    raise _no_rest(chain, float(state.q[0]))


def _no_rest(chain: Chain, angle: float) -> SimulationFailed:
    return SimulationFailed(
        f"the leg finds no rest with the shaft held at {np.degrees(angle):.2f} degrees, "
        f"{1e3 * chain.ground_depth:.1f} mm above the "
        f"ground, within {LONGEST_JUMP_S:g} s; give its hinges some damping, or smaller stages"
    )


def _measure(rig: RigModel, chain: Chain, state: State, jumped: bool) -> StaticState:
    work = allocate_workspace(state.q.size, state.q.size)
    zeros = np.zeros(state.q.size)
    assemble_once(chain, NO_LAWS, state, 0.0, state.q, zeros, zeros, None, work)
    return make_static_state(
        rig,
        state.q.copy(),
        float(work.R[0]),
        work.contact[0].copy(),
        work.contact[1].copy(),
        jumped,
    )
