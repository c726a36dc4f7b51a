"""The compiled chain of the leg as a `Simulator`: strokes, static tables, and the motion of the
shaft; and its nuisance parameters.

Nuisance parameters are what every hypothesis may change within its prior, see section 3 of
docs/method.md:

- the values of [known_to]
- four ground parameters that are seldom measured
- the swing of a leg that is not quite at rest when the recording begins
- for the motion of the shaft, the delay of the drive
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import PARAMETERS, ModelPoint, make_prior
from rfca_rig.analysis.fitting.scatter import USUAL_SCATTER
from rfca_rig.analysis.fitting.space import FitParameter, Prior
from rfca_rig.diagnosis.config import USUAL_ERROR, WIDE_STEP
from rfca_rig.diagnosis.leg.shaft_observations import ShaftCondition
from rfca_rig.diagnosis.leg.stages import HOLD_S, StageTable
from rfca_rig.diagnosis.leg.strokes import DynamicCondition
from rfca_rig.diagnosis.likelihood.covariance import discrepancy_covariance, make_whitening
from rfca_rig.diagnosis.likelihood.marginal_likelihood import LinearModel, laplace_posterior
from rfca_rig.diagnosis.simulator import Dataset, ScatterDirection, Simulator, make_dataset, spread
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.declarations.sensor import CLOCK_OFFSET
from rfca_rig.model.parameters import PresentEffect, RigModel, Swing
from rfca_rig.model.static_stages import StageMoves
from rfca_rig.model.stroke import SimulatedStroke, StrokeRequest, simulate_variations

# Beside the friction coefficient: presliding, tangential damping, friction rise in a deep print,
# and damping of a point that leaves.
SELDOM_MEASURED = ("presliding", "tangential_damping", "friction_rise", "leaving_damping")
LATE_MS = 2.0  # an adapter, a bus and a drive's own cycle; a gain of its loop does much the same
# a leg that was released straight half a second before still swings by a third of its sag
SWING_SHARE_STD = 0.3
SWING_RATE_STD_PER_S = 25.0  # the same as a speed, at the 13 Hz of the paper's leg


def nuisances_of(
    rig: RigModel, known_to: Mapping[str, float], before_s: float
) -> Prior[ModelPoint]:
    """Space of all nuisance parameters of the leg.

    Parameters
    ----------
    rig
        The nominal model.
    known_to
        Standard uncertainties by key. Parameters that are seldom measured have a usual prior
        without a key; a key of 0 makes a value exact.
    before_s
        How long before the start of the motion the recording begins.
    """
    # Before the motion begins, a free swing of the leg can show; without such samples it cannot be
    # fitted.
    if before_s > 0.0:
        swinging = replace(rig, swing=Swing(before_s, 0.0, 0.0))
    else:
        swinging = rig
    listed = {p.name for p in PARAMETERS.values() if p.known_to in known_to}
    names = [
        p.name
        for p in PARAMETERS.values()
        if p.name in listed.union(SELDOM_MEASURED) and _prior_std(p, known_to) > 0.0
    ]
    if names:
        space = make_prior(names, ModelPoint(swinging), known_to)
    else:
        space = Prior((), ModelPoint(swinging), np.empty(0), np.empty(0, dtype=bool))
    space = replace(space, has_prior=np.ones(len(space.std), dtype=bool))
    if before_s > 0.0:
        return _extend(space, _SWING, known_to)
    return space


def nuisances_of_drive(
    rig: RigModel, centre: ModelPoint, known_to: Mapping[str, float]
) -> Prior[ModelPoint]:
    """Space of the nuisance parameters of the shaft's motion, around the leg in `centre`."""
    # The leg is taken from the forces. Only ground, friction and height stay free, since the shaft
    # hardly depends on them.
    stated = {
        key: known_to[key]
        for name in SELDOM_MEASURED
        if (key := PARAMETERS[name].known_to or "") in known_to
    }
    space = nuisances_of(rig, {**stated, "friction_coefficient": 0.01, "height_mm": 0.1}, 0.0)
    return _extend(replace(space, centre=centre), (_DELAY,), known_to)


def _prior_std(parameter: FitParameter[ModelPoint], known_to: Mapping[str, float]) -> float:
    return known_to.get(parameter.known_to or "", parameter.spread)


def _extend(
    space: Prior[ModelPoint],
    more: tuple[FitParameter[ModelPoint], ...],
    known_to: Mapping[str, float],
) -> Prior[ModelPoint]:
    free = tuple(p for p in more if _prior_std(p, known_to) > 0.0)
    return replace(
        space,
        parameters=(*space.parameters, *free),
        std=np.append(space.std, [_prior_std(p, known_to) for p in free]),
        has_prior=np.append(space.has_prior, np.ones(len(free), dtype=bool)),
    )


def _swing(at: ModelPoint) -> Swing:
    return at.rig.swing or Swing(0.0, 0.0, 0.0)


