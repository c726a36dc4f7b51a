"""Contact of the floor with the circles at the link ends, and torques that resist the turn of a
hinge.

The floor has normal force, friction, adhesion, and external fields. The memories of friction and
hysteresis depend on the turned angle only, not on the step.
"""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.simulator.body import COS, FD, FY, MOMENT, SIN, SPIN, VD, VY, D, Y, jit_internal

Floats = NDArray[np.float64]

# columns of `hinge` (n, 18), row 0 unused: the shaft has no spring
K0, K2, HINGE_DAMPING, GAP, PRESET, ASYMMETRY, QUADRATIC, STOP, STOP_STIFFNESS = range(9)
PIN, LOOP, LOOP_ANGLE, ARM, ARM_TIME, PIN_CREEP, DETENT, DETENTS, TENDON = range(9, 18)
# columns of `memory` (n, 3): share of the pin's friction in use, the loop's share, the dashpot's
# angle
PIN_SHARE, LOOP_SHARE, ARM_ANGLE = range(3)

# entries of `floor` (30), the last two are how far it is shaken now, and how fast
(
    STIFFNESS,
    DAMPING,
    MU,
    EXPONENT,
    TWO_SIDED,
    PRESLIDING,
    DRAG,
    LEVER,
    LEVER_POWER,
    RISE,
    RISE_SPEED,
    RISE_POWER,
    BACKWARD,
    SLOPE,
    BUMP,
    BUMP_AT,
    BUMP_WIDTH,
    ADHESION,
    HOLD,
    MAGNET,
    REACH,
    PATCH_AT,
    PATCH_WIDTH,
    PATCH_MU,
    PATCH_STIFFNESS,
    SHAKE,
    SHAKE_HZ,
    HEIGHT,
    SHAKEN,
    SHAKING,
) = range(30)

# Penetration under the paper's loads. Laws with other powers agree with the standard ones at this
# depth.
TYPICAL_DEPTH_M = 3e-3
# Normal force from which the viscous share of friction is full; it vanishes with the force.
DRAGGED_FROM_N = 1.0
# Iterations and tolerance of the search for the touched point; each leaves at most a third of the
# error.
ROUNDS = 40
FOUND_M = 1e-12
# Dahl's length over the presliding distance: the initial slope alone would reach full friction
# after this share of the distance.
ELASTIC_SHARE = 0.7


@jit_internal
def dahl(share: float, moved: float, creep: float) -> float:
    """Share of dry friction in use after a move: Dahl's law with exponent one half, exact for a
    move in one direction.

    df/dx = sgn (1 - f sgn)^(1/2) / creep. Full friction is reached after a finite distance, 2 creep
    from none.
    """
    side = 1.0 if moved >= 0.0 else -1.0
    # The root of 1 - f sgn falls linearly with the distance, down to zero.
    left = np.sqrt(max(1.0 - share * side, 0.0)) - 0.5 * abs(moved) / creep
    left = max(left, 0.0)
    return float(side * (1.0 - left * left))


@jit_internal
def bouc_wen(share: float, moved: float, width: float) -> float:
    """Hysteresis by Bouc and Wen with exponent one: z' = (1 - z sgn) phi' / width, one backward
    Euler step.
    """
    way = abs(moved) / width
    side = 1.0 if moved >= 0.0 else -1.0
    return (share + side * way) / (1.0 + way)


@jit_internal
def dashpot_angle(slack: float, phi_before: float, phi: float, seconds: float, tau: float) -> float:
    """Angle of the dashpot in series with a spring, x' = (phi - x) / tau, by the trapezoid rule."""
    half = 0.5 * seconds / tau
    return (slack * (1.0 - half) + half * (phi_before + phi)) / (1.0 + half)


@jit_internal
def spring_torque(phi: float, hinge: Floats, i: int) -> float:
    """Torque of the spring of hinge `i` in N m, without friction and damping; `hinge` is (n,
    18).
    """
    x = phi - hinge[i, PRESET]
    gap = hinge[i, GAP]
    if x > gap:
        bent = x - gap
    elif x < -gap:
        bent = x + gap
    else:
        bent = 0.0
    harder = 1.0 + hinge[i, ASYMMETRY] * (1.0 if bent > 0.0 else -1.0)
    return float(harder * hinge[i, K0] * bent * (1.0 + hinge[i, K2] * bent * bent))


