"""Result of the evaluation of static stages, with the warnings that a reader needs before using the
curve.

A measured point of the curve is, at every stage and hinge, its angle and the torque that static
balance requires there.

The elastica of the paper's strip predicts a hinge's torque, to compare with the measured curve. The
paper does not state how the shells hold the strip, nor the length over which it bends. Three
assumptions are computed:

- held by direction in the middle of each link, (3) to (8), which has no hardening;
- clamped at both sides of the pin where it slides in its grooves, free over a link's pitch;
- the same, free over the length that gives the measured k0.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.balance import LinearConditions
from rfca_rig.analysis.torque_rotation.bases import LawValues, SplineThroughRest, TorqueCurve
from rfca_rig.analysis.torque_rotation.checks import (
    BendingLoop,
    EstimatedSystematicError,
    FormCheck,
    HingeCheck,
    Outlier,
    RestAngles,
    RestCheck,
)
from rfca_rig.analysis.torque_rotation.recovery import CurveFit
from rfca_rig.analysis.torque_rotation.stages import LOOK_AT_MARKS, StageData
from rfca_rig.description.sections import MIN_K2_PER_RAD2
from rfca_rig.errors import BadInput
from rfca_rig.model.hinge_springs import knots_from
from rfca_rig.model.paper.hinge_curve import HeldHinge, compute_sliding_curve, fit_hardening
from rfca_rig.model.paper.strip import paper_strips, table_1_materials
from rfca_rig.model.parameters import Leg, RigModel
from rfca_rig.recording.model import StaticStage

Floats = NDArray[np.float64]

MATERIAL = "CFSP"


@dataclass(frozen=True)
class Points:
    """All arrays (S, h), NaN where no angle was measured. Angles count from rest.

    The torques follow from the measured angles, before any curve is assumed. `turned` is +1 where a
    hinge reached its angle by bending, -1 where it came back, 0 where that is not clear.
    """

    phi_rad: Floats
    phi_std_rad: Floats
    torque_Nm: Floats
    torque_std_Nm: Floats
    turned: Floats


def points_of(found: CurveFit, data: StageData) -> Points:
    """Compute the points; zeros, tares, shares of several touching ends, and missing angles are
    taken from the solution.
    """
    balance = found.adjusted.balance
    h = data.hinges
    p = found.adjusted.point.p
    curve = slice(0, found.adjusted.balance.curve_size)
    # Missing readings are taken from the solution, without error.
    known = np.concatenate([data.seen, np.ones((len(data.seen), 4), dtype=bool)], axis=1)
    whole = found.errors.covariance(data, found.adjusted.balance.rig.leg.link_lengths_m)
    z = np.where(known, data.measured, found.adjusted.point.z)
    C = whole * known[:, :, None] * known[:, None, :]
    angle = balance.correct_readings(z, p, data.recording)[:, :h] - balance.rest_rad(p)
    torque = np.empty(data.seen.shape)
    std = np.empty(data.seen.shape)
    for group, c in zip(found.adjusted.groups, found.adjusted.point.c, strict=True):
        line = balance.linear(group, z[group.rows], c, p)
        # Condition = curve torque - load. Subtracting it from the curve's torque leaves the load
        # alone.
        torque[group.rows] = line.by_p[:, :h, curve] @ p[curve] - line.g[:, :h]
        # The error of a torque comes from angles and forces directly, and through the floor's
        # forces.
        by_z = -line.by_z[:, :h] + _through_floor(line, h)
        by_z[:, np.arange(h), np.arange(h)] += (
            balance.basis.slopes(angle[group.rows]) @ p[: balance.basis.size]
        )
        std[group.rows] = np.sqrt(np.einsum("sji,sik,sjk->sj", by_z, C[group.rows], by_z))
    angle_std = np.sqrt(np.diagonal(C, axis1=1, axis2=2))[:, :h]
    angle, angle_std, torque, std = (
        np.where(data.seen, values, np.nan) for values in (angle, angle_std, torque, std)
    )
    return Points(angle, angle_std, torque, std, data.turned * np.sign(data.measured[:, :h]))


def _through_floor(line: LinearConditions, hinges: int) -> Floats:
    """Derivatives (S, h, m) of the torques by the readings of fy and fz through the floor's
    forces, with shares kept.
    """
    by_z = np.zeros((len(line.g), hinges, hinges + 4))
    ends = line.normal_N.shape[1]
    if not ends:
        return by_z
    N = np.maximum(line.normal_N, 1e-9)
    share = N / N.sum(axis=1, keepdims=True)
    # Derivative of N by depth.
    deeper = line.by_c[:, hinges + 1, :ends]
    by_N = line.by_c[:, :hinges, :ends] / np.maximum(deeper, 1e-9)[:, None]
    by_z[:, :, hinges + 1] = np.einsum("sjk,sk->sj", line.by_c[:, :hinges, ends:], share)
    by_z[:, :, hinges + 2] = np.einsum("sjk,sk->sj", by_N, share)
    return by_z


@dataclass(frozen=True)
class Repeats:
    """The law's values of each recording by itself, and the factor on the errors that their
    scatter requires: 1 where it is as expected.
    """

    values: tuple[LawValues, ...] = ()
    widened: float = 1.0


@dataclass(frozen=True)
class StaticResult:
    """`law` is the curve k0 (phi + k2 phi^3) with its `values`, `free` the curve of splines;
    `found` is the solution behind `curve`.

    `model` is the curve in the form for a model file, which bears nothing at rest, and `model_form`
    its test. `rests` are the rest angles found with the law and with `model`, None where they count
    as exact.
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
        # The reader of model files decides, so that a curve is offered exactly when its file could
        # be read.
        try:
            knots_from(
                np.degrees(basis.knots_rad).tolist(),
                self.model.coefficients.tolist(),
                "the measured curve",
            )
        except BadInput as error:
            return str(error)
        return ""

    @property
    def most_bent(self) -> StaticStage | None:
        """The stage with the largest angle between first and last link, the measure of the
        paper's bending test; None if not known.
        """
        known = [stage for stage in self.data.stages if np.isfinite(stage.bend_deg)]
        return max(known, key=lambda stage: stage.bend_deg, default=None)

    @property
    def curve(self) -> TorqueCurve:
        """The curve to use: the law where it holds, else the splines."""
        if self.form.holds:
            return self.law
        return self.free

    @property
    def other_curve(self) -> TorqueCurve:
        """The curve that `curve` is compared with."""
        if self.form.holds:
            return self.free
        return self.law

    @property
    def rests_of_curve(self) -> RestAngles | None:
        """Rest angles found with `curve`, None where they count as exact."""
        if self.form.holds:
            return self.rests[0]
        return self.rests[1]


