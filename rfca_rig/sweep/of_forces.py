"""Outputs that are forces of a stroke, in the sensor's axes and signs unless stated otherwise."""

import numpy as np

from rfca_rig.model.parameters import GRAVITY_M_S2
from rfca_rig.sweep.computed import CaseResults


def valley_time_s(case: CaseResults) -> float:
    return case.valley.time_s


def valley_fz_N(case: CaseResults) -> float:
    return case.valley.fz_N


def peak_force_N(case: CaseResults) -> float:
    return float(np.hypot(case.stroke.fy_N, case.stroke.fz_N)[case.moving].max())


def peak_moment_Nm(case: CaseResults) -> float:
    return float(np.abs(case.stroke.tx_Nm[case.moving]).max())


def peak_shaft_torque_Nm(case: CaseResults) -> float:
    return float(np.abs(case.stroke.shaft_torque_Nm[case.moving]).max())


def load_capacity_N(case: CaseResults) -> float:
    # fz is negative where the ground pushes the leg up; a load is positive.
    return -float(case.stroke.fz_N[case.pressing])


def load_capacity_kg(case: CaseResults) -> float:
    return load_capacity_N(case) / GRAVITY_M_S2


def driving_force_N(case: CaseResults) -> float:
    return -float(case.stroke.fy_N[case.pressing])


def impulse_Ns(case: CaseResults) -> float:
    return case.integrate(case.normal_N)


def driving_impulse_Ns(case: CaseResults) -> float:
    return case.integrate(np.asarray(case.stroke.tangential_N.sum(axis=1)))


def touchdown_s(case: CaseResults) -> float:
    return float(case.stroke.t_s[case.touchdown])


def contact_time_s(case: CaseResults) -> float:
    # The integral of an indicator counts the time of all contacts, also of separate ones.
    return case.integrate(np.where(case.normal_N > 0.0, 1.0, 0.0))
