"""Solves a small dense linear system in compiled code by LU factors with partial pivoting, which may serve many right sides."""

from rfca_rig.model.compiled import jit_inline, jit_internal
from rfca_rig.model.state import Floats, Integers


@jit_inline
def factor(J: Floats, pivot: Integers, first: int) -> bool:
    """Replaces J (n, n), from row and column `first` on, by its LU factors, `pivot` (n,) the row exchanges.

    False where J is singular or not finite.
    """
    n = pivot.size
    for k in range(first, n):
        p = k
        for i in range(k + 1, n):
            if abs(J[i, k]) > abs(J[p, k]):
                p = i
        pivot[k] = p
        # Written so that NaN, for which each comparison is false, counts as singular.
        if not abs(J[p, k]) > 0.0:
            return False
        if p != k:
            for j in range(first, n):
                J[k, j], J[p, j] = J[p, j], J[k, j]
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
def substitute(J: Floats, pivot: Integers, first: int, x: Floats) -> None:
    """Solves for x (n,) in place with the factors in J (n, n); entries before `first` stay as they are."""
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


@jit_internal
def solve(J: Floats, pivot: Integers, x: Floats) -> bool:
    """Solves J y = x for J (n, n) and x (n,), with y in the place of x; J is overwritten. False where it is singular or not finite."""
    if not factor(J, pivot, 0):
        return False
    substitute(J, pivot, 0, x)
    return True
