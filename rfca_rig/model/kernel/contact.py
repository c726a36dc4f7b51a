"""Contact of the link ends with the ground: Hertz with damping, Coulomb friction with stick.
Symbols as in `state`.

Friction depends on how far an end has slipped, and within a step only the position at its beginning
is known. An end that reverses its slip inside a step has been farther than where it ends, and one
that touches down was tied where it touched. The step is therefore cut short just after a reversal,
and the anchors follow from the path of the end.
"""

import numpy as np

from rfca_rig.model.kernel.bump import (
    SLOPE,
    Y,
    add_normal_rotation,
    locate_on_bump,
    measure_climb,
    rotate_arms,
)
from rfca_rig.model.kernel.compiled import jit_inline
from rfca_rig.model.kernel.lanes import in_any_lane, lowest, select, sign
from rfca_rig.model.kernel.laws import LOAD, NORMAL, SLIP, call_law
from rfca_rig.model.kernel.state import Chain, Floats, Laws, State, Weights, Work

Normal = tuple[float, float, float]
Tangential = tuple[float, float, float, float]

# Viscous drag grows in proportion to the normal force up to this value, so that it vanishes where
# an end lifts off.
FULL_DRAG_N = 1.0

# Share of the presliding by which an end may move back unnoticed. In that step, friction errs by
# this share of mu N.
MISSED_SHARE = 0.02
WITHIN_REACH = 1.0 - 1e-9  # a stretch at the presliding, but for rounding


@jit_inline
def normal_force(
    stiffness: float, damping: float, depth: float, rate: float
) -> tuple[float, float, float]:
    """Hertz with damping, eq. (17): (N, dN/d depth, dN/d rate). An end that leaves is pushed less,
    but never pulled.

    N = stiffness depth^1.5 (1 + damping rate) for a depth [m] above 0 and a depth rate [m/s], after
    Hunt and Crossley (1975).
    """
    # Below the rate where `grow` is 0 the law would pull. N is continuous there, and zero slopes
    # are those of the branch N = 0.
    root = np.sqrt(depth)
    grow = 1.0 + damping * rate
    N = stiffness * depth * root
    N_depth = 1.5 * stiffness * root
    pushes = grow > 0.0
    return (
        select(pushes, N * grow, 0.0),
        select(pushes, N_depth * grow, 0.0),
        select(pushes, N * damping, 0.0),
    )


@jit_inline
def plain_normal_force(chain: Chain, depth: float, rate: float) -> tuple[float, float, float]:
    """(N, dN/d depth, dN/d rate) of the nominal floor, whose damping may differ between an end
    that enters and one that leaves.
    """
    damping = select(rate > 0.0, chain.contact_damping, chain.leaving_damping)
    return normal_force(chain.contact_stiffness, damping, depth, rate)


@jit_inline
def sum_normal_laws(
    laws: Laws, depth: float, rate: float, work: Work
) -> tuple[float, float, float]:
    """(N, dN/d depth, dN/d rate) that laws of effects add to the nominal floor."""
    x = work.x
    out = work.out
    N = N_depth = N_rate = 0.0
    for m in range(laws.place.size):
        if laws.place[m] == NORMAL:
            x[0] = depth
            x[1] = rate
            call_law(laws.address[m], x, x, laws.parameter[m], out)
            N = N + out[0]
            N_depth = N_depth + out[1]
            N_rate = N_rate + out[2]
    return N, N_depth, N_rate


@jit_inline
def friction_factor(
    laws: Laws, slip: float, normal: float, work: Work
) -> tuple[float, float, float]:
    """Factor of all effects on the friction coefficient at a sliding speed and a normal force,
    and its derivatives by both.
    """
    x = work.x
    out = work.out
    factor = 1.0
    factor_v = 0.0
    factor_N = 0.0
    for m in range(laws.place.size):
        if laws.place[m] == SLIP:
            x[0] = slip
            call_law(laws.address[m], x, x, laws.parameter[m], out)
            factor, factor_v, factor_N = (
                factor * out[0],
                factor_v * out[0] + factor * out[1],
                factor_N * out[0],
            )
        elif laws.place[m] == LOAD:
            x[0] = normal
            call_law(laws.address[m], x, x, laws.parameter[m], out)
            factor, factor_v, factor_N = (
                factor * out[0],
                factor_v * out[0],
                factor_N * out[0] + factor * out[1],
            )
    return factor, factor_v, factor_N


