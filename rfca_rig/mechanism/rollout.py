"""Simulates a plant over a recording: a compiled loop around MuJoCo's step, with laws that MuJoCo's
models do not have.

`mujoco.rollout` accepts forces as functions of time only. Friction that depends on speed or load
must be computed at each step, so the loop calls MuJoCo's step by its address, with the interpreter
lock released.

A motion may begin in the rest pose, in which no joint accelerates under its commands and effects.
The spring of a joint may have play: within half the gap to either side of its rest position it does
nothing.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import root

from rfca_rig.errors import SimulationFailed
from rfca_rig.mechanism.contact_law import ContactArrays, apply_contact_forces
from rfca_rig.mechanism.contact_step import StageArrays, take_step
from rfca_rig.mechanism.gears import PARTS, SMOOTHED_S, add_deflection, estimate_gear_start
from rfca_rig.mechanism.laws import pack_laws
from rfca_rig.mechanism.library import MujocoArrays, list_arrays
from rfca_rig.mechanism.plant import Plant
from rfca_rig.mechanism.prescribed import PrescribedArrays, PrescribedMotion, prescribe
from rfca_rig.model.kernel.compiled import jit, jit_internal

# The acceleration at a start that was read late depends on that start itself.
LAG_ROUNDS = 3
UNBALANCED = 1e-7  # share of the largest torque that may remain, of weight or spring

Floats = NDArray[np.float64]
Places = NDArray[np.intp]


class PlayArrays(NamedTuple):
    """Half the gap (n,) of each joint in rad or m, its rest position (n,), and coefficients (3, n)
    of x, x |x| and x^3 of its spring.

    The torque is that at `ahead_s` after a step's beginning: the mean over the step under
    Runge-Kutta; an implicit step takes its springs at its beginning.
    """

    half_gap: Floats
    rest: Floats
    spring: Floats
    ahead_s: float


@jit
def add_spring_play(arrays: PlayArrays, q: Floats, w: Floats, applied: Floats) -> None:
    """Adds torques to `applied` (n,) that turn MuJoCo's springs into springs with play; `q` and
    `w` are (n,).
    """
    # MuJoCo computes the spring without play; its torque is cancelled, and that of the reduced
    # deflection is applied instead.
    for i in range(arrays.half_gap.size):
        if arrays.half_gap[i] > 0.0:
            full = q[i] + arrays.ahead_s * w[i] - arrays.rest[i]
            engaged = np.sign(full) * max(abs(full) - arrays.half_gap[i], 0.0)
            one = arrays.spring[0, i]
            two = arrays.spring[1, i]
            three = arrays.spring[2, i]
            applied[i] += full * (one + abs(full) * two + full * full * three)
            applied[i] -= engaged * (one + abs(engaged) * two + engaged * engaged * three)


def find_rest_pose(
    model: Any,
    data: Any,
    simulated: NDArray[np.intp],
    steady: Floats,
    contacts: ContactArrays,
    play: PlayArrays,
) -> None:
    """Puts the simulated joints into static equilibrium; `data` has the positions of the others and
    the commands.

    Dry friction is neglected: its force at rest would depend on how the mechanism came to rest.

    Parameters
    ----------
    model, data
        MuJoCo's own; `data` holds the pose from which the equilibrium is sought.
    simulated
        (s,) indices of the joints that move.
    steady
        (n,) constant torques.
    contacts, play
        The laws that MuJoCo does not have.

    Raises
    ------
    SimulationFailed
        Where no equilibrium is found.
    """
    friction = model.dof_frictionloss.copy()
    model.dof_frictionloss[:] = 0.0
    data.qvel[:] = 0.0
    try:
        _balance(
            model,
            data,
            simulated,
            steady,
            contacts,
            play._replace(half_gap=np.zeros_like(play.half_gap)),
        )
        # Within its gap a spring gives no direction, so the search begins where it engages, on the
        # side of the first solution.
        if play.half_gap.any():
            data.qpos[simulated] += (np.sign(data.qpos - play.rest) * play.half_gap)[simulated]
            _balance(model, data, simulated, steady, contacts, play)
    finally:
        model.dof_frictionloss[:] = friction
    contacts.clock[:] = 0.0
    contacts.touch_s[:] = np.inf
    contacts.stretch[:] = 0.0


def _balance(
    model: Any,
    data: Any,
    simulated: NDArray[np.intp],
    steady: Floats,
    contacts: ContactArrays,
    play: PlayArrays,
) -> None:
    import mujoco  # noqa: PLC0415  (optional)

    largest = 0.0

    def compute_imbalance(pose: Floats) -> Floats:
        nonlocal largest
        data.qpos[simulated] = pose
        data.qfrc_applied[:] = steady
        add_spring_play(play, data.qpos, data.qvel, data.qfrc_applied)
        mujoco.mj_forward(model, data)
        # The contact law needs positions and velocities, and MuJoCo the forces of the law: two
        # passes.
        if contacts.radius.size:
            contacts.stretch[:] = 0.0
            apply_contact_forces(contacts, 0.0)
            mujoco.mj_forward(model, data)
        largest = max(largest, float(np.abs(data.qfrc_bias).max()))
        return np.array((data.qfrc_smooth + data.qfrc_constraint)[simulated])

    solution = root(compute_imbalance, data.qpos[simulated].copy(), tol=1e-12)
    # The residual decides, not the solver's own status; `not <=` also catches NaN. The call leaves
    # `data` in the pose found.
    residual = float(np.abs(compute_imbalance(solution.x)).max())
    if not residual <= UNBALANCED * max(largest, 1e-3):
        raise SimulationFailed(
            f"no rest pose found: {residual:.2g} N m or N stay unbalanced; start it "
            "estimated, or check the model"
        )


@dataclass(frozen=True)
class CommandTrace:
    """Commands of the actuators: times `t_s` (k,) ascending, `command` (k, u) in the actuators'
    units, linear between them. `is_powered`: whether the actuators were on.
    """

    t_s: Floats
    command: Floats
    is_powered: bool = True

    @cached_property
    def total(self) -> Floats:
        """Integral of the commands from the first time on, (k, u); exact for straight lines."""
        spans = 0.5 * np.diff(self.t_s)[:, None] * (self.command[1:] + self.command[:-1])
        return np.vstack([np.zeros(self.command.shape[1]), np.cumsum(spans, axis=0)])


@dataclass(frozen=True)
class Motion:
    """Simulated readings: `position`, `speed` (k, n) of the joints in rad and rad/s or m and m/s,
    and `sensors` (k, d) in SI units.

    `touch_s` (c,) is the time at which each contact that has a law of its own first touched, inf
    where it never did.
    """

    position: Floats
    speed: Floats
    sensors: Floats
    touch_s: Floats


@jit_internal
def look_up(row: Floats, which: int, count: int, u: float) -> float:
    """The value at `u` of row `which` of a table (3, k) with its knots in row 0: linear between
    knots, constant beyond them.
    """
    if u <= row[0, 0]:
        return float(row[which, 0])
    if u >= row[0, count - 1]:
        return float(row[which, count - 1])
    i = 0
    while u > row[0, i + 1]:
        i += 1
    return float(
        row[which, i]
        + (u - row[0, i]) / (row[0, i + 1] - row[0, i]) * (row[which, i + 1] - row[which, i])
    )


class TorqueArrays(NamedTuple):
    """Torques in the n joints that MuJoCo does not have.

    `friction` (7, n): dry friction, Stribeck friction, its rise and its speed, the share of the
    load that is lost, Dahl's friction and the angle over which it builds up. `bristle` (n,) is the
    state of Dahl's friction, `offset` (n,) are constant torques, `law_numbers` and `law_tables`
    come from `pack_laws`.
    """

    friction: Floats
    bristle: Floats
    offset: Floats
    law_numbers: Floats
    law_tables: Floats


class CommandArrays(NamedTuple):
    """Commands of the u actuators in each of k steps, and how they fall with speed.

    `command` (k, u). `torque_speed` (2, u) or (2, 0): the largest command at rest, and its relative
    decrease per unit of speed of the actuator's joint, `joints` (u,); the second is negative where
    the gear reverses the direction.
    """

    command: Floats
    torque_speed: Floats
    joints: Places


class PathArrays(NamedTuple):
    """What a simulation of k steps leaves.

    Positions `q` and speeds `w` (k + 1, n) before each step and after the last, `sensors` (k + 1,
    d) or (k + 1, 0) before each step, as MuJoCo computes them at a step's beginning, and the
    torques of the actuators in each step, `torque` (k, n) or (k, 0).
    """

    q: Floats
    w: Floats
    sensors: Floats
    torque: Floats


@jit_internal
def act_tables(torques: TorqueArrays, mujoco: MujocoArrays, before: Floats, h: float) -> None:
    """Adds the torques of tables to MuJoCo's own arrays; `before` (n,) are the speeds a step
    earlier.

    A braking torque becomes dry friction, which cannot reverse the motion within a step. As an
    explicit torque, a steep law would need steps shorter than inertia over slope.
    """
    for m in range(torques.law_numbers.shape[0]):
        numbers = torques.law_numbers[m]
        table = torques.law_tables[m]
        i = int(numbers[0])
        by_speed = numbers[1] > 0.0
        count = int(numbers[2])
        speed = mujoco.w[i]
        # Positions are taken in the middle of the step, or a spring would gain energy.
        u = speed if by_speed else mujoco.q[i] + 0.5 * h * speed
        value = look_up(table, 1, count, u)
        if by_speed:
            towards = 1.0 if u > 0.0 else -1.0
            brakes = mujoco.frictionloss[i] + value * towards
            # A negative friction loss is impossible: the part that drives the motion is applied as
            # a torque.
            mujoco.frictionloss[i] = max(brakes, 0.0)
            mujoco.applied[i] -= min(brakes, 0.0) * towards
        else:
            mujoco.applied[i] -= value
        # Rate of the argument: its sign selects the branch of a hysteresis, smoothly about zero.
        rate = (speed - before[i]) / h if by_speed else speed
        mujoco.applied[i] -= look_up(table, 2, count, u) * np.tanh(rate / numbers[3])


@jit_internal
def apply_friction(torques: TorqueArrays, mujoco: MujocoArrays, h: float) -> None:
    """Sets the dry friction of a step, and adds Dahl's friction to the applied torques."""
    friction = torques.friction
    bristle = torques.bristle
    for i in range(mujoco.w.size):
        speed = mujoco.w[i]
        if friction[1, i] > 0.0:
            rise = friction[2, i] * np.exp(-abs(speed) / friction[3, i])
        else:
            rise = 0.0
        # The load is that of the step before, which MuJoCo has computed already.
        load = abs(mujoco.by_actuators[i])
        mujoco.frictionloss[i] = (
            friction[0, i] + friction[1, i] * (1.0 + rise) + friction[4, i] * load
        )
        if friction[5, i] > 0.0:
            # Dahl's equation, solved exactly for a constant speed during the step; the mean over
            # the step acts.
            slip = h * speed / friction[6, i]
            towards = 1.0 if slip > 0.0 else -1.0
            after = towards + (bristle[i] - towards) * np.exp(-abs(slip))
            mujoco.applied[i] -= friction[5, i] * 0.5 * (bristle[i] + after)
            bristle[i] = after


