"""One step of the exam's simulator: half a drift, one solve for the change of all rates, half a
drift.

`n` is the number of rods. Arrays of size (n + 1) have one more entry for the frame, where the mount
yields.

The shaft's drive has a command, the motor that follows it, and the transmission between motor and
leg.
"""

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.simulator.body import (
    LENGTH,
    SD,
    SY,
    gather,
    jit_cached,
    jit_internal,
    place_bodies,
    solve_between,
)
from rfca_rig.exam.simulator.floor import (
    HINGE_DAMPING,
    QUADRATIC,
    TENDON,
    add_contact_forces,
    add_drag,
    add_magnet_force,
    hinge_torque,
    update_hinge_memory,
    update_shaking,
)

Floats = NDArray[np.float64]

# entries of `drive` (16)
(
    START,
    KP,
    KI,
    ROTOR,
    SHAFT,
    SHAFT_DAMPING,
    SHAFT_GAP,
    SHAFT_LOSS,
    RIPPLE,
    CYCLES,
    PHASE,
    CABLE,
    LIMIT,
    COGGING,
    COGS,
    HOSE,
) = range(16)
# entries of `motor` (4): commanded angle and speed, the motor's angle and speed
COMMAND_ANGLE, COMMAND_SPEED, MOTOR_ANGLE, MOTOR_SPEED = range(4)

# Speed of the regularised sign: at a few times this, a dragging cable pulls fully.
CABLE_SPEED_RAD_S = 0.02

# entries of `mount` (10)
(
    RADIUS,
    LINK_DRAG,
    DRAG_POWER,
    GRAVITY_Y,
    GRAVITY_D,
    FRAME_MASS,
    FRAME_STIFFNESS,
    FRAME_DAMPING,
    FRAME_LEAN,
    FRAME_FELT,
) = range(10)
# columns of the samples: forces on the mount, torque into the leg and of the motor, the motor's
# angle and speed, then n angles
FORCE_Y, FORCE_D, LEG_TORQUE, MOTOR_TORQUE, ANGLE, SPEED, FIRST_ANGLE = range(7)


@jit_internal
def command_speed(knots: Floats, t: float) -> float:
    """Commanded speed in rad/s: linear between `knots` (2, m) of times and speeds, at rest
    before and after.
    """
    m = knots.shape[1]
    if t <= knots[0, 0] or t > knots[0, m - 1]:
        return 0.0
    i = np.searchsorted(knots[0], t)
    t0 = knots[0, i - 1]
    t1 = knots[0, i]
    return float(knots[1, i - 1] + (knots[1, i] - knots[1, i - 1]) * (t - t0) / (t1 - t0))


@jit_internal
def add_ripple(drive: Floats, angle: float, speed: float) -> float:
    """Commanded speed at a shaft angle, with the speed ripple of `drive` (16,)."""
    return float(
        speed
        * (1.0 + drive[RIPPLE] * np.cos(drive[CYCLES] * (angle - drive[START]) + drive[PHASE]))
    )


@jit_internal
def advance_command(drive: Floats, knots: Floats, motor: Floats, t: float, h: float) -> None:
    """Advance the commanded angle and speed in `motor` (4,) by one step, by the midpoint rule;
    `knots` is (2, m).
    """
    begin = add_ripple(drive, motor[COMMAND_ANGLE], command_speed(knots, t))
    half = motor[COMMAND_ANGLE] + 0.5 * h * begin
    motor[COMMAND_ANGLE] += h * add_ripple(drive, half, command_speed(knots, t + 0.5 * h))
    motor[COMMAND_SPEED] = add_ripple(drive, motor[COMMAND_ANGLE], command_speed(knots, t + h))


