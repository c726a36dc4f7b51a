"""Simulates one flapping stroke: force, torque and shape over time."""

from collections.abc import Callable, Hashable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import SimulationFailed
from rfca_rig.executors.cores import cores
from rfca_rig.model.catalogue import set_up
from rfca_rig.model.chain import (
    Steps,
    Tolerance,
    advance,
    allocate_workspace_of,
    make_unloaded_state,
)
from rfca_rig.model.kernel.integrator import FIRST_STEP_S
from rfca_rig.model.kernel.lanes import LANES
from rfca_rig.model.kernel.state import Samples
from rfca_rig.model.motion import ShaftMotion, ramp_to_speed
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.setup import SensorOutput, Setup, measure_at_rest
from rfca_rig.model.side_by_side import (
    Start,
    allocate_samples_of_lanes,
    allocate_samples_of_leg,
    move_side_by_side,
)

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class SimulatedStroke:
    """A stroke of the model, in the sensor's axes and signs.

    `t_s` (m,); `q_rad`, `w_rad_s` (m, n) absolute link angles and their speeds; `fy_N`, `fz_N`,
    `tx_Nm`, `shaft_torque_Nm` (m,); `normal_N`, `tangential_N` (m, n) at the end of each link.
    `shaft_angle_rad` is (m,).
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

    def at(self, t_s: Floats) -> "SimulatedStroke":
        """The stroke at some of its times (k,), ascending."""
        rows = np.searchsorted(self.t_s, t_s)
        chosen = {
            part.name: getattr(self, part.name)[rows]
            for part in fields(self)
            if part.name not in ("steps", "rejected_steps")
        }
        return replace(self, **chosen)


def simulate_stroke_at_speed(
    rig: RigModel,
    height_m: float,
    speed_rad_s: float,
    t_s: Floats,
    tolerance: Tolerance | None = None,
    strokes_before: tuple[int, ...] = (),
) -> SimulatedStroke:
    """Simulates a stroke with the shaft at constant speed after the drive's ramp, as the paper
    does.

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
    """Simulates a stroke with the shaft moving as given from t = 0, the leg at rest before unless
    the rig has a swing.

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


_ALL_BUT_EFFECTS = tuple(part.name for part in fields(RigModel) if part.name != "effects")


class _Times:
    """Sample times (m,) as part of a key: requests of one condition share the very array, whose
    thousands of numbers need no look then.
    """

    def __init__(self, t_s: Floats) -> None:
        self._t_s = t_s

    def __hash__(self) -> int:
        return hash((self._t_s.size, self._t_s[-1:].tobytes()))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Times) and (
            self._t_s is other._t_s or np.array_equal(self._t_s, other._t_s)
        )


@dataclass(frozen=True)
class StrokeRequest:
    """A stroke to simulate: its complete setup, the times (m,) at which it is sampled, and the
    error allowed per step.
    """

    setup: Setup
    t_s: Floats
    tolerance: Tolerance

    @cached_property
    def motion(self) -> tuple[Hashable, ...]:
        """Requests with the same value move the leg in the same way, whatever the sensor makes
        of it.
        """
        setup = self.setup
        turn = self.setup.motion
        legs = (
            *(getattr(setup.rig, name) for name in _ALL_BUT_EFFECTS),
            setup.moved_by,
            setup.height_m,
            setup.strokes_before,
        )
        arrays = (turn.breaks_s.tobytes(), turn.coefficients.tobytes(), turn.landings_s.tobytes())
        return (*legs, self.tolerance, *arrays, _Times(self.t_s))

    @cached_property
    def kind(self) -> tuple[Hashable, ...]:
        """Requests with the same value may move side by side."""
        setup = self.setup
        effects = tuple(effect.id for _, effect in setup.moved_by)
        return (
            effects,
            len(setup.rig.leg.link_lengths_m),
            setup.begins_s,
            self.tolerance,
            _Times(self.t_s),
        )


def recall_stroke(request: StrokeRequest, only_sensed: bool = False) -> SimulatedStroke:
    """Simulates a stroke, but uses a motion of the leg again that was simulated recently. Raises
    SimulationFailed.

    For a search, which tries dozens of effects of the sensor on one motion of the leg. If
    `only_sensed`, the stroke holds no more than the shaft's angle and the forces.
    """
    sampled = len(_sensed_times(request.t_s, request.setup.sensed_every_s))
    key = (request.motion, sampled, only_sensed)
    samples, cost = _move_once(_Motion(key, request, only_sensed))
    # Whoever gets a stroke may change its arrays.
    return _sense(request, Samples(*(column.copy() for column in samples)), cost)


@dataclass(frozen=True)
class _Motion:
    key: tuple[Hashable, ...]
    request: StrokeRequest = field(compare=False)
    only_sensed: bool = field(compare=False)


# Enough for the conditions of a campaign, in several threads. A whole stroke has 0.4 MB.
@lru_cache(maxsize=32)
def _move_once(motion: _Motion) -> tuple[Samples, Steps]:
    return _move(motion.request, motion.request.setup.sensed_every_s, motion.only_sensed)


def simulate_setup(
    setup: Setup, t_s: Floats, tolerance: Tolerance | None = None, only_sensed: bool = False
) -> SimulatedStroke:
    """As `simulate_stroke`, for a setup that is complete already; `t_s` (m,) ascending, and
    `only_sensed` as in `recall_stroke`.
    """
    request = StrokeRequest(setup, t_s, tolerance or Tolerance())
    return _sense(request, *_move(request, setup.sensed_every_s, only_sensed))


def _move(request: StrokeRequest, every_s: float, only_sensed: bool) -> tuple[Samples, Steps]:
    setup = request.setup
    t_s = _sensed_times(request.t_s, every_s)
    leg = _begin(setup)
    out = allocate_samples_of_leg(t_s, leg.state, only_sensed)
    moving = _fill_rest(leg, setup.begins_s, out)
    span_s = setup.begins_s, float(t_s[-1])
    return out, advance(
        leg.chain,
        leg.shaft,
        leg.state,
        span_s,
        FIRST_STEP_S,
        request.tolerance,
        moving,
        leg.laws,
        leg.work,
    )


def _sensed_times(t_s: Floats, every_s: float) -> Floats:
    """The times `t_s` (m,), and even ones between them so that none are farther apart than
    `every_s`.
    """
    spacing = np.diff(t_s)
    # Rounding must not add a piece to a spacing that is a multiple already.
    pieces = np.maximum(np.ceil(spacing / every_s - 1e-6), 1.0).astype(np.intp)
    if (pieces == 1).all():
        return t_s
    first = np.repeat(np.cumsum(pieces) - pieces, pieces)
    share = (np.arange(first.size) - first) / np.repeat(pieces, pieces)
    times = np.repeat(t_s[:-1], pieces) + share * np.repeat(spacing, pieces)
    return np.append(times, t_s[-1:])


def _begin(setup: Setup) -> Start:
    chain = setup.chain()
    laws = setup.compile_laws(chain)
    work = allocate_workspace_of(chain)
    return Start(chain, laws, *setup.begin(chain, laws, work), work)


def _fill_rest(leg: Start, begins_s: float, out: Samples) -> Samples:
    """Fills the samples of `out` before the motion begins, which costs no integration, and
    returns the others.
    """
    resting = int(np.searchsorted(out.t, begins_s, side="right"))
    if not resting:
        return out
    force = measure_at_rest(leg.chain, leg.laws, leg.state, leg.work)
    # There may be fewer columns than coordinates and links.
    out.q[:resting] = leg.state.q[: out.q.shape[1]]
    out.w[:resting] = 0.0
    out.force[:resting] = force
    out.contact[:resting] = leg.work.contact[:, : out.contact.shape[2]]
    return Samples(*(column[resting:] for column in out))


def _sense(request: StrokeRequest, everything: Samples, cost: Steps) -> SimulatedStroke:
    """The stroke as the sensor shows it at the times of the request; `everything` may have more
    times between.
    """
    setup = request.setup
    # The first link turns with the shaft, whose angle is always there.
    links = max(everything.contact.shape[2], 1)
    fy, fz, torque = everything.force.T
    # The sensor sits below the shaft, so fy adds a moment to the shaft's torque.
    tx = torque + setup.rig.sensor.below_shaft_m * fy
    felt = setup.apply_sensor_changes(SensorOutput(everything.t, fy, fz, tx, everything.q[:, 0]))
    stroke = SimulatedStroke(
        t_s=everything.t,
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
    if len(everything.t) == len(request.t_s):
        return stroke
    return stroke.at(request.t_s)


@dataclass(frozen=True)
class Job:
    """One stroke to simulate, with sample times `t_s` (m,); fields as the arguments of
    `simulate_stroke`.
    """

    rig: RigModel
    height_m: float
    motion: ShaftMotion
    t_s: Floats
    tolerance: Tolerance | None = None
    strokes_before: tuple[int, ...] = ()

    def setup(self) -> Setup:
        """What is simulated. Raises BadInput for effects that do not fit."""
        return set_up(self.rig, self.height_m, self.motion, self.strokes_before)


def simulate_strokes(
    jobs: Sequence[Job], threads: int | None = None, only_sensed: bool = False
) -> list[SimulatedStroke | SimulationFailed]:
    """Simulates the strokes of `jobs`; each result is in the order of its job, a SimulationFailed
    where there is none.

    Strokes of one kind, with the same sample times and effects, move side by side, up to eight of
    them with common steps; results differ from those of single strokes by less than `tolerance`
    allows. Those that touch down at about the same time are taken together, because a step is as
    short as the worst of eight needs. On `threads`, or as many as there are cores: compiled code
    releases the interpreter lock. If `only_sensed`, strokes of a block hold no more than the
    shaft's angle and the forces; new memory for the shapes takes a third of the time. Raises
    BadInput for effects that do not fit, as for a single stroke.
    """
    requests = [StrokeRequest(job.setup(), job.t_s, job.tolerance or Tolerance()) for job in jobs]
    blocks = _divide_into_blocks(requests, LANES, _order_by_likeness)
    results: list[SimulatedStroke | SimulationFailed] = [SimulationFailed("not simulated")] * len(
        jobs
    )

    def simulate(block: Sequence[int]) -> None:
        # Sensed at once, while the samples are in the processor's cache.
        of_block = [requests[number] for number in block]
        moved = _move_block(of_block, _least_spacing_s(of_block), only_sensed)
        for number, motion in zip(block, moved, strict=True):
            if isinstance(motion, SimulationFailed):
                results[number] = motion
            else:
                results[number] = _sense(requests[number], *motion)

    with ThreadPoolExecutor(max(1, min(threads or cores(), len(blocks) or 1))) as pool:
        list(pool.map(simulate, blocks))
    return results


def compile_side_by_side(rig: RigModel) -> None:
    """Compiles what moves legs side by side, unless the disk has it, by moving two of them for a
    millisecond, far above the ground.

    They do not begin at rest: what finds their rest is compiled by every run, perhaps at this
    moment.
    """
    motion = ramp_to_speed(rig.leg.start_angle_rad, 1.0, rig.drive.ramp_s, 1e-3)
    setup = set_up(rig, 10.0, motion)
    chain = setup.chain()
    laws = setup.compile_laws(chain)
    leg = Start(
        chain,
        laws,
        motion.shaft(),
        make_unloaded_state(chain, motion.start_rad, laws),
        allocate_workspace_of(chain),
    )
    move_side_by_side(
        [leg, leg],
        0.0,
        Tolerance(),
        allocate_samples_of_lanes(np.array([1e-3]), leg.state, only_sensed=True),
    )


Pair = tuple[SimulatedStroke, SimulatedStroke | None]


def simulate_variations(
    here: StrokeRequest, varied: Sequence[StrokeRequest], only_sensed: bool = False
) -> list[Pair | SimulationFailed]:
    """Simulates variations of a stroke, each beside the stroke itself, so that their difference is
    free of what different steps would add.

    Parameters
    ----------
    here
        The stroke.
    varied
        Its variations, in any number.
    only_sensed
        Whether the shaft's angle and the forces are enough.

    Returns
    -------
    list
        For each variation its stroke and that of `here` with the same steps; None for the latter
        where the two cannot move side by side, as with other effects. SimulationFailed where a
        variation has no answer.
    """
    # The stroke and what shares its motion are sensed from the same samples.
    every_s = _least_spacing_s([here, *varied])
    # Motions are numbered, because comparing them takes long. What changes only the sensor shares
    # motion 0, that of `here`.
    numbers = {here.motion: 0}
    motion_of = [numbers.setdefault(request.motion, len(numbers)) for request in varied]
    first_of = {0: here}
    for number, request in zip(motion_of, varied, strict=True):
        first_of.setdefault(number, request)
    motions: dict[int, tuple[Moved, SimulatedStroke | None]] = {}

    def store(reference: Moved, block: Sequence[int], moved: Sequence[Moved]) -> None:
        # Sensed once for all variations beside it.
        if isinstance(reference, SimulationFailed):
            stroke = None
        else:
            stroke = _sense(here, *reference)
        motions.update(
            (number, (motion, stroke)) for number, motion in zip(block, moved, strict=True)
        )
        # Any of the blocks will do for what shares the motion of `here`, as long as both come from
        # it.
        motions.setdefault(0, (reference, stroke))

    beside = [
        number for number, request in first_of.items() if number and request.kind == here.kind
    ]
    apart = [number for number, request in first_of.items() if number and request.kind != here.kind]
    for places in _divide_into_blocks([first_of[number] for number in beside], LANES - 1):
        block = [beside[index] for index in places]
        reference, *moved = _move_block(
            [here, *(first_of[number] for number in block)], every_s, only_sensed
        )
        store(reference, block, moved)
    for places in _divide_into_blocks([first_of[number] for number in apart], LANES):
        block = [apart[index] for index in places]
        moved = _move_block([first_of[number] for number in block], every_s, only_sensed)
        motions.update(
            (number, (motion, None)) for number, motion in zip(block, moved, strict=True)
        )
    if 0 not in motions and 0 in motion_of:
        store(_move_alone(here, every_s, only_sensed), (), ())
    pairs: list[Pair | SimulationFailed] = []
    for number, request in zip(motion_of, varied, strict=True):
        motion, stroke = motions[number]
        pairs.append(
            motion if isinstance(motion, SimulationFailed) else (_sense(request, *motion), stroke)
        )
    return pairs


Moved = tuple[Samples, Steps] | SimulationFailed


Order = Callable[[Sequence[StrokeRequest]], Sequence[int]]


def _divide_into_blocks(
    requests: Sequence[StrokeRequest], most: int, order: Order = lambda alike: range(len(alike))
) -> list[list[int]]:
    """Numbers of the requests, those of one kind in blocks of up to `most`, in an order that is
    chosen for each kind.
    """
    groups: dict[Hashable, list[int]] = {}
    for number, request in enumerate(requests):
        groups.setdefault(request.kind, []).append(number)
    blocks = []
    for group in groups.values():
        indices = order([requests[number] for number in group])
        ordered = [group[index] for index in indices]
        for first in range(0, len(ordered), most):
            blocks.append(ordered[first : first + most])
    return blocks


def _order_by_likeness(requests: Sequence[StrokeRequest]) -> Sequence[int]:
    """An order in which strokes of like heights and speeds stand together, by halving along the
    quantity that differs most (k-d tree).
    """
    turned = [
        float(np.diff(request.setup.motion.angle_rad(request.t_s[[0, -1]]))[0])
        for request in requests
    ]
    quantities = np.column_stack([turned, [request.setup.height_m for request in requests]])
    relative = quantities / np.maximum(np.abs(quantities).mean(axis=0), 1e-300)

    def order(numbers: NDArray[np.intp]) -> list[int]:
        if len(numbers) <= LANES:
            return [int(number) for number in numbers]
        column = relative[numbers, np.argmax(np.ptp(relative[numbers], axis=0))]
        # Whole blocks in the first half, so that only the last block of all is smaller.
        half = LANES * ((len(numbers) + LANES) // (2 * LANES))
        numbers = numbers[np.argsort(column, kind="stable")]
        return [*order(numbers[:half]), *order(numbers[half:])]

    return order(np.arange(len(requests)))


def _least_spacing_s(requests: Sequence[StrokeRequest]) -> float:
    return min(request.setup.sensed_every_s for request in requests)


def _move_block(
    requests: Sequence[StrokeRequest], every_s: float, only_sensed: bool
) -> list[Moved]:
    """Moves up to eight legs with the same sample times, side by side where the compiled chain
    allows it and all of them succeed.

    They are sampled as in `_sensed_times`. If `only_sensed`, their samples hold no more than the
    shaft's angle and the forces.
    """
    setups = [request.setup for request in requests]
    t_s = _sensed_times(requests[0].t_s, every_s)
    try:
        legs = [_begin(setup) for setup in setups]
        if len(legs) > 1 and len({leg.kind for leg in legs}) == 1:
            out = allocate_samples_of_lanes(t_s, legs[0].state, only_sensed)
            lanes = []
            for lane in range(len(legs)):
                lanes.append(Samples(t_s, *(column[..., lane] for column in out[1:])))
            moving = [
                _fill_rest(leg, setups[0].begins_s, samples)
                for leg, samples in zip(legs, lanes, strict=True)
            ]
            resting = len(t_s) - len(moving[0].t)
            cost = move_side_by_side(
                legs,
                setups[0].begins_s,
                requests[0].tolerance,
                Samples(*(column[resting:] for column in out)),
            )
            return [(samples, cost) for samples in lanes]
    except SimulationFailed:
        # Below, each stroke succeeds or fails alone.
        pass
    return [_move_alone(request, every_s, only_sensed) for request in requests]


def _move_alone(request: StrokeRequest, every_s: float, only_sensed: bool) -> Moved:
    try:
        return _move(request, every_s, only_sensed)
    except SimulationFailed as failed:
        # One stroke that fails must not lose the others.
        return failed
