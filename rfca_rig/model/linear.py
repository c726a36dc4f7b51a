"""A small dense linear system, solved without leaving compiled code: factored once, substituted as often as it serves."""

from rfca_rig.model.compiled import inlined, internal
from rfca_rig.model.state import Floats, Integers


@inlined
def factor(J: Floats, pivot: Integers, first: int) -> bool:
    """J, from row and column `first` on, becomes its triangular factors with row exchange; False where singular or not finite."""
    n = pivot.size
    for k in range(first, n):
        p = k
        for i in range(k + 1, n):
            if abs(J[i, k]) > abs(J[p, k]):
                p = i
        pivot[k] = p
        if not abs(J[p, k]) > 0.0:
            return False
        if p != k:
            for j in range(first, n):
                J[k, j], J[p, j] = J[p, j], J[k, j]
        inverse = 1.0 / J[k, k]
        J[k, k] = inverse
        for i in range(k + 1, n):
            f = J[i, k] * inverse
            J[i, k] = f
            for j in range(k + 1, n):
                J[i, j] -= f * J[k, j]
    return True


@inlined
def substitute(J: Floats, pivot: Integers, first: int, x: Floats) -> None:
    """Solves for x in place with the factors in J; what stands before `first` is left alone."""
    n = pivot.size
    for k in range(first, n):
        p = pivot[k]
        x[k], x[p] = x[p], x[k]
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


@internal
def solve(J: Floats, pivot: Integers, x: Floats) -> bool:
    """Solves J x = x in place; False where J is singular or not finite."""
    if not factor(J, pivot, 0):
        return False
    substitute(J, pivot, 0, x)
    return True