@dataclass(frozen=True)
class PredictedHingeCurve:
    """One assumption in words, its free length, k0 and hardening of its law, and the curve over
    `phi_rad` (m,), bending positive.
    """

    words: str
    free_m: float
    k0_Nm_per_rad: float
    k2_per_rad2: float
    phi_rad: Floats
    torque_Nm: Floats
    stiffness_Nm_per_rad: Floats


def predict_hinge_curves(
    leg: Leg, k0_Nm_per_rad: float, most_rad: float
) -> tuple[PredictedHingeCurve, ...]:
    """Curves of the paper's two strips in this leg, up to an angle above 0 and below 90 degrees."""
    strip = paper_strips({material.name: material for material in table_1_materials()}[MATERIAL])
    pitch_m = float(np.mean(leg.link_lengths_m[1:-1]))
    EI = strip.bending_stiffness_Nm2
    phi = np.linspace(0.0, most_rad, 61)
    # A strip that may only bend between link centres, with a given end direction, has constant
    # curvature: EI / pitch.
    held = PredictedHingeCurve(
        "held by direction in the middle of each link",
        pitch_m,
        EI / pitch_m,
        0.0,
        phi,
        EI / pitch_m * phi,
        0.0 * phi + EI / pitch_m,
    )
    return (
        held,
        _sliding(EI, pitch_m, phi, "sliding, free over a link"),
        _sliding(EI, EI / k0_Nm_per_rad, phi, "sliding, free over EI / k₀"),
    )


