"""Pendulums: chains of one or more links without ground whose joints are driven by recorded
torques.

They use the compiled chain of the leg. A link without length or mass is held still in front of the
first one, so that every joint is a hinge between two links and all laws of hinges act on it. The
angle of joint 1 counts from the hanging position, that of any other joint from the direction of the
link before.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.catalogue import resolve_effect
from rfca_rig.model.chain import Tolerance, advance, allocate_samples
from rfca_rig.model.effects.joint_torques import CLOCK, TorqueTrace, drive_of, with_traces
from rfca_rig.model.effects.joints import friction_of, inertia_of
from rfca_rig.model.effects.sensor_timing import filter_first_order
from rfca_rig.model.kernel.integrator import FIRST_STEP_S, update_memory_once
from rfca_rig.model.kernel.laws import HINGE, LINK, ROTOR, LawUse
from rfca_rig.model.kernel.stage import allocate_workspace
from rfca_rig.model.kernel.state import Chain, Laws, State
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import Drive, Ground, Leg, PresentEffect, RigModel, SensorMount
from rfca_rig.model.setup import JointReadings, Setup

Floats = NDArray[np.float64]

FINE = Tolerance(1e-5, 3e-2)
HANGING_RAD = 0.5 * np.pi  # of the compiled chain, which counts from the horizontal
NO_GROUND_M = 1e6  # height at which no pendulum reaches the ground
# Span of the differences for acceleration and jerk at the start: short against a swing, long
# against the integrator's error.
SOON_S = 5e-3
# The joints are assumed to have turned at their initial speed for this long before the start; it
# fills the memory of the laws.
EVEN_S = 0.1


@dataclass(frozen=True)
class PendulumLink:
    """One link and the joint that carries it.

    `length_m` to the next joint or to the tip; `centre_of_mass_m` from the joint along the link;
    `inertia_kg_m2` about the joint. Viscous damping and dry friction of the joint and the inertia
    of a rotor, as reflected to it by the gear, are nominal values. A `driven` joint turns under the
    recorded torque plus `torque_offset_Nm`, `torque_delay_s` later than recorded; others have no
    torque. The reading of the joint's angle is too large by `zero_offset_rad`.
    """

    length_m: float
    mass_kg: float
    centre_of_mass_m: float
    inertia_kg_m2: float
    joint_damping_Nm_s_per_rad: float = 0.0
    joint_friction_Nm: float = 0.0
    torque_offset_Nm: float = 0.0
    driven: bool = True
    zero_offset_rad: float = 0.0
    torque_delay_s: float = 0.0
    rotor_inertia_kg_m2: float = 0.0


@dataclass(frozen=True)
class Pendulum:
    """Links from the fixed joint outwards. Raises BadInput for none, or for a link whose inertia
    is below that of a point mass.
    """

    links: tuple[PendulumLink, ...]

    def __post_init__(self) -> None:
        if not self.links:
            raise BadInput("a pendulum without links; give one or more")
        for number, link in enumerate(self.links, start=1):
            # Steiner's theorem: the inertia about the joint is at least mass times distance
            # squared.
            least = link.mass_kg * link.centre_of_mass_m**2
            if link.inertia_kg_m2 < least * (1.0 - 1e-9):
                raise BadInput(
                    f"link {number}: {link.inertia_kg_m2:g} kg m2 about the joint is less "
                    f"than its mass has at the centre, {least:g}; "
                    f"give the inertia about the joint, not about the centre of mass"
                )


@dataclass(frozen=True)
class PendulumMotion:
    """A simulated motion: joint angles and speeds (m, n) at the times (m,)."""

    t_s: Floats
    angle_rad: Floats
    speed_rad_s: Floats


@dataclass(frozen=True)
class DrivenPendulum:
    """A pendulum with its effects, ready to swing any number of times."""

    pendulum: Pendulum
    chain: Chain
    uses: tuple[LawUse, ...]
    laws: Laws
    readings: JointReadings = field(default=JointReadings())

    def swing(
        self,
        trace: TorqueTrace,
        angle_rad: Floats,
        speed_rad_s: Floats,
        t_s: Floats,
        tolerance: Tolerance = FINE,
    ) -> PendulumMotion:
        """Simulates the readings of a motion.

        Parameters
        ----------
        trace
            Torques of all joints; an offset of the torque sensor is added while the motors are
            powered.
        angle_rad, speed_rad_s
            (n,) readings at t = 0.
        t_s
            (m,) ascending, above 0.
        tolerance
            Error per step.

        Returns
        -------
        PendulumMotion
            Readings (m, n).

        Raises
        ------
        BadInput
            Where the trace has not one torque per joint.
        SimulationFailed
            Where the integrator cannot go on.
        """
        n = len(self.pendulum.links)
        if (
            trace.torque_Nm.shape[1:] != (n,)
            or angle_rad.shape != (n,)
            or speed_rad_s.shape != (n,)
        ):
            raise BadInput(
                f"{n} joints, but torques of {trace.torque_Nm.shape[1:]}, angles of "
                f"{angle_rad.shape}; give one per joint"
            )
        offset = np.array(
            [link.torque_offset_Nm if trace.powered else 0.0 for link in self.pendulum.links]
        )
        zero = np.array([link.zero_offset_rad for link in self.pendulum.links])
        laws = with_traces(self.laws, self.uses, replace(trace, torque_Nm=trace.torque_Nm + offset))
        if self.readings == JointReadings():
            motion = self._simulate(laws, angle_rad - zero, speed_rad_s, t_s, tolerance)
        else:
            motion = self._simulate_lagged(laws, angle_rad - zero, speed_rad_s, t_s, tolerance)
        return replace(motion, angle_rad=motion.angle_rad + zero)

    def _simulate(
        self, laws: Laws, angle_rad: Floats, speed_rad_s: Floats, t_s: Floats, tolerance: Tolerance
    ) -> PendulumMotion:
        state = self._begin(laws, angle_rad, speed_rad_s)
        samples = allocate_samples(t_s, len(angle_rad) + 1)
        advance(
            self.chain,
            FIXED.shaft(),
            state,
            (0.0, float(t_s[-1])),
            FIRST_STEP_S,
            tolerance,
            samples,
            laws,
        )
        return PendulumMotion(t_s, np.diff(samples.q, axis=1), np.diff(samples.w, axis=1))

    def _simulate_lagged(
        self, laws: Laws, angle_rad: Floats, speed_rad_s: Floats, t_s: Floats, tolerance: Tolerance
    ) -> PendulumMotion:
        """The same read with a lag: tau y' = x - y. At the start x = y + tau y' for the angle, y
        = x - tau x' + tau^2 x'' for the speed.
        """
        # The true state at the start follows from the readings only with its derivatives, which
        # come from a short simulation.
        lag_s = self.readings.angle_lag_s
        more_s = self.readings.speed_lag_s
        angle = angle_rad + lag_s * speed_rad_s
        speed = speed_rad_s
        # Acceleration and jerk belong to the true state, which depends on them: two rounds. Without
        # a lag of the angle it is known.
        for _ in range(2 if lag_s > 0.0 else 1):
            # One-sided differences of the speed over two steps of SOON_S.
            soon = self._simulate(
                laws, angle, speed, np.array([1.0, 2.0]) * SOON_S, tolerance
            ).speed_rad_s
            acceleration = (4.0 * soon[0] - soon[1] - 3.0 * speed) / (2.0 * SOON_S)
            jerk = (soon[1] - 2.0 * soon[0] + speed) / SOON_S**2
            speed = speed_rad_s + lag_s * acceleration - lag_s**2 * jerk
        # The filter takes straight lines between samples, which would cut the corners of a slow
        # sampling.
        times = np.union1d(t_s, np.arange(SOON_S, t_s[-1], SOON_S))
        motion = self._simulate(laws, angle, speed, times, tolerance)
        angles = _read(times, angle, motion.angle_rad, angle_rad, lag_s)
        speeds = _read(times, speed, motion.speed_rad_s, speed_rad_s, lag_s)
        late_speed = speed_rad_s - more_s * acceleration + more_s**2 * jerk
        speeds = _read(times, speed_rad_s, speeds, late_speed, more_s)
        wanted = np.searchsorted(times, t_s)
        return PendulumMotion(t_s, angles[wanted], speeds[wanted])

    def _begin(self, laws: Laws, angle_rad: Floats, speed_rad_s: Floats) -> State:
        """Initial state. The memory of the laws is that of a rotation at constant speed, so that
        a moving joint has its full friction.
        """
        links = len(self.chain.length)
        q = HANGING_RAD + np.append(0.0, np.cumsum(angle_rad))
        w = np.append(0.0, np.cumsum(speed_rad_s))
        state = State(q, w, np.zeros(links), np.zeros(links), np.zeros((len(self.uses), links, 4)))
        # The laws that read the torque count the time of the assumed rotation too, which ends where
        # the trace begins.
        for index, use in enumerate(self.uses):
            if use.reads_torque:
                state.memory[index, :, CLOCK] = -2.0 * EVEN_S
        work = allocate_workspace(links, links)
        work.w[:] = w
        for ago_s in (EVEN_S, 0.0):
            work.q[:] = q - ago_s * w
            update_memory_once(self.chain, laws, state, EVEN_S, work)
        return state


def _read(t_s: Floats, first: Floats, then: Floats, reading: Floats, lag_s: float) -> Floats:
    """Output (m, n) at `t_s` of a first-order lag for the inputs `first` (n,) at 0 and `then`
    (m, n); its output at 0 is `reading` (n,).
    """
    if lag_s <= 0.0:
        return then
    # The filter begins in its steady state; the difference to the actual reading decays beside it.
    times = np.append(0.0, t_s)
    at_rest = [
        filter_first_order(times, np.append(x0, x), lag_s)[1:]
        for x0, x in zip(first, then.T, strict=True)
    ]
    return np.column_stack(at_rest) + np.exp(-t_s / lag_s)[:, None] * (reading - first)


FIXED = ShaftMotion(np.array([0.0, 1.0]), np.array([[HANGING_RAD, 0.0, 0.0, 0.0]]), np.empty(0))


def make_driven_pendulum(
    pendulum: Pendulum, effects: Sequence[PresentEffect] = ()
) -> DrivenPendulum:
    """The pendulum with effects, applied in their order. Raises BadInput for one that does not
    act on a pendulum.
    """
    setup = _set_up(pendulum)
    for present in effects:
        effect, values = resolve_effect(present)
        before = setup
        setup = effect.apply(before, values)
        # A law of the ground or the sensor would be accepted by the chain and do nothing; a silent
        # effect would mislead a fit.
        if effect.where == "ground" or not _acts(before, setup):
            raise BadInput(
                f"effect {present.id}: acts on ground, shaft or force sensor, which a "
                "pendulum does not have; leave it out"
            )
    chain = setup.chain()
    laws = setup.compile_laws(chain)
    if chain.frame_mass > 0.0:
        raise BadInput("a pendulum hangs from a fixed joint; leave frame_compliance out")
    return DrivenPendulum(
        pendulum, chain, setup.laws, laws, setup.joint_readings or JointReadings()
    )


def simulate_pendulum(
    pendulum: Pendulum,
    trace: TorqueTrace,
    angle_rad: Floats,
    speed_rad_s: Floats,
    t_s: Floats,
    effects: Sequence[PresentEffect] = (),
    tolerance: Tolerance = FINE,
) -> PendulumMotion:
    """One motion of a pendulum from `angle_rad`, `speed_rad_s` (n,) at times `t_s` (m,); see
    `DrivenPendulum.swing`.
    """
    return make_driven_pendulum(pendulum, effects).swing(
        trace, angle_rad, speed_rad_s, t_s, tolerance
    )


def rods(pendulum: Pendulum) -> RigModel:
    """The rig that effects receive: rods of the right lengths and masses, without springs,
    ground or sensor.
    """
    links = pendulum.links
    leg = Leg(
        (0.0, *(link.length_m for link in links)),
        (0.0, *(link.mass_kg for link in links)),
        0.0,
        0.0,
        0.0,
        0.0,
        0.0,
    )
    return RigModel(leg, Ground(0.0, 0.0, 0.0, 1.0, 0.0), SensorMount(0.0), Drive(1.0))


def _acts(before: Setup, after: Setup) -> bool:
    """Whether an effect changed anything that a pendulum has."""
    parts = (
        (before.chain_changes, after.chain_changes),
        (before.laws, after.laws),
        (before.rig.leg, after.rig.leg),
        (before.joint_readings, after.joint_readings),
    )
    changed = any(old is not new for old, new in parts)
    elsewhere = after.drive is not before.drive or any(
        use.place not in (HINGE, LINK, ROTOR) for use in after.laws
    )
    return changed and not elsewhere


def _set_up(pendulum: Pendulum) -> Setup:
    """The plain pendulum. Its leg consists of uniform rods; `_set_masses` then sets masses,
    inertias and damping in the chain.
    """
    links = pendulum.links
    drives = tuple(
        drive_of(joint, link.torque_delay_s)
        for joint, link in enumerate(links, start=1)
        if link.driven
    )
    friction = tuple(
        friction_of(link.joint_friction_Nm, joint)
        for joint, link in enumerate(links, start=1)
        if link.joint_friction_Nm
    )
    rotors = tuple(
        inertia_of(link.rotor_inertia_kg_m2, joint)
        for joint, link in enumerate(links, start=1)
        if link.rotor_inertia_kg_m2
    )
    laws = drives + friction + rotors
    return Setup(
        rods(pendulum),
        NO_GROUND_M,
        FIXED,
        (lambda chain: _set_masses(chain, pendulum),),
        laws,
        joint_readings=JointReadings(),
    )


def _set_masses(chain: Chain, pendulum: Pendulum) -> Chain:
    """The chain with the masses, inertias and joint damping of the pendulum.

    M_ij = L_i S_j for links i before j, with S_j the first moment of link j and of all mass beyond
    it at its end; see `state`.
    """
    links = pendulum.links
    n = len(chain.length)
    mass_beyond = np.append(np.cumsum([link.mass_kg for link in links[::-1]])[::-1][1:], 0.0)
    link_moments = np.array([link.mass_kg * link.centre_of_mass_m for link in links])
    first = link_moments + mass_beyond * chain.length[1:]
    moment = np.zeros((n, n))
    first_moment = np.zeros(n)
    damping = chain.hinge_damping.copy()
    moment[1:, 1:] = np.tril(np.outer(first, chain.length[1:]), -1)
    moment += moment.T
    for i, link in enumerate(links):
        moment[i + 1, i + 1] = link.inertia_kg_m2 + mass_beyond[i] * link.length_m**2
        damping[i + 1] += link.joint_damping_Nm_s_per_rad
    first_moment[1:] = first
    return chain._replace(moment=moment, first_moment=first_moment, hinge_damping=damping)
