"""Solves one implicit stage of a step by Newton's iteration, with the row of the shaft. Symbols as
in `state`.

The iteration keeps its factored Jacobian while it is good. The shaft's motion is prescribed or
under the torque of a drive, which closes row 0 of the equations.
"""

import numpy as np

from rfca_rig.model.kernel.compiled import jit_inline, jit_internal
from rfca_rig.model.kernel.forces import assemble
from rfca_rig.model.kernel.lanes import (
    count_lanes,
    highest,
    in_all_lanes,
    in_any_lane,
    lane_of,
    select,
    sign,
    with_lane,
)
from rfca_rig.model.kernel.state import Chain, Floats, Laws, Shaft, State, Work

NEWTON_LIMIT = 10  # a stage that needs more iterations is cheaper to repeat at half the length
GOOD_CONTRACTION = 0.1  # an iteration that gains less than a digit gets a new Jacobian
# Share of a hinge's spring stiffness. Where the slope of the effects changes by more, the Jacobian
# is outdated.
SAME_SLOPE = 0.3
# Newton diverges; the comparison also catches NaN, for which it is false.
ABSURD_RAD_S2 = 1e15


@jit_inline
def factor(J: Floats, first: int) -> bool:
    """Replaces J (c, c), from row and column `first` on, by its LU factors. False where J is
    singular or not finite.

    Rows are not exchanged: inertia, hinges and the normal force of the ground make J positive
    definite, and friction changes it little.
    """
    n = J.shape[0]
    for k in range(first, n):
        # Written so that NaN, for which each comparison is false, counts as singular.
        if not in_all_lanes(abs(J[k, k]) > 0.0):
            return False
        # The diagonal keeps the inverse, so that each substitution multiplies instead of dividing.
        inverse = 1.0 / J[k, k]
        J[k, k] = inverse
        for i in range(k + 1, n):
            f = J[i, k] * inverse
            J[i, k] = f
            for j in range(k + 1, n):
                J[i, j] -= f * J[k, j]
    return True


@jit_inline
def substitute(J: Floats, first: int, x: Floats) -> None:
    """Solves for x (c,) in place with the factors in J (c, c); entries before `first` stay as
    they are.
    """
    n = J.shape[0]
    for k in range(first, n):
        v = x[k]
        for j in range(first, k):
            v -= J[k, j] * x[j]
        x[k] = v
    for k in range(n - 1, first - 1, -1):
        v = x[k]
        for j in range(k + 1, n):
            v -= J[k, j] * x[j]
        x[k] = v * J[k, k]


@jit_inline
def find_pivot(J: Floats, k: int) -> int:
    """The row of J (c, c), from `k` on, with the largest entry in column `k`."""
    p = k
    for i in range(k + 1, J.shape[0]):
        if abs(J[i, k]) > abs(J[p, k]):
            p = i
    return p


@jit_internal
def solve(J: Floats, x: Floats) -> bool:
    """Solves J y = x for J (c, c) and x (c,), with y in the place of x; J is overwritten. False
    where it is singular or not finite.

    With exchange of rows: far from rest J may be indefinite.
    """
    n = x.size
    for k in range(n):
        p = find_pivot(J, k)
        if not abs(J[p, k]) > 0.0:
            return False
        if p != k:
            x[k], x[p] = x[p], x[k]
            for j in range(n):
                J[k, j], J[p, j] = J[p, j], J[k, j]
        for i in range(k + 1, n):
            f = J[i, k] / J[k, k]
            x[i] -= f * x[k]
            for j in range(k + 1, n):
                J[i, j] -= f * J[k, j]
    for k in range(n - 1, -1, -1):
        v = x[k]
        for j in range(k + 1, n):
            v -= J[k, j] * x[j]
        x[k] = v / J[k, k]
    return True


