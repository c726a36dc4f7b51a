"""Outputs that are energies of a stroke, from its start to the end of the shaft's turn."""

import numpy as np

from rfca_rig.model.forces import mechanical_energy_J
from rfca_rig.sweep.computed import CaseResults, Floats


def _power_W(case: CaseResults) -> Floats:
    return np.asarray(case.stroke.shaft_torque_Nm * case.stroke.w_rad_s[:, 0])


def energy_J(case: CaseResults) -> float:
    return case.integrate(_power_W(case))


def energy_put_in_J(case: CaseResults) -> float:
    return case.integrate(np.maximum(_power_W(case), 0.0))


def dissipated_J(case: CaseResults) -> float:
    ends = [case.moving.start, -1]
    # The work that is neither stored in links, springs, height nor floor was dissipated.
    before, after = mechanical_energy_J(case.chain, case.stroke.q_rad[ends], case.stroke.w_rad_s[ends])
    return energy_J(case) - float(after - before)


def hinge_loss_J(case: CaseResults) -> float:
    rates = np.diff(case.stroke.w_rad_s, axis=1)
    return case.integrate(np.asarray((case.chain.hinge_damping[1:] * rates**2).sum(axis=1)))


def peak_power_W(case: CaseResults) -> float:
    return float(_power_W(case)[case.moving].max())
