"""The ground under the link ends: Hertz with damping, Coulomb friction with stick. Symbols as in `state`."""

import numpy as np

from rfca_rig.model.compiled import compiled
from rfca_rig.model.state import Chain, Floats


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
def add_contacts(chain: Chain, q: Floats, w: Floats, anchor: Floats, cw: float, cq: float, R: Floats, J: Floats, contact: Floats) -> None:
    """Ground forces at every link end; `contact` (2, n) receives N and F. Work of F: F (dY_k - r dq_k)."""
    y = depth = sink = slide = 0.0
    r = chain.radius
    down, along = chain.length * np.cos(q), -chain.length * np.sin(q)  # dD/dq_j and dY/dq_j
    for k in range(q.size):
        y += down[k]  # l cos q is also the run along y
        depth -= along[k]
        sink += down[k] * w[k]
        slide += along[k] * w[k]
        delta = depth + r - chain.ground_depth
        if delta <= 0.0:
            contact[0, k] = contact[1, k] = 0.0
            continue
        N, N_delta, N_rate = normal_force(chain, delta, sink)
        F, F_s, F_v, F_N = tangential_force(chain, y - r * q[k] - anchor[k], slide - r * w[k], N)
        contact[0, k], contact[1, k] = N, F
        for j in range(k + 1):
            along_j = along[j] - (r if j == k else 0.0)
            dN = cq * (N_delta * down[j] + N_rate * along[j] * w[j]) + cw * N_rate * down[j]
            dF = cq * (F_s * along_j - F_v * down[j] * w[j]) + cw * F_v * along_j + F_N * dN
            R[j] += N * down[j] - F * along_j
            J[j, j] += cq * (N * along[j] + F * down[j])
            for i in range(k + 1):
                J[i, j] += dN * down[i] - dF * (along[i] - (r if i == k else 0.0))


@compiled
def drag_anchors(chain: Chain, q: Floats, anchor: Floats, contact: Floats) -> None:
    """After a step: the anchors of slipping ends follow, those of ends in the air wait right below them."""
    y = 0.0
    for k in range(q.size):
        y += chain.length[k] * np.cos(q[k])
        s, reach = y - chain.radius * q[k], chain.mu * contact[0, k] / chain.grip
        anchor[k] = min(max(anchor[k], s - reach), s + reach)
