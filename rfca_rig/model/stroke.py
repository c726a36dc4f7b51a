"""Simulates one flapping stroke: force, torque and shape over time."""

from collections.abc import Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.executors.cores import cores
from rfca_rig.model.catalogue import set_up
from rfca_rig.model.chain import Steps, Tolerance, advance, allocate_samples
from rfca_rig.model.forces import measure_once
from rfca_rig.model.integrator import FIRST_STEP_S
from rfca_rig.model.motion import ShaftMotion, ramp_to_speed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.setup import SensorOutput, Setup
from rfca_rig.model.stage import allocate_workspace
from rfca_rig.model.state import Samples

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SimulatedStroke:
    """A stroke of the model, in the sensor's axes and signs.

    `t_s` (m,); `q_rad`, `w_rad_s` (m, n) absolute link angles and their speeds; `fy_N`, `fz_N`, `tx_Nm`, `shaft_torque_Nm` (m,);
    `normal_N`, `tangential_N` (m, n) at the end of each link. `shaft_angle_rad` is (m,).
    """

    t_s: Floats
    q_rad: Floats
    w_rad_s: Floats
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


def simulate_stroke_at_speed(
    rig: RigModel,
    height_m: float,
    speed_rad_s: float,
    t_s: Floats,
    tolerance: Tolerance | None = None,
    strokes_before: tuple[int, ...] = (),
) -> SimulatedStroke:
    """Simulates a stroke with the shaft at constant speed after the drive's ramp, as the paper does.

    Parameters
    ----------
    rig
        Leg, ground, sensor, drive and effects.
    height_m
        Height of the shaft above the ground.
    speed_rad_s
        Speed after the ramp.
    t_s
        (m,) ascending sample times; the ramp begins at 0.
    tolerance, strokes_before
        As in `simulate_stroke`.

    Raises
    ------
    SimulationFailed
        Where the integrator cannot go on.

    References
    ----------
    Section IV.B.
    """
    motion = ramp_to_speed(rig.leg.start_angle_rad, speed_rad_s, rig.drive.ramp_s, float(t_s[-1]))
    return simulate_stroke(rig, height_m, motion, t_s, tolerance, strokes_before)


def simulate_stroke(
    rig: RigModel,
    height_m: float,
    motion: ShaftMotion,
    t_s: Floats,
    tolerance: Tolerance | None = None,
    strokes_before: tuple[int, ...] = (),
) -> SimulatedStroke:
    """Simulates a stroke with the shaft moving as given from t = 0, the leg at rest before unless the rig has a swing.

    Parameters
    ----------
    rig, height_m
        The rig, and the height of the shaft above the ground.
    motion
        Prescribed or commanded angle of the shaft.
    t_s
        (m,) ascending sample times; samples up to the beginning have the initial state.
    tolerance
        Error per step; the method is of third order in the step.
    strokes_before
        Strokes that the leg had made before, for each stroke whose mean this is; () counts none.

    Raises
    ------
    BadInput
        For an effect that is unknown or does not fit the rig.
    SimulationFailed
        Where the integrator cannot go on.
    """
    return simulate_setup(set_up(rig, height_m, motion, strokes_before), t_s, tolerance)


def recall_stroke(
    rig: RigModel, height_m: float, motion: ShaftMotion, t_s: Floats, tolerance: Tolerance, strokes_before: tuple[int, ...]
) -> SimulatedStroke:
    """As `simulate_stroke`, but a motion of the leg that was simulated recently is used again; `t_s` is (m,).

    For a search, which tries dozens of effects of the sensor on one motion of the leg.
    """
    setup = set_up(rig, height_m, motion, strokes_before)
    arrays = (t_s, motion.breaks_s, motion.coefficients, motion.landings_s)
    key = (replace(rig, effects=()), setup.moved_by, height_m, strokes_before, tolerance, *(part.tobytes() for part in arrays))
    samples, cost = _move_once(_Stroke(key, setup, t_s, tolerance))
    # Whoever gets a stroke may change its arrays.
    return _sense(setup, Samples(*(column.copy() for column in samples)), cost)


@dataclass(frozen=True)
class _Stroke:
    """A stroke to simulate. Strokes with the same `key` move in the same way, whatever the sensor makes of it."""

    key: tuple[Hashable, ...]
    setup: Setup = field(compare=False)
    t_s: Floats = field(compare=False)
    tolerance: Tolerance = field(compare=False)


