"""How much of what a case conceals the forces show, and how much of that remains when the nominal values may move."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.exam.cases import Case
from rfca_rig.exam.experiment import stroke_traces
from rfca_rig.exam.labels import really
from rfca_rig.exam.nominal_world import (
    CONTACT_SHARE,
    DAMPING_SHARE,
    FRICTION,
    HEIGHT_MM,
    K0_SHARE,
    MASS_SHARE,
    START_DEG,
    OffBy,
    moved,
    nominal_world,
)
from rfca_rig.exam.sampled_rig import ExamScatter, world_of
from rfca_rig.exam.sensor import Noise, felt
from rfca_rig.exam.world import World

Floats = NDArray[np.float64]

MODEL_ERROR = 0.01

FARTHEST = 4.0  # sigmas that a nominal value may move
NEAR, SHORT = 0.3, 0.3  # sigmas within which moves stay as they are, and over which they are found anew
STEPS = 4
BELIEVED = 7


def sigmas_off(sigmas: Floats) -> OffBy:
    """The nominal values that many standard deviations further, (7,)."""
    return OffBy(
        height_mm=HEIGHT_MM * sigmas[0],
        start_angle_deg=START_DEG * sigmas[1],
        friction_coefficient=FRICTION * sigmas[2],
        k0_factor=float(np.exp(K0_SHARE * sigmas[3])),
        mass_factor=float(np.exp(MASS_SHARE * sigmas[4])),
        hinge_damping_factor=float(np.exp(DAMPING_SHARE * sigmas[5])),
        contact_stiffness_factor=float(np.exp(CONTACT_SHARE * sigmas[6])),
    )


@dataclass(frozen=True)
class Size:
    """Root mean square of the change of fy, fz and tx, whichever is largest, in units of a sample's noise.

    `shift` as it is; `left` after the nominal values have moved within what they are known to, to explain it as well as they can.
    `above` is what is left in units of noise and of the error that any model may have, MODEL_ERROR of the force: nobody can name what
    hides below that.
    """

    shift: float
    left: float
    above: float


def size_of(case: Case) -> Size:
    """The size at the first and the last condition of the case, from the command to the valley of the leg without the effect.

    Infinite where nothing but the labels of the columns or of the conditions is wrong.
    """
    if case.mislabelled and really(nominal_world(1.0), case.mislabelled) == nominal_world(1.0):
        return Size(np.inf, np.inf, np.inf)
    first, last = 0, len(case.design.conditions) - 1
    seen = [_seen(case, number) for number in sorted({first, last})]
    shift, moves, forces = (np.concatenate(parts, axis=1) for parts in zip(*((s.shift, s.moves, s.forces) for s in seen), strict=True))
    noise, both = np.ones_like(forces), np.hypot(1.0, MODEL_ERROR * forces)
    return Size(_largest(shift), _left(seen, shift, moves, noise), _left(seen, shift, moves, both))


@dataclass(frozen=True)
class _Seen:
    """One condition in units of a sample's noise: what the concealed physics does, (3, m), what one sigma of each nominal value does,
    (3, m, p), the plain `forces` (3, m), and how they change where the nominal values have moved by so many sigmas each.
    """

    shift: Floats
    moves: Floats
    forces: Floats
    moved_by: Callable[[Floats], Floats]


def _seen(case: Case, number: int) -> _Seen:
    """Of the last repeat of a condition."""
    (height_mm, speed), repeats = case.design.conditions[number], case.design.repeats
    before = (number + 1) * repeats - 1
    plain = replace(case, effects={}, strangers={}, uneven=None, mislabelled=None)
    world = world_of(plain, 1e-3 * height_mm, ExamScatter(), 1)
    base, until = _forces(world, speed, None)
    concealed, _ = _forces(world_of(case, 1e-3 * height_mm, ExamScatter(), repeats, strokes_before=before), speed, until)

    def moved_by(sigmas: Floats) -> Floats:
        return _forces(moved(world, sigmas_off(sigmas)), speed, until)[0] - base

    moves = np.stack([moved_by(one) for one in np.eye(BELIEVED)], axis=-1)
    return _Seen(concealed - base, moves, base, moved_by)


def _left(seen: Sequence[_Seen], shift: Floats, moves: Floats, units: Floats) -> float:
    """What the nominal values leave of the shift after some steps of Gauss and Newton, the prior of each one observation.

    Far from where they are believed their moves are another, as the swing of a leg under much more damping.
    """
    there, rest, least = np.zeros(BELIEVED), shift, np.inf
    for _ in range(STEPS):
        step = _step(rest / units, moves / units[..., None], there)
        least = min(least, _largest((rest - moves @ step) / units))
        if np.abs(step).max() < NEAR:
            break
        there = np.clip(there + step, -FARTHEST, FARTHEST)
        moved_there = _moved_by(seen, there)
        rest = shift - moved_there
        moves = np.stack([(_moved_by(seen, there + SHORT * one) - moved_there) / SHORT for one in np.eye(BELIEVED)], axis=-1)
    return min(least, _largest(rest / units))


def _step(rest: Floats, moves: Floats, there: Floats) -> Floats:
    J = moves.reshape(-1, BELIEVED)
    return np.asarray(np.linalg.solve(J.T @ J + np.eye(BELIEVED), J.T @ rest.ravel() - there))


def _moved_by(seen: Sequence[_Seen], sigmas: Floats) -> Floats:
    return np.concatenate([one.moved_by(sigmas) for one in seen], axis=1)


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