@jit_internal
def set_commands(commands: CommandArrays, k: int, mujoco: MujocoArrays) -> None:
    """Sets the commands of step k, limited by the speeds at its beginning."""
    for j in range(mujoco.ctrl.size):
        mujoco.ctrl[j] = commands.command[k, j]
    for j in range(commands.torque_speed.shape[1]):
        # The limit falls with speed in the direction of the motion, and grows against it: one
        # straight line through both.
        at_rest = commands.torque_speed[0, j]
        lost = commands.torque_speed[1, j] * mujoco.w[commands.joints[j]]
        mujoco.ctrl[j] = min(
            max(mujoco.ctrl[j], -at_rest * max(0.0, 1.0 + lost)), at_rest * max(0.0, 1.0 - lost)
        )


@jit
def run_steps(
    mujoco: MujocoArrays,
    h: float,
    commands: CommandArrays,
    torques: TorqueArrays,
    play: PlayArrays,
    prescribed: PrescribedArrays,
    contacts: ContactArrays,
    stages: StageArrays,
    path: PathArrays,
) -> None:
    """Takes a step of `h` [s] for each command, and fills `path`."""
    steps = commands.command.shape[0]
    q = mujoco.q
    w = mujoco.w
    for k in range(steps):
        for i in range(q.size):
            mujoco.applied[i] = torques.offset[i]
        prescribe(prescribed, k, h, q, w, mujoco.applied)
        add_spring_play(play, q, w, mujoco.applied)
        for i in range(q.size):
            path.q[k, i] = q[i]
            path.w[k, i] = w[i]
        apply_friction(torques, mujoco, h)
        act_tables(torques, mujoco, path.w[max(k - 1, 0)], h)
        set_commands(commands, k, mujoco)
        take_step(mujoco, h, stages, contacts, path.sensors[k])
        for i in range(path.torque.shape[1]):
            path.torque[k, i] = mujoco.by_actuators[i]
    # The last state, after the last step, has its prescribed joints on the trajectory as well.
    prescribe(prescribed, steps, h, q, w, mujoco.applied)
    for i in range(q.size):
        path.q[-1, i] = q[i]
        path.w[-1, i] = w[i]