@jit_internal
def pi_torque(
    drive: Floats, motor: Floats, command_before: float, angle: float, speed: float, h: float
) -> tuple[float, float]:
    """Torque of the PI speed loop at mid-step in N m, and by how much it falls per rad/s of speed.

    `drive` is (16,), `motor` (4,) with the command after the step, `command_before` the commanded
    angle before it. `angle` is the rotor's at mid-step, `speed` before the step.
    """
    command = 0.5 * (command_before + motor[COMMAND_ANGLE])
    demand = drive[KI] * (command - angle) + drive[KP] * (
        (motor[COMMAND_ANGLE] - command_before) / h - speed
    )
    cogging = drive[COGGING] * np.sin(drive[COGS] * (angle - drive[START]))
    # A saturated motor no longer reacts to speed, so its implicit share is zero.
    if abs(demand) > drive[LIMIT]:
        return (drive[LIMIT] if demand > 0.0 else -drive[LIMIT]) + cogging, 0.0
    return demand + cogging, drive[KP]


@jit_internal
def shaft_torque(drive: Floats, angle: float, speed: float) -> tuple[float, float]:
    """Torque of the shaft between motor and leg in N m, and by how much it rises per rad/s of
    relative speed.

    `drive` is (16,); `angle` and `speed` are those of the motor relative to the leg. Beyond the
    play the ends press on each other with a loss that grows with the pressure; they never pull.
    """
    beyond = max(abs(angle) - drive[SHAFT_GAP], 0.0)
    side = 1.0 if angle > 0.0 else -1.0
    pressure = drive[SHAFT] * beyond
    towards = pressure * (1.0 + drive[SHAFT_LOSS] * side * speed)
    rising = drive[SHAFT_LOSS] * pressure if towards > 0.0 else 0.0
    return side * max(towards, 0.0) + drive[SHAFT_DAMPING] * speed, drive[SHAFT_DAMPING] + rising


@jit_internal
def turn_rotor(drive: Floats, motor: Floats, command_before: float, back: float, h: float) -> float:
    """Advance a rotor under PI control by one step, in `motor` (4,); returns the motor's torque in
    N m.

    `back` is the torque of the twisted shaft on the rotor, `command_before` the commanded angle
    before the step.
    """
    angle = motor[MOTOR_ANGLE] + 0.5 * h * motor[MOTOR_SPEED]
    push, falling = pi_torque(drive, motor, command_before, angle, motor[MOTOR_SPEED], h)
    # Implicit in the falling torque: stiff controllers would otherwise limit the step.
    gained = h * (push - back) / (drive[ROTOR] + 0.5 * h * falling)
    motor[MOTOR_SPEED] += gained
    motor[MOTOR_ANGLE] = angle + 0.5 * h * motor[MOTOR_SPEED]
    return float(push - 0.5 * falling * gained)


@jit_internal
def cable_drag_torque(drive: Floats, angle: float, speed: float) -> float:
    """Torque in N m of a dragging cable and of a hose that turns the shaft back to its start;
    `drive` is (16,).
    """
    return float(
        -drive[CABLE] * np.tanh(speed / CABLE_SPEED_RAD_S) - drive[HOSE] * (angle - drive[START])
    )


@jit_internal
def load_bodies(
    rod: Floats, mount: Floats, floor: Floats, pose: Floats, used: Floats, h: float, load: Floats
) -> None:
    """Set `load` (3, n) to all external forces at the middle of a step, from the `pose` (9, n +
    1) there.
    """
    load[:] = 0.0
    add_contact_forces(floor, mount[RADIUS], pose, used, 0.5 * h, False, load)
    add_magnet_force(floor, mount[RADIUS], pose, load)
    add_drag(mount[LINK_DRAG], mount[DRAG_POWER], rod[LENGTH], pose, load)