def _with_share(at: ModelPoint, share: float) -> ModelPoint:
    return replace(at, rig=replace(at.rig, swing=replace(_swing(at), share=share)))


def _with_rate(at: ModelPoint, rate_per_s: float) -> ModelPoint:
    return replace(at, rig=replace(at.rig, swing=replace(_swing(at), rate_per_s=rate_per_s)))


_SWING = (
    FitParameter(
        "swing",
        "sags",
        False,
        SWING_SHARE_STD,
        lambda at: _swing(at).share,
        _with_share,
        "swing_sags",
    ),
    FitParameter(
        "swing_rate",
        "sags/s",
        False,
        SWING_RATE_STD_PER_S,
        lambda at: _swing(at).rate_per_s,
        _with_rate,
        "swing_sags_per_s",
    ),
)

# What differs from one day of recording to the next anyway.
NUISANCES_OF_A_DAY = frozenset(parameter.name for parameter in _SWING)

COMMAND_DELAY = "command_delay"
_DELAY: FitParameter[ModelPoint] = FitParameter(
    COMMAND_DELAY,
    "ms",
    False,
    LATE_MS,
    lambda at: 1e3 * at.command_delay_s,
    lambda at, ms: replace(at, command_delay_s=1e-3 * ms),
    "command_delay_ms",
)


Floats = NDArray[np.float64]
LegCondition = DynamicCondition | StageTable | ShaftCondition

TRIGGER_MS = 0.2  # one sample at 5 kHz: what a trigger leaves open that is read once a sample
# Usual ways to approach a stage. The approach is not recorded, and friction makes the readings
# depend on it.
MOVES = (
    StageMoves(1.0, 0.005, HOLD_S),
    StageMoves(1.0, 0.05, HOLD_S),
    StageMoves(0.2, 0.2, HOLD_S),
)


@dataclass(frozen=True)
class LegSimulator(Simulator):
    """The leg. If `stopped_as_commanded`, the shaft of static stages stopped at its commanded
    angle without moving back. If `knows_approach`, their approach is not inferred.
    """

    stopped_as_commanded: bool = True
    knows_approach: bool = False

    def simulate(self, at: ModelPoint, condition: LegCondition) -> Floats:
        """Predicted rows (m,) of a condition, signal after signal. Raises SimulationFailed."""
        return condition.simulated(at)

    @property
    def varies_many(self) -> bool:
        """Strokes that vary a little are simulated side by side."""
        return True

    def simulate_changes(
        self, at: ModelPoint, rows: Floats, inputs: Sequence[ModelPoint], condition: LegCondition
    ) -> list[Floats | None]:
        """The change of the predicted rows (m,) from `at` to each input, as in `Simulator`; each
        stroke moves beside that of `at`.
        """
        if not inputs:
            return super().simulate_changes(at, rows, inputs, condition)
        base = condition.request(at)
        varied = [_request_or_none(condition, point) for point in inputs]
        prescribed: dict[int, Floats] = {}
        if isinstance(condition, ShaftCondition):
            still = [
                (number, request)
                for number, request in enumerate(varied)
                if request is not None and request.setup.drive is None
            ]
            prescribed = {
                number: condition.read_prescribed(inputs[number], request) - rows
                for number, request in still
            }
        # Stages have hinge angles, too.
        only_sensed = not isinstance(condition, StageTable)
        simulated = [
            request
            for number, request in enumerate(varied)
            if request is not None and number not in prescribed
        ]
        pairs = iter(simulate_variations(base, simulated, only_sensed))
        changes: list[Floats | None] = []
        read_beside: SimulatedStroke | None = None
        beside = rows
        for number, (point, request) in enumerate(zip(inputs, varied, strict=True)):
            if request is None or number in prescribed:
                pair = None
            else:
                pair = next(pairs)
            if pair is None or isinstance(pair, SimulationFailed):
                changes.append(prescribed.get(number))
            else:
                # Neighbours share the stroke beside them, whose rows are read once.
                if pair[1] is not read_beside:
                    read_beside = pair[1]
                    beside = rows if read_beside is None else condition.read(at, read_beside)
                changes.append(condition.read(point, pair[0]) - beside)
        return changes

    def coarsen(self, conditions: Sequence[LegCondition], count: int) -> list[int]:
        """At most `count` of the moving conditions, and one static table."""
        is_table = [isinstance(condition, StageTable) for condition in conditions]
        moving = np.flatnonzero(~np.array(is_table))
        tables = np.flatnonzero(is_table)
        return sorted(int(number) for number in (*moving[spread(len(moving), count)], *tables[:1]))

    def scatter(
        self, at: ModelPoint, conditions: Sequence[LegCondition]
    ) -> tuple[ScatterDirection, ...]:
        """Scatter of rack height, friction, start angle and trigger.

        The trigger is the time at which the clock of the force starts relative to that of the
        shaft. A recorded start angle is simulated, so its scatter is not left in the mean.
        """
        std = np.array(list(USUAL_SCATTER.values()))
        parameters = tuple(replace(PARAMETERS[name], relative=False) for name in USUAL_SCATTER)
        space = Prior(parameters, at, std, np.ones(len(std), dtype=bool))
        flaps = select_strokes(conditions)
        starts_recorded = bool(flaps) and all(flap.turn.start_rad is not None for flap in flaps)
        late, early = (
            at.with_effects(
                (PresentEffect(CLOCK_OFFSET.id, (("offset_s", sign * 1e-3 * TRIGGER_MS),)),)
            )
            for sign in (1.0, -1.0)
        )
        return (
            *(
                ScatterDirection(
                    name,
                    USUAL_SCATTER[name],
                    space.at(step),
                    space.at(-step),
                    starts_recorded and name == "start_angle",
                )
                for name, step in zip(USUAL_SCATTER, np.eye(len(std)), strict=True)
            ),
            ScatterDirection("trigger", TRIGGER_MS, late, early),
        )

    def forget_history(self, conditions: tuple[LegCondition, ...]) -> tuple[LegCondition, ...]:
        """The conditions before the approach of the stages is known: static friction in them is
        free.
        """
        if self.knows_approach:
            return conditions
        return _with_tables(
            conditions,
            [replace(table, stopped_as_commanded=False) for table in select_tables(conditions)],
        )

    def infer_history(
        self,
        conditions: tuple[LegCondition, ...],
        input_at: Callable[[Floats], ModelPoint],
        x: Floats,
    ) -> tuple[LegCondition, ...]:
        """The conditions with the static tables approached in the most probable way.

        Parameters
        ----------
        conditions
            All conditions.
        input_at, x
            The input of the simulator as a function of all unknowns (p,), and their values.
        """
        if self.knows_approach:
            return conditions
        tables = [
            replace(table, stopped_as_commanded=self.stopped_as_commanded)
            for table in select_tables(conditions)
        ]
        if not tables:
            return conditions
        moves = infer_approach(tables, input_at, x)
        return _with_tables(conditions, [replace(table, moves=moves) for table in tables])