@jit_inline
def carry_stretch(
    stretch: float, limit: float, begun: float, begun_limit: float
) -> tuple[float, float, float]:
    """Force of a tie times the presliding, which is stretch times friction limit, and its
    derivatives by both.

    The stiffness of a tie is the limit mu N over presliding. The step began with the stretch
    `begun` under the limit `begun_limit`. Where the limit falls, the force falls with it. Where it
    grows, the present force stays and only further stretch is stiffer: a force that grew with the
    limit would give back more energy than the tie took.
    """
    falls = limit < begun_limit
    # The limit grows linearly over the step, so that further stretch meets its mean stiffness:
    # second order in the step.
    mean = 0.5 * (limit + begun_limit)
    more = stretch - begun
    return (
        select(falls, limit * stretch, begun_limit * begun + mean * more),
        select(falls, limit, mean),
        select(falls, stretch, 0.5 * more),
    )


@jit_inline
def tangential_force(
    chain: Chain,
    friction: tuple[float, float, float],
    stretch: float,
    slip: float,
    normal: float,
    begun: float,
    begun_limit: float,
) -> Tangential:
    """Coulomb friction with stick as a state, eqs. (18)-(19): (F, dF/d stretch, dF/d slip, dF/dN).

    The lowest point is tied to an anchor; the tie carries mu N at the stretch `presliding`, and
    beyond it the anchor is dragged along. A leg at rest keeps its force for ever; under a law in
    the sliding speed alone it would creep to zero. Drag acts in addition, stuck or not, and
    vanishes with the normal force. Where an end is pulled down (N < 0, adhesion) friction has the
    magnitude of N. `friction` is mu with its derivatives by slip and N; `begun` and `begun_limit`
    are as in `carry_stretch`.
    """
    mu, mu_v, mu_N = friction
    pressed = abs(normal)
    side = select(normal >= 0.0, 1.0, -1.0)
    limit = mu * pressed
    carried, F_s, F_limit = carry_stretch(stretch, limit, begun, begun_limit)
    F = -carried / chain.presliding
    F_s = -F_s / chain.presliding
    F_limit = -F_limit / chain.presliding
    # The end slips: F is at its limit, its slope by stretch is 0, and by the limit it is the sign
    # of F.
    slips = abs(F) > limit
    way = select(F > 0.0, 1.0, -1.0)
    F = select(slips, way * limit, F)
    F_s = select(slips, 0.0, F_s)
    F_limit = select(slips, way, F_limit)
    light = pressed < FULL_DRAG_N
    drag = select(light, chain.drag * pressed / FULL_DRAG_N, chain.drag)
    drag_N = select(light, chain.drag * side / FULL_DRAG_N, 0.0)
    F_N = F_limit * (mu * side + mu_N * pressed) - drag_N * slip
    return F - drag * slip, F_s, F_limit * mu_v * pressed - drag, F_N


@jit_inline
def correct_path(chain: Chain, state: State, k: int, q: Floats, work: Work) -> float:
    """Correction [m] of the path of end k since the step began, where its lever depends on depth or
    the floor has a bump.

    It is the path beyond that along a level floor with the full lever: the end rolls less, and it
    climbs the bump. Second order in the step; end k is located in `work`, and `q` (c,) are the
    present coordinates.
    """
    way = 0.0
    if in_any_lane(chain.lever_rise != 0.0):
        # The lever shrinks with the depth; the mean of both ends of the step makes the integral
        # second order.
        depth = 0.5 * (max(work.ends[k, 0], 0.0) + max(work.place[k, 0], 0.0))
        way = chain.lever_rise * depth * (q[k] - state.q[k])
    if in_any_lane(chain.bump_height != 0.0):
        return way + measure_climb(k, work)
    return way


@jit_inline
def project_frame_on_floor(chain: Chain) -> tuple[float, float]:
    """Components along the floor and into it of a unit displacement of the frame."""
    along = chain.frame_down * chain.floor_sin + chain.frame_aside * chain.floor_cos
    return along, chain.frame_down * chain.floor_cos - chain.frame_aside * chain.floor_sin


