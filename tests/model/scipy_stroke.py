"""The same equations of motion in the hands of SciPy: slow, but somebody else's integrators.

Friction with memory is no ordinary differential equation, so the floor is without it here; its
normal forces stay.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.integrate import solve_ivp

from rfca_rig.model.chain import find_rest_state, make_chain
from rfca_rig.model.kernel.forces import assemble_once
from rfca_rig.model.kernel.stage import allocate_workspace
from rfca_rig.model.kernel.state import NO_LAWS
from rfca_rig.model.parameters import RigModel
from tests.model.legs import PAPER

ICE = replace(PAPER, ground=replace(PAPER.ground, friction_coefficient=0.0, drag_N_s_per_m=0.0))


@dataclass(frozen=True)
class ScipyStroke:
    """fz and the sum of the contact forces (m,), and how often the equations were evaluated."""

    fz_N: np.ndarray
    normal_N: np.ndarray
    evaluations: int


def solve_stroke(
    rig: RigModel,
    height_m: float,
    speed_rad_s: float,
    t_s: np.ndarray,
    rtol: float,
    method: str = "LSODA",
) -> ScipyStroke:
    """A stroke without friction at `t_s` (m,) > 0; the shaft as in `simulate_stroke_at_speed`."""
    chain = make_chain(rig, height_m)
    n = chain.length.size
    ramp_s = rig.drive.ramp_s
    rest = find_rest_state(chain, rig.leg.start_angle_rad)
    work = allocate_workspace(n, n)

    def full(t: float, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        ramping = t < ramp_s
        share = t / ramp_s
        angle = rig.leg.start_angle_rad + speed_rad_s * (
            0.5 * ramp_s * share**2 if ramping else t - 0.5 * ramp_s
        )
        q = np.concatenate([[angle], x[: n - 1]])
        w = np.concatenate([[speed_rad_s * min(share, 1.0)], x[n - 1 :]])
        a = np.zeros(n)
        a[0] = speed_rad_s / ramp_s if ramping else 0.0
        assemble_once(chain, NO_LAWS, rest, 0.0, q, w, a, (1.0, 0.0, 0.0), work)
        a[1:] = np.linalg.solve(work.J[1:, 1:], -work.R[1:])
        return q, w, a

    def rhs(t: float, x: np.ndarray) -> np.ndarray:
        _, w, a = full(t, x)
        return np.concatenate([w[1:], a[1:]])

    fz = []
    normal = []
    evaluations = 0
    x = np.concatenate([rest.q[1:], np.zeros(n - 1)])
    t0 = 0.0
    for part in (
        t_s[t_s <= ramp_s],
        t_s[t_s > ramp_s],
    ):  # the shaft's acceleration jumps in between
        solution = solve_ivp(rhs, (t0, part[-1]), x, method, part, rtol=rtol, atol=1e-3 * rtol)
        for t, y in zip(part, solution.y.T, strict=True):
            q, w, a = full(t, y)
            sunk = chain.first_moment @ (np.cos(q) * a - np.sin(q) * w**2)
            normal.append(work.contact[0].sum())
            fz.append(chain.total_mass * chain.gravity - sunk - normal[-1])
        evaluations += solution.nfev
        x = solution.y[:, -1]
        t0 = part[-1]
    return ScipyStroke(np.array(fz), np.array(normal), evaluations)