def _sliding(
    EI_Nm2: float, free_m: float, phi_rad: Floats, description: str
) -> PredictedHingeCurve:
    torque = compute_sliding_curve(HeldHinge(EI_Nm2, free_m), phi_rad).torque_Nm
    law = fit_hardening(phi_rad, torque)
    return PredictedHingeCurve(
        description,
        free_m,
        law.k0_Nm_per_rad,
        law.k2_per_rad2,
        phi_rad,
        torque,
        np.gradient(torque, phi_rad, edge_order=2),
    )


# Limits above which a warning is given.
MUCH_HINGE_DEG = 0.6  # of a hinge angle in a photo
MUCH_FORCE = 1.0  # times the noise of one sample, for a mean of many
MUCH_STATED = 2.0
MUCH_WIDENED = 1.5
MOST_STRAYS = 3


def remarks(result: StaticResult) -> list[str]:
    """Warnings on the form, then on the instruments, then on single hinges and values; empty
    where there are none.
    """
    on_hinges = _hinges(result)
    return [
        *_form(result),
        *_loop(result),
        *_strays(result),
        *_noise(result),
        *on_hinges,
        *_implausible_values(result, bool(on_hinges)),
        *_stages(result),
    ]


def _form(result: StaticResult) -> list[str]:
    form = result.form
    sentences = []
    if not form.holds:
        sentences.append(
            "The law k0 (phi + k2 phi^3) does not hold: splines fit better than chance "
            f"allows (chi2 lower by {form.gain:.0f} for "
            f"{form.more} more numbers), and part from it by {abs(form.apart_Nm):.2f} N m, "
            f"{abs(100 * form.apart_relative):.1f} % of the largest torque, at "
            f"{abs(np.degrees(form.at_rad)):.0f} degrees. "
            "The curve shown is that of the splines; k0 and k2 are only the nearest."
        )
    if result.values.k2_per_rad2 < 0.0:
        sentences.append(_softens(result))
    if result.not_monotone:
        sentences.append(f"No model can take the measured curve: {result.not_monotone}.")
    return sentences


def _softens(result: StaticResult) -> str:
    k2 = result.values.k2_per_rad2
    if k2 >= MIN_K2_PER_RAD2:
        return f"The hinges soften: k2 is {k2:.3f} 1/rad2, below zero."
    return (
        f"The hinges soften: k2 is {k2:.3f} 1/rad2, and a law below {MIN_K2_PER_RAD2:.3f} "
        "falls before 90 degrees; take the measured curve."
    )


def _loop(result: StaticResult) -> list[str]:
    loop = result.loop
    if loop is None or not loop.seen:
        return []
    if loop.half_Nm < 0.0:
        return [
            (
                f"Hinges that turned back bear {-2 * loop.half_Nm:.3f} N m more than before: "
                "no friction does that; had the stages settled?"
            )
        ]
    return [
        f"The hinges have a loop: unbending they bear {2 * loop.half_Nm:.3f} N m less "
        "than bending. The curve runs through its middle; "
        "turning back only a little, a hinge shows part of its loop."
    ]


