"""Moves up to eight legs side by side through one call of the compiled chain, in the lanes of its
numbers; see `lanes`.

They take common steps, as short as the worst of them needs. Legs that differ little take almost the
same steps as alone, and the difference of their forces is free of what different steps would add.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from operator import attrgetter

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.model.chain import Steps, Tolerance
from rfca_rig.model.kernel.integrator import DONE, FIRST_STEP_S, integrate_lanes
from rfca_rig.model.kernel.lanes import LANES, allocate_aligned
from rfca_rig.model.kernel.stage import allocate_workspace
from rfca_rig.model.kernel.state import Chain, Laws, Samples, Shaft, State, Work

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Start:
    """A leg that is ready to move: what moves, its laws, what turns the shaft, the state at the
    beginning, and working memory.
    """

    chain: Chain
    laws: Laws
    shaft: Shaft
    state: State
    work: Work

    @property
    def kind(self) -> tuple[object, ...]:
        """Legs of one kind may move side by side: as many coordinates and pieces of splines, the
        same laws, a drive for all or for none.
        """
        laws = tuple(
            field.tobytes()
            for field in (self.laws.address, self.laws.advance, self.laws.place, self.laws.only)
        )
        sizes = (
            self.state.q.size,
            self.state.anchor.size,
            self.chain.spring_origin.shape,
            self.laws.parameter.shape,
        )
        return laws, sizes, self.shaft.free, self.shaft.coefficient.shape


def move_side_by_side(
    starts: Sequence[Start], begin_s: float, tolerance: Tolerance, out: Samples
) -> Steps:
    """Integrates legs of one kind, eight at most, from `begin_s` to the last sample.

    Parameters
    ----------
    starts
        The legs; their states are not changed.
    begin_s
        Where the motion begins.
    tolerance
        Error per step of each leg.
    out
        Samples to fill, with lanes as last axis; their times (m,) ascend from after `begin_s`.

    Returns
    -------
    Steps
        The steps that the legs have in common.

    Raises
    ------
    SimulationFailed
        Where one of the legs cannot go on.
    """
    if not out.t.size:
        return Steps(0, 0, FIRST_STEP_S)
    # Lanes that are left over repeat the last leg.
    chain, laws, shaft, state = _stack_legs([*starts, *[starts[-1]] * (LANES - len(starts))])
    status, next_s, accepted, rejected = integrate_lanes(
        chain,
        laws,
        shaft,
        state,
        begin_s,
        float(out.t[-1]),
        FIRST_STEP_S,
        tolerance.longest_s,
        tolerance.most_steps,
        tolerance.bounds,
        _allocate_workspace(starts[0].state.q.size, starts[0].state.anchor.size),
        out,
    )
    if status != DONE:
        raise SimulationFailed(
            f"one of {len(starts)} legs cannot go on after {accepted + rejected} steps"
        )
    return Steps(accepted, rejected, next_s)


def allocate_samples_of_lanes(t_s: Floats, leg: State, only_sensed: bool) -> Samples:
    """Samples at the times `t_s` (m,) with lanes as last axis; if `only_sensed`, no more than
    the shaft's angle and the forces.
    """
    return Samples(t_s, *_divide(_shapes_of_samples(t_s, leg, only_sensed)))


def allocate_samples_of_leg(t_s: Floats, leg: State, only_sensed: bool) -> Samples:
    """The same at `t_s` (m,) for one leg, without lanes and uninitialised."""
    return Samples(t_s, *map(np.empty, _shapes_of_samples(t_s, leg, only_sensed)))


def _shapes_of_samples(t_s: Floats, leg: State, only_sensed: bool) -> list[tuple[int, ...]]:
    """Of all samples but their times `t_s` (m,)."""
    if only_sensed:
        coordinates = 1
        speeds = 0
        links = 0
    else:
        coordinates = leg.q.size
        speeds = leg.w.size
        links = leg.anchor.size
    return [(len(t_s), *shape) for shape in ((coordinates,), (speeds,), (3,), (2, links))]


def _stack_legs(legs: Sequence[Start]) -> tuple[Chain, Laws, Shaft, State]:
    """The fields (...) of eight legs as arrays (..., 8).

    A law is called for one leg at a time, so its memory is (m, n, 8, 4), and its parameters are (m,
    8, ...).
    """
    shaft_of_lanes = attrgetter(*_OF_LANES)
    whole = [(*leg.chain, *shaft_of_lanes(leg.shaft), *leg.state[:-1]) for leg in legs]
    numbers = []
    arrays = []
    for i, field in enumerate(whole[0]):
        if isinstance(field, np.ndarray):
            arrays.append(i)
        else:
            numbers.append(i)
    of_numbers, *of_arrays = _divide([(len(numbers),), *(whole[0][i].shape for i in arrays)])
    # All numbers at once: assigning one by one takes most of the time.
    numbers_by_leg = []
    for fields in whole:
        numbers_by_leg.append([fields[i] for i in numbers])
    of_numbers[:] = np.array(numbers_by_leg).T
    for i, out in zip(arrays, of_arrays, strict=True):
        for lane, fields in enumerate(whole):
            out[..., lane] = fields[i]
    stacked = dict(zip((*numbers, *arrays), (*of_numbers, *of_arrays), strict=True))
    in_order = [stacked[i] for i in range(len(stacked))]
    after_chain = len(Chain._fields)
    after_shaft = after_chain + len(_OF_LANES)
    chain = Chain._make(in_order[:after_chain])
    of_shaft = dict(zip(_OF_LANES, in_order[after_chain:after_shaft], strict=True))
    shaft = legs[0].shaft._asdict() | of_shaft
    # A step ends where the acceleration of any shaft jumps.
    shaft["landings"] = np.array(
        sorted({time for leg in legs for time in leg.shaft.landings.tolist()})
    )
    state = State._make(
        [
            *in_order[after_shaft:],
            np.stack([leg.state.memory for leg in legs], axis=2),
        ]
    )
    laws = legs[0].laws._replace(parameter=np.stack([leg.laws.parameter for leg in legs], axis=1))
    return chain, laws, Shaft(**shaft), state


# The fields of a shaft that differ from leg to leg.
_OF_LANES = tuple(name for name in Shaft._fields if name not in ("landings", "free"))


def _allocate_workspace(coordinates: int, links: int) -> Work:
    work = Work(*_divide(_shapes_of_workspace(coordinates, links)))
    work.limit[:] = np.inf
    return work


@lru_cache(maxsize=64)
def _shapes_of_workspace(coordinates: int, links: int) -> tuple[tuple[int, ...], ...]:
    return tuple(field.shape for field in allocate_workspace(coordinates, links))


def _divide(shapes: Sequence[tuple[int, ...]]) -> list[Floats]:
    """Arrays (..., 8) of zeros, cut from a single one: few allocations, each at an address that
    vector instructions need.
    """
    sizes = [prod(shape) for shape in shapes]
    whole = allocate_aligned(sum(sizes), LANES)
    begin = 0
    parts = []
    for shape, size in zip(shapes, sizes, strict=True):
        parts.append(whole[begin : begin + size].reshape(*shape, LANES))
        begin += size
    return parts