@jit_internal
def add_hinge_torques(
    hinge: Floats, memory: Floats, phi: Floats, w: Floats, h: float, M: Floats, x: Floats
) -> None:
    """Subtract the hinge torques from `x` (n,) and add their implicit damping to the diagonal of
    `M` (n, n).
    """
    bent = 0.0
    for i in range(1, hinge.shape[0]):
        bent += phi[i]
    for i in range(1, hinge.shape[0]):
        quadratic = hinge[i, QUADRATIC] * abs(w[i])
        # Trapezoidal rule in the rate. The derivative of c |w| w is 2 c |w|, hence `quadratic` a
        # second time in M.
        damping = hinge[i, HINGE_DAMPING] + quadratic
        x[i] -= (
            hinge_torque(phi[i], 0.5 * h * w[i], 0.5 * h, hinge, memory, i)
            + damping * w[i]
            + hinge[i, TENDON] * bent
        )
        M[i, i] += 0.5 * h * (damping + quadratic)


@jit_internal
def add_frame_terms(
    mount: Floats, hanging: float, phi: Floats, w: Floats, h: float, n: int, M: Floats, x: Floats
) -> None:
    """Add the frame's terms to row n of `M` (n + 1, n + 1) and `x` (n + 1,), if there is a frame.

    It is at rest at zero under the hanging leg.
    """
    if phi.size == n:
        return
    M[n, n] += mount[FRAME_MASS] + 0.5 * h * mount[FRAME_DAMPING]
    x[n] -= hanging + mount[FRAME_STIFFNESS] * phi[n] + mount[FRAME_DAMPING] * w[n]


@jit_internal
def drive_shaft(
    drive: Floats,
    motor: Floats,
    commanded: float,
    phi: Floats,
    w: Floats,
    h: float,
    M: Floats,
    x: Floats,
) -> float:
    """Add the torque on a shaft that is free to turn to row 0 of `M` (n, n) and `x` (n,).

    `commanded` is the commanded angle before the step. Returns the torque at mid-step without its
    implicit part.
    """
    if drive[SHAFT] != 0.0:
        angle = motor[MOTOR_ANGLE] + 0.5 * h * motor[MOTOR_SPEED]
        speed = motor[MOTOR_SPEED]
        # Without a controller the motor follows the command exactly.
        if drive[KP] == 0.0:
            angle = 0.5 * (commanded + motor[COMMAND_ANGLE])
            speed = (motor[COMMAND_ANGLE] - commanded) / h
        torque, rising = shaft_torque(drive, angle - phi[0], speed - w[0])
        M[0, 0] += 0.5 * h * rising
    else:
        # A rigid shaft: the rotor's inertia turns with the leg.
        torque, falling = pi_torque(drive, motor, commanded, phi[0], w[0], h)
        M[0, 0] += drive[ROTOR] + 0.5 * h * falling
    x[0] += torque
    return torque


@jit_internal
def drift(phi: Floats, w: Floats, gained: Floats, h: float, rate: Floats) -> None:
    """Half a step of `phi` (n,) at the old rates `w` (n,); `rate` (n,) becomes the rates predicted
    for mid-step.

    `gained` (n,) is the change of the rates in the step before.
    """
    # Extrapolated rates keep forces that depend on speed at second order without a second solve.
    for i in range(phi.size):
        phi[i] += 0.5 * h * w[i]
        rate[i] = w[i] + 0.5 * gained[i]


@jit_internal
def balance(M: Floats, bias: Floats, cable_torque: float, A: Floats, x: Floats) -> None:
    """Set the lower triangle of `A` (n, n) to M and `x` (n,) to the generalised forces; hinges
    and drive are added later.
    """
    for i in range(x.size):
        x[i] = -bias[i]
        for j in range(i + 1):
            A[i, j] = M[i, j]
    x[0] += cable_torque


