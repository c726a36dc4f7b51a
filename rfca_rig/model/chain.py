"""Converts the leg to the arrays of the compiled code, finds its rest pose, and calls the
integrator.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.model.hinge_springs import table_of
from rfca_rig.model.kernel.compiled import jit, jit_inline
from rfca_rig.model.kernel.contact import drag_anchors
from rfca_rig.model.kernel.forces import assemble_stiffness
from rfca_rig.model.kernel.integrator import (
    DONE,
    SHORTEST_STEP_S,
    STEP_TOO_SHORT,
    integrate,
    update_memory,
)
from rfca_rig.model.kernel.laws import TABLE, LawUse, address_of, address_of_advance
from rfca_rig.model.kernel.stage import allocate_workspace, drive_torque, solve
from rfca_rig.model.kernel.state import NO_LAWS, Chain, Laws, Samples, Shaft, State, Work
from rfca_rig.model.parameters import GRAVITY_M_S2, RigModel

NEWTON_LIMIT = 200
# Time since the last step that laws with memory are given: at rest everything has relaxed.
LONG_S = 1e9
# per iteration, so that a leg far from rest does not jump through the ground
LONGEST_TURN_RAD = 0.1

Floats = NDArray[np.float64]

# At rest the error estimate allows any step, and a contact that begins and ends within one would be
# missed.
LONGEST_STEP_S = 5e-3


@jit_inline
def close_shaft_row(shaft: Shaft, q: Floats, work: Work) -> None:
    """Adds the torque of a free shaft's spring to row 0, or replaces the row by the condition
    that a held shaft stays; `q` is (c,).
    """
    if shaft.free:
        torque, k_angle, _ = drive_torque(shaft, shaft.angle - q[0], 0.0, q[0])
        work.R[0] -= torque
        work.J[0, 0] += k_angle
    else:
        work.R[0] = 0.0
        for i in range(q.size):
            work.J[0, i] = 0.0
        work.J[0, 0] = 1.0


@jit_inline
def find_largest(x: Floats) -> float:
    """The largest absolute value in x (c,); inf where one is not finite."""
    largest = 0.0
    for i in range(x.size):
        # Written so that NaN counts as not finite, too.
        if not abs(x[i]) < np.inf:
            return np.inf
        largest = max(largest, abs(x[i]))
    return largest


@jit
def settle(
    chain: Chain, laws: Laws, shaft: Shaft, state: State, tolerance: float, work: Work
) -> bool:
    """Changes state.q to the equilibrium with the shaft held at q[0], or free on its spring; then
    initialises memory and anchors.

    By damped Newton, until its last change is below `tolerance` [rad]; an infinite one takes the
    pose as it is. The memory is that of the laws, the anchors are right below the ends. False, and
    nothing initialised, where no equilibrium is found.

    For an equilibrium, `chain` must be without friction: the force of a stuck end depends on its
    path, which a rest pose does not contain. Loops, because assignments of whole arrays make the
    compiler include the texts of their errors, which takes some seconds.
    """
    q = state.q
    still = work.base_w
    change = np.inf
    for i in range(q.size):
        still[i] = 0.0
    iterations = 0
    while not change < tolerance and not np.isinf(tolerance):
        iterations += 1
        if iterations > NEWTON_LIMIT:
            return False
        assemble_stiffness(chain, laws, state, LONG_S, q, still, still, work)
        close_shaft_row(shaft, q, work)
        if not solve(work.J, work.R):
            return False
        change = find_largest(work.R)
        if np.isinf(change):
            return False
        # All coordinates are scaled alike, which keeps Newton's direction.
        for i in range(q.size):
            q[i] -= work.R[i] * min(1.0, LONGEST_TURN_RAD / max(change, 1e-300))
    assemble_stiffness(chain, laws, state, LONG_S, q, state.w, state.a, work)
    for i in range(q.size):
        work.q[i] = q[i]
    update_memory(chain, laws, state, LONG_S, work)
    # With all depths at zero, `drag_anchors` takes every end for one in the air and puts its anchor
    # below it.
    for k in range(work.place.shape[0]):
        for j in range(work.place.shape[1]):
            work.place[k, j] = 0.0
    drag_anchors(chain, state, q, work)
    return True


@dataclass(frozen=True)
class Tolerance:
    """Allowed error per step. The default gives force valleys to 1e-4 of those of a run a thousand
    times tighter, spikes to 0.2 %.

    `longest_s` bounds a step that the errors would allow, as at rest: an event within a step goes
    unnoticed. `most_steps` bounds a simulation whose steps are so short that it would take hours,
    as where a tip chatters: a stroke takes some thousands.
    """

    angle_rad: float = 1e-5
    speed_rad_s: float = 3e-2
    longest_s: float = LONGEST_STEP_S
    most_steps: int = 1_000_000

    @cached_property
    def bounds(self) -> Floats:
        """Both errors, as the compiled code takes them."""
        return np.array([self.angle_rad, self.speed_rad_s])


@dataclass(frozen=True)
class Steps:
    """Number of accepted and rejected steps of an integration, and the step length with which
    the next one may begin.
    """

    accepted: int
    rejected: int
    next_s: float


def make_chain(rig: RigModel, height_m: float) -> Chain:
    """The chain of `rig` with its shaft `height_m` above the ground, without effects."""
    leg = rig.leg
    ground = rig.ground
    # The cached arrays serve every chain of this leg, and callers may change their own copy.
    length, first_moment, moment = (
        array.copy() for array in _inertia(leg.link_lengths_m, leg.link_masses_kg)
    )
    springs = table_of(leg.torque_splines, length.size)
    # Everything that only effects use has its neutral value here: a level floor, no frame, no bump,
    # no friction of the shaft.
    return Chain(
        length=length,
        first_moment=first_moment,
        k0=np.full(length.size, leg.k0_Nm_per_rad),
        k2=np.full(length.size, leg.k2_per_rad2),
        spring_origin=springs.origin,
        spring_cubic=springs.cubic,
        hinge_damping=np.full(length.size, leg.hinge_damping_Nm_s_per_rad),
        rest=np.array([0.0, *(leg.rest_angles_rad or np.zeros(length.size - 1))]),
        moment=moment,
        radius=leg.link_radius_m,
        lever=rig.friction_lever_m,
        lever_rise=ground.friction_rise_share,
        gravity=GRAVITY_M_S2,
        gravity_along=0.0,
        total_mass=float(sum(leg.link_masses_kg)),
        ground_depth=height_m,
        floor_cos=1.0,
        floor_sin=0.0,
        contact_stiffness=ground.stiffness_N_per_m1p5,
        contact_damping=ground.damping_s_per_m,
        leaving_damping=ground.damping_s_per_m * ground.leaving_damping_share,
        mu=ground.friction_coefficient,
        presliding=ground.presliding_m,
        drag=ground.drag_N_s_per_m,
        frame_mass=0.0,
        frame_stiffness=0.0,
        frame_damping=0.0,
        frame_on_sensor=0.0,
        frame_down=1.0,
        frame_aside=0.0,
        shaft_friction=0.0,
        bump_height=0.0,
        bump_at=0.0,
        bump_width=1.0,
    )


@lru_cache(maxsize=64)
def _inertia(
    lengths_m: tuple[float, ...], masses_kg: tuple[float, ...]
) -> tuple[Floats, Floats, Floats]:
    """Lengths, first moments (n,) and moments (n, n) of a leg; cached, because a fit asks for
    the same leg many times.
    """
    length = np.array(lengths_m)
    mass = np.array(masses_kg)
    # Row k: how far the mass centre of link k moves per radian of each absolute angle, all links
    # stretched out in line.
    reach = np.tril(np.broadcast_to(length, (length.size, length.size)), -1) + np.diag(length / 2.0)
    # M_ij at equal angles; `forces` multiplies it by cos(q_i - q_j). Uniform rods add m L^2 / 12
    # about their own centre.
    moment = np.einsum("k,ki,kj->ij", mass, reach, reach) + np.diag(mass * length**2 / 12.0)
    return length, mass @ reach, moment


def make_laws(uses: Sequence[LawUse]) -> Laws:
    """The laws of effects as arrays; compiles each once per process."""
    if not uses:
        return NO_LAWS
    # All rows are as wide as the longest table, since the compiled chain reads one rectangular
    # array.
    parameter = np.zeros((len(uses), TABLE + max((len(use.table) for use in uses), default=0)))
    for row, use in zip(parameter, uses, strict=True):
        row[: len(use.parameters)] = use.parameters
        row[TABLE : TABLE + len(use.table)] = use.table
    return Laws(
        address=np.array([address_of(use.law, use.place) for use in uses], dtype=np.int64),
        advance=np.array(
            [address_of_advance(use.advance) if use.advance else 0 for use in uses], dtype=np.int64
        ),
        place=np.array([use.place for use in uses], dtype=np.int64),
        only=np.array([use.only for use in uses], dtype=np.int64),
        parameter=parameter,
    )


EMPTY = np.empty(0)
HELD_SHAFT = Shaft(EMPTY, np.empty((0, 4)), EMPTY, False, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def allocate_workspace_of(chain: Chain) -> Work:
    """Working memory for this chain. A frame that yields is one more coordinate."""
    links = chain.length.size
    return allocate_workspace(links + (chain.frame_mass > 0.0), links)


def make_unloaded_state(
    chain: Chain, shaft_angle_rad: float, laws: Laws = NO_LAWS, shaft: Shaft = HELD_SHAFT
) -> State:
    """The chain without motion, in the shape that it has without loads."""
    links = chain.length.size
    coordinates = links + (chain.frame_mass > 0.0)
    state = State(
        q=np.full(coordinates, shaft_angle_rad + shaft.gap),  # the weight has taken up the play
        w=np.zeros(coordinates),
        a=np.zeros(coordinates),
        anchor=np.zeros(links),
        memory=np.zeros((laws.place.size, links, 4)),
    )
    state.q[:links] += np.cumsum(chain.rest)
    # The displacement of a frame counts from where it carries the leg at rest, see
    # `forces.add_frame`.
    state.q[links:] = 0.0
    return state


def find_rest_state(
    chain: Chain,
    shaft_angle_rad: float,
    laws: Laws = NO_LAWS,
    shaft: Shaft = HELD_SHAFT,
    work: Work | None = None,
) -> State:
    """The chain in equilibrium under its weight, its shaft held or on the spring of a compliant
    drive; without friction on the ground.

    `work` is unused memory of `allocate_workspace_of`, if the caller has some. Raises
    SimulationFailed where no rest pose is found.
    """
    state = make_unloaded_state(chain, shaft_angle_rad, laws, shaft)
    # Friction would make the pose depend on how the leg got there; 1e-12 rad is close to rounding,
    # so that forces are smooth in fits.
    if not settle(
        chain._replace(mu=0.0, drag=0.0),
        laws,
        shaft,
        state,
        1e-12,
        work or allocate_workspace_of(chain),
    ):
        raise SimulationFailed(
            f"no rest pose found with the shaft at {np.degrees(shaft_angle_rad):.1f} degrees and "
            f"{1e3 * chain.ground_depth:.1f} mm above the ground; is the rack height right?"
        )
    return state


def set_swinging(
    chain: Chain, laws: Laws, state: State, share: float, rate_per_s: float, work: Work
) -> None:
    """Lifts a resting leg by `share` of its sag, 1 for its unloaded shape, and gives it a speed
    of `rate_per_s` sags per second.
    """
    links = chain.length.size
    sag = state.q[0] + np.cumsum(chain.rest) - state.q[:links]
    state.q[:links] += share * sag
    state.w[:links] += rate_per_s * sag
    settle(chain, laws, HELD_SHAFT, state, np.inf, work)


def allocate_samples(t_s: Floats, coordinates: int, links: int | None = None) -> Samples:
    """Uninitialised samples at the times `t_s` (m,), for an integration to fill; `links` is n
    where it differs from `coordinates`, c.
    """
    m = len(t_s)
    return Samples(
        t_s,
        np.empty((m, coordinates)),
        np.empty((m, coordinates)),
        np.empty((m, 3)),
        np.empty((m, 2, links or coordinates)),
    )


Integrator = Callable[..., tuple[int, float, int, int]]


def resolve_integrator(
    chain: Chain, laws: Laws, shaft: Shaft, state: State, work: Work, samples: Samples
) -> Integrator:
    """The compiled code for arguments of these types, compiled or loaded now if need be; it must
    not be called with other types.

    Per call the compiler's dispatcher finds out the type of each of some sixty arrays, which takes
    several times as long as a short span.
    """
    compiled: Any = integrate
    # Without compilation, as for coverage, it is the Python function itself.
    if not hasattr(compiled, "typeof_pyval"):
        return integrate
    arguments = chain, laws, shaft, state, 0.0, 0.0, 0.0, 0.0, 1, Tolerance().bounds, work, samples
    types = tuple(map(compiled.typeof_pyval, arguments))
    entry: Integrator = compiled.compile(types)
    return entry


def advance(
    chain: Chain,
    shaft: Shaft,
    state: State,
    span_s: tuple[float, float],
    step_s: float,
    tolerance: Tolerance,
    samples: Samples,
    laws: Laws = NO_LAWS,
    work: Work | None = None,
    integrator: Integrator = integrate,
) -> Steps:
    """Integrates `state` over `span_s` in place and fills `samples`.

    Parameters
    ----------
    chain, shaft, laws
        What moves, what turns the shaft, and the laws of effects.
    state
        At the start of the span; at its end afterwards.
    span_s
        Start and end.
    step_s
        Length of the first step.
    tolerance
        Error per step; the method is of third order, see `integrator`.
    samples
        Their times lie in the span, its start excluded.
    work
        Working memory of an earlier call for the same chain, for a caller with many short spans;
        the result is that of new memory.
    integrator
        From `resolve_integrator`, for such a caller, too.

    Returns
    -------
    Steps
        Counts, and the step length to continue with.

    Raises
    ------
    SimulationFailed
        Where no step converges, or where it would take more than `tolerance.most_steps`.
    """
    if work is None:
        work = allocate_workspace(state.q.size, state.anchor.size)
    else:
        # Everything else in it is written before it is read.
        work.ends.fill(0.0)
    status, next_s, accepted, rejected = integrator(
        chain,
        laws,
        shaft,
        state,
        span_s[0],
        span_s[1],
        step_s,
        tolerance.longest_s,
        tolerance.most_steps,
        tolerance.bounds,
        work,
        samples,
    )
    if status != DONE:
        if status == STEP_TOO_SHORT:
            why = f"no step above {SHORTEST_STEP_S:g} s converges"
        else:
            why = f"steps are down to {next_s:.1g} s"
        raise SimulationFailed(
            f"the model stopped after {accepted + rejected} steps between {span_s[0]:.3f} "
            f"s and {span_s[1]:.3f} s, "
            f"{1e3 * chain.ground_depth:.1f} mm above the ground: {why}; look for a "
            "slipped decimal point in the leg or the ground"
        )
    return Steps(accepted, rejected, next_s)
