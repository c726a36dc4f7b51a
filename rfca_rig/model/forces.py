"""Equations of motion of the chain: residual, its derivative, and what the mount feels. Symbols as in `state`."""

import numpy as np

from rfca_rig.model.compiled import compiled
from rfca_rig.model.contact import add_contacts
from rfca_rig.model.state import Chain, Floats, Work


@compiled
def add_inertia(chain: Chain, w: Floats, a: Floats, ca: float, cw: float, cq: float, work: Work) -> None:
    """M a + h: M_ij = c_ij cos(q_i - q_j), h_i = sum_j c_ij sin(q_i - q_j) w_j^2."""
    R, J, sin, cos, moment = work.R, work.J, work.sin, work.cos, chain.moment
    for i in range(w.size):
        R[i] += moment[i, i] * a[i]
        J[i, i] += ca * moment[i, i]
        for j in range(i):
            c = moment[i, j] * (cos[i] * cos[j] + sin[i] * sin[j])
            s = moment[i, j] * (sin[i] * cos[j] - cos[i] * sin[j])
            R[i] += c * a[j] + s * w[j] * w[j]
            R[j] += c * a[i] - s * w[i] * w[i]
            from_j = cq * (s * a[j] - c * w[j] * w[j])
            from_i = cq * (s * a[i] + c * w[i] * w[i])
            J[i, j] += ca * c + cw * 2.0 * s * w[j] + from_j
            J[j, i] += ca * c - cw * 2.0 * s * w[i] - from_i
            J[i, i] -= from_j
            J[j, j] += from_i


@compiled
def add_weight_and_hinges(chain: Chain, q: Floats, w: Floats, cw: float, cq: float, work: Work) -> None:
    """Weight of the links, and in each hinge k0 phi + k0 k2 phi^3 + c dphi/dt."""
    R, J = work.R, work.J
    for i in range(q.size):
        weight = chain.gravity * chain.first_moment[i]
        R[i] -= weight * work.cos[i]
        J[i, i] += cq * weight * work.sin[i]
    for i in range(1, q.size):
        phi, k0, k2, c = q[i] - q[i - 1], chain.k0[i], chain.k2[i], chain.hinge_damping[i]
        torque = k0 * phi * (1.0 + k2 * phi * phi) + c * (w[i] - w[i - 1])
        slope = cq * k0 * (1.0 + 3.0 * k2 * phi * phi) + cw * c
        R[i] += torque
        R[i - 1] -= torque
        J[i, i] += slope
        J[i - 1, i - 1] += slope
        J[i, i - 1] -= slope
        J[i - 1, i] -= slope


@compiled
def assemble(chain: Chain, q: Floats, w: Floats, a: Floats, anchor: Floats, ca: float, cw: float, cq: float, work: Work) -> None:
    """Residual and its derivative at (q, w, a) into `work`: R, J, and the forces of the ground in `work.contact`."""
    for i in range(q.size):
        work.sin[i], work.cos[i] = np.sin(q[i]), np.cos(q[i])
        work.R[i] = 0.0
        for j in range(q.size):
            work.J[i, j] = 0.0
    add_inertia(chain, w, a, ca, cw, cq, work)
    add_weight_and_hinges(chain, q, w, cw, cq, work)
    add_contacts(chain, q, w, anchor, cw, cq, work)


@compiled
def measure(chain: Chain, q: Floats, w: Floats, a: Floats, anchor: Floats, work: Work, force: Floats) -> None:
    """force = (fy, fz, shaft torque): what the leg does to its mount, in the sensor's axes (z down, y against the plane's y)."""
    assemble(chain, q, w, a, anchor, 0.0, 0.0, 0.0, work)
    force[0], force[1], force[2] = 0.0, chain.total_mass * chain.gravity, work.R[0]
    for i in range(w.size):
        sin, cos, ww = work.sin[i], work.cos[i], w[i] * w[i]
        force[0] += chain.first_moment[i] * (-sin * a[i] - cos * ww) - work.contact[1, i]
        force[1] -= chain.first_moment[i] * (cos * a[i] - sin * ww) + work.contact[0, i]