@jit_inline
def locate_ends(chain: Chain, state: State, q: Floats, w: Floats, work: Work) -> None:
    """Writes depth, depth rate, stretch from the anchor and slip of every link end into
    `work.place` (n, 7); `q`, `w` are (c,).
    """
    place = work.place
    links = chain.length.size
    y = slide = depth = sink = 0.0
    if q.size > links:
        along_floor, into_floor = project_frame_on_floor(chain)
        y = q[links] * along_floor
        depth = q[links] * into_floor
        slide = w[links] * along_floor
        sink = w[links] * into_floor
    for k in range(links):
        down = work.down[k]
        along = work.along[k]
        # `down` serves twice: y grows by length cos q, which is also the rate at which the end
        # sinks with the angle.
        y += down
        depth -= along
        sink += down * w[k]
        slide += along * w[k]
        place[k, 0] = depth + chain.radius - chain.ground_depth * chain.floor_cos
        place[k, 1] = sink
        if in_any_lane(chain.bump_height != 0.0):
            run = locate_on_bump(chain, k, y, slide, sink, work)
        else:
            run = slide
        # The point where friction acts rolls along the floor: the link's angle times the lever is
        # no sliding.
        place[k, 2] = (
            y - chain.lever * q[k] + correct_path(chain, state, k, q, work) - state.anchor[k]
        )
        place[k, 3] = run - (chain.lever - chain.lever_rise * max(place[k, 0], 0.0)) * w[k]


@jit_inline
def add_contacts(chain: Chain, laws: Laws, w: Floats, weights: Weights | None, work: Work) -> None:
    """Adds the ground forces at the located ends to R and J, and writes them into `work.contact`
    (2, n) = N, F.

    With the laws of effects and a frame that yields. `w` is (c,); without `weights` J stays as it
    is.
    """
    place = work.place
    contact = work.contact
    for k in range(place.shape[0]):
        contact[0, k] = contact[1, k] = work.regime[0, k] = work.limit[0, k] = 0.0
        touches = place[k, 0] > 0.0
        if in_any_lane(touches):
            depth = max(place[k, 0], 0.0)
            N, N_depth, N_rate = plain_normal_force(chain, depth, place[k, 1])
            more, more_depth, more_rate = sum_normal_laws(laws, depth, place[k, 1], work)
            N = N + more
            N_depth = N_depth + more_depth
            N_rate = N_rate + more_rate
            factor, factor_v, factor_N = friction_factor(laws, place[k, 3], N, work)
            friction = (chain.mu * factor, chain.mu * factor_v, chain.mu * factor_N)
            F, F_s, F_v, F_N = tangential_force(
                chain, friction, place[k, 2], place[k, 3], N, work.ends[k, 2], work.limit[2, k]
            )
            # In a lane whose end is in the air nothing acts.
            normal = (
                select(touches, N, 0.0),
                select(touches, N_depth, 0.0),
                select(touches, N_rate, 0.0),
            )
            tangential = (
                select(touches, F, 0.0),
                select(touches, F_s, 0.0),
                select(touches, F_v, 0.0),
                select(touches, F_N, 0.0),
            )
            work.limit[0, k] = select(touches, friction[0] * abs(N), 0.0)
            contact[0, k] = normal[0]
            contact[1, k] = tangential[0]
            # Branch of the law, by which `stage` judges whether J is still valid: 0 in the air, 1
            # stuck, else 2 + the sign of the stretch.
            work.regime[0, k] = select(
                touches, select(F_s != 0.0, 1.0, 2.0 + sign(place[k, 2])), 0.0
            )
            # Over a level floor the directions of all ends agree; on a bump each end has its own.
            across = work.down
            aside = work.along
            frame_aside, frame_across = project_frame_on_floor(chain)
            if in_any_lane(chain.bump_height != 0.0):
                across = work.across
                aside = work.aside
                frame_aside, frame_across = rotate_arms(chain, k, frame_aside, frame_across, work)
            add_contact(chain, k, normal, tangential, w, weights, work, across, aside)
            if w.size > place.shape[0]:
                add_frame_contact(
                    chain,
                    k,
                    normal,
                    tangential,
                    w,
                    weights,
                    work,
                    across,
                    aside,
                    frame_across,
                    frame_aside,
                )
            if weights is not None and in_any_lane(chain.bump_height != 0.0):
                add_normal_rotation(chain, k, normal, tangential, w, weights[2], work)


