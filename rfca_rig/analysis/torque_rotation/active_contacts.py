"""Which link ends touch the floor at each stage: active-set iteration of assuming, solving and checking."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.balance import Balance, Group
from rfca_rig.analysis.torque_rotation.gauss_helmert import Adjustment, NotConverged, Point, adjust
from rfca_rig.analysis.torque_rotation.stages import StageData
from rfca_rig.errors import SimulationFailed

Floats = NDArray[np.float64]
Ends = tuple[int, ...]

# Standard deviations of the rack's height that an end near the floor may be off.
HEIGHT_MARGIN_STD = 3.0
# Standard deviations of fz and of its tare from which on a load is certain.
LOADED_STD = 4.0
# Above the floor: an end that may touch, as far as a photo shows. Including an end in the air does no harm.
NEAR_M = 6e-3
MIN_DEPTH_M = 1e-4
MAX_ROUNDS = 6


def solve_contacts(balance: Balance, data: StageData, C: Floats, start: Point, ends: Sequence[Ends]) -> tuple[Adjustment, tuple[Ends, ...]]:
    """Adjust the stages and find the ends that may touch, beginning with `ends` (S,).

    Parameters
    ----------
    balance, data
        The conditions and the stages.
    C
        (S, m, m) covariance of the measured values.
    start
        Point to begin from.
    ends
        (S,) ends that may touch at each stage.

    Raises
    ------
    SimulationFailed
        Where no balance is found.
    """
    tried, point = set(), start
    for _ in range(MAX_ROUNDS):
        adjusted = _adjust_or_fail(balance, data, C, point, ends)
        # A set that was tried before would repeat itself for ever.
        tried.add(tuple(ends))
        depth = _depths(balance, data, adjusted.point.z, adjusted.point.p)
        found = tuple(_with_deep(own, row) for own, row in zip(ends, depth, strict=True))
        if found in tried:
            break
        ends, point = found, make_start_point(balance, data, adjusted.point, found)
    return adjusted, tuple(ends)


def _adjust_or_fail(balance: Balance, data: StageData, C: Floats, point: Point, ends: Sequence[Ends]) -> Adjustment:
    try:
        return adjust(balance, group_by_contacts(data, ends), data.measured, C, point)
    except NotConverged as error:
        raise SimulationFailed(
            f"no balance of moments is found for these {len(data.stages)} stages; {data.label(error.row)} is farthest from one: look for a "
            "wrong sign, unit or height there or in all stages, or for a slipped decimal point in the leg"
        ) from None


def guess_contacts(balance: Balance, data: StageData, p: Floats) -> tuple[Ends, ...]:
    """Ends (S,) that the photo shows in or near the floor; always the lowest one where the sensor measures a load.

    `p` (P,) are the unknowns at the start.
    """
    depth = _depths(balance, data, data.measured, p)
    load_N = balance.weight_N - data.measured[:, data.hinges + 2]
    pressed = load_N > LOADED_STD * np.hypot(data.force_std[:, 1], data.sample_noise[1])
    heights = [systematic_error.std for systematic_error in balance.systematic_errors.each if systematic_error.name.startswith("height_")]
    # An end that is included but does not press costs nothing; one that is missed would falsify the balance.
    near_m = NEAR_M + HEIGHT_MARGIN_STD * max(heights, default=0.0)
    low = (depth > -near_m) | (pressed[:, None] & (depth == depth.max(axis=1, keepdims=True)))
    return tuple(tuple(np.flatnonzero(row).tolist()) for row in low)


def find_pressing_ends(adjusted: Adjustment, stages: int) -> tuple[Ends, ...]:
    """The ends (S,) that press on the floor."""
    found: list[Ends] = [()] * stages
    for group, c in zip(adjusted.groups, adjusted.point.c, strict=True):
        for row, own in zip(group.rows, c, strict=True):
            found[row] = tuple(end for end, deep_m in zip(group.ends, own, strict=False) if deep_m > 0.0)
    return tuple(found)


def make_start_point(balance: Balance, data: StageData, point: Point, ends: Sequence[Ends]) -> Point:
    """The same angles and curve; the ends share the sensor's load in proportion to their depth^1.5, as Hertz does."""
    depth = _depths(balance, data, point.z, point.p)
    h, stiffness = data.hinges, balance.rig.ground.stiffness_N_per_m1p5
    c = []
    for group in group_by_contacts(data, ends):
        pressed = np.maximum(depth[group.rows][:, list(group.ends)], MIN_DEPTH_M) ** 1.5
        share = pressed / pressed.sum(axis=1, keepdims=True)
        N = share * np.maximum(balance.weight_N - data.measured[group.rows, h + 2], 1e-2)[:, None]
        # Depth from Hertz, d = (N / k)^(2/3), and friction that balances fy.
        c.append(np.concatenate([(N / stiffness) ** (2.0 / 3.0), -share * data.measured[group.rows, h + 1][:, None]], axis=1))
    return replace(point, c=tuple(c))


def group_by_contacts(data: StageData, ends: Sequence[Ends]) -> tuple[Group, ...]:
    """Groups of stages with the same ends near the floor, in the order of their first stage."""
    height = np.searchsorted(data.heights_m, data.height_m)
    groups = []
    for pattern in dict.fromkeys(ends):
        rows = np.array([i for i, own in enumerate(ends) if own == pattern], dtype=np.intp)
        groups.append(Group(rows, pattern, data.height_m[rows], height[rows], data.recording[rows]))
    return tuple(groups)


def _depths(balance: Balance, data: StageData, z: Floats, p: Floats) -> Floats:
    every = group_by_contacts(data, [()] * len(z))[0]
    return balance.depth_m(balance.correct_readings(z, p, data.recording), p, every)


def _with_deep(ends: Ends, depth_m: Floats) -> Ends:
    return tuple(sorted({*ends, *np.flatnonzero(depth_m > MIN_DEPTH_M).tolist()}))