@jit
def low_pass(values: Floats, share: float) -> None:
    """Filters the rows of (k, n) by a first-order low-pass, in place, from the first row on."""
    for k in range(1, values.shape[0]):
        for i in range(values.shape[1]):
            values[k, i] = values[k - 1, i] + share * (values[k, i] - values[k - 1, i])


@jit
def lag_readings(values: Floats, late: Floats, remains: float, new: float) -> None:
    """Fills `late` (k, n), whose first row is given, with `values` (k, n) behind a first-order lag,
    exact for values that are straight lines between the rows.

    Of a difference `remains` after a step, and `new` of a step is the share of the later value.
    """
    for k in range(1, values.shape[0]):
        for i in range(values.shape[1]):
            late[k, i] = (
                remains * late[k - 1, i]
                + new * values[k, i]
                + (1.0 - remains - new) * values[k - 1, i]
            )


@jit
def sample_path(
    t_s: Floats,
    h: float,
    path_q: Floats,
    path_w: Floats,
    read_w: Floats,
    position: Floats,
    speed: Floats,
) -> None:
    """Fills positions and speeds (m, n) at times (m,) between steps of `h` [s], from those before
    each step and after the last, (k + 1, n).

    Positions follow the cubic through both ends of a step with their speeds `path_w`, the speeds
    that are read, `read_w`, a straight line.
    """
    for m in range(t_s.size):
        k = min(int(t_s[m] / h), path_q.shape[0] - 2)
        x = t_s[m] / h - k
        for i in range(path_q.shape[1]):
            rise = path_q[k + 1, i] - path_q[k, i]
            bend = (1.0 - x) * (h * path_w[k, i] - rise) + x * (rise - h * path_w[k + 1, i])
            position[m, i] = path_q[k, i] + x * rise + x * (1.0 - x) * bend
            speed[m, i] = read_w[k, i] + x * (read_w[k + 1, i] - read_w[k, i])