@jit_inline
def add_contact(
    chain: Chain,
    k: int,
    normal: Normal,
    tangential: Tangential,
    w: Floats,
    weights: Weights | None,
    work: Work,
    down: Floats,
    along: Floats,
) -> None:
    """Adds the contact at the end of link k to R and, with `weights`, to J.

    The virtual work of F is F (dY_k - arm dq_k), arm = l - rise delta. `w` is (c,). `down` and
    `along` (n,) are how the end moves into and along the floor under it per radian of each link.
    """
    N, N_delta, N_rate = normal
    F, F_s, F_v, F_N = tangential
    R = work.R
    J = work.J
    arm = chain.lever - chain.lever_rise * work.place[k, 0]
    for j in range(k + 1):
        R[j] += N * down[j] - F * (along[j] - (arm if j == k else 0.0))
    if weights is None:
        return
    _, cw, cq = weights
    for j in range(k + 1):
        along_j = along[j] - (arm if j == k else 0.0)
        # dN and dF: change of the forces per unit of coordinate j, by angle and by speed. The
        # directions turn with q_j, too.
        dN = cq * (N_delta * down[j] + N_rate * along[j] * w[j]) + cw * N_rate * down[j]
        dF = cq * (F_s * along_j - F_v * down[j] * w[j]) + cw * F_v * along_j + F_N * dN
        # d down_j / dq_j = along_j and d along_j / dq_j = -down_j, at constant forces.
        J[j, j] += cq * (N * along[j] + F * down[j])
        J[k, j] -= cq * F * chain.lever_rise * down[j]
        for i in range(k + 1):
            J[i, j] += dN * down[i] - dF * (along[i] - (arm if i == k else 0.0))


@jit_inline
def add_frame_contact(
    chain: Chain,
    k: int,
    normal: Normal,
    tangential: Tangential,
    w: Floats,
    weights: Weights | None,
    work: Work,
    down: Floats,
    along: Floats,
    cos: float,
    sin: float,
) -> None:
    """Adds the contact at the end of link k to the row and column of the frame's coordinate.

    A unit displacement of the frame moves every end by `cos` into the floor and `sin` along it. `w`
    is (c,); `down` and `along` (n,) are as in `add_contact`.
    """
    R = work.R
    J = work.J
    b = w.size - 1
    N, N_delta, N_rate = normal
    F, F_s, F_v, F_N = tangential
    R[b] += N * cos - F * sin
    if weights is None:
        return
    _, cw, cq = weights
    dN = (cq * N_delta + cw * N_rate) * cos
    dF = (cq * F_s + cw * F_v) * sin + F_N * dN
    J[b, b] += dN * cos - dF * sin
    arm = chain.lever - chain.lever_rise * work.place[k, 0]
    J[k, b] -= cq * F * chain.lever_rise * cos
    for j in range(k + 1):
        along_j = along[j] - (arm if j == k else 0.0)
        J[j, b] += dN * down[j] - dF * along_j
        dN_j = cq * (N_delta * down[j] + N_rate * along[j] * w[j]) + cw * N_rate * down[j]
        dF_j = cq * (F_s * along_j - F_v * down[j] * w[j]) + cw * F_v * along_j + F_N * dN_j
        J[b, j] += dN_j * cos - dF_j * sin


@jit_inline
def stretch_after(chain: Chain, k: int, stretch: float, limit: float, work: Work) -> float:
    """Stretch [m] of the tie of end k after a step to `stretch` under the friction limit
    `limit`: its force over its present stiffness.
    """
    # No tie in the air. Beyond the presliding the end has slipped, and the anchor follows it.
    tied = (work.place[k, 0] > 0.0) & (limit > 0.0)
    carried, _, _ = carry_stretch(stretch, limit, work.ends[k, 2], work.limit[2, k])
    return select(
        tied, min(max(carried / select(tied, limit, 1.0), -chain.presliding), chain.presliding), 0.0
    )


@jit_inline
def drag_anchors(chain: Chain, state: State, q: Floats, work: Work) -> None:
    """Moves the anchors with slipping ends, and puts them below those in the air; `q` is (c,), the
    ends are located in `work`.

    For a leg at rest, or a step in which no end reversed its slip; `update_friction_anchors` treats
    the others.
    """
    if q.size > chain.length.size:
        y = q[chain.length.size] * project_frame_on_floor(chain)[0]
    else:
        y = 0.0
    for k in range(chain.length.size):
        y += work.down[k]
        more = correct_path(chain, state, k, q, work)
        s = y - chain.lever * q[k] + more
        state.anchor[k] = (
            s - stretch_after(chain, k, s - state.anchor[k], work.limit[0, k], work) - more
        )


