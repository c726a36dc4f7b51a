"""One flapping stroke of the model: force, torque and shape over time."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.model import kernel
from rfca_rig.model.chain import Chain, ChainState, at_rest, chain_of
from rfca_rig.model.motion import ShaftMotion, ramp_to_speed
from rfca_rig.model.parameters import RigModel

Floats = NDArray[np.float64]

LONGEST_STEP_S = 2e-3
PRESCRIBED = np.zeros(7)


@dataclass(frozen=True)
class Tolerance:
    """Allowed error per step. The default gives force valleys to 1e-4 of a run a thousand times tighter."""

    angle_rad: float = 1e-4
    speed_rad_s: float = 0.3


@dataclass(frozen=True)
class SimulatedStroke:
    """A stroke of the model, in the sensor's axes and signs.

    `t_s` (m,); `q_rad` (m, n) absolute link angles; `fy_N`, `fz_N`, `tx_Nm`, `shaft_torque_Nm` (m,);
    `normal_N`, `tangential_N` (m, n) at the end of each link.
    """

    t_s: Floats
    q_rad: Floats
    fy_N: Floats
    fz_N: Floats
    tx_Nm: Floats
    shaft_torque_Nm: Floats
    normal_N: Floats
    tangential_N: Floats
    steps: int
    rejected_steps: int

    @property
    def shaft_angle_rad(self) -> Floats:
        return self.q_rad[:, 0]


def stroke_at_speed(rig: RigModel, height_m: float, speed_rad_s: float, t_s: Floats, tolerance: Tolerance | None = None) -> SimulatedStroke:
    """The stroke with the shaft at constant speed after the drive's ramp, as the paper simulates it."""
    motion = ramp_to_speed(rig.leg.start_angle_rad, speed_rad_s, rig.drive.ramp_s, float(t_s[-1]))
    return stroke_following(rig, height_m, motion, t_s, tolerance)


def stroke_following(rig: RigModel, height_m: float, motion: ShaftMotion, t_s: Floats, tolerance: Tolerance | None = None) -> SimulatedStroke:
    """The stroke with the shaft moving as given, from rest at t <= 0.

    `t_s` (m,) ascending sample times; those before 0 show the leg at rest. Second order in the step, error-controlled;
    `tolerance` is per step. Raises SimulationFailed, with the moment, where the integrator cannot go on.
    """
    tolerance = tolerance or Tolerance()
    chain = chain_of(rig, height_m)
    state = at_rest(chain, float(motion.angle_rad(np.array([0.0]))[0]))
    resting = t_s <= 0.0
    samples = Samples.room(len(t_s), chain.links)
    samples.fill_resting(chain, state, resting)
    moving = samples.part(slice(int(resting.sum()), None))
    status, state.step_s, steps, rejected = advance(chain, state, motion, PRESCRIBED, (0.0, float(t_s[-1])), t_s[~resting], moving, tolerance)
    if status != kernel.DONE:
        raise SimulationFailed(
            f"the model stopped in a stroke at {1e3 * height_m:.1f} mm after {steps} steps: no step above "
            f"{kernel.SHORTEST_STEP_S:g} s converges; check stiffness, damping and masses of the leg for a slipped decimal point"
        )
    fy, fz, torque = samples.force.T
    tx = torque + rig.sensor.below_shaft_m * fy
    return SimulatedStroke(t_s, samples.q, fy, fz, tx, torque, samples.contact[:, 0], samples.contact[:, 1], steps, rejected)


@dataclass(frozen=True)
class Samples:
    """Room for what the kernel writes: `q`, `w` (m, n), `force` (m, 3) = fy, fz, shaft torque, `contact` (m, 2, n) = N, F."""

    q: Floats
    w: Floats
    force: Floats
    contact: Floats

    @staticmethod
    def room(samples: int, links: int) -> "Samples":
        return Samples(np.empty((samples, links)), np.empty((samples, links)), np.empty((samples, 3)), np.empty((samples, 2, links)))

    def part(self, rows: slice) -> "Samples":
        return Samples(self.q[rows], self.w[rows], self.force[rows], self.contact[rows])

    def fill_resting(self, chain: Chain, state: ChainState, rows: NDArray[np.bool_]) -> None:
        """Writes the rest pose into the given rows."""
        n = chain.links
        normal, tangential, force = np.zeros(n), np.zeros(n), np.zeros(3)
        kernel.measure(
            chain.scalar, chain.link, chain.moment, state.q, state.w, state.a, state.anchor, np.empty(n), np.empty((n, n)), normal, tangential, force
        )
        self.q[rows], self.w[rows], self.force[rows] = state.q, 0.0, force
        self.contact[rows, 0], self.contact[rows, 1] = normal, tangential


def advance(
    chain: Chain,
    state: ChainState,
    motion: ShaftMotion,
    drive: Floats,
    span_s: tuple[float, float],
    t_s: Floats,
    samples: Samples,
    tolerance: Tolerance,
) -> tuple[int, float, int, int]:
    """Carries `state` over `span_s` in place and writes `samples` at `t_s`; `drive` as numbered in the kernel.

    Returns the kernel's status, the next step length, and the accepted and rejected steps.
    """
    result = kernel.integrate(
        chain.scalar,
        chain.link,
        chain.moment,
        drive,
        motion.breaks_s,
        motion.coefficients,
        motion.landings_s,
        span_s[0],
        span_s[1],
        state.step_s,
        LONGEST_STEP_S,
        np.array([tolerance.angle_rad, tolerance.speed_rad_s]),
        state.q,
        state.w,
        state.a,
        state.anchor,
        t_s,
        samples.q,
        samples.w,
        samples.force,
        samples.contact,
    )
    return tuple(result)