@jit
def average_commands(
    t_s: Floats, command: Floats, total: Floats, edges: Floats, mean: Floats
) -> None:
    """Fills the means (k, u) of commands between edges (k + 1,) ascending [s].

    `command` (m, u) are those at times `t_s` (m,), and `total` (m, u) their integral. Outside of
    these times the end values continue, so the integral grows linearly.
    """
    last = t_s.size - 1
    for i in range(command.shape[1]):
        place = 0
        before = 0.0
        for k in range(edges.size):
            edge = edges[k]
            if edge <= t_s[0]:
                now = (edge - t_s[0]) * command[0, i]
            elif edge >= t_s[last]:
                now = total[last, i] + (edge - t_s[last]) * command[last, i]
            else:
                while edge > t_s[place + 1]:
                    place += 1
                share = (edge - t_s[place]) / (t_s[place + 1] - t_s[place])
                now = total[place, i] + share * (total[place + 1, i] - total[place, i])
            if k > 0:
                mean[k - 1, i] = (now - before) / (edge - edges[k - 1])
            before = now


def simulate_plant(
    plant: Plant,
    trace: CommandTrace,
    position: Floats | None,
    speed: Floats | None,
    t_s: Floats,
    since_s: float = 0.0,
    prescribed: PrescribedMotion | None = None,
) -> Motion:
    """Simulates the readings of a motion from a start at time zero.

    Parameters
    ----------
    plant
        The mechanism with nuisance parameters and effects.
    trace
        Commands of its actuators. It begins before zero, to fill delays and lags.
    position, speed
        (n,) as read at the start; None for a start at rest in equilibrium.
    t_s
        (k,) ascending, above zero: sample times of the readings.
    since_s
        Time between the beginning of the recording and the start.
    prescribed
        The motion of the prescribed joints, as read.

    Raises
    ------
    SimulationFailed
        Where the simulation diverges, or there is no equilibrium to start in.
    """
    h = plant.step_s
    sample_s = float(t_s[-1]) / len(t_s)
    # The speed of a gear's deflection is a difference over a sample, also at the last time.
    beyond_s = sample_s if plant.has_yielding_gears else 0.0
    steps = int(np.ceil((t_s[-1] + beyond_s) / h - 1e-9))
    if position is None or speed is None:
        start = None
    else:
        start = (position - plant.zero_offset, speed)
    path, touch_s = _integrate(
        plant, trace, steps, start, since_s, sample_s, _prescribe(plant, prescribed, steps)
    )
    path_q = path.q
    path_w = path.w
    if not (np.isfinite(path_q[-1]).all() and np.isfinite(path_w[-1]).all()):
        where = plant.mechanism.path
        raise SimulationFailed(
            f"{where}: the simulation diverges with steps of {h:g} s; look for a slipped "
            "decimal point in the model"
        )
    if plant.reading_lag_s > 0.0:
        path_q = _read_late(path_q, plant.reading_lag_s, h)
        path_w = _read_late(path_w, plant.reading_lag_s, h)
    read_w = path_w
    if plant.speed_lag_s > 0.0:
        read_w = _read_late(path_w, plant.speed_lag_s, h)
    joints = path_q.shape[1]
    position = np.empty((len(t_s), joints))
    speed = np.empty((len(t_s), joints))
    sample_path(t_s, h, path_q, path_w, read_w, position, speed)
    return Motion(
        position + plant.zero_offset,
        speed,
        _read_sensors(plant, path.sensors, t_s, since_s),
        touch_s,
    )


