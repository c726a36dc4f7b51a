"""Result of the evaluation of static stages.

A measured point of the curve is, at every stage and hinge, its angle and the torque that static balance requires there.

The elastica of the paper's strip predicts a hinge's torque, to compare with the measured curve. The paper does not state how the shells
hold the strip, nor the length over which it bends. Three assumptions are computed:

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
from rfca_rig.analysis.torque_rotation.stages import StageData
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

    The torques follow from the measured angles, before any curve is assumed. `turned` is +1 where a hinge reached its angle by bending, -1
    where it came back, 0 where that is not clear.
    """

    phi_rad: Floats
    phi_std_rad: Floats
    torque_Nm: Floats
    torque_std_Nm: Floats
    turned: Floats


def points_of(found: CurveFit, data: StageData) -> Points:
    """Compute the points; zeros, tares, shares of several touching ends, and missing angles are taken from the solution."""
    balance, h = found.adjusted.balance, data.hinges
    p, curve = found.adjusted.point.p, slice(0, found.adjusted.balance.curve_size)
    # Missing readings are taken from the solution, without error.
    known = np.concatenate([data.seen, np.ones((len(data.seen), 4), dtype=bool)], axis=1)
    whole = found.errors.covariance(data, found.adjusted.balance.rig.leg.link_lengths_m)
    z, C = np.where(known, data.measured, found.adjusted.point.z), whole * known[:, :, None] * known[:, None, :]
    angle = balance.correct_readings(z, p, data.recording)[:, :h] - balance.rest_rad(p)
    torque, std = np.empty(data.seen.shape), np.empty(data.seen.shape)
    for group, c in zip(found.adjusted.groups, found.adjusted.point.c, strict=True):
        line = balance.linear(group, z[group.rows], c, p)
        # Condition = curve torque - load. Subtracting it from the curve's torque leaves the load alone.
        torque[group.rows] = line.by_p[:, :h, curve] @ p[curve] - line.g[:, :h]
        # The error of a torque comes from angles and forces directly, and through the floor's forces.
        by_z = -line.by_z[:, :h] + _through_floor(line, h)
        by_z[:, np.arange(h), np.arange(h)] += balance.basis.slopes(angle[group.rows]) @ p[: balance.basis.size]
        std[group.rows] = np.sqrt(np.einsum("sji,sik,sjk->sj", by_z, C[group.rows], by_z))
    angle_std = np.sqrt(np.diagonal(C, axis1=1, axis2=2))[:, :h]
    angle, angle_std, torque, std = (np.where(data.seen, each, np.nan) for each in (angle, angle_std, torque, std))
    return Points(angle, angle_std, torque, std, data.turned * np.sign(data.measured[:, :h]))


def _through_floor(line: LinearConditions, hinges: int) -> Floats:
    """Derivatives (S, h, m) of the torques by the readings of fy and fz through the floor's forces, with shares kept."""
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


@dataclass(frozen=True)
class PredictedHingeCurve:
    """One assumption in words, its free length, k0 and hardening of its law, and the curve over `phi_rad` (m,), bending positive."""

    says: str
    free_m: float
    k0_Nm_per_rad: float
    k2_per_rad2: float
    phi_rad: Floats
    torque_Nm: Floats
    stiffness_Nm_per_rad: Floats


def predict_hinge_curves(leg: Leg, k0_Nm_per_rad: float, most_rad: float) -> tuple[PredictedHingeCurve, ...]:
    """Curves of the paper's two strips in this leg, up to an angle above 0 and below 90 degrees."""
    strip = paper_strips({material.name: material for material in table_1_materials()}[MATERIAL])
    pitch_m, EI = float(np.mean(leg.link_lengths_m[1:-1])), strip.bending_stiffness_Nm2
    phi = np.linspace(0.0, most_rad, 61)
    # A strip that may only bend between link centres, with a given end direction, has constant curvature: EI / pitch.
    held = PredictedHingeCurve(
        "held by direction in the middle of each link", pitch_m, EI / pitch_m, 0.0, phi, EI / pitch_m * phi, 0.0 * phi + EI / pitch_m
    )
    return (
        held,
        _sliding(EI, pitch_m, phi, "sliding, free over a link"),
        _sliding(EI, EI / k0_Nm_per_rad, phi, "sliding, free over EI / k₀"),
    )


def _sliding(EI_Nm2: float, free_m: float, phi_rad: Floats, says: str) -> PredictedHingeCurve:
    torque = compute_sliding_curve(HeldHinge(EI_Nm2, free_m), phi_rad).torque_Nm
    law = fit_hardening(phi_rad, torque)
    return PredictedHingeCurve(
        says, free_m, law.k0_Nm_per_rad, law.k2_per_rad2, phi_rad, torque, np.gradient(torque, phi_rad, edge_order=2)
    )
