"""Solves one implicit stage of a step by Newton's iteration, which keeps its factored Jacobian while it is good. Symbols as in `state`."""

import numpy as np

from rfca_rig.model.compiled import jit_inline, jit_internal
from rfca_rig.model.forces import assemble
from rfca_rig.model.linear import factor, substitute
from rfca_rig.model.shaft import drive_rotor, update_motion
from rfca_rig.model.state import Chain, Laws, Shaft, State, Work

NEWTON_LIMIT = 10  # a stage that needs more iterations is cheaper to repeat at half the length
GOOD_CONTRACTION = 0.1  # an iteration that gains less than a digit gets a new Jacobian
# Share of a hinge's spring stiffness. Where the slope of the effects changes by more, the Jacobian is outdated.
SAME_SLOPE = 0.3
# Newton diverges; the comparison also catches NaN, for which it is false.
ABSURD_RAD_S2 = 1e15


def allocate_workspace(coordinates: int, links: int) -> Work:
    """Working memory for a chain of so many links (n) and coordinates (c)."""
    # Few large arrays, each cut into views: an integration begins with few allocations.
    v, u = np.zeros((15, coordinates)), np.zeros((2, links))
    stages, regimes, exchange = np.zeros((3, 4, coordinates)), np.zeros((2, 2, links)), np.zeros((2, 8))
    return Work(
        R=np.zeros(coordinates),
        J=np.zeros((coordinates, coordinates)),
        pivot=np.zeros(coordinates, np.int64),
        sin=v[0],
        cos=v[1],
        down=u[0],
        along=u[1],
        across=v[12],
        aside=v[13],
        arm=v[2],
        speed2=v[3],
        by_cos=v[4],
        by_sin=v[5],
        q=v[6],
        w=v[7],
        a=v[8],
        stage_q=stages[0],
        stage_w=stages[1],
        stage_a=stages[2],
        jerk=v[9],
        base_q=v[10],
        base_w=v[11],
        contact=np.zeros((2, links)),
        force=np.zeros(3),
        place=np.zeros((links, 7)),
        ends=np.zeros((links, 7)),
        limit=np.full((3, links), np.inf),
        regime=regimes[0],
        regime_of_J=regimes[1],
        outside=np.zeros(2),
        x=exchange[0],
        out=exchange[1],
    )


@jit_internal
def solve_stage(
    chain: Chain, laws: Laws | None, shaft: Shaft, state: State, elapsed: float, t: float, g: float, enough: float, reuse: bool, work: Work
) -> bool:
    """Finds `work.a` such that R(base_q + g w, base_w + g a, a) = 0, with q and w. True if the last change of w is below `enough`.

    With `reuse`, the factored Jacobian of an earlier stage with the same g is kept while every contact and hinge is on the
    branch of its law on which it was made, and while each iteration gains a digit.
    """
    q, w, a, before = work.q, work.w, work.a, np.inf
    # The acceleration of a prescribed shaft is known: its row and column are left out of the system, eq. (16).
    first = 0 if shaft.free else 1
    for _ in range(NEWTON_LIMIT):
        update_motion(shaft, t, work.base_q, work.base_w, g, q, w, a)
        if reuse:
            assemble(chain, laws, state, elapsed, q, w, a, None, work)
            reuse = is_jacobian_valid(chain, work)
        if not reuse:
            # dw/da = g and dq/da = g^2 within the stage, which makes these the weights of the three derivatives of R.
            assemble(chain, laws, state, elapsed, q, w, a, (1.0, g, g * g), work)
            drive_rotor(shaft, t, q, w, a, g, True, work)
            if not factor(work.J, work.pivot, first):
                return False
            store_regime(work)
        else:
            drive_rotor(shaft, t, q, w, a, g, False, work)
        substitute(work.J, work.pivot, first, work.R)
        change = 0.0
        for i in range(first, q.size):
            a[i] -= work.R[i]
            change = max(change, abs(work.R[i]))
        if not change < ABSURD_RAD_S2:
            return False
        if g * change < enough:
            # q and w must agree with the last change of a, since the next step begins from them.
            update_motion(shaft, t, work.base_q, work.base_w, g, q, w, a)
            return True
        reuse = change < GOOD_CONTRACTION * before
        before = change
    return False


@jit_inline
def is_jacobian_valid(chain: Chain, work: Work) -> bool:
    """Whether all laws are on the branches on which they were when J was computed."""
    now, then, same = work.regime, work.regime_of_J, True
    for k in range(now.shape[1]):
        same = same and now[0, k] == then[0, k] and abs(now[1, k] - then[1, k]) <= SAME_SLOPE * chain.k0[k]
    return same


@jit_inline
def store_regime(work: Work) -> None:
    """Stores the branches for which J has just been computed."""
    for i in range(work.regime.shape[0]):
        for k in range(work.regime.shape[1]):
            work.regime_of_J[i, k] = work.regime[i, k]
