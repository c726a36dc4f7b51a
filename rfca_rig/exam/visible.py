"""How much of what a case conceals the forces show, and how much of that remains when the believed values may move."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.believed import (
    CONTACT_SHARE,
    DAMPING_SHARE,
    FRICTION,
    HEIGHT_MM,
    K0_SHARE,
    MASS_SHARE,
    START_DEG,
    OffBy,
    believed_world,
    moved,
)
from rfca_rig.exam.cases import Case
from rfca_rig.exam.experiment import stroke_traces
from rfca_rig.exam.labels import really
from rfca_rig.exam.rig_of import Scatter, world_of
from rfca_rig.exam.sensor import Noise, felt
from rfca_rig.exam.world import World

Floats = NDArray[np.float64]

# the believed values one standard deviation further
ONE_SIGMA = (
    OffBy(height_mm=HEIGHT_MM),
    OffBy(start_angle_deg=START_DEG),
    OffBy(friction_coefficient=FRICTION),
    OffBy(k0_factor=1.0 + K0_SHARE),
    OffBy(mass_factor=1.0 + MASS_SHARE),
    OffBy(hinge_damping_factor=1.0 + DAMPING_SHARE),
    OffBy(contact_stiffness_factor=1.0 + CONTACT_SHARE),
)


@dataclass(frozen=True)
class Size:
    """Root mean square of the change of fy, fz and tx, whichever is largest, in units of a sample's noise.

    `shift` as it is; `left` after the believed values have moved within what they are known to, to explain it as well as they can.
    """

    shift: float
    left: float


def size_of(case: Case) -> Size:
    """The size at the first and the last condition of the case, from the command to the valley of the leg without the effect.

    Infinite where nothing but the labels of the columns or of the conditions is wrong.
    """
    if case.mislabelled and really(believed_world(1.0), case.mislabelled) == believed_world(1.0):
        return Size(np.inf, np.inf)
    plain = replace(case, effects={}, strangers={}, uneven=None, mislabelled=None)
    conditions = dict.fromkeys((case.design.conditions[0], case.design.conditions[-1]))
    shift, moves = [], []
    for height_mm, speed in conditions:
        world = world_of(plain, 1e-3 * height_mm, Scatter(), 1)
        base, until = _forces(world, speed, None)
        concealed, _ = _forces(world_of(case, 1e-3 * height_mm, Scatter(), case.design.repeats), speed, until)
        shift.append(concealed - base)
        moves.append(np.stack([_forces(moved(world, off), speed, until)[0] - base for off in ONE_SIGMA], axis=-1))
    return _size(np.concatenate(shift, axis=1), np.concatenate(moves, axis=1))


def _size(shift: Floats, moves: Floats) -> Size:
    """shift (3, m) and moves (3, m, p), all in units of the noise; the prior of each move counts as one observation."""
    J = moves.reshape(-1, moves.shape[-1])
    wanted = np.linalg.solve(J.T @ J + np.eye(J.shape[1]), J.T @ shift.ravel())
    return Size(_largest(shift), _largest(shift - moves @ wanted))


def _largest(x: Floats) -> float:
    return float(np.sqrt((x**2).mean(axis=1)).max())


def _forces(world: World, speed: float, until: int | None) -> tuple[Floats, int]:
    """fy, fz and tx (3, m) in units of their noise up to sample `until`, the valley where that is not given."""
    traces = stroke_traces(world, speed, step_s=2e-4)
    noise = Noise()
    fy, fz, tx = felt(world, traces)
    first = int(np.searchsorted(traces.t_s, 0.0))
    if until is None:
        until = int(np.argmin(np.where(traces.t_s > 0.3, fz, 0.0)))
    return np.array([fy / noise.fy_N, fz / noise.fz_N, tx / noise.tx_Nm])[:, first:until], until