@jit_internal
def solve(
    drive: Floats,
    motor: Floats,
    commanded: float,
    held: bool,
    phi: Floats,
    w: Floats,
    h: float,
    A: Floats,
    x: Floats,
) -> float:
    """Solve for the accelerations, into `x` (n,).

    Returns the torque of `drive_shaft` where the shaft is free. Where it is `held`, its
    acceleration is known and 0 is returned.
    """
    if not held:
        torque = drive_shaft(drive, motor, commanded, phi, w, h, A, x)
        solve_between(A, x, 0, x.size)
        return torque
    # The shaft reaches the commanded speed at the end of the step. Its column moves to the
    # right-hand side.
    known = (motor[COMMAND_SPEED] - w[0]) / h
    for i in range(1, x.size):
        x[i] -= A[i, 0] * known
    solve_between(A, x, 1, x.size)
    x[0] = known
    return 0.0


@jit_internal
def kick(
    hinge: Floats, memory: Floats, x: Floats, h: float, phi: Floats, w: Floats, gained: Floats
) -> None:
    """Advance the rates `w` (n,) by the accelerations `x` (n,), the angles `phi` (n,) by half a
    step, and the hinges' `memory` (n, 3).
    """
    for i in range(phi.size):
        # The way of the whole step, with the mean of the old and the new rate.
        moved = h * (w[i] + 0.5 * h * x[i])
        gained[i] = h * x[i]
        w[i] += gained[i]
        phi[i] += 0.5 * h * w[i]
        if 0 < i < hinge.shape[0]:
            update_hinge_memory(phi[i], moved, h, hinge, memory, i)


@jit_cached
def run(
    rod: Floats,
    hinge: Floats,
    floor: Floats,
    drive: Floats,
    mount: Floats,
    knots: Floats,
    phi: Floats,
    motor: Floats,
    t0: float,
    h: float,
    steps: int,
    window: Floats,
    out: Floats,
) -> bool:
    """Integrate `steps` steps of length `h` from `t0`; returns whether the result is finite.

    Parameters
    ----------
    rod, hinge, floor, drive, mount : arrays
        The rig, (4, n), (n, 18), (30,), (16,) and (10,); entries as named in the modules of these
        names, in SI units.
    knots : (2, k) array
        Times and commanded speeds.
    phi, motor : (n,) or (n + 1,), and (4,) arrays
        Angles, with the frame's displacement last if there is one, and state of the motor. Both are
        changed.
    window : (m, 2) array
        First and last step of each sample, ascending.
    out : (m, 6 + n) array
        Receives the mean of each sample, in the columns named at the head of this module. Zero at
        first.
    """
    n = rod.shape[1]
    size = phi.size
    # Without a controller and with a rigid shaft, the shaft's motion is prescribed.
    frame = size > n
    held = drive[SHAFT] == 0.0 and drive[KP] == 0.0
    row = 0
    w = np.zeros(size)
    gained = np.zeros(size)
    rate = np.zeros(size)
    x = np.zeros(size)
    bias = np.zeros(n + 3)
    M = np.zeros((n + 1, n + 1))
    A = np.zeros((n + 1, n + 1))
    pose = np.zeros((9, n + 1))
    load = np.zeros((3, n))
    lump = np.zeros((2, n))
    memory = np.zeros((n, 3))
    used = np.zeros(n)
    now = np.zeros(FIRST_ANGLE + n)
    lean = mount[FRAME_LEAN]
    # Weight along the frame's line. It is subtracted in `add_frame_terms`, so that zero is the
    # frame's rest under the leg.
    hanging = rod[1].sum() * (mount[GRAVITY_D] * np.cos(lean) + mount[GRAVITY_Y] * np.sin(lean))
    for step in range(steps):
        # `advance_command` overwrites this, and the controller needs the command on both sides of
        # the step.
        command_before = motor[COMMAND_ANGLE]
        advance_command(drive, knots, motor, t0 + step * h, h)
        drift(phi, w, gained, h, rate)
        update_shaking(floor, t0 + (step + 0.5) * h)
        place_bodies(rod, phi, rate, frame, lean, pose)
        load_bodies(rod, mount, floor, pose, used, h, load)
        gather(rod, pose, load, mount[GRAVITY_Y], mount[GRAVITY_D], lean, M, bias, lump)
        pulled = cable_drag_torque(drive, phi[0], rate[0])
        balance(M, bias, pulled, A, x)
        add_hinge_torques(hinge, memory, phi, w, h, A, x)
        add_frame_terms(mount, hanging, phi, w, h, n, A, x)
        torque = solve(drive, motor, command_before, held, phi, w, h, A, x)
        # Friction states move only after the solve: all forces of a step start from the same
        # memory.
        add_contact_forces(floor, mount[RADIUS], pose, used, h, True, load)
        # Before the kick: the angles and the forces of a sample belong to the same instant, the
        # middle of the step.
        compute_reactions(M, bias, lump, x, frame, mount, pulled, phi, now)
        kick(hinge, memory, x, h, phi, w, gained)
        report_motor(drive, motor, command_before, torque, held, phi, w, h, now)
        row = sample(now, step, row, window, out)
    return bool(np.isfinite(phi).all())


