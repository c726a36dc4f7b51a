"""Contact with a floor that has a bump: nearest point, depth and slope. Symbols as in `state`.

The height of the floor over its level is B exp(-((Y - Y_0) / b)^2). The depth of the circle around
an end is measured along the normal of the floor, from the point of the floor that is nearest to the
end. The gradient of that depth is the unit normal, so that a force which depends on the depth alone
is conservative.
"""

import numpy as np

from rfca_rig.model.kernel.compiled import jit, jit_inline
from rfca_rig.model.kernel.lanes import in_all_lanes, in_any_lane, select
from rfca_rig.model.kernel.state import Chain, Floats, Work

ROUNDS = 12  # of Newton's iteration at most; it takes three or four
FOUND_M = 1e-12
# Least derivative of the condition that is solved. It is smaller for an end that is farther from a
# hollow than its centre of curvature.
LEAST_SLOPE = 0.2

# Columns of `work.place`: place along the level floor [m], slope there, and change of the slope's
# angle with the end's path [1/m].
Y = 4
SLOPE = 5
TURN = 6


@jit_inline
def elevation(chain: Chain, y: float) -> tuple[float, float, float]:
    """Height of the floor over its level at a place along it [m], its slope, and its second
    derivative [1/m].
    """
    x = (y - chain.bump_at) / chain.bump_width
    rise = chain.bump_height * np.exp(-x * x)
    return (
        rise,
        -2.0 * x / chain.bump_width * rise,
        (4.0 * x * x - 2.0) / (chain.bump_width * chain.bump_width) * rise,
    )


@jit_inline
def find_nearest(chain: Chain, y: float, up: float) -> tuple[float, float, float]:
    """Nearest point of the floor to an end at `y` along and `up` over the level [m]: (distance,
    slope, rotation of the normal per path).

    The rotation is that per metre that the end moves along the floor.
    """
    # Above the highest point by more than the radius, the end touches nothing, and the vertical
    # distance will do.
    above = up - max(chain.bump_height, 0.0) > chain.radius
    rise, slope, _ = elevation(chain, y)
    vertical = up - rise
    slope_below = slope
    if in_all_lanes(above):
        return vertical, slope_below, 0.0 * y
    # Newton for the foot of the perpendicular: (x - y) + (rise - up) slope = 0, where the line to
    # the end is normal to the floor.
    x = y
    for _ in range(ROUNDS):
        rise, slope, bend = elevation(chain, x)
        step = (x - y + (rise - up) * slope) / max(
            1.0 + slope * slope + (rise - up) * bend, LEAST_SLOPE
        )
        x -= step
        if in_all_lanes(abs(step) < FOUND_M):
            break
    rise, slope, bend = elevation(chain, x)
    cos = 1.0 / np.sqrt(1.0 + slope * slope)
    distance = (up - rise - slope * (y - x)) * cos
    # Seen from the end, the radius of curvature of the floor is larger by the distance.
    curvature = bend * cos * cos * cos
    turn = curvature / (1.0 - curvature * distance)
    return (
        select(above, vertical, distance),
        select(above, slope_below, slope),
        select(above, 0.0, turn),
    )


@jit
def fill_distances(chain: Chain, y: Floats, up: Floats, out: Floats) -> None:
    """Writes the distances from the floor of ends at `y` along and `up` over the level into
    `out`, all (m, n) [m].
    """
    for i in range(y.shape[0]):
        for k in range(y.shape[1]):
            out[i, k] = find_nearest(chain, y[i, k], up[i, k])[0]


@jit_inline
def locate_on_bump(chain: Chain, k: int, y: float, along: float, into: float, work: Work) -> float:
    """Replaces depth and depth rate of end k by those over the bump, and returns its speed along
    the bump [m/s].

    `y`, `along` and `into` are its place, and its speeds along and into the level floor.
    """
    up = chain.radius - work.place[k, 0]
    distance, slope, turn = find_nearest(chain, y, up)
    cos = 1.0 / np.sqrt(1.0 + slope * slope)
    work.place[k, 0] = chain.radius - distance
    work.place[k, 1] = (into + slope * along) * cos
    work.place[k, Y] = y
    work.place[k, SLOPE] = slope
    work.place[k, TURN] = turn
    speed: float = (along - slope * into) * cos
    return speed


@jit_inline
def measure_climb(k: int, work: Work) -> float:
    """Path of end k along the floor since the step began less its path along the level [m];
    second order in the step.
    """
    place = work.place
    ends = work.ends
    # Trapezoid rule over the step, for the arc length and for the part of the tangent across the
    # level floor.
    longer = (
        0.5
        * (
            np.sqrt(1.0 + place[k, SLOPE] * place[k, SLOPE])
            + np.sqrt(1.0 + ends[k, SLOPE] * ends[k, SLOPE])
        )
        - 1.0
    )
    longer_path: float = longer * (place[k, Y] - ends[k, Y]) - 0.5 * (
        place[k, SLOPE] + ends[k, SLOPE]
    ) * (place[k, 0] - ends[k, 0])
    return longer_path


@jit_inline
def find_slope_direction(chain: Chain, k: int, work: Work) -> tuple[float, float]:
    """Cosine and sine of the floor's slope under end k."""
    cos = 1.0
    slope = 0.0
    if in_any_lane(chain.bump_height != 0.0):
        slope = work.place[k, SLOPE]
        cos = 1.0 / np.sqrt(1.0 + slope * slope)
    return cos, cos * slope


@jit_inline
def rotate_arms(
    chain: Chain, k: int, frame_along: float, frame_into: float, work: Work
) -> tuple[float, float]:
    """Writes how end k moves across and along the floor under it per unit of each coordinate into
    `work.across` and `work.aside`.

    Returns the same along and across for the frame, whose coordinate is the last, from its
    components over the level floor.
    """
    cos, sin = find_slope_direction(chain, k, work)
    for j in range(k + 1):
        work.across[j] = cos * work.down[j] + sin * work.along[j]
        work.aside[j] = cos * work.along[j] - sin * work.down[j]
    along = cos * frame_along - sin * frame_into
    across = cos * frame_into + sin * frame_along
    if work.across.size > work.down.size:
        work.across[work.down.size] = across
        work.aside[work.down.size] = along
    return along, across


@jit_inline
def add_normal_rotation(
    chain: Chain,
    k: int,
    normal: tuple[float, float, float],
    tangential: tuple[float, float, float, float],
    w: Floats,
    weight: float,
    work: Work,
) -> None:
    """Adds to J (c, c) the rotation of normal and tangent with the path of end k along the
    floor; `weight` is that of dR/dq, `w` (c,).
    """
    N, _, N_rate = normal
    F, _, F_v, F_N = tangential
    J = work.J
    across = work.across
    aside = work.aside
    turn = work.place[k, TURN]
    arm = chain.lever - chain.lever_rise * work.place[k, 0]
    dN = N_rate * (work.place[k, 3] + arm * w[k]) * turn
    dF = F_N * dN - F_v * work.place[k, 1] * turn
    for j in range(w.size):
        # Links beyond end k do not move it; coordinates up to k and that of a frame do.
        if k < j < work.place.shape[0]:
            continue
        arm_j = aside[j] - (arm if j == k else 0.0)
        row = turn * (N * aside[j] + F * across[j]) + dN * across[j] - dF * arm_j
        for i in range(w.size):
            if not k < i < work.place.shape[0]:
                J[j, i] += weight * row * aside[i]