# Enough for the conditions of a campaign, in several threads. A stroke has 0.4 MB.
@lru_cache(maxsize=32)
def _move_once(stroke: _Stroke) -> tuple[Samples, Steps]:
    return _move(stroke.setup, stroke.t_s, stroke.tolerance)


def simulate_setup(setup: Setup, t_s: Floats, tolerance: Tolerance | None = None) -> SimulatedStroke:
    """As `simulate_stroke`, for a setup that is complete already; `t_s` (m,) ascending."""
    return _sense(setup, *_move(setup, t_s, tolerance or Tolerance()))


def _move(setup: Setup, t_s: Floats, tolerance: Tolerance) -> tuple[Samples, Steps]:
    chain = setup.chain()
    laws = setup.compile_laws(chain)
    shaft, state = setup.begin(chain, laws)
    links = chain.length.size
    everything = allocate_samples(t_s, state.q.size, links)
    resting = int(np.searchsorted(t_s, setup.begins_s, side="right"))
    # Samples before the motion begins cost no integration.
    work, force = allocate_workspace(state.q.size, state.anchor.size), np.empty(3)
    measure_once(chain, laws, state, 0.0, state.q, state.w, state.a, work, force)
    everything.q[:resting], everything.w[:resting] = state.q, 0.0
    everything.force[:resting], everything.contact[:resting] = force, work.contact
    moving = Samples(*(column[resting:] for column in everything))
    return everything, advance(chain, shaft, state, (setup.begins_s, float(t_s[-1])), FIRST_STEP_S, tolerance, moving, laws)


def _sense(setup: Setup, everything: Samples, cost: Steps) -> SimulatedStroke:
    """The stroke as the sensor shows it."""
    t_s, links = everything.t, everything.contact.shape[2]
    fy, fz, torque = everything.force.T
    # The sensor sits below the shaft, so fy adds a moment to the shaft's torque.
    felt = setup.apply_sensor_changes(SensorOutput(t_s, fy, fz, torque + setup.rig.sensor.below_shaft_m * fy, everything.q[:, 0]))
    return SimulatedStroke(
        t_s=t_s,
        q_rad=everything.q[:, :links],
        w_rad_s=everything.w[:, :links],
        fy_N=felt.fy_N,
        fz_N=felt.fz_N,
        tx_Nm=felt.tx_Nm,
        shaft_torque_Nm=torque,
        normal_N=everything.contact[:, 0],
        tangential_N=everything.contact[:, 1],
        steps=cost.accepted,
        rejected_steps=cost.rejected,
    )


@dataclass(frozen=True)
class Job:
    """One stroke to simulate, with sample times `t_s` (m,); fields as the arguments of `simulate_stroke`."""

    rig: RigModel
    height_m: float
    motion: ShaftMotion
    t_s: Floats
    tolerance: Tolerance | None = None


def simulate_strokes(jobs: Sequence[Job], threads: int | None = None) -> list[SimulatedStroke | SimulationFailed]:
    """Simulates the strokes of `jobs`; each result is in the order of its job, a SimulationFailed where there is none.

    Bit for bit as one after the other. On `threads`, or as many as there are cores: compiled code releases the interpreter lock. Each
    thread takes every n-th job, so that neighbours, which tend to cost alike, are spread. Raises BadInput for effects that do not fit,
    as for a single stroke.
    """
    count = max(1, min(threads or cores(), len(jobs)))
    if count == 1:
        return [_stroke(job) for job in jobs]
    results: list[SimulatedStroke | SimulationFailed] = [SimulationFailed("not simulated")] * len(jobs)
    with ThreadPoolExecutor(count) as pool:
        parts = [jobs[first::count] for first in range(count)]
        for first, strokes in enumerate(pool.map(lambda part: [_stroke(job) for job in part], parts)):
            results[first::count] = strokes
    return results


def _stroke(job: Job) -> SimulatedStroke | SimulationFailed:
    try:
        return simulate_stroke(job.rig, job.height_m, job.motion, job.t_s, job.tolerance)
    except SimulationFailed as failed:
        # One stroke that fails must not lose the others.
        return failed
