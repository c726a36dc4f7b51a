"""A floor with a bump: where on it the end of a link touches. Symbols as in `state`.

The height of the floor over its level is B exp(-((Y - Y_0) / b)^2). How deep the circle around an end is in it is measured along the normal
of the floor, from the point of the floor that is nearest to the end. The slope of that depth is the unit normal, so that a force which
depends on the depth alone is conservative.
"""

import numpy as np

from rfca_rig.model.compiled import compiled, inlined
from rfca_rig.model.state import Chain, Floats, Work

ROUNDS = 12  # of Newton's iteration at most; it takes three or four
FOUND_M = 1e-12
LEAST_SLOPE = 0.2  # of the condition that is solved; it is below for an end that is farther from a hollow than its centre of curvature

Y, SLOPE, TURN = 4, 5, 6  # columns of `work.place`: way along the level floor, slope there, change of its angle with the way of the end


@inlined
def elevation(chain: Chain, y: float) -> tuple[float, float, float]:
    """Height of the floor over its level at a place along it, its slope, and the change of that."""
    x = (y - chain.bump_at) / chain.bump_width
    rise = chain.bump_height * np.exp(-x * x)
    return rise, -2.0 * x / chain.bump_width * rise, (4.0 * x * x - 2.0) / (chain.bump_width * chain.bump_width) * rise


@inlined
def find_nearest(chain: Chain, y: float, up: float) -> tuple[float, float, float]:
    """Of the point of the floor nearest to an end at `y` and `up` over the level: distance, slope there, and the turn of the normal per way
    of the end along the floor.
    """
    if up - max(chain.bump_height, 0.0) > chain.radius:  # out of reach
        rise, slope, _ = elevation(chain, y)
        return up - rise, slope, 0.0
    x = y
    for _ in range(ROUNDS):
        rise, slope, bend = elevation(chain, x)
        step = (x - y + (rise - up) * slope) / max(1.0 + slope * slope + (rise - up) * bend, LEAST_SLOPE)
        x -= step
        if abs(step) < FOUND_M:
            break
    rise, slope, bend = elevation(chain, x)
    cos = 1.0 / np.sqrt(1.0 + slope * slope)
    distance = (up - rise - slope * (y - x)) * cos
    curvature = bend * cos * cos * cos
    return distance, slope, curvature / (1.0 - curvature * distance)


@compiled
def fill_distances(chain: Chain, y: Floats, up: Floats, out: Floats) -> None:
    """Distances from the floor of ends at `y` and `up` over the level, all (m, n)."""
    for i in range(y.shape[0]):
        for k in range(y.shape[1]):
            out[i, k] = find_nearest(chain, y[i, k], up[i, k])[0]


@inlined
def locate_on_bump(chain: Chain, k: int, y: float, along: float, into: float, work: Work) -> float:
    """Depth and sinking of an end, located and moving over the level floor as given; returns its speed along the bump."""
    up = chain.radius - work.place[k, 0]
    distance, slope, turn = find_nearest(chain, y, up)
    cos = 1.0 / np.sqrt(1.0 + slope * slope)
    work.place[k, 0], work.place[k, 1] = chain.radius - distance, (into + slope * along) * cos
    work.place[k, Y], work.place[k, SLOPE], work.place[k, TURN] = y, slope, turn
    return float((along - slope * into) * cos)


@inlined
def climbed(k: int, work: Work) -> float:
    """How much longer the way of end k along the floor since the step began is than its way along the level; second order in the step."""
    place, ends = work.place, work.ends
    longer = 0.5 * (np.sqrt(1.0 + place[k, SLOPE] ** 2) + np.sqrt(1.0 + ends[k, SLOPE] ** 2)) - 1.0
    return float(longer * (place[k, Y] - ends[k, Y]) - 0.5 * (place[k, SLOPE] + ends[k, SLOPE]) * (place[k, 0] - ends[k, 0]))


@inlined
def turn_to_bump(chain: Chain, k: int, work: Work) -> tuple[float, float]:
    """Cosine and sine of the floor's slope under end k."""
    if chain.bump_height == 0.0:
        return 1.0, 0.0
    cos = 1.0 / np.sqrt(1.0 + work.place[k, SLOPE] ** 2)
    return cos, cos * work.place[k, SLOPE]


@inlined
def turn_ways(chain: Chain, k: int, frame_along: float, frame_into: float, work: Work) -> tuple[float, float]:
    """How end k moves across and along the floor under it per unit of each coordinate, into `work.across` and `work.aside`.

    Returns along and across of a frame, which stand last, from its ways over the level floor.
    """
    cos, sin = turn_to_bump(chain, k, work)
    for j in range(k + 1):
        work.across[j] = cos * work.down[j] + sin * work.along[j]
        work.aside[j] = cos * work.along[j] - sin * work.down[j]
    along, across = cos * frame_along - sin * frame_into, cos * frame_into + sin * frame_along
    if work.across.size > work.down.size:
        work.across[work.down.size], work.aside[work.down.size] = across, along
    return along, across


@inlined
def add_turn_of_normal(
    chain: Chain,
    k: int,
    normal: tuple[float, float, float],
    tangential: tuple[float, float, float, float],
    w: Floats,
    weight: float,
    work: Work,
) -> None:
    """What the derivative gets from normal and tangent, which turn with the way of end k along the floor; `weight` is that of dR/dq."""
    N, _, N_rate = normal
    F, _, F_v, F_N = tangential
    J, across, aside, turn = work.J, work.across, work.aside, work.place[k, TURN]
    arm = chain.lever - chain.lever_rise * work.place[k, 0]
    dN = N_rate * (work.place[k, 3] + arm * w[k]) * turn
    dF = F_N * dN - F_v * work.place[k, 1] * turn
    for j in range(w.size):
        if k < j < work.place.shape[0]:
            continue
        arm_j = aside[j] - (arm if j == k else 0.0)
        row = turn * (N * aside[j] + F * across[j]) + dN * across[j] - dF * arm_j
        for i in range(w.size):
            if not k < i < work.place.shape[0]:
                J[j, i] += weight * row * aside[i]
