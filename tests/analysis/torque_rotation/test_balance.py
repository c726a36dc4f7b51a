"""The conditions of a stage against virtual work, and their derivatives against differences."""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.analysis.torque_rotation.balance import Balance, Group
from rfca_rig.analysis.torque_rotation.bases import Hardening, SplineThroughRest, make_spline
from rfca_rig.analysis.torque_rotation.stages import SystematicError, SystematicErrors
from rfca_rig.model.hinge_springs import table_of
from rfca_rig.model.parameters import GRAVITY_M_S2, TorqueSpline
from tests.analysis.torque_rotation.tables import RIG

S = 4
HINGES = 6
ALL = SystematicErrors(
    (
        SystematicError("shaft_zero", 1.0, "", column=6),
        SystematicError("mass", 1.0, ""),
        SystematicError("gain", 1.0, ""),
        SystematicError("friction_lever", 1.0, ""),
        SystematicError("contact", 1.0, ""),
        SystematicError("slope", 1.0, ""),
        SystematicError("height_0", 1.0, ""),
        SystematicError("height_1", 1.0, ""),
        SystematicError("tare", 1.0, "", column=8, recording=1),
        SystematicError("hinge_zero", 1.0, "", column=3),
        SystematicError("hinge_scale_5", 1.0, ""),
        SystematicError("rest_4", 1.0, ""),
    )
)


def somewhere(ends, seed=0, systematic_errors=ALL, rise=0.0):
    rng = np.random.default_rng(seed)
    balance = Balance(
        replace(RIG, ground=replace(RIG.ground, friction_rise_share=rise)),
        Hardening(),
        systematic_errors,
        rng.normal(size=(S, HINGES, 1)),
    )
    group = Group(np.arange(S), ends, np.full(S, 0.2), np.arange(S) % 2, np.arange(S) % 2)
    z = np.concatenate(
        [-0.3 * rng.random((S, HINGES)), 2.0 + rng.random((S, 1)), 10.0 * rng.normal(size=(S, 3))],
        axis=1,
    )
    c = np.concatenate(
        [1e-3 + 5e-3 * rng.random((S, len(ends))), 10.0 * rng.normal(size=(S, len(ends)))], axis=1
    )
    p = np.concatenate([[11.0, 44.0, 0.1], 0.01 * rng.normal(size=len(systematic_errors.errors))])
    return balance, group, z, c, p


def work_J(z, N, F, ends, rises_m):
    """Potential of weight and of constant floor forces, friction at the lowest points of the
    ends or higher, z up; y along the floor.
    """
    lengths = np.array(RIG.leg.link_lengths_m)
    masses = np.array(RIG.leg.link_masses_kg)
    radius = RIG.leg.link_radius_m
    q = z[6] + np.concatenate([[0.0], np.cumsum(z[:6])])
    y = np.cumsum(lengths * np.cos(q))
    up = -np.cumsum(lengths * np.sin(q))
    middle = up + 0.5 * lengths * np.sin(q)
    rolled = [
        y[end] - (radius - rise_m) * q[end] for end, rise_m in zip(ends, rises_m, strict=True)
    ]
    return (
        GRAVITY_M_S2 * masses @ middle
        - sum(n * up[end] for n, end in zip(N, ends, strict=True))
        - F @ rolled
    )


@pytest.mark.parametrize("rise", [0.0, 0.7])
@pytest.mark.parametrize("ends", [(), (6,), (5, 6), (2, 5, 6)])
def test_loads_are_what_virtual_work_says(ends, rise):
    balance, group, z, c, p = somewhere(ends, systematic_errors=SystematicErrors(()), rise=rise)
    line = balance.linear(group, z, c, p)
    torque = z[:, :6] * (11.0 + 44.0 * z[:, :6] ** 2) + 0.1 * balance.extra[:, :, 0]
    for row in range(S):
        N = line.normal_N[row]
        F = c[row, len(ends) :]
        rises_m = rise * c[row, : len(ends)]
        for joint in range(7):
            step = 1e-6 * np.eye(10)[6 if joint == 0 else joint - 1]
            slope = (
                work_J(z[row] + step, N, F, ends, rises_m)
                - work_J(z[row] - step, N, F, ends, rises_m)
            ) / 2e-6
            if joint:
                assert torque[row, joint - 1] + slope == pytest.approx(
                    line.g[row, joint - 1], abs=1e-6
                )
            else:
                drive = z[row, 9] + RIG.sensor.below_shaft_m * F.sum()  # tx less what fy adds to it
                assert drive - slope == pytest.approx(line.g[row, HINGES], abs=1e-6)


