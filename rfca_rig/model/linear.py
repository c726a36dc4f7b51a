"""A small dense linear system, solved without leaving compiled code."""

from rfca_rig.model.compiled import compiled
from rfca_rig.model.state import Floats


@compiled
def solve(J: Floats, x: Floats) -> bool:
    """Solves J x = x in place by elimination with row exchange; False where J is singular or not finite."""
    n = x.size
    for k in range(n):
        p = k
        for i in range(k + 1, n):
            if abs(J[i, k]) > abs(J[p, k]):
                p = i
        if not abs(J[p, k]) > 0.0:
            return False
        if p != k:
            for j in range(k, n):
                J[k, j], J[p, j] = J[p, j], J[k, j]
            x[k], x[p] = x[p], x[k]
        inverse = 1.0 / J[k, k]
        for i in range(k + 1, n):
            f = J[i, k] * inverse
            if f != 0.0:
                for j in range(k + 1, n):
                    J[i, j] -= f * J[k, j]
                x[i] -= f * x[k]
    for k in range(n - 1, -1, -1):
        for j in range(k + 1, n):
            x[k] -= J[k, j] * x[j]
        x[k] /= J[k, k]
    return True