@jit_internal
def compute_reactions(
    M: Floats,
    bias: Floats,
    lump: Floats,
    a: Floats,
    frame: bool,
    mount: Floats,
    cable_torque: float,
    phi: Floats,
    now: Floats,
) -> None:
    """Write the force of the mount on the leg, the torque into the leg and the mid-step angles into
    `now` (6 + n,).

    All follow from the accelerations `a` (n,) or (n + 1,). With a frame, the sensor may also feel a
    share of the frame's mass.
    """
    n = lump.shape[1]
    fy = bias[n + 2]
    fd = bias[n + 1]
    torque = bias[0] - cable_torque
    for j in range(n):
        fy -= lump[SD, j] * a[j]
        fd += lump[SY, j] * a[j]
        torque += M[j, 0] * a[j]
        now[FIRST_ANGLE + j] = phi[j]
    if frame:
        carried = (M[n, n] + mount[FRAME_FELT] * mount[FRAME_MASS]) * a[n]
        fd += carried * np.cos(mount[FRAME_LEAN])
        fy += carried * np.sin(mount[FRAME_LEAN])
        torque += M[n, 0] * a[n]
    now[FORCE_Y] = fy
    now[FORCE_D] = fd
    now[LEG_TORQUE] = torque


@jit_internal
def report_motor(
    drive: Floats,
    motor: Floats,
    commanded: float,
    torque: float,
    held: bool,
    phi: Floats,
    w: Floats,
    h: float,
    now: Floats,
) -> None:
    """Write the motor's torque, angle and speed after a step into `now` (6 + n,); advances a rotor
    behind a soft shaft.

    `commanded` is the commanded angle before the step, `torque` the return value of `solve`.
    """
    now[MOTOR_TORQUE] = now[LEG_TORQUE]
    if not held and drive[SHAFT] != 0.0 and drive[KP] != 0.0:
        now[MOTOR_TORQUE] = turn_rotor(drive, motor, commanded, torque, h)
    elif held or drive[SHAFT] != 0.0:
        motor[MOTOR_ANGLE] = motor[COMMAND_ANGLE]
        motor[MOTOR_SPEED] = motor[COMMAND_SPEED]
    else:
        motor[MOTOR_ANGLE] = phi[0]
        motor[MOTOR_SPEED] = w[0]
    now[ANGLE] = motor[MOTOR_ANGLE]
    now[SPEED] = motor[MOTOR_SPEED]


@jit_internal
def sample(now: Floats, step: int, row: int, window: Floats, out: Floats) -> int:
    """Add this step's `now` (6 + n,) to the rows of `out` whose `window` (m, 2) it lies in;
    returns the first incomplete row.
    """
    for i in range(row, out.shape[0]):
        if step < window[i, 0]:
            break
        if step <= window[i, 1]:
            share = 1.0 / (window[i, 1] - window[i, 0] + 1.0)
            for j in range(now.size):
                out[i, j] += share * now[j]
    while row < out.shape[0] and step >= window[row, 1]:
        row += 1
    return row
