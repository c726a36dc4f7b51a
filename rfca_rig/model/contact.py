"""The ground under the link ends: Hertz with damping, Coulomb friction with stick. Symbols as in `state`."""

import numpy as np

from rfca_rig.model.compiled import compiled
from rfca_rig.model.state import Chain, Floats, Work


@compiled
def normal_force(chain: Chain, depth: float, rate: float) -> tuple[float, float, float]:
    """Hertz with damping while approaching, eq. (17): (N, dN/d depth, dN/d rate) for a circle `depth` deep, sinking at `rate`."""
    if depth <= 0.0:
        return 0.0, 0.0, 0.0
    root = np.sqrt(depth)
    hertz = chain.contact_stiffness * depth * root
    if rate <= 0.0:
        return hertz, 1.5 * chain.contact_stiffness * root, 0.0
    grow = 1.0 + chain.contact_damping * rate
    return hertz * grow, 1.5 * chain.contact_stiffness * root * grow, hertz * chain.contact_damping


@compiled
def tangential_force(chain: Chain, stretch: float, slip: float, normal: float) -> tuple[float, float, float, float]:
    """Coulomb friction with stick as a state, eqs. (18)-(19): (F, dF/d stretch, dF/d slip, dF/dN).

    The lowest point is tied to an anchor by a stiff spring; beyond mu N the anchor is dragged along. A leg at rest keeps its
    force for ever, which a law in the sliding speed alone would let creep to zero. `drag` acts beside it, stuck or not.
    """
    spring, limit, drag = -chain.grip * stretch, chain.mu * normal, chain.drag
    if spring > limit:
        return limit - drag * slip, 0.0, -drag, chain.mu
    if spring < -limit:
        return -limit - drag * slip, 0.0, -drag, -chain.mu
    return spring - drag * slip, -chain.grip, -drag, 0.0


@compiled
def add_contacts(chain: Chain, q: Floats, w: Floats, anchor: Floats, cw: float, cq: float, work: Work) -> None:
    """Ground forces at every link end, also into `work.contact` (2, n) = N, F."""
    y = depth = sink = slide = 0.0
    for k in range(q.size):
        down, along = chain.length[k] * work.cos[k], -chain.length[k] * work.sin[k]
        y += down  # l cos q is the run along y, and also dD/dq
        depth -= along
        sink += down * w[k]
        slide += along * w[k]
        if depth + chain.radius <= chain.ground_depth:
            work.contact[0, k] = work.contact[1, k] = 0.0
        else:
            stretch = y - chain.radius * q[k] - anchor[k]
            place = (depth + chain.radius - chain.ground_depth, sink, stretch, slide - chain.radius * w[k])
            add_contact(chain, k, place, w, cw, cq, work)


@compiled
def add_contact(chain: Chain, k: int, place: tuple[float, float, float, float], w: Floats, cw: float, cq: float, work: Work) -> None:
    """The contact at the end of link k; `place` = depth, its rate, stretch from the anchor, slip. Work of F: F (dY_k - r dq_k)."""
    N, N_delta, N_rate = normal_force(chain, place[0], place[1])
    F, F_s, F_v, F_N = tangential_force(chain, place[2], place[3], N)
    work.contact[0, k], work.contact[1, k] = N, F
    R, J = work.R, work.J
    for j in range(k + 1):
        down, along = chain.length[j] * work.cos[j], -chain.length[j] * work.sin[j]
        along_j = along - (chain.radius if j == k else 0.0)
        dN = cq * (N_delta * down + N_rate * along * w[j]) + cw * N_rate * down
        dF = cq * (F_s * along_j - F_v * down * w[j]) + cw * F_v * along_j + F_N * dN
        R[j] += N * down - F * along_j
        J[j, j] += cq * (N * along + F * down)
        for i in range(k + 1):
            J[i, j] += dN * chain.length[i] * work.cos[i] + dF * chain.length[i] * work.sin[i]
        J[k, j] += dF * chain.radius


@compiled
def drag_anchors(chain: Chain, q: Floats, anchor: Floats, contact: Floats) -> None:
    """After a step: the anchors of slipping ends follow, those of ends in the air wait right below them."""
    y = 0.0
    for k in range(q.size):
        y += chain.length[k] * np.cos(q[k])
        s, reach = y - chain.radius * q[k], chain.mu * contact[0, k] / chain.grip
        anchor[k] = min(max(anchor[k], s - reach), s + reach)