@pytest.mark.parametrize("rise", [0.0, 0.7])
@pytest.mark.parametrize("ends", [(), (6,), (5, 6), (2, 5, 6)])
def test_derivatives_are_those_of_differences(ends, rise):
    balance, group, z, c, p = somewhere(ends, seed=1, rise=rise)
    line = balance.linear(group, z, c, p)
    looks = (
        (z, line.by_z, lambda at: balance.linear(group, at, c, p).g),
        (c, line.by_c, lambda at: balance.linear(group, z, at, p).g),
        (p, line.by_p, lambda at: balance.linear(group, z, c, at).g),
    )
    for at, slopes, value in looks:
        for i in range(at.shape[-1]):
            step = np.zeros(at.shape)
            step[..., i] = 1e-7
            assert (
                np.abs((value(at + step) - value(at - step)) / 2e-7 - slopes[:, :, i]).max() < 2e-5
            )


def test_torques_count_from_rest_as_believed_and_as_doubted():
    balance, group, z, c, p = somewhere(
        (), systematic_errors=SystematicErrors((SystematicError("rest_4", 1.0, ""),))
    )
    rest = np.array([0.02, -0.01, 0.03, 0.0, 0.0, 0.01])
    bent = replace(
        balance, rig=replace(balance.rig, leg=replace(balance.rig.leg, rest_angles_rad=tuple(rest)))
    )
    p[-1] = 0.05
    x = z[:, :6] - rest - 0.05 * np.eye(6)[2]
    loads = balance.linear(group, z, c, p * np.array([0.0, 0.0, 1.0, 0.0])).g[:, :6]
    assert bent.linear(group, z, c, p).g[:, :6] - loads == pytest.approx(11.0 * x + 44.0 * x**3)


@pytest.mark.parametrize("basis", [SplineThroughRest((0.05, 0.12, 0.25, 0.4))])
def test_splines_through_rest_are_the_models_own(basis):
    torques = np.array([0.6, 1.5, 3.4, 6.8])
    spline = table_of((TorqueSpline((0.0, *basis.knots_rad), (0.0, *torques)),), 2)
    x = np.array([-0.6, -0.3, -0.01, 0.0, 0.2, 0.39, 0.7])
    assert basis.columns(x) @ torques == pytest.approx(
        spline.torque(np.stack([0 * x, x], axis=1))[:, 1], abs=1e-12
    )
    assert basis.slopes(x) @ torques == pytest.approx(
        spline.stiffness(np.stack([0 * x, x], axis=1))[:, 1], abs=1e-10
    )


def test_an_end_in_the_air_does_not_press():
    balance, group, z, c, p = somewhere((5, 6), systematic_errors=SystematicErrors(()))
    c[:, 0] = -2e-3
    assert balance.linear(group, z, c, p).normal_N[:, 0].max() < 1e-4


def test_splines_hold_the_law():
    phi = np.linspace(-0.4, 0.1, 200)
    basis = make_spline(phi, 3)
    torque = 11.0 * (phi + 4.2 * phi**3)
    coefficients = np.linalg.lstsq(basis.columns(phi), torque, rcond=None)[0]
    beyond = np.array([-0.5, -0.2, 0.2])
    assert basis.columns(beyond) @ coefficients == pytest.approx(
        11.0 * (beyond + 4.2 * beyond**3), abs=1e-9
    )
    assert basis.slopes(beyond) @ coefficients == pytest.approx(
        11.0 * (1.0 + 12.6 * beyond**2), abs=1e-7
    )
