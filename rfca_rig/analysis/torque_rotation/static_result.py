"""Result of the evaluation of static stages."""

from dataclasses import dataclass

import numpy as np

from rfca_rig.analysis.torque_rotation.bases import SplineThroughRest
from rfca_rig.analysis.torque_rotation.checks import (
    BendingLoop,
    EstimatedSystematicError,
    FormCheck,
    HingeCheck,
    Outlier,
    RestAngles,
    RestCheck,
)
from rfca_rig.analysis.torque_rotation.curve import LawValues, TorqueCurve
from rfca_rig.analysis.torque_rotation.points import Points
from rfca_rig.analysis.torque_rotation.recovery import CurveFit
from rfca_rig.analysis.torque_rotation.stages import StageData
from rfca_rig.errors import BadInput
from rfca_rig.model.hinge_springs import knots_from
from rfca_rig.model.parameters import RigModel
from rfca_rig.recording.model import StaticStage


@dataclass(frozen=True)
class Repeats:
    """The law's values of each recording by itself, and the factor on the errors that their scatter requires: 1 where it is as expected."""

    each: tuple[LawValues, ...] = ()
    widened: float = 1.0


@dataclass(frozen=True)
class StaticResult:
    """`law` is the curve k0 (phi + k2 phi^3) with its `values`, `free` the curve of splines; `found` is the solution behind `curve`.

    `model` is the curve in the form for a model file, which bears nothing at rest, and `model_form` its test. `rests` are the rest angles
    found with the law and with `model`, None where they count as exact.
    """

    rig: RigModel
    data: StageData
    found: CurveFit
    law: TorqueCurve
    values: LawValues
    free: TorqueCurve
    model: TorqueCurve
    model_form: FormCheck
    rests: tuple[RestAngles | None, ...]
    rest_checks: tuple[RestCheck, ...]
    form: FormCheck
    loop: BendingLoop | None
    hinges: tuple[HingeCheck, ...]
    systematic_errors: tuple[EstimatedSystematicError, ...]
    strays: tuple[Outlier, ...]
    points: Points
    repeats: Repeats

    @property
    def not_monotone(self) -> str:
        """Why a model cannot take the measured curve, in one line; empty where it can."""
        basis = self.model.basis
        assert isinstance(basis, SplineThroughRest)
        # The reader of model files decides, so that a curve is offered exactly when its file could be read.
        try:
            knots_from(np.degrees(basis.knots_rad).tolist(), self.model.coefficients.tolist(), "the measured curve")
        except BadInput as error:
            return str(error)
        return ""

    @property
    def most_bent(self) -> StaticStage | None:
        """The stage with the largest angle between first and last link, the measure of the paper's bending test; None if not known."""
        known = [stage for stage in self.data.stages if np.isfinite(stage.bend_deg)]
        return max(known, key=lambda stage: stage.bend_deg, default=None)

    @property
    def curve(self) -> TorqueCurve:
        """The curve to use: the law where it holds, else the splines."""
        return self.law if self.form.holds else self.free