def _read_late(path: Floats, lag_s: float, h: float) -> Floats:
    """The path (k, n) behind a first-order lag that the motion has reached before it begins.

    A lag y of x, T y' = x - y, is then x - T x' + T^2 x'' at the start, up to the third power of T.
    """
    late = path.copy()
    if len(path) > 2:
        rate = (-3.0 * path[0] + 4.0 * path[1] - path[2]) / (2.0 * h)
        bend = (path[0] - 2.0 * path[1] + path[2]) / h**2
        late[0] += lag_s * (lag_s * bend - rate)
    _lag(path, late, lag_s, h)
    return late


def _lag(values: Floats, late: Floats, lag_s: float, h: float) -> None:
    """Fills `late` (k, n) behind its first row, as `lag_readings`."""
    remains = float(np.exp(-h / lag_s))
    lag_readings(values, late, remains, 1.0 - lag_s / h * (1.0 - remains))


def _prescribe(plant: Plant, motion: PrescribedMotion | None, steps: int) -> PrescribedArrays:
    joints = np.array(plant.mechanism.prescribed, dtype=np.intp)
    if motion is None:
        return PrescribedArrays(joints[:0], np.empty((steps + 1, 0)), np.empty((steps + 1, 0)))
    position, speed = motion.sample(np.arange(steps + 1, dtype=np.float64) * plant.step_s)
    return PrescribedArrays(joints, position - plant.zero_offset[joints], speed)


