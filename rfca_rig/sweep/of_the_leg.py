"""Outputs on hinges and strip, and on the leg at rest."""

import numpy as np

from rfca_rig.model.hinge_springs import bending_stiffness_Nm_per_rad, bending_torque_Nm
from rfca_rig.model.static_stages import StaticState
from rfca_rig.model.statics_contact import follow_static_path
from rfca_rig.sweep.computed import CaseResults, OutputMissing


def largest_hinge_angle_rad(case: CaseResults) -> float:
    # q_rad are absolute angles of the links; a hinge angle is the difference of two.
    return float(np.abs(np.diff(case.stroke.q_rad[case.moving], axis=1)).max())


def largest_hinge_angle_deg(case: CaseResults) -> float:
    return float(np.degrees(largest_hinge_angle_rad(case)))


def bend_deg(case: CaseResults) -> float:
    q = case.stroke.q_rad[case.moving]
    return float(np.degrees(np.abs(q[:, -1] - q[:, 0]).max()))


def hinge_k0_Nm_per_rad(case: CaseResults) -> float:
    return case.rig.leg.k0_Nm_per_rad


def equivalent_stiffness_Nm_per_rad(case: CaseResults, angle_deg: float) -> float:
    return float(bending_stiffness_Nm_per_rad(case.rig.leg, np.radians(angle_deg)))


def strip_used_pct(case: CaseResults) -> float:
    return 100.0 * largest_hinge_angle_rad(case) / case.design.cell_m() / case.design.strip.breaking_curvature_per_m


def strip_used_short_pct(case: CaseResults) -> float:
    # The length over which the strip bends if k0 is its doing alone, as in `analysis.strips`.
    length_m = case.design.strip.bending_stiffness_Nm2 / case.rig.leg.k0_Nm_per_rad
    return 100.0 * largest_hinge_angle_rad(case) / length_m / case.design.strip.breaking_curvature_per_m


def strip_used_torque_pct(case: CaseResults) -> float:
    torque = bending_torque_Nm(case.rig.leg, np.array(largest_hinge_angle_rad(case)))
    return 100.0 * float(torque) / case.design.strip.breaking_moment_Nm


def static_torque_Nm(case: CaseResults, angle_deg: float) -> float:
    return _at_rest(case, angle_deg).shaft_torque_Nm


def static_load_N(case: CaseResults, angle_deg: float) -> float:
    return -_at_rest(case, angle_deg).fz_N


def _at_rest(case: CaseResults, angle_deg: float) -> StaticState:
    if case.rig.effects:
        raise OutputMissing(f"statics know the plain leg only, not effect {case.rig.effects[0].id}")
    return follow_static_path(case.rig, case.design.height_m, [float(np.radians(angle_deg))])[-1]
