"""Large deflection of a thin strip that only bends: the discrete elastica of the paper's (1), (2),
(4) and (7).

The strip is described by its tangent angle theta(s) over arc length, so that the curvature is
dtheta/ds exactly; written for y(x), this is (1). Axes of the strip: x along the tangent at its near
end before it bends, y across. With nodes s_0..s_N, their weights w_j of the trapezoid rule, and the
multipliers of (4):

    U     = sum_e EI / (2 ds_e) (theta_e+1 - theta_e)^2               (7)
    end   = sum_j w_j (cos theta_j, sin theta_j)
    L     = U - F . end + sum_i lambda_i (theta(s_i) - beta_i) + mu . (end - target)

Newton-Raphson on dL = 0. By the envelope theorem dU/dbeta_i = -lambda_i, the moment that a hold
exerts, and dU/dtarget = -mu, its force. The error is of second order in the node distance, and even
in it, so that one Richardson step gives the fourth order.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvalsh_tridiagonal
from scipy.sparse import bmat, coo_matrix, csc_matrix, diags
from scipy.sparse.linalg import splu

from rfca_rig.errors import SimulationFailed

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

MOST_ITERATIONS = 100
LARGEST_TURN_RAD = 0.3  # per node and iteration: keeps Newton on its branch
SETTLED_RAD = 1e-10
FIRST_LOAD = 0.5  # of EI / L^2, a fifth of Euler's load of a cantilever
LARGEST_STRIDE_RAD = 0.3  # between loads: a shape farther away may lie on another branch
SHORTEST_STEP = 1e-7


@dataclass(frozen=True)
class Mesh:
    """Nodes along a strip of bending stiffness EI: `s_m` (N+1,), ascending from 0."""

    s_m: Floats
    EI_Nm2: float

    @property
    def weights_m(self) -> Floats:
        """(N+1,) of the trapezoid rule."""
        half = 0.5 * np.diff(self.s_m)
        return np.concatenate(([0.0], half)) + np.concatenate((half, [0.0]))

    @property
    def stiffness(self) -> Any:
        """Sparse (N+1, N+1): U = theta . stiffness . theta / 2."""
        k = self.EI_Nm2 / np.diff(self.s_m)
        diagonal = np.concatenate(([0.0], k)) + np.concatenate((k, [0.0]))
        return diags([-k, diagonal, -k], [-1, 0, 1], format="csc")

    def end_m(self, theta_rad: Floats) -> Floats:
        """(2,) place of the far end."""
        return np.array([self.weights_m @ np.cos(theta_rad), self.weights_m @ np.sin(theta_rad)])


@dataclass(frozen=True)
class Holds:
    """Constraints of the strip: tangent angles at some nodes, both (m,), and the place of its
    far end, where that is given.
    """

    nodes: Ints
    angle_rad: Floats
    end_m: tuple[float, float] | None = None


@dataclass(frozen=True)
class Bent:
    """A bent strip: `theta_rad` (N+1,), `multipliers` (m,) or (m + 2,) as in L, `energy_J` the
    bending energy alone; `end_m` is (2,).
    """

    mesh: Mesh
    theta_rad: Floats
    multipliers: Floats
    energy_J: float
    iterations: int

    @property
    def end_m(self) -> Floats:
        return self.mesh.end_m(self.theta_rad)

    @property
    def greatest_curvature_per_m(self) -> float:
        return float(np.abs(np.diff(self.theta_rad) / np.diff(self.mesh.s_m)).max())


@dataclass(frozen=True)
class Tip:
    """Place of the end of a cantilever, and its tangent angle."""

    x_m: float
    y_m: float
    slope_rad: float


def even_mesh(EI_Nm2: float, length_m: float, elements: int) -> Mesh:
    """Mesh of equal elements, second order in their length."""
    return Mesh(np.linspace(0.0, length_m, elements + 1), EI_Nm2)


def mesh_through(
    EI_Nm2: float, length_m: float, stations_m: Floats, elements: int
) -> tuple[Mesh, Ints]:
    """Mesh of about `elements` elements with a node on every station `stations_m` (h,), and the
    indices (h,) of those nodes.
    """
    # Equal elements between neighbouring stations, at least one, in proportion to the distance.
    borders = np.unique(np.concatenate(([0.0], stations_m, [length_m])))
    counts = np.maximum(1, np.round(elements * np.diff(borders) / length_m)).astype(int)
    parts = [
        np.linspace(a, b, n, endpoint=False)
        for a, b, n in zip(borders[:-1], borders[1:], counts, strict=True)
    ]
    s = np.concatenate([*parts, [length_m]])
    return Mesh(s, EI_Nm2), np.searchsorted(s, stations_m)


def bend(mesh: Mesh, holds: Holds, force_N: Floats, start_rad: Floats) -> Bent:
    """Stationary shape of a strip, by Newton-Raphson.

    Parameters
    ----------
    mesh, holds
        The strip, and its constraints.
    force_N
        (2,) on the far end, along x and y.
    start_rad
        (N+1,) tangent angles from which the iteration begins; it decides the branch.

    Raises
    ------
    SimulationFailed
        Where the iteration does not converge.

    References
    ----------
    Equations (4) and (7).
    """
    bent = _newton(mesh, holds, force_N, start_rad)
    if bent is None:
        raise SimulationFailed(
            f"strip of {1e3 * mesh.s_m[-1]:.1f} mm under {np.hypot(*force_N):.3g} N: its "
            f"shape does not settle to {SETTLED_RAD:g} rad in "
            f"{MOST_ITERATIONS} iterations; go there in smaller steps, or with more elements"
        )
    return bent


def _newton(mesh: Mesh, holds: Holds, force_N: Floats, start_rad: Floats) -> Bent | None:
    theta = start_rad.copy()
    multipliers = np.zeros(_count(holds))
    for iteration in range(1, MOST_ITERATIONS + 1):
        residual, matrix = _system(mesh, holds, force_N, theta, multipliers)
        change = splu(matrix).solve(-residual)
        turn = float(np.abs(change[: theta.size]).max())
        # The multipliers are damped alike, or they would belong to another shape.
        change *= min(1.0, LARGEST_TURN_RAD / max(turn, SETTLED_RAD))
        theta = theta + change[: theta.size]
        multipliers = multipliers + change[theta.size :]
        if turn < SETTLED_RAD:
            return Bent(
                mesh, theta, multipliers, float(0.5 * theta @ (mesh.stiffness @ theta)), iteration
            )
    return None


def sensitivity(bent: Bent, holds: Holds, force_N: Floats) -> Floats:
    """(m, m) second derivatives of U with respect to the held angles (and the end's place, where
    held), at a converged shape.

    `force_N` (2,) is the force for which it was computed.
    """
    # A unit change of each constraint on the right side of the last Newton system: the multipliers
    # respond by minus the second derivative.
    _, matrix = _system(bent.mesh, holds, force_N, bent.theta_rad, bent.multipliers)
    size = bent.theta_rad.size
    count = bent.multipliers.size
    moved = np.zeros((size + count, count))
    moved[size:] = np.eye(count)
    return -np.asarray(splu(matrix).solve(moved))[size:]


def bend_cantilever(
    EI_Nm2: float, length_m: float, force_N: tuple[float, float], elements: int = 100
) -> Bent:
    """A strip clamped at s = 0 along x, with a force (x, y) of constant direction on its tip, on
    the branch that begins at rest.

    Every shape on the path is stable. Raises SimulationFailed where there is no such path: under a
    force straight back along the strip, beyond Euler's load, it may buckle to either side.
    """
    mesh = even_mesh(EI_Nm2, length_m, elements)
    clamp = Holds(np.array([0]), np.zeros(1))
    force = np.array(force_N)
    theta = np.zeros(elements + 1)
    # The load grows in steps, which are halved where Newton fails or leaves the branch, and grow by
    # half where it does not.
    share = 0.0
    step = min(1.0, FIRST_LOAD * EI_Nm2 / length_m**2 / max(np.hypot(*force), 1e-300))
    while True:
        bent = _newton(mesh, clamp, min(share + step, 1.0) * force, theta)
        if bent is None or not _follows(bent, theta, min(share + step, 1.0) * force):
            step *= 0.5
            if step < SHORTEST_STEP:
                raise SimulationFailed(
                    f"strip of {1e3 * length_m:.1f} mm: at {share:.6f} of "
                    f"{np.hypot(*force):.3g} N the next shape is not near; "
                    "where the force is straight back along the strip, give it a little to one side"
                )
            continue
        share = min(share + step, 1.0)
        theta = bent.theta_rad
        if share == 1.0:
            return bent
        step *= 1.5


def cantilever_tip(
    EI_Nm2: float, length_m: float, force_N: tuple[float, float], elements: int = 50
) -> Tip:
    """Tip of a cantilever to fourth order: Richardson extrapolation from `elements` and twice as
    many.
    """
    coarse, fine = (bend_cantilever(EI_Nm2, length_m, force_N, n) for n in (elements, 2 * elements))
    x, y = (4.0 * fine.end_m - coarse.end_m) / 3.0
    return Tip(float(x), float(y), float((4.0 * fine.theta_rad[-1] - coarse.theta_rad[-1]) / 3.0))


def _follows(bent: Bent, before_rad: Floats, force_N: Floats) -> bool:
    """Whether the shape is near the one before and a minimum of U - F . end; Newton also finds
    the unbent strip under a buckling load.
    """
    near = np.abs(bent.theta_rad - before_rad).max() <= LARGEST_STRIDE_RAD
    _, matrix = _system(
        bent.mesh, Holds(np.array([0]), np.zeros(1)), force_N, bent.theta_rad, bent.multipliers
    )
    # The clamped node is fixed and the last row belongs to its multiplier: what remains of the
    # matrix is tridiagonal.
    diagonal = matrix.diagonal()[1:-1]
    beside = matrix.diagonal(1)[1:-1]
    lowest = eigvalsh_tridiagonal(diagonal, beside, select="i", select_range=(0, 0))[0]
    return bool(near and lowest > 0.0)


def _count(holds: Holds) -> int:
    return holds.nodes.size + (0 if holds.end_m is None else 2)


def _system(
    mesh: Mesh, holds: Holds, force_N: Floats, theta: Floats, multipliers: Floats
) -> tuple[Floats, Any]:
    """Gradient of L by theta and multipliers, and its derivative."""
    cos = mesh.weights_m * np.cos(theta)
    sin = mesh.weights_m * np.sin(theta)
    pull = force_N.copy()
    gap = theta[holds.nodes] - holds.angle_rad
    rows = csc_matrix(
        coo_matrix(
            (np.ones(holds.nodes.size), (np.arange(holds.nodes.size), holds.nodes)),
            (holds.nodes.size, theta.size),
        )
    )
    # A held end acts like a force on it: minus its multipliers.
    if holds.end_m is not None:
        pull -= multipliers[-2:]
        gap = np.concatenate((gap, [cos.sum() - holds.end_m[0], sin.sum() - holds.end_m[1]]))
    slopes = rows if holds.end_m is None else bmat([[rows], [np.stack((-sin, cos))]])
    along = multipliers[: holds.nodes.size] @ rows
    gradient = mesh.stiffness @ theta + pull[0] * sin - pull[1] * cos + along
    curvature = mesh.stiffness + diags(pull[0] * cos + pull[1] * sin)
    return np.concatenate((gradient, gap)), bmat(
        [[curvature, slopes.T], [slopes, None]], format="csc"
    )