def _contact_arrays(plant: Plant, data: Any) -> ContactArrays:
    model = plant.model
    laws = plant.mechanism.contacts
    sphere = np.array([model.geom(law.sphere).id for law in laws], dtype=np.intp)
    plane = np.array([model.geom(law.plane).id for law in laws], dtype=np.intp)
    return ContactArrays(
        plant.contact_law,
        np.array(model.geom_size[sphere, 0]),
        sphere,
        plane,
        model.geom_bodyid[sphere].astype(np.intp),
        model.geom_bodyid[plane].astype(np.intp),
        model.body_rootid.astype(np.intp),
        np.zeros((len(laws), 3)),
        np.zeros(len(laws)),
        np.zeros(1),
        np.full(len(laws), np.inf),
        np.empty((3, 3)),
        data.geom_xpos,
        data.geom_xmat,
        data.xipos,
        data.subtree_com,
        data.cvel,
        data.xfrc_applied,
    )


def _stage_arrays(plant: Plant) -> StageArrays:
    laws = len(plant.mechanism.contacts)
    if plant.mechanism.is_implicit or laws == 0:
        n = 0
    else:
        n = plant.model.nv
    return StageArrays(
        np.empty(n), np.empty(n), np.empty((laws, 3)), np.empty(laws), np.empty((2, n))
    )


def _torque_arrays(plant: Plant, steady: Floats) -> TorqueArrays:
    friction = np.vstack([plant.friction, plant.stribeck, plant.load_loss, plant.hysteresis])
    return TorqueArrays(friction, np.zeros(plant.model.nv), steady, *pack_laws(plant.laws))


def _play_arrays(plant: Plant) -> PlayArrays:
    model = plant.model
    # Under Runge-Kutta the torque in the middle of the step is its mean; an implicit step takes its
    # springs at the beginning.
    if plant.mechanism.is_implicit:
        ahead_s = 0.0
    else:
        ahead_s = 0.5 * plant.step_s
    # Joints of a number other than one would come in the order of Fortran, for which the compiler
    # would compile the rollout once more.
    spring = np.ascontiguousarray(np.vstack([model.jnt_stiffness, model.jnt_stiffnesspoly.T]))
    return PlayArrays(plant.spring_half_gap, model.qpos_spring, spring, ahead_s)