def _noise(result: StaticResult) -> list[str]:
    errors = result.found.errors
    data = result.data
    sentences = []
    if (data.unstated & data.seen).any() and np.degrees(errors.hinge_std_rad) > MUCH_HINGE_DEG:
        sentences.append(
            f"Hinge angles scatter by {np.degrees(errors.hinge_std_rad):.2f} degrees "
            "about any one curve, more than photos should."
        )
    if errors.stated_factor > MUCH_STATED:
        sentences.append(
            f"Hinge angles scatter {errors.stated_factor:.1f} times as much as was stated of them."
        )
    # The median stage stands for all: a single one with a large stated error does not count.
    over = errors.force_factor * float(np.median(data.force_std[:, 1] / data.sample_noise[1]))
    if over > MUCH_FORCE:
        sentences.append(
            "Forces and angles do not go together: the mean forces would have to err by "
            f"{over:.1f} times the noise of one sample. "
            "Something beyond one curve for all hinges is at work; the interval does not cover it."
        )
    if result.repeats.widened > MUCH_WIDENED:
        sentences.append(
            "The recordings differ more than their errors allow; the interval is "
            f"{result.repeats.widened:.1f} times wider for that."
        )
    return sentences


def _strays(result: StaticResult) -> list[str]:
    sentences = [
        (
            f"In {stray.label} {stray.words} reads {stray.off:+.2g} {stray.unit} from what "
            "balance asks for: look at it again, or leave it out."
        )
        for stray in result.strays[:MOST_STRAYS]
    ]
    more = len(result.strays) - len(sentences)
    if more:
        sentences.append(f"So do {more} more readings.")
    return sentences


def _hinges(result: StaticResult) -> list[str]:
    """The most significant departure of a hinge alone.

    A hinge that is softer bends the curve of all towards itself, so that the others look stiffer;
    and one that rests elsewhere looks softer or stiffer, and shifts the mean of all.
    """
    significances = []
    texts = []
    for hinge_check in result.hinges:
        if hinge_check.is_significant:
            significances.append(hinge_check.significance)
            texts.append(_stiffness_remark(hinge_check))
    for rest_check in result.rest_checks:
        if rest_check.is_significant:
            significances.append(rest_check.significance)
            texts.append(_rest_remark(rest_check))
    if not texts:
        return []
    return [texts[int(np.argmax(significances))]]


def _stiffness_remark(check: HingeCheck) -> str:
    if check.stiffer > 0:
        which_way = "stiffer"
    else:
        which_way = "softer"
    return (
        f"Hinge {check.hinge} is {abs(100 * check.stiffer):.1f} +- {100 * check.std:.1f} % "
        f"{which_way} than the curve of all, which it bends towards itself. {LOOK_AT_MARKS}"
    )


def _rest_remark(check: RestCheck) -> str:
    if check.hinge is None:
        which = "All hinges look as if they rest"
        first = ""
    else:
        which = f"Hinge {check.hinge} looks as if it rests"
        first = f"{LOOK_AT_MARKS} "
    return (
        f"{which} at {np.degrees(check.rest_rad):+.2f} +- {np.degrees(check.std_rad):.2f} degrees "
        f"from the nominal value. {first}With rest_angle_deg in [known_to] the rest angles are "
        "found together with the curve."
    )


def _implausible_values(result: StaticResult, has_odd_hinge: bool) -> list[str]:
    """Values far from their priors. An odd hinge and its marks stand in for each other, so where
    there is a remark on one, the errors of marks are left out.
    """
    errors = [error for error in result.systematic_errors if error.is_implausible]
    if has_odd_hinge:
        errors = [error for error in errors if error.remedy != LOOK_AT_MARKS]
    return [
        f"The {error.words} would be {error.value:+.3g} {error.unit} from the nominal "
        "value, whose standard uncertainty is "
        f"{error.prior_std:.2g} {error.unit}. {error.remedy}"
        for error in errors
    ]


def _stages(result: StaticResult) -> list[str]:
    left = result.data.left_out
    sentences = [
        f"Stage {omitted.stage.stage} at {1e3 * omitted.stage.height_m:g} mm is left out: "
        f"{omitted.why}."
        for omitted in left
    ]
    if result.rig.effects:
        names = ", ".join(effect.id for effect in result.rig.effects)
        sentences.append(f"The nominal effects ({names}) are not taken out of angles and forces.")
    return sentences