@jit_inline
def shaft_at(shaft: Shaft, t: float) -> tuple[float, float, float]:
    """(angle, speed, acceleration) of the prescribed shaft; at a break the piece that ends there
    counts.
    """
    x = shaft.breaks[0]
    c0 = x
    c1 = x
    c2 = x
    c3 = x
    for lane in range(count_lanes(x)):
        # Bisection for the last piece that begins before t. Before the first break and after the
        # last one, the outer pieces go on.
        low = 0
        high = shaft.coefficient.shape[0]
        while high - low > 1:
            middle = (low + high) // 2
            if lane_of(shaft.breaks[middle], lane) < t:
                low = middle
            else:
                high = middle
        x = with_lane(x, lane, t - lane_of(shaft.breaks[low], lane))
        c0 = with_lane(c0, lane, lane_of(shaft.coefficient[low, 0], lane))
        c1 = with_lane(c1, lane, lane_of(shaft.coefficient[low, 1], lane))
        c2 = with_lane(c2, lane, lane_of(shaft.coefficient[low, 2], lane))
        c3 = with_lane(c3, lane, lane_of(shaft.coefficient[low, 3], lane))
    return (
        c0 + x * (c1 + x * (c2 + x * c3)),
        c1 + x * (2.0 * c2 + x * 3.0 * c3),
        2.0 * c2 + 6.0 * c3 * x,
    )


@jit_inline
def drive_torque(shaft: Shaft, angle: float, speed: float, at: float) -> tuple[float, float, float]:
    """Torque on a free shaft that is `angle` and `speed` behind its command, and stands `at`
    this angle: (T, -dT/dq, -dT/dw).
    """
    bent = angle
    k_angle = shaft.k_angle
    k_speed = shaft.k_speed
    plays = shaft.gap > 0.0
    if in_any_lane(plays):
        bent = angle - min(max(angle, -shaft.gap), shaft.gap)
        side = sign(bent)
        # Hunt and Crossley: the damping grows with the depth, so the torque does not jump at
        # contact; it is never negative, so no pull.
        pressed = select(plays, max(1.0 + shaft.loss * side * speed, 0.0), 1.0)
        k_angle *= select(plays, pressed * abs(side), 1.0)
        k_speed += select(plays & (pressed > 0.0), shaft.k_angle * abs(bent) * shaft.loss, 0.0)
        bent *= pressed
    torque = shaft.feed + shaft.k_angle * bent + shaft.k_speed * speed
    free = abs(torque) <= shaft.limit
    torque = select(free, torque, shaft.limit * sign(torque))
    k_angle = select(free, k_angle, 0.0)
    k_speed = select(free, k_speed, 0.0)
    # Cogging comes from the magnets, so the limit of the current does not apply to it.
    if in_any_lane(shaft.cogging != 0.0):
        electrical = shaft.cycles * (at - shaft.angle) + shaft.phase
        torque += shaft.cogging * np.sin(electrical)
        k_angle -= shaft.cogging * shaft.cycles * np.cos(electrical)
    return torque, k_angle, k_speed


@jit_inline
def drive_rotor(
    shaft: Shaft, t: float, q: Floats, w: Floats, a: Floats, g: float, derive: bool, work: Work
) -> None:
    """Adds rotor and drive torque to row 0, eq. (16), of a free shaft; `q`, `w` and `a` are (c,).

    A prescribed shaft has no row, because its acceleration is known. `derive` says whether J is
    wanted, with the stage's g.
    """
    if not shaft.free:
        return
    angle = shaft.angle
    speed = shaft.speed
    if shaft.breaks.size > 0:
        angle, speed, _ = shaft_at(shaft, t)
    torque, k_angle, k_speed = drive_torque(shaft, angle - q[0], speed - w[0], q[0])
    work.R[0] += shaft.rotor * a[0] - torque
    if derive:
        work.J[0, 0] += shaft.rotor + g * k_speed + g * g * k_angle