@jit_inline
def measure_slip_reversal(chain: Chain, h: float, k: int, work: Work) -> float:
    """Distance [m] from the farthest point of end k to its place at the step's end, if it
    slipped first and then reversed; else 0.
    """
    # It must touch at both ends of the step, reverse its speed, and have slipped along its speed,
    # at its full stretch, at the beginning.
    v0 = work.ends[k, 3]
    v1 = work.place[k, 3]
    stretch = work.ends[k, 2]
    touches = (work.ends[k, 0] > 0.0) & (work.place[k, 0] > 0.0)
    reverses = (
        (v0 * v1 < 0.0) & (stretch * v0 > 0.0) & (abs(stretch) >= WITHIN_REACH * chain.presliding)
    )
    # The speed changes linearly from v0 to v1, so the last part of the step after the reversal
    # takes h |v1| / |v0 - v1|.
    return select(touches & reverses, 0.5 * h * v1 * v1 / abs(v0 - v1), 0.0)


@jit_inline
def limit_step_to_reversal(chain: Chain, h: float, work: Work) -> float:
    """Length [s] of a step that ends just after the first reversal of an end; h if none moves
    back farther than allowed.
    """
    allowed = MISSED_SHARE * chain.presliding
    shorter = h
    for k in range(work.place.shape[0]):
        far = measure_slip_reversal(chain, h, k, work) > allowed
        if in_any_lane(far):
            # With constant deceleration the end stands after v0 / braking; from there it moves back
            # by a quarter of what is allowed.
            v0 = abs(work.ends[k, 3])
            braking = (v0 + abs(work.place[k, 3])) / h
            shorter = min(
                shorter, lowest(select(far, (v0 + np.sqrt(0.5 * braking * allowed)) / braking, h))
            )
    return shorter


@jit_inline
def update_friction_anchors(chain: Chain, state: State, h: float, q: Floats, work: Work) -> bool:
    """Updates the anchors (n,) after a step of length h [s] to `q` (c,), the ends located in
    `work`.

    True where an end reversed or touched down: a friction force has changed, and the accelerations
    must be computed again.
    """
    changed = chain.presliding < 0.0  # in no lane so far
    if q.size > chain.length.size:
        y = q[chain.length.size] * project_frame_on_floor(chain)[0]
    else:
        y = 0.0
    for k in range(chain.length.size):
        y += work.down[k]
        more = correct_path(chain, state, k, q, work)
        s = y - chain.lever * q[k] + more
        depth = work.place[k, 0]
        rate = work.place[k, 1]
        slip = work.place[k, 3]
        limit = work.limit[1, k]
        stretch = s - state.anchor[k]
        back = measure_slip_reversal(chain, h, k, work)
        # An end that reversed slips to the farthest point first, which drags the anchor along; then
        # the tie relaxes by the way back.
        excursion = back * sign(work.ends[k, 3])
        # After a touchdown the limit has grown from zero since then, which halves the force of the
        # stretch.
        touches_down = (depth > 0.0) & (work.ends[k, 0] <= 0.0)
        touched_s = select(rate > 0.0, min(depth / rate, h), h)
        stretch = select(
            touches_down,
            0.5 * slip * touched_s,
            stretch_after(chain, k, stretch + excursion, limit, work) - excursion,
        )
        changed = changed | touches_down | (back > 0.0)
        reach = select(depth > 0.0, chain.presliding, 0.0)
        state.anchor[k] = s - min(max(stretch, -reach), reach) - more
    store_ends(chain, state, q, work)
    for k in range(chain.length.size):
        work.limit[2, k] = work.limit[1, k]
    return in_any_lane(changed)


@jit_inline
def store_ends(chain: Chain, state: State, q: Floats, work: Work) -> None:
    """Stores the motion of the located ends in `work.ends` (n, 7), for the next step, with the
    stretch from the new anchors; `q` (c,).
    """
    if q.size > chain.length.size:
        y = q[chain.length.size] * project_frame_on_floor(chain)[0]
    else:
        y = 0.0
    for k in range(chain.length.size):
        y += work.down[k]
        work.ends[k, 0] = work.place[k, 0]
        work.ends[k, 1] = work.place[k, 1]
        work.ends[k, 3] = work.place[k, 3]
        if in_any_lane(chain.bump_height != 0.0):
            work.ends[k, Y] = work.place[k, Y]
            work.ends[k, SLOPE] = work.place[k, SLOPE]
        work.ends[k, 2] = y - chain.lever * q[k] - state.anchor[k]
