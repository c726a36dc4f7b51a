"""Evaluates static stages: from recordings to the torque-rotation curve, with all tests."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.averaging import (
    at_knots,
    share_of_richer_form,
    with_departure,
)
from rfca_rig.analysis.torque_rotation.bases import (
    Basis,
    Hardening,
    Spline,
    SplineThroughRest,
    TorqueCurve,
    law_values,
    make_spline,
    make_spline_through_rest,
)
from rfca_rig.analysis.torque_rotation.checks import (
    FormCheck,
    RestCheck,
    check_hinges,
    check_rest_angles,
    compare_forms,
    estimate_loop,
    estimate_rest_angles,
    find_outliers,
    from_rest_rad,
    list_estimated_errors,
)
from rfca_rig.analysis.torque_rotation.recovery import CurveFit, Errors, fit_curve
from rfca_rig.analysis.torque_rotation.stages import (
    Instruments,
    StageData,
    SystematicErrors,
    list_systematic_errors,
    make_stage_data,
)
from rfca_rig.analysis.torque_rotation.static_result import Repeats, StaticResult, points_of
from rfca_rig.description.model_file import nominal_model
from rfca_rig.errors import BadInput, SimulationFailed
from rfca_rig.model.hinge_springs import FEWEST_ANGLES as FEWEST_KNOTS
from rfca_rig.model.parameters import RigModel
from rfca_rig.progress import ProgressCount, ignore_progress
from rfca_rig.recording.model import Recording

Floats = NDArray[np.float64]

# Angles for each piece of a spline, and the largest number of pieces and knots.
ANGLES_PER_PIECE = 20
MOST_PIECES = 3
MOST_KNOTS = 5
# Shares of the angles below the knots of the finer form, which follows a spring that engages late:
# a play of 1.2 degrees is met to 0.1 % of the largest torque from 7 degrees on, and to 4 % by four
# knots at even shares.
NEAR_REST = (0.0, 0.12, 0.25, 0.5, 0.75, 1.0)
ANGLES_NEAR_REST = 60
# Less data does not determine a curve and is refused.
FEWEST_ANGLES = 12
FEWEST_STAGES = 3
LEAST_RANGE_DEG = 2.0
# Share of the law's misfit (in chi2) that a rest angle must make up for. A common rest angle of 1.5
# degrees made up for 99.9 %, and none for more than 7 % in twelve legs with other laws.
EXPLAINED_SHARE = 0.5
# Solutions of the stages with different unknowns, for the progress callback.
SOLVE_COUNT = 6


@dataclass(frozen=True)
class StageAssumptions:
    """Model and uncertainties that the stages are evaluated with, all in the files' units.

    `nominal` has the sections of a model, `known_to` the uncertainties of its values, `instruments`
    those of sensor and marks. `hinge_std_deg` is one standard deviation of a hinge angle where a
    stage does not state it; None to estimate it from the stages.
    """

    nominal: Mapping[str, Any]
    known_to: Mapping[str, float | None] = field(default_factory=dict)
    instruments: Instruments = field(default_factory=Instruments)
    hinge_std_deg: float | None = None


@dataclass(frozen=True)
class _Case:
    """One set of stages ready to be solved."""

    data: StageData
    rig: RigModel
    systematic_errors: SystematicErrors

    def solve(
        self, basis: Basis, errors: Errors, loop: bool = False, learn: bool = True
    ) -> CurveFit:
        turned = None
        if loop:
            turned = self.data.turned[:, :, None]
        return fit_curve(self.data, self.rig, basis, self.systematic_errors, errors, turned, learn)

    def splines(self) -> Spline:
        """A form that fits any curve, whatever its torque at rest."""
        nominal = np.array(self.rig.leg.rest_angles_rad or (0.0,) * self.data.hinges)
        angles = (self.data.measured[:, : self.data.hinges] - nominal)[self.data.seen]
        return make_spline(angles, int(np.clip(len(angles) // ANGLES_PER_PIECE, 1, MOST_PIECES)))

    def through_rest(self, law: CurveFit) -> list[SplineThroughRest]:
        """Forms that a model can take, the simplest first; angles count from the rest angles of
        `law`.
        """
        angles = from_rest_rad(law, self.data)[self.data.seen]
        knots = int(np.clip(len(angles) // ANGLES_PER_PIECE, FEWEST_KNOTS, MOST_KNOTS))
        shares: list[Sequence[float]] = [tuple(np.arange(1, knots + 1) / knots)]
        if len(angles) >= ANGLES_NEAR_REST:
            shares.append(NEAR_REST)
        return [make_spline_through_rest(angles, knot_shares) for knot_shares in shares]


def evaluate(
    recordings: Sequence[Recording],
    supposed: StageAssumptions,
    watcher: ProgressCount = ignore_progress,
) -> StaticResult:
    """Determine the curve that all stages of the recordings share.

    Parameters
    ----------
    recordings
        Static stages of one leg.
    supposed
        Model and uncertainties.
    watcher
        Progress callback.

    Raises
    ------
    BadInput
        Where the stages do not determine a curve.
    SimulationFailed
        Where no balance is found.

    Notes
    -----
    The form is decided with the errors found with splines: a law that does not hold would attribute
    its misfit to the instruments.
    """
    case = _case(recordings, supposed)
    watcher(0, SOLVE_COUNT)
    free = _freest(case)
    watcher(1, SOLVE_COUNT)
    bending = case.data.turned * np.sign(case.data.measured[:, : case.data.hinges])
    loop = None
    closed = None
    if (bending < 0).any():
        looped = case.solve(case.splines(), free.errors, loop=True)
        loop = estimate_loop(looped, case.data)
        # A hysteresis loop is kept in the model only where it is significant.
        if loop is not None and loop.seen:
            closed = looped
            free = looped
    watcher(2, SOLVE_COUNT)
    law = case.solve(Hardening(), free.errors, loop=closed is not None)
    watcher(3, SOLVE_COUNT)
    # Both forms are compared with the same errors; with errors of its own each would look adequate.
    same_errors = case.solve(Hardening(), free.errors, loop=closed is not None, learn=False)
    watcher(4, SOLVE_COUNT)
    model = _model(case, free, law, closed is not None)
    watcher(5, SOLVE_COUNT)
    widened = _repeats(recordings, supposed, law)
    curves = _average_forms(case.data, same_errors, law, model, free, widened.widened)
    if curves.form.holds:
        fit = law
    else:
        fit = free
    # What a law misses looks like hinges that differ. So they are tested with richer forms where
    # the law is rejected, also where it is near enough to be shown.
    if curves.form.is_rejected:
        hinges = check_hinges(free, case.data, curves.free)
    else:
        hinges = check_hinges(law, case.data, curves.law)
    return StaticResult(
        rig=case.rig,
        data=case.data,
        found=fit,
        law=curves.law,
        values=law_values(curves.law),
        free=curves.free,
        model=curves.model,
        model_form=curves.model_form,
        rests=tuple(estimate_rest_angles(solution, widened.widened) for solution in (law, model)),
        rest_checks=_test_rest_angles(case.data, curves, same_errors, law, model),
        form=curves.form,
        loop=loop,
        hinges=hinges,
        systematic_errors=list_estimated_errors(fit.adjusted),
        strays=find_outliers(fit, case.data),
        points=points_of(fit, case.data),
        repeats=widened,
    )


def _case(recordings: Sequence[Recording], supposed: StageAssumptions) -> _Case:
    rig = nominal_model(supposed.nominal)
    _check(recordings, rig)
    noise_std = supposed.nominal["sensor"].get("noise_std") or {}
    data = make_stage_data(recordings, noise_std, supposed.hinge_std_deg)
    if len(data.stages) < FEWEST_STAGES or int(data.seen.sum()) < FEWEST_ANGLES:
        raise BadInput(
            f"{len(data.stages)} settled stages with "
            f"{int(data.seen.sum()) if len(data.stages) else 0} hinge angles in all: a curve needs "
            f"at least {FEWEST_STAGES} stages and {FEWEST_ANGLES} angles; take more stages"
        )
    angles_deg = np.degrees(data.measured[:, : data.hinges][data.seen])
    if np.ptp(angles_deg) < LEAST_RANGE_DEG:
        raise BadInput(
            f"all hinge angles lie within {np.ptp(angles_deg):.2f} degrees: a curve needs "
            f"at least {LEAST_RANGE_DEG:g}; turn the shaft "
            "farther, and look whether the angles are in degrees"
        )
    return _Case(data, rig, list_systematic_errors(data, supposed.known_to, supposed.instruments))


def _check(recordings: Sequence[Recording], rig: RigModel) -> None:
    hinges = len(rig.leg.link_lengths_m) - 1
    for recording in recordings:
        if not recording.static:
            raise BadInput(
                f"{recording.title!r} holds no static stages; record some with: rfca-rig static run"
            )
        if not any(np.isfinite(stage.hinge_deg).any() for stage in recording.static):
            raise BadInput(
                f"{recording.title!r}: none of its {len(recording.static)} static stages "
                "has a hinge angle; record the stages with a "
                "camera in the rig file, or give the static CSV the columns hinge2_deg "
                ".. hinge7_deg"
            )
        for stage in recording.static:
            if len(stage.hinge_deg) != hinges:
                raise BadInput(
                    f"{recording.title!r}: stage {stage.stage} at "
                    f"{1e3 * stage.height_m:g} mm has {len(stage.hinge_deg)} hinges and "
                    f"the model's leg has {hinges}; give the model of this leg with --model"
                )


def _model(case: _Case, free: CurveFit, law: CurveFit, has_loop: bool) -> CurveFit:
    """The simplest form that a model can take and that is not rejected against the free splines,
    else the finest.
    """
    for basis in case.through_rest(law):
        fit = case.solve(basis, free.errors, loop=has_loop, learn=False)
        form = compare_forms(fit, free, _curve(fit, case.data, 1.0), _curve(free, case.data, 1.0))
        if not form.is_rejected:
            break
    return fit


def _freest(case: _Case) -> CurveFit:
    """Solution with splines and the likelier noise model, of independent hinges or of shared
    marks; noise without a balance is left out.
    """
    solutions = []
    last_error = None
    for chained in (False, True):
        try:
            solutions.append(case.solve(case.splines(), Errors(chained=chained)))
        except SimulationFailed as error:
            last_error = error
    if not solutions and last_error is not None:
        raise last_error
    return max(solutions, key=lambda solution: solution.log_likelihood)


@dataclass(frozen=True)
class _Curves:
    """The curve in its three forms, each with a band that holds its departure from richer forms,
    and the comparisons of law and model with the splines.
    """

    law: TorqueCurve
    model: TorqueCurve
    free: TorqueCurve
    form: FormCheck
    model_form: FormCheck


def _average_forms(
    data: StageData,
    same_errors: CurveFit,
    law: CurveFit,
    model: CurveFit,
    free: CurveFit,
    widened: float,
) -> _Curves:
    """The three curves with the differences between them in their covariances.

    The law is averaged with the simplest richer form that is not rejected: the model's spline
    through rest, else the splines. `same_errors` is the law solved with the errors of `free`.
    """
    by_law, by_model, by_free = (_curve(fit, data, widened) for fit in (law, model, free))
    by_same_errors = _curve(same_errors, data, 1.0)
    form = compare_forms(same_errors, free, by_same_errors, by_free)
    model_form = compare_forms(model, free, by_model, by_free)
    # Splines have a torque at rest, so that they count angles from the rest of the other form.
    law_shift, model_shift = (_mean_rest_rad(fit) - _mean_rest_rad(free) for fit in (law, model))
    if model_form.is_rejected:
        law_curve = with_departure(by_law, by_free, share_of_richer_form(form), law_shift)
    else:
        richer = compare_forms(same_errors, model, by_same_errors, by_model)
        law_curve = with_departure(by_law, by_model, share_of_richer_form(richer))
    share_of_law = share_of_richer_form(form).of_other_form
    of_model = with_departure(by_model, by_free, share_of_richer_form(model_form), model_shift)
    assert isinstance(by_model.basis, SplineThroughRest)
    return _Curves(
        law=law_curve,
        model=at_knots(of_model, by_model.basis),
        free=with_departure(by_free, by_law, share_of_law, -law_shift),
        form=form,
        model_form=model_form,
    )


def _test_rest_angles(
    data: StageData, curves: _Curves, same_errors: CurveFit, law: CurveFit, model: CurveFit
) -> tuple[RestCheck, ...]:
    """Tests beside the law. A common rest angle looks like a law that is wrong, and the other way
    round: where the law is rejected and no rest angle makes up for most of its misfit, the tests
    are beside the model's spline.
    """
    if curves.form.is_rejected:
        beside_law = check_rest_angles(same_errors, data, curves.law)
        explained = max((check.significance**2 for check in beside_law), default=0.0)
        if explained < EXPLAINED_SHARE * curves.form.gain:
            return check_rest_angles(model, data, curves.model)
    return check_rest_angles(law, data, curves.law)


def _mean_rest_rad(fit: CurveFit) -> float:
    return float(fit.adjusted.balance.rest_rad(fit.adjusted.point.p).mean())


def _curve(fit: CurveFit, data: StageData, widened: float) -> TorqueCurve:
    adjusted = fit.adjusted
    # The curve counts as known only over the angles that were measured.
    angles = from_rest_rad(fit, data)[data.seen]
    size = adjusted.balance.basis.size
    return TorqueCurve(
        basis=adjusted.balance.basis,
        coefficients=adjusted.point.p[:size],
        covariance=widened**2 * adjusted.covariance[:size, :size],
        range_rad=(float(angles.min()), float(angles.max())),
        bends=float(np.sign(angles.sum())) or 1.0,
        freedom=adjusted.freedom,
    )


def _repeats(recordings: Sequence[Recording], supposed: StageAssumptions, law: CurveFit) -> Repeats:
    """Each recording by itself with the errors found for all, where several recordings suffice."""
    if len(recordings) < 2:
        return Repeats()
    values = []
    pulls = 0.0
    freedom = 0
    size = law.adjusted.balance.basis.size
    middle = law.adjusted.point.p[:size]
    for recording in recordings:
        try:
            case = _case([recording], supposed)
        except BadInput:
            continue
        alone = case.solve(Hardening(), law.errors, learn=False)
        curve = _curve(alone, case.data, 1.0)
        # Mahalanobis distance of each recording from the common curve: its mean should be 1 per
        # coefficient.
        apart = curve.coefficients - middle
        pulls = pulls + float(apart @ np.linalg.solve(curve.covariance, apart))
        freedom = freedom + size
        values.append(law_values(curve))
    # The common curve was fitted to the same recordings.
    freedom -= size
    widened = 1.0
    if freedom > 0:
        widened = float(np.sqrt(max(1.0, pulls / freedom)))
    return Repeats(tuple(values), widened)
