"""Predictions of a hinge's torque by the elastica of the paper's strip, to compare with the measured curve.

The paper does not state how the shells hold the strip, nor the length over which it bends. Three assumptions are computed:

- held by direction in the middle of each link, (3) to (8), which has no hardening;
- clamped at both sides of the pin where it slides in its grooves, free over a link's pitch;
- the same, free over the length that gives the measured k0.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.model.paper.hinge_curve import HeldHinge, compute_sliding_curve, fit_hardening
from rfca_rig.model.paper.strip import paper_strips, table_1_materials
from rfca_rig.model.parameters import Leg

Floats = NDArray[np.float64]

MATERIAL = "CFSP"


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