def _integrate(
    plant: Plant,
    trace: CommandTrace,
    steps: int,
    start: tuple[Floats, Floats] | None,
    since_s: float,
    sample_s: float,
    prescribed: PrescribedArrays,
) -> tuple[PathArrays, Floats]:
    """The path with positions and speeds at the encoders, and times of first contact (c,).

    `start` are positions and speeds (n,) at the motors, None for a start at rest.
    """
    import mujoco  # noqa: PLC0415  (optional)

    model = plant.model
    command = average_steps(plant, trace, steps, since_s)
    steady = plant.torque_offset if trace.is_powered else np.zeros(model.nv)
    # What an earlier simulation with this model left would begin this one.
    model.dof_frictionloss[:] = plant.friction + plant.stribeck[0]
    with plant.mechanism.borrow_data(model) as data:
        contacts = _contact_arrays(plant, data)
        play = _play_arrays(plant)
        data.ctrl[:] = command[0]
        if start is None:
            _start_at_rest(plant, data, prescribed, contacts, play, steady)
        else:
            data.qpos[:], data.qvel[:] = start
        data.qfrc_applied[:] = steady
        # The first step's friction depends on the actuators' torques.
        mujoco.mj_forward(model, data)
        if plant.reading_lag_s > 0.0 and start is not None:
            _move_to_late_start(plant, data, start, command)
        gears = None
        # The start was read by the motors' encoders, too; the joints are behind by the deflection.
        if plant.has_yielding_gears:
            around = replace(trace, t_s=trace.t_s + SMOOTHED_S)
            coarse = replace(plant, step_s=2.0 * SMOOTHED_S / PARTS)
            gears = estimate_gear_start(
                plant, data, average_steps(coarse, around, PARTS, since_s - SMOOTHED_S)
            )
            data.qpos[:] = data.qpos - gears.ahead
            data.qvel[:] = data.qvel - gears.rate
            data.ctrl[:] = command[0]
            mujoco.mj_forward(model, data)
        path = PathArrays(
            q=np.empty((steps + 1, model.nv)),
            w=np.empty((steps + 1, model.nv)),
            sensors=np.empty((steps + 1, model.nsensordata if plant.reads_sensors else 0)),
            torque=np.empty((steps, 0 if gears is None else model.nv)),
        )
        run_steps(
            list_arrays(model, data),
            plant.step_s,
            CommandArrays(command, *_torque_speed(plant)),
            _torque_arrays(plant, steady),
            play,
            prescribed,
            contacts,
            _stage_arrays(plant),
            path,
        )
        # Sensors after the last step. Contact forces are applied first, since the sensors read
        # their reaction.
        if path.sensors.size:
            if contacts.radius.size:
                mujoco.mj_forward(model, data)
                apply_contact_forces(contacts, 0.0)
            mujoco.mj_forward(model, data)
            path.sensors[-1] = data.sensordata
    if gears is not None and np.isfinite(path.w[-1]).all():
        add_deflection(plant, gears, path.torque, path.q, path.w, sample_s)
    return path, contacts.touch_s


def _move_to_late_start(
    plant: Plant, data: Any, start: tuple[Floats, Floats], commands: Floats
) -> None:
    """Puts the plant where it is when positions and speeds (n,), `start`, are read through the lag.

    Of a lag, T y' = x - y, the position is x = y + T y' and the speed x' = y' + T a - T^2 j with
    acceleration a and jerk j, up to the third power of T. These belong to the true state.
    """
    import mujoco  # noqa: PLC0415  (optional)

    position, speed = start
    lag_s = plant.reading_lag_s
    true_position = position + lag_s * speed
    true_speed = speed
    for _ in range(LAG_ROUNDS):
        data.qpos[:] = true_position
        data.qvel[:] = true_speed
        data.ctrl[:] = commands[0]
        mujoco.mj_forward(plant.model, data)
        acceleration = data.qacc.copy()
        data.qpos[:] += plant.step_s * true_speed
        data.qvel[:] += plant.step_s * acceleration
        data.ctrl[:] = commands[min(1, len(commands) - 1)]
        mujoco.mj_forward(plant.model, data)
        jerk = (data.qacc - acceleration) / plant.step_s
        true_speed = speed + lag_s * acceleration - lag_s**2 * jerk
    data.qpos[:] = true_position
    data.qvel[:] = true_speed
    data.ctrl[:] = commands[0]
    mujoco.mj_forward(plant.model, data)