@jit_inline
def update_motion(
    shaft: Shaft,
    t: float,
    base_q: Floats,
    base_w: Floats,
    g: float,
    q: Floats,
    w: Floats,
    a: Floats,
) -> None:
    """Writes q and w of a stage from its acceleration, all (c,); a prescribed shaft follows its
    command exactly.
    """
    for i in range(q.size):
        w[i] = base_w[i] + g * a[i]
        q[i] = base_q[i] + g * w[i]
    if not shaft.free:
        q[0], w[0], a[0] = shaft_at(shaft, t)


def allocate_workspace(coordinates: int, links: int) -> Work:
    """Working memory for a chain of so many links (n) and coordinates (c)."""
    # Few large arrays, each cut into views: an integration begins with few allocations.
    v = np.zeros((15, coordinates))
    u = np.zeros((2, links))
    stages = np.zeros((3, 4, coordinates))
    regimes = np.zeros((2, 2, links))
    exchange = np.zeros((2, 8))
    return Work(
        R=np.zeros(coordinates),
        J=np.zeros((coordinates, coordinates)),
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
    chain: Chain,
    laws: Laws,
    shaft: Shaft,
    state: State,
    elapsed: float,
    t: float,
    g: float,
    enough: float,
    reuse: bool,
    work: Work,
) -> bool:
    """Finds `work.a` such that R(base_q + g w, base_w + g a, a) = 0, with q and w. True if the last
    change of w is below `enough`.

    With `reuse`, the factored Jacobian of an earlier stage with the same g is kept while every
    contact and hinge is on the branch of its law on which it was made, and while each iteration
    gains a digit.
    """
    q = work.q
    w = work.w
    a = work.a
    before = np.inf
    # The acceleration of a prescribed shaft is known: its row and column are left out of the
    # system, eq. (16).
    first = 0 if shaft.free else 1
    for _ in range(NEWTON_LIMIT):
        update_motion(shaft, t, work.base_q, work.base_w, g, q, w, a)
        if reuse:
            assemble(chain, laws, state, elapsed, q, w, a, None, work)
            reuse = is_jacobian_valid(chain, work)
        if not reuse:
            # dw/da = g and dq/da = g^2 within the stage, which makes these the weights of the three
            # derivatives of R.
            assemble(chain, laws, state, elapsed, q, w, a, (1.0, g, g * g), work)
            drive_rotor(shaft, t, q, w, a, g, True, work)
            if not factor(work.J, first):
                return False
            store_regime(work)
        else:
            drive_rotor(shaft, t, q, w, a, g, False, work)
        substitute(work.J, first, work.R)
        change = abs(work.R[first])
        finite = work.R[first] < ABSURD_RAD_S2
        for i in range(first, q.size):
            a[i] -= work.R[i]
            finite = finite & (abs(work.R[i]) < ABSURD_RAD_S2)
            change = max(change, abs(work.R[i]))
        if not in_all_lanes(finite):
            return False
        worst = highest(change)
        if g * worst < enough:
            # q and w must agree with the last change of a, since the next step begins from them.
            update_motion(shaft, t, work.base_q, work.base_w, g, q, w, a)
            return True
        reuse = worst < GOOD_CONTRACTION * before
        before = worst
    return False


@jit_inline
def is_jacobian_valid(chain: Chain, work: Work) -> bool:
    """Whether all laws are on the branches on which they were when J was computed."""
    now = work.regime
    then = work.regime_of_J
    same = now[0, 0] == then[0, 0]
    for k in range(now.shape[1]):
        same = (
            same
            & (now[0, k] == then[0, k])
            & (abs(now[1, k] - then[1, k]) <= SAME_SLOPE * chain.k0[k])
        )
    return in_all_lanes(same)


@jit_inline
def store_regime(work: Work) -> None:
    """Stores the branches for which J has just been computed."""
    for i in range(work.regime.shape[0]):
        for k in range(work.regime.shape[1]):
            work.regime_of_J[i, k] = work.regime[i, k]