@jit_internal
def hinge_torque(
    phi: float, moved: float, seconds: float, hinge: Floats, memory: Floats, i: int
) -> float:
    """Total torque that resists at hinge `i` in N m, without damping; `hinge` is (n, 18), `memory`
    (n, 3).

    `moved` rad and `seconds` are counted from the last update of `memory`, which stays unchanged.
    """
    torque = spring_torque(phi, hinge, i)
    over = abs(phi) - hinge[i, STOP]
    if over > 0.0:
        torque += hinge[i, STOP_STIFFNESS] * over * (1.0 if phi > 0.0 else -1.0)
    if hinge[i, DETENT] != 0.0:
        torque += hinge[i, DETENT] * np.sin(hinge[i, DETENTS] * phi)
    # Dahl reaches full friction after 2 creep, so half of PIN_CREEP makes it full after PIN_CREEP.
    if hinge[i, PIN] != 0.0:
        torque += hinge[i, PIN] * dahl(memory[i, PIN_SHARE], moved, 0.5 * hinge[i, PIN_CREEP])
    if hinge[i, LOOP] != 0.0:
        torque += hinge[i, LOOP] * bouc_wen(memory[i, LOOP_SHARE], moved, hinge[i, LOOP_ANGLE])
    if hinge[i, ARM] != 0.0:
        torque += hinge[i, ARM] * (
            phi - dashpot_angle(memory[i, ARM_ANGLE], phi - moved, phi, seconds, hinge[i, ARM_TIME])
        )
    return float(torque)


@jit_internal
def update_hinge_memory(
    phi: float, moved: float, seconds: float, hinge: Floats, memory: Floats, i: int
) -> None:
    """Update row `i` of `memory` (n, 3) after a step of `moved` rad in `seconds`; `hinge` is (n,
    18).
    """
    memory[i, PIN_SHARE] = dahl(memory[i, PIN_SHARE], moved, 0.5 * hinge[i, PIN_CREEP])
    memory[i, LOOP_SHARE] = bouc_wen(memory[i, LOOP_SHARE], moved, hinge[i, LOOP_ANGLE])
    memory[i, ARM_ANGLE] = dashpot_angle(
        memory[i, ARM_ANGLE], phi - moved, phi, seconds, hinge[i, ARM_TIME]
    )


@jit_internal
def normal_force(floor: Floats, depth: float, rate: float) -> float:
    """Normal force in N by Hunt and Crossley, less the adhesion; `rate` in m/s is positive while
    the depth grows.

    `floor` is (30,). Damping acts during separation only where the floor is `TWO_SIDED`.
    """
    # The usual exponent without a call of pow.
    if floor[EXPONENT] == 1.5:
        power = depth * np.sqrt(depth)
    else:
        power = depth ** floor[EXPONENT]
    closing = rate if rate > 0.0 or floor[TWO_SIDED] != 0.0 else 0.0
    # The elastic and damping part never pulls, however fast the ends separate.
    force = floor[STIFFNESS] * power * max(1.0 + floor[DAMPING] * closing, 0.0)
    if floor[ADHESION] != 0.0:
        force -= floor[ADHESION] * np.tanh(depth / floor[HOLD])
    return float(force)


@jit_internal
def friction_limit(floor: Floats, slip: float, share: float) -> float:
    """Friction coefficient at a slip speed in m/s; the sign of `share`, the friction in use,
    gives the direction. `floor` is (30,).
    """
    mu = floor[MU]
    if floor[RISE] != 0.0:
        speeds = abs(slip) / floor[RISE_SPEED]
        mu *= 1.0 + floor[RISE] * np.exp(
            -speeds if floor[RISE_POWER] == 1.0 else -(speeds ** floor[RISE_POWER])
        )
    return float(mu * floor[BACKWARD] if share < 0.0 else mu)


@jit_internal
def elevation(floor: Floats, y: float) -> tuple[float, float]:
    """Height of the floor (30,) at `y` above its level at the shaft, in m, and its slope."""
    rise = floor[SLOPE] * y
    slope = floor[SLOPE]
    if floor[BUMP] != 0.0:
        x = (y - floor[BUMP_AT]) / floor[BUMP_WIDTH]
        bump = floor[BUMP] * np.exp(-x * x)
        rise += bump
        slope -= 2.0 * x / floor[BUMP_WIDTH] * bump
    return rise, slope


@jit_internal
def find_contact(floor: Floats, radius: float, y: float, d: float) -> float:
    """The y in m at which the floor is nearest to a circle with centre (y, d): there the floor's
    normal passes through the centre.
    """
    at = y
    up = floor[HEIGHT] - d
    # A straight floor needs no search, and a circle far above the bump cannot touch it.
    if floor[BUMP] == 0.0 or up > floor[SLOPE] * y + abs(floor[BUMP]) + 2.0 * radius:
        return at
    for _ in range(ROUNDS):
        rise, slope = elevation(floor, at)
        before = at
        at = y + (up - rise) * slope
        if abs(at - before) < FOUND_M:
            break
    return at