def _start_at_rest(
    plant: Plant,
    data: Any,
    prescribed: PrescribedArrays,
    contacts: ContactArrays,
    play: PlayArrays,
    steady: Floats,
) -> None:
    """Puts the plant into equilibrium under `steady` torques (n,), or off it where the plant has an
    initial swing.
    """
    model = plant.model
    moving = plant.mechanism.simulated
    data.qpos[prescribed.joints] = prescribed.position[0]
    find_rest_pose(model, data, np.array(moving, dtype=np.intp), steady, contacts, play)
    sprung = [joint for joint in moving if plant.mechanism.has_spring(joint)]
    # The swing is a share of the way from equilibrium to the pose in which the springs are free.
    lift = model.qpos_spring[sprung] - data.qpos[sprung]
    data.qpos[sprung] += plant.start_swing * lift
    data.qvel[sprung] = plant.start_swing_rate_per_s * lift


def _torque_speed(plant: Plant) -> tuple[Floats, Places]:
    """Lines of torque over speed for `run_steps`, empty where no line falls; factors on the
    commands apply to them, too.
    """
    stall, share = plant.torque_speed
    if not share.any():
        return np.empty((2, 0)), np.empty(0, dtype=np.intp)
    lines = np.vstack(
        [stall * np.abs(plant.command_gain), share * np.sign(plant.model.actuator_gear[:, 0])]
    )
    return lines, plant.model.actuator_trnid[:, 0].astype(np.intp)


def _read_sensors(plant: Plant, path: Floats, t_s: Floats, since_s: float) -> Floats:
    """The sensors' values at these times, after lag, delay, crosstalk, gain, offset and drift;
    before the start they are constant.
    """
    if path.shape[1] == 0:
        return np.empty((len(t_s), 0))
    h = plant.step_s
    if plant.sensor_lag_s > 0.0:
        late = path.copy()
        _lag(path, late, plant.sensor_lag_s, h)
        path = late
    times = np.arange(len(path)) * h
    read = np.column_stack(
        [np.interp(t_s - plant.sensor_delay_s, times, values) for values in path.T]
    )
    if plant.sensor_crosstalk.any():
        read = read + read @ plant.sensor_crosstalk.T
    drift = (since_s + t_s)[:, None] * plant.sensor_drift_per_s
    return np.asarray(read * plant.sensor_gain + plant.sensor_offset + drift)


def limit_by_speed(plant: Plant, commands: Floats, speed: Floats) -> Floats:
    """Commands (k, u) within the lines of torque over speed, at speeds (k, n) of the joints; as
    `set_commands` limits them.
    """
    lines, joints = _torque_speed(plant)
    if not joints.size:
        return commands
    at_rest, share = lines
    lost = share * speed[:, joints]
    most = at_rest * np.maximum(0.0, 1.0 - lost)
    least = -at_rest * np.maximum(0.0, 1.0 + lost)
    return np.asarray(np.clip(commands, least, most))


def average_steps(plant: Plant, trace: CommandTrace, steps: int, since_s: float) -> Floats:
    """(k, u) what acts during each step: the mean over the step, after delay, lag, gain, dead
    band and saturation.
    """
    if trace.command.shape[1] == 0:
        return np.empty((steps, 0))
    h = plant.step_s
    if plant.command_lag_s > 0.0:
        before = int(max(0.0, -trace.t_s[0] / plant.step_s))
    else:
        before = 0
    edges: Floats = np.arange(-before, steps + 1, dtype=np.float64) * h
    edges = edges - plant.command_delay_s - plant.command_clock_rate * (since_s + edges)
    # Differences of the integral at the edges of the steps are exact means, however coarse the
    # steps are.
    command = np.empty((len(edges) - 1, trace.command.shape[1]))
    average_commands(trace.t_s, trace.command, trace.total, edges, command)
    if plant.command_lag_s > 0.0:
        low_pass(command, 1.0 - float(np.exp(-h / plant.command_lag_s)))
        # The mean over the step, not the value at its end.
        command[1:] = 0.5 * (command[1:] + command[:-1])
    command = command[before:] * plant.command_gain
    command = np.sign(command) * np.maximum(np.abs(command) - plant.command_dead_band, 0.0)
    return np.ascontiguousarray(np.clip(command, -plant.command_limit, plant.command_limit))
