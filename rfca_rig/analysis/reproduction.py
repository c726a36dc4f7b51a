"""Section IV of the paper for one leg: the torque-rotation curve from static stages goes into the
model, and the model predicts the strokes. Nothing is fitted to strokes.

The strokes are compared twice: with the shaft at its average speed, as in the paper, and along the
recorded shaft, which is an input of the model like the height of the rack. The prediction along the
recorded shaft has an interval.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from rfca_rig.analysis.compare import ComparedCondition, Table2, compare_condition, make_table2_row
from rfca_rig.analysis.crosscheck import CheckedCondition, check_condition
from rfca_rig.analysis.repeats import Condition, group_by_condition
from rfca_rig.analysis.strips import SWEEP_DEG
from rfca_rig.analysis.torque_rotation.static_result import StaticResult
from rfca_rig.analysis.valley_uncertainty import PredictedValley, predict_valley
from rfca_rig.errors import BadInput
from rfca_rig.model.parameters import RigModel
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress
from rfca_rig.protocol.experiments import PlannedCondition
from rfca_rig.recording.model import Stroke


@dataclass(frozen=True)
class ReproducedCondition:
    """One height and speed.

    Parameters
    ----------
    average, recorded
        The strokes compared with the model, its shaft at its average speed and as recorded.
    valley
        The valley predicted along the recorded shaft, with its uncertainty.
    """

    average: ComparedCondition
    recorded: ComparedCondition
    valley: PredictedValley

    @property
    def condition(self) -> Condition:
        return self.average.condition


@dataclass(frozen=True)
class Reproduction:
    """What section IV of the paper shows.

    Parameters
    ----------
    static
        The torque-rotation curve, and what it was found from.
    rig
        The model with that curve.
    conditions
        In the order of the paper's Fig. 7 (c) to (f): by speed, then by height.
    checked
        The same conditions computed by MuJoCo; empty where that was left out.
    not_checked
        Why it was left out.
    """

    static: StaticResult
    rig: RigModel
    conditions: tuple[ReproducedCondition, ...]
    checked: tuple[CheckedCondition, ...] = ()
    not_checked: str = ""

    @property
    def table2(self) -> Table2:
        """Table II as the paper makes it: the shaft at its average speed."""
        return Table2(tuple(make_table2_row(shown.average, "") for shown in self.by_height))

    @property
    def table2_recorded(self) -> Table2:
        """The same along the recorded shaft."""
        return Table2(tuple(shown.valley.row for shown in self.by_height))

    @property
    def by_height(self) -> tuple[ReproducedCondition, ...]:
        """The conditions in the order of Table II: by height, then by speed."""
        return tuple(
            sorted(
                self.conditions,
                key=lambda shown: (shown.condition.height_m, shown.condition.speed_rad_s),
            )
        )

    @property
    def inside(self) -> tuple[int, int]:
        """How many measured times and forces are in their predicted 95 % intervals, and of how
        many.
        """
        known = []
        for shown in self.conditions:
            for quantity in (shown.valley.time, shown.valley.fz):
                if quantity.is_inside is not None:
                    known.append(quantity.is_inside)
        return sum(known), len(known)


def reproduce_strokes(
    static: StaticResult,
    rig: RigModel,
    known_to: Mapping[str, float],
    strokes: Sequence[Stroke],
    report_progress: ProgressCount = ignore_progress,
) -> Reproduction:
    """Predict the strokes with a model whose springs come from static stages.

    Parameters
    ----------
    static
        The torque-rotation curve.
    rig
        The model with it.
    known_to
        One standard deviation of the model's values, as in the section of that name.
    strokes
        Recorded strokes of one leg.
    report_progress
        Called with the number of conditions done and their number.

    Raises
    ------
    BadInput
        Where there is no stroke, or `known_to` lists nothing.
    SimulationFailed
        Where a stroke cannot be simulated.
    """
    if not strokes:
        raise BadInput("no stroke is recorded, so there is nothing to predict")
    conditions = sorted(group_by_condition(strokes), key=_place_in_figure)
    reproduced = []
    for condition in iterate_with_progress(conditions, report_progress):
        recorded = compare_condition(rig, condition, "recorded")
        reproduced.append(
            ReproducedCondition(
                average=compare_condition(rig, condition, "average"),
                recorded=recorded,
                valley=predict_valley(recorded, rig, known_to, "recorded"),
            )
        )
    return Reproduction(static, rig, tuple(reproduced))


def _place_in_figure(condition: Condition) -> tuple[float, float]:
    """Order of Fig. 7 (c) to (f): by speed, then by height."""
    return condition.speed_rad_s, condition.height_m


def check_against_mujoco(
    reproduction: Reproduction, report_progress: ProgressCount = ignore_progress
) -> tuple[CheckedCondition, ...]:
    """The contact force of every condition by MuJoCo, with the same springs and the same ground.

    Raises BadInput where a leg does not touch the ground.
    """
    conditions = [
        PlannedCondition(shown.condition.height_m, shown.condition.speed_rad_s)
        for shown in reproduction.conditions
    ]
    return tuple(
        check_condition(reproduction.rig, condition, SWEEP_DEG)
        for condition in iterate_with_progress(conditions, report_progress)
    )
