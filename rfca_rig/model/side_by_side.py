"""Moves up to eight legs side by side through one call of the compiled chain, in the lanes of its numbers; see `lanes`.

They take common steps, as short as the worst of them needs. Legs that differ little take almost the same steps as alone, and the
difference of their forces is free of what different steps would add.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import prod

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
    """A leg that is ready to move: what moves, its laws, what turns the shaft, and the state at the beginning."""

    chain: Chain
    laws: Laws
    shaft: Shaft
    state: State

    @property
    def kind(self) -> tuple[object, ...]:
        """Legs of one kind may move side by side: as many coordinates and pieces of splines, the same laws, a drive for all or for none."""
        laws = tuple(field.tobytes() for field in (self.laws.address, self.laws.advance, self.laws.place, self.laws.only))
        sizes = self.state.q.size, self.state.anchor.size, self.chain.spring_origin.shape, self.laws.parameter.shape
        return laws, sizes, self.shaft.free, self.shaft.coefficient.shape


def move_side_by_side(starts: Sequence[Start], begin_s: float, tolerance: Tolerance, out: Samples) -> Steps:
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
    legs = [*starts, *[starts[-1]] * (LANES - len(starts))]
    status, next_s, accepted, rejected = integrate_lanes(
        Chain._make(_stack_fields([leg.chain for leg in legs])),
        legs[0].laws._replace(parameter=np.stack([leg.laws.parameter for leg in legs], axis=1)),
        _stack_shafts(legs),
        _stack_states(legs),
        begin_s,
        float(out.t[-1]),
        FIRST_STEP_S,
        tolerance.longest_s,
        tolerance.most_steps,
        tolerance.bounds,
        _allocate_workspace(legs[0].state.q.size, legs[0].state.anchor.size),
        out,
    )
    if status != DONE:
        raise SimulationFailed(f"one of {len(starts)} legs cannot go on after {accepted + rejected} steps")
    return Steps(accepted, rejected, next_s)


def allocate_samples_of_lanes(t_s: Floats, leg: State, only_sensed: bool) -> Samples:
    """Samples at the times `t_s` (m,) with lanes as last axis; if `only_sensed`, no more than the shaft's angle and the forces."""
    coordinates, speeds, links = (1, 0, 0) if only_sensed else (leg.q.size, leg.w.size, leg.anchor.size)
    return Samples(t_s, *_divide([(len(t_s), *shape) for shape in ((coordinates,), (speeds,), (3,), (2, links))]))


def _stack_fields(tuples: Sequence[Sequence[Floats | float]]) -> list[Floats]:
    """The fields (...) of eight tuples as arrays (..., 8)."""
    stacked = _divide([np.shape(field) for field in tuples[0]])
    for lane, fields in enumerate(tuples):
        for out, field in zip(stacked, fields, strict=True):
            out[..., lane] = field
    return stacked


def _stack_states(legs: Sequence[Start]) -> State:
    # The memory of laws is (m, n, 8, 4), because a law is called for one leg at a time.
    return State._make([*_stack_fields([leg.state[:-1] for leg in legs]), np.stack([leg.state.memory for leg in legs], axis=2)])


def _stack_shafts(legs: Sequence[Start]) -> Shaft:
    names = [name for name in Shaft._fields if name not in ("landings", "free")]
    columns = _stack_fields([[getattr(leg.shaft, name) for name in names] for leg in legs])
    # A step ends where the acceleration of any shaft jumps.
    landings = np.unique(np.concatenate([leg.shaft.landings for leg in legs]))
    fields = {**legs[0].shaft._asdict(), **dict(zip(names, columns, strict=True)), "landings": landings}
    return Shaft(**fields)


def _allocate_workspace(coordinates: int, links: int) -> Work:
    alone = allocate_workspace(coordinates, links)
    work = Work(*_divide([field.shape for field in alone]))
    work.limit[:] = np.inf
    return work


def _divide(shapes: Sequence[tuple[int, ...]]) -> list[Floats]:
    """Arrays (..., 8) of zeros, cut from a single one: few allocations, each at an address that vector instructions need."""
    sizes = [prod(shape) for shape in shapes]
    whole, begin, parts = allocate_aligned(sum(sizes), LANES), 0, []
    for shape, size in zip(shapes, sizes, strict=True):
        parts.append(whole[begin : begin + size].reshape(*shape, LANES))
        begin += size
    return parts