@jit_internal
def lever_reduction(floor: Floats, depth: float) -> float:
    """By how much, in m, friction's lever is shorter than the circle's radius at this
    penetration depth in m; `floor` is (30,).
    """
    if floor[LEVER_POWER] == 1.0:
        return float(floor[LEVER] * depth)
    return float(floor[LEVER] * TYPICAL_DEPTH_M * (depth / TYPICAL_DEPTH_M) ** floor[LEVER_POWER])


@jit_internal
def add_contact_forces(
    floor: Floats,
    radius: float,
    pose: Floats,
    used: Floats,
    seconds: float,
    keep: bool,
    load: Floats,
) -> None:
    """Add the floor's forces at all link ends to `load` (3, n), from the `pose` (9, n + 1).

    With `keep`, update `used` (n,) instead, the share of friction in use at each end; `seconds` is
    the time since its last update.
    """
    n = load.shape[1]
    for k in range(n):
        y = pose[Y, k + 1]
        d = pose[D, k + 1]
        at = find_contact(floor, radius, y, d)
        rise, slope = elevation(floor, at)
        cos = 1.0 / np.sqrt(1.0 + slope * slope)
        sin = slope * cos
        depth = (d - floor[HEIGHT] + rise + slope * (y - at) + floor[SHAKEN]) * cos + radius
        if depth <= 0.0:
            # An end that has left the floor forgets its presliding.
            if keep:
                used[k] = 0.0
            continue
        rate = pose[VY, k + 1] * sin + (pose[VD, k + 1] + floor[SHAKING]) * cos
        lever = radius - lever_reduction(floor, depth)
        slip = pose[VY, k + 1] * cos - pose[VD, k + 1] * sin - lever * pose[SPIN, k]
        share = dahl(used[k], slip * seconds, ELASTIC_SHARE * floor[PRESLIDING])
        if keep:
            used[k] = share
            continue
        N = normal_force(floor, depth, rate)
        mu = friction_limit(floor, slip, share)
        if floor[PATCH_AT] < y < floor[PATCH_AT] + floor[PATCH_WIDTH]:
            N = N * floor[PATCH_STIFFNESS]
            mu = mu * floor[PATCH_MU]
        # |N|, because adhesion can make N negative while the end still rubs.
        F = -mu * abs(N) * share - floor[DRAG] * min(abs(N) / DRAGGED_FROM_N, 1.0) * slip
        load[FY, k] += F * cos - N * sin
        load[FD, k] -= F * sin + N * cos
        load[MOMENT, k] -= lever * F


@jit_internal
def update_shaking(floor: Floats, t: float) -> None:
    """Store the displacement and speed of a shaking floor at time `t` in `floor` (30,)."""
    if floor[SHAKE] != 0.0:
        rate = 2.0 * np.pi * floor[SHAKE_HZ]
        floor[SHAKEN] = floor[SHAKE] * np.sin(rate * t)
        floor[SHAKING] = rate * floor[SHAKE] * np.cos(rate * t)


@jit_internal
def add_magnet_force(floor: Floats, radius: float, pose: Floats, load: Floats) -> None:
    """Add the pull of a magnet under the floor on the tip to `load` (3, n)."""
    if floor[MAGNET] != 0.0:
        n = load.shape[1]
        gap = max(floor[HEIGHT] - radius - pose[D, n], 0.0)
        load[FD, n - 1] += floor[MAGNET] / (1.0 + gap / floor[REACH]) ** 2


@jit_internal
def add_drag(coefficient: float, power: float, length: Floats, pose: Floats, load: Floats) -> None:
    """Add the drag across each rod to `load` (3, n): at its middle, with `power` of the speed
    there.

    `coefficient` is the drag per length at 1 m/s; `length` is (n,).
    """
    if coefficient == 0.0:
        return
    for k in range(load.shape[1]):
        c = pose[COS, k]
        s = pose[SIN, k]
        half = 0.5 * length[k]
        across = (
            0.5 * (pose[VD, k] + pose[VD, k + 1]) * c - 0.5 * (pose[VY, k] + pose[VY, k + 1]) * s
        )
        force = -coefficient * length[k] * across * abs(across) ** (power - 1.0)
        load[FY, k] -= force * s
        load[FD, k] += force * c
        load[MOMENT, k] -= half * force  # it acts at the middle, the load is kept at the end
