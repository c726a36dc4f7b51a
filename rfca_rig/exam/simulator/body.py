"""Mass matrix and inertial loads of a chain in RELATIVE angles: composite rigid bodies and one pass
of Newton and Euler.

The plane has y along the floor and d downwards; angles grow from y towards d. Body k turns about
joint k and ends in joint k + 1.

`compiled` compiles the exam's simulator with numba.
"""

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba.extending import register_jitable
from numpy.typing import NDArray

from rfca_rig.compile_cache import CodeCache

Function = TypeVar("Function", bound=Callable[..., object])

_jitable = cast(Any, register_jitable)

Floats = NDArray[np.float64]

# rows of `rod` (4, n)
LENGTH, MASS, CENTRE, INERTIA = range(4)
# rows of `pose` (9, n + 1): joint, its velocity, its centripetal acceleration; direction and
# turning speed of the body
Y, D, VY, VD, AY, AD, COS, SIN, SPIN = range(9)
# rows of `load` (3, n): force and moment from outside at the far end of each body, the moment
# without the force's own
FY, FD, MOMENT = range(3)
# rows of `lump` (2, n): first moments about joint k of all bodies from k on
SY, SD = range(2)


def _folder() -> Path:
    """Cache folder for the present source of the simulator: the cache notices edits in a
    function's own file only.
    """
    content = b"".join(source.read_bytes() for source in sorted(Path(__file__).parent.glob("*.py")))
    parent = os.environ.get("NUMBA_CACHE_DIR") or str(Path.home() / ".cache" / "rfca-rig")
    return Path(parent) / f"exam-{hashlib.sha256(content).hexdigest()[:16]}"


def jit_cached(function: Function) -> Function:
    """The function, compiled on first use and cached on disk; a division by zero gives inf, as
    in numpy.
    """
    dispatcher = cast(Any, numba.njit)(nogil=True, error_model="numpy")(function)
    # Without compilation, as for coverage, it is the Python function itself.
    if dispatcher is not function:
        dispatcher._cache = CodeCache(function, _folder())
    return cast(Function, dispatcher)


def jit_internal(function: Function) -> Function:
    """The same for compiled callers only. Called from the interpreter, the function runs as
    plain Python.
    """
    return cast(
        Function,
        _jitable(nogil=True, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)(
            function
        ),
    )


@jit_internal
def place_bodies(
    rod: Floats, phi: Floats, w: Floats, frame: bool, lean: float, pose: Floats
) -> None:
    """Fill `pose` (9, n + 1) with positions, velocities and centripetal accelerations of all
    joints, from angles and rates (n,).

    With a frame, phi[n] is how far the shaft has moved along a line that leans by `lean` from d
    towards y.
    """
    n = rod.shape[1]
    angle = spin = 0.0
    pose[Y, 0] = pose[VY, 0] = pose[AY, 0] = pose[AD, 0] = pose[D, 0] = pose[VD, 0] = 0.0
    if frame:
        pose[Y, 0] = phi[n] * np.sin(lean)
        pose[D, 0] = phi[n] * np.cos(lean)
        pose[VY, 0] = w[n] * np.sin(lean)
        pose[VD, 0] = w[n] * np.cos(lean)
    for k in range(n):
        angle += phi[k]
        spin += w[k]
        c = np.cos(angle)
        s = np.sin(angle)
        L = rod[LENGTH, k]
        pose[COS, k] = c
        pose[SIN, k] = s
        pose[SPIN, k] = spin
        pose[Y, k + 1] = pose[Y, k] + L * c
        pose[D, k + 1] = pose[D, k] + L * s
        pose[VY, k + 1] = pose[VY, k] - L * s * spin
        pose[VD, k + 1] = pose[VD, k] + L * c * spin
        pose[AY, k + 1] = pose[AY, k] - L * c * spin * spin
        pose[AD, k + 1] = pose[AD, k] - L * s * spin * spin


@jit_internal
def gather(
    rod: Floats,
    pose: Floats,
    load: Floats,
    gravity_y: float,
    gravity_d: float,
    lean: float,
    M: Floats,
    bias: Floats,
    lump: Floats,
) -> None:
    """Mass matrix M (n + 1, n + 1), lower triangle, and the generalised forces at zero
    acceleration, bias (n + 3,).

    Row n of both is the whole leg moving along the frame's line. bias[n + 1] and bias[n + 2] are
    the forces along d and y that hold the leg. `lump` (2, n) receives the first moments about each
    joint.
    """
    n = rod.shape[1]
    mass = sy = sd = inertia = fy = fd = torque = 0.0
    for k in range(n - 1, -1, -1):
        L = rod[LENGTH, k]
        m = rod[MASS, k]
        centre = rod[CENTRE, k]
        c = pose[COS, k]
        s = pose[SIN, k]
        spin = pose[SPIN, k]
        # From the tip to the shaft: the composite body beyond this rod is shifted to joint k by the
        # parallel axis theorem.
        ly = L * c
        ld = L * s
        inertia += 2.0 * (ly * sy + ld * sd) + mass * L * L + rod[INERTIA, k] + m * centre * centre
        sy += mass * ly + m * centre * c
        sd += mass * ld + m * centre * s
        mass += m
        # Newton for this rod: what the next rod passes on, less the external load at the far end,
        # plus the inertial force at the centre.
        out_y = fy - load[FY, k]
        out_d = fd - load[FD, k]
        in_y = m * (pose[AY, k] - centre * c * spin * spin - gravity_y)
        in_d = m * (pose[AD, k] - centre * s * spin * spin - gravity_d)
        torque += ly * out_d - ld * out_y - load[MOMENT, k] + centre * (c * in_d - s * in_y)
        fy = out_y + in_y
        fd = out_d + in_d
        bias[k] = torque
        lump[SY, k] = sy
        lump[SD, k] = sd
        M[k, k] = inertia
        M[n, k] = sy * np.cos(lean) - sd * np.sin(lean)
        for i in range(k):
            M[k, i] = inertia + (pose[Y, k] - pose[Y, i]) * sy + (pose[D, k] - pose[D, i]) * sd
    M[n, n] = mass
    bias[n] = fd * np.cos(lean) + fy * np.sin(lean)
    bias[n + 1] = fd
    bias[n + 2] = fy


@jit_internal
def solve_between(A: Floats, x: Floats, first: int, end: int) -> None:
    """Solve A[first:end, first:end] x = x in place by Cholesky; A (n, n) is symmetric, its lower
    triangle is read and overwritten.
    """
    # The diagonal keeps the reciprocal of each root: the two substitutions then multiply instead of
    # divide.
    for j in range(first, end):
        pivot = A[j, j]
        for k in range(first, j):
            pivot -= A[j, k] * A[j, k]
        root = 1.0 / np.sqrt(pivot)
        A[j, j] = root
        for i in range(j + 1, end):
            rest = A[i, j]
            for k in range(first, j):
                rest -= A[i, k] * A[j, k]
            A[i, j] = rest * root
    for j in range(first, end):
        for k in range(first, j):
            x[j] -= A[j, k] * x[k]
        x[j] *= A[j, j]
    for j in range(end - 1, first - 1, -1):
        for k in range(j + 1, end):
            x[j] -= A[k, j] * x[k]
        x[j] *= A[j, j]