def _request_or_none(condition: LegCondition, at: ModelPoint) -> StrokeRequest | None:
    try:
        return condition.request(at)
    except BadInput:
        return None


def make_leg_dataset(
    conditions: Iterable[LegCondition], stopped_as_commanded: bool = True
) -> Dataset:
    """The dataset of the recordings of a leg. Raises BadInput where there is none."""
    conditions = tuple(conditions)
    if not conditions:
        raise BadInput(
            "nothing to diagnose: no stroke shows a touchdown and a valley, and there is "
            "no static table"
        )
    return make_dataset(conditions, LegSimulator(stopped_as_commanded))


def select_strokes(conditions: Iterable[object]) -> tuple[DynamicCondition, ...]:
    """The conditions of the dynamic experiment."""
    return tuple(condition for condition in conditions if isinstance(condition, DynamicCondition))


def select_tables(conditions: Iterable[object]) -> tuple[StageTable, ...]:
    """The tables of the static experiment."""
    return tuple(condition for condition in conditions if isinstance(condition, StageTable))


def infer_approach(
    tables: Sequence[StageTable], input_at: Callable[[Floats], ModelPoint], x: Floats
) -> StageMoves:
    """The most probable of the usual ways to move the shaft from stage to stage.

    Parameters
    ----------
    tables
        The static tables.
    input_at, x
        The input of the simulator as a function of all unknowns (p,), and where they are
        linearised. All of them are integrated out.
    """
    return max(
        MOVES,
        key=lambda moves: _log_evidence(
            [replace(table, moves=moves) for table in tables], input_at, x
        ),
    )


def _with_tables(
    conditions: tuple[LegCondition, ...], tables: Sequence[StageTable]
) -> tuple[LegCondition, ...]:
    """The conditions with these tables in place of theirs; the same tuple where they are the
    same.
    """
    if tuple(tables) == select_tables(conditions):
        return conditions
    return (
        *(condition for condition in conditions if not isinstance(condition, StageTable)),
        *tables,
    )


def _log_evidence(
    tables: Sequence[StageTable], input_at: Callable[[Floats], ModelPoint], x: Floats
) -> float:
    dataset = make_leg_dataset(tables)
    rows = dataset.rows
    # One wide difference per unknown: no step corrects this Jacobian, so it must average over the
    # roughness of contact.
    points = [x, *(x + WIDE_STEP * np.eye(len(x)))]
    predicted, *moved = dataset.predict_all([input_at(point) for point in points])
    if predicted is None:
        return -np.inf
    # A difference without an answer counts as no influence.
    jacobian = np.column_stack(
        [np.zeros(len(predicted)) if m is None else (m - predicted) / WIDE_STEP for m in moved]
    )
    whitening = make_whitening(
        np.diag(rows.noise**2) + USUAL_ERROR**2 * discrepancy_covariance(rows)
    )
    return laplace_posterior(
        LinearModel(rows.measured - predicted + jacobian @ x, jacobian), whitening
    ).log_evidence
