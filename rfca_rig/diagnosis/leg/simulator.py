"""The compiled chain of the leg as a `Simulator`: strokes, static tables, and the motion of the shaft."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.fitting.parameters import PARAMETERS, ModelPoint
from rfca_rig.analysis.fitting.scatter import USUAL_SCATTER
from rfca_rig.analysis.fitting.space import Prior
from rfca_rig.diagnosis.config import USUAL_ERROR, WIDE_STEP
from rfca_rig.diagnosis.data.dataset import Dataset, make_dataset
from rfca_rig.diagnosis.leg.shaft_observations import ShaftCondition
from rfca_rig.diagnosis.leg.stages import HOLD_S, StageTable
from rfca_rig.diagnosis.leg.strokes import DynamicCondition
from rfca_rig.diagnosis.likelihood.covariance import discrepancy_covariance, make_whitening
from rfca_rig.diagnosis.likelihood.marginal_likelihood import LinearModel, laplace_posterior
from rfca_rig.diagnosis.simulator import ScatterDirection, Simulator, spread
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.parameters import PresentEffect
from rfca_rig.model.static_stages import StageMoves
from rfca_rig.model.stroke import Request, simulate_variations

Floats = NDArray[np.float64]
LegCondition = DynamicCondition | StageTable | ShaftCondition

TRIGGER_MS = 0.2  # one sample at 5 kHz: what a trigger leaves open that is read once a sample
# Usual ways to approach a stage. The approach is not recorded, and friction makes the readings depend on it.
MOVES = (StageMoves(1.0, 0.005, HOLD_S), StageMoves(1.0, 0.05, HOLD_S), StageMoves(0.2, 0.2, HOLD_S))


@dataclass(frozen=True)
class LegSimulator(Simulator):
    """The leg. If `stopped_as_commanded`, the shaft of static stages stopped at its commanded angle without moving back."""

    stopped_as_commanded: bool = True

    def simulate(self, at: ModelPoint, condition: LegCondition) -> Floats:
        """Predicted rows (m,) of a condition, signal after signal. Raises SimulationFailed."""
        return condition.simulated(at)

    @property
    def varies_many(self) -> bool:
        """Strokes that vary a little are simulated side by side."""
        return True

    def simulate_changes(self, at: ModelPoint, rows: Floats, inputs: Sequence[ModelPoint], condition: LegCondition) -> list[Floats | None]:
        """The change of the predicted rows (m,) from `at` to each input, as in `Simulator`; each stroke moves beside that of `at`."""
        if isinstance(condition, StageTable) or not inputs:
            return super().simulate_changes(at, rows, inputs, condition)
        here, varied = condition.request(at), [_request_or_none(condition, each) for each in inputs]
        if isinstance(condition, ShaftCondition) and all(one is None or one.setup.drive is None for one in varied):
            return super().simulate_changes(at, rows, inputs, condition)
        pairs = iter(simulate_variations(here, [one for one in varied if one is not None]))
        changes: list[Floats | None] = []
        for each, one in zip(inputs, varied, strict=True):
            pair = None if one is None else next(pairs)
            if pair is None or isinstance(pair, SimulationFailed):
                changes.append(None)
            else:
                beside = rows if pair[1] is None else condition.read(at, pair[1])
                changes.append(condition.read(each, pair[0]) - beside)
        return changes

    def coarsen(self, conditions: Sequence[LegCondition], count: int) -> list[int]:
        """At most `count` of the moving conditions, and one static table."""
        is_table = [isinstance(condition, StageTable) for condition in conditions]
        moving, tables = np.flatnonzero(~np.array(is_table)), np.flatnonzero(is_table)
        return sorted(int(number) for number in (*moving[spread(len(moving), count)], *tables[:1]))

    def scatter(self, at: ModelPoint, conditions: Sequence[LegCondition]) -> tuple[ScatterDirection, ...]:
        """Scatter of rack height, friction, start angle and trigger.

        The trigger is the time at which the clock of the force starts relative to that of the shaft. A recorded start angle is simulated,
        so its scatter is not left in the mean.
        """
        std = np.array(list(USUAL_SCATTER.values()))
        parameters = tuple(replace(PARAMETERS[name], relative=False) for name in USUAL_SCATTER)
        space = Prior(parameters, at, std, np.ones(len(std), dtype=bool))
        flaps = select_strokes(conditions)
        starts_recorded = bool(flaps) and all(flap.turn.start_rad is not None for flap in flaps)
        late, early = (at.with_effects((PresentEffect("clock_offset", (("offset_s", sign * 1e-3 * TRIGGER_MS),)),)) for sign in (1.0, -1.0))
        return (
            *(
                ScatterDirection(name, USUAL_SCATTER[name], space.at(step), space.at(-step), starts_recorded and name == "start_angle")
                for name, step in zip(USUAL_SCATTER, np.eye(len(std)), strict=True)
            ),
            ScatterDirection("trigger", TRIGGER_MS, late, early),
        )

    def forget_history(self, conditions: tuple[LegCondition, ...]) -> tuple[LegCondition, ...]:
        """The conditions before the approach of the stages is known: static friction in them is free."""
        return _with_tables(conditions, [replace(table, stopped_as_commanded=False) for table in select_tables(conditions)])

    def infer_history(
        self, conditions: tuple[LegCondition, ...], input_at: Callable[[Floats], ModelPoint], x: Floats
    ) -> tuple[LegCondition, ...]:
        """The conditions with the static tables approached in the most probable way.

        Parameters
        ----------
        conditions
            All conditions.
        input_at, x
            The input of the simulator as a function of all unknowns (p,), and their values.
        """
        tables = [replace(table, stopped_as_commanded=self.stopped_as_commanded) for table in select_tables(conditions)]
        if not tables:
            return conditions
        moves = infer_approach(tables, input_at, x)
        return _with_tables(conditions, [replace(table, moves=moves) for table in tables])


def _request_or_none(condition: DynamicCondition | ShaftCondition, at: ModelPoint) -> Request | None:
    try:
        return condition.request(at)
    except BadInput:
        return None


def make_leg_dataset(conditions: Iterable[LegCondition], stopped_as_commanded: bool = True) -> Dataset:
    """The dataset of the recordings of a leg. Raises BadInput where there is none."""
    conditions = tuple(conditions)
    if not conditions:
        raise BadInput("nothing to diagnose: no stroke shows a touchdown and a valley, and there is no static table")
    return make_dataset(conditions, LegSimulator(stopped_as_commanded))


def select_strokes(conditions: Iterable[object]) -> tuple[DynamicCondition, ...]:
    """The conditions of the dynamic experiment."""
    return tuple(condition for condition in conditions if isinstance(condition, DynamicCondition))


def select_tables(conditions: Iterable[object]) -> tuple[StageTable, ...]:
    """The tables of the static experiment."""
    return tuple(condition for condition in conditions if isinstance(condition, StageTable))


def infer_approach(tables: Sequence[StageTable], input_at: Callable[[Floats], ModelPoint], x: Floats) -> StageMoves:
    """The most probable of the usual ways to move the shaft from stage to stage.

    Parameters
    ----------
    tables
        The static tables.
    input_at, x
        The input of the simulator as a function of all unknowns (p,), and where they are linearised. All of them are integrated out.
    """
    return max(MOVES, key=lambda moves: _log_evidence([replace(table, moves=moves) for table in tables], input_at, x))


def _with_tables(conditions: tuple[LegCondition, ...], tables: Sequence[StageTable]) -> tuple[LegCondition, ...]:
    """The conditions with these tables in place of theirs; the same tuple where they are the same."""
    if tuple(tables) == select_tables(conditions):
        return conditions
    return (*(condition for condition in conditions if not isinstance(condition, StageTable)), *tables)


def _log_evidence(tables: Sequence[StageTable], input_at: Callable[[Floats], ModelPoint], x: Floats) -> float:
    dataset = make_leg_dataset(tables)
    rows = dataset.rows
    # One wide difference per unknown: no step corrects this Jacobian, so it must average over the roughness of contact.
    here, *moved = dataset.predict_all([input_at(point) for point in (x, *(x + WIDE_STEP * unit for unit in np.eye(len(x))))])
    if here is None:
        return -np.inf
    # A difference without an answer counts as no influence.
    jacobian = np.column_stack([np.zeros(len(here)) if m is None else (m - here) / WIDE_STEP for m in moved])
    whitening = make_whitening(np.diag(rows.noise**2) + USUAL_ERROR**2 * discrepancy_covariance(rows))
    return laplace_posterior(LinearModel(rows.measured - here + jacobian @ x, jacobian), whitening).log_evidence
