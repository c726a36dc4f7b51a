"""Equilibrium conditions between the true angles and forces of a settled stage: moments at the
shaft and at every hinge, forces, and the positions of the link ends on the floor.

Absolute angles q_i = shaft + hinges up to i, positive downwards. N_k and F_k are the floor's forces
on end k: up, and along +y. They act at the lowest point of its circle, a lever l away from the end,
or higher by a share `rise` of its depth d_k. P_i and Q_i are their sums over ends i and beyond, and
w_i is the first moment of weight that link i carries. Joint j then bears

    load_j = sum over i >= j of [(w_i - P_i L_i) cos q_i - Q_i L_i sin q_i] - sum over k >= j of (l
    - rise d_k) F_k

A hinge bears it with its torque, the drive with minus the shaft's. An end in the floor presses by
Hertz. Its friction is free in sign and size: with one end it is what the sensor reads, and with
several each has about its share.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.bases import Basis
from rfca_rig.analysis.torque_rotation.stages import (
    ALL_RECORDINGS,
    SystematicErrors,
    rest_name,
    scale_name,
)
from rfca_rig.model.parameters import GRAVITY_M_S2, RigModel

Floats = NDArray[np.float64]

# Flatness of a plate, and roundness of a link end.
FLOOR_FLAT_M = 5e-5
# Share of its depth by which an end may be off Hertz's law.
HERTZ_MISFIT_SHARE = 0.01
# Deviation of the friction of one of several ends from its share, as a share of mu N.
SHARE_STD = 0.5
# Force below which it is not known whether an end presses.
NEGLIGIBLE_N = 0.1


@dataclass(frozen=True)
class Group:
    """Stages with the same ends on the floor: their `rows` (S_g,) among all, `ends` touching (from
    0), height, and indices of height and recording.
    """

    rows: NDArray[np.intp]
    ends: tuple[int, ...]
    height_m: Floats
    height: NDArray[np.intp]
    recording: NDArray[np.intp]


@dataclass(frozen=True)
class LinearConditions:
    """The conditions g (S, R) at some point, with their derivatives.

    `by_z` (S, R, m) is by the measured values, `by_c` (S, R, 2 T) by depths and friction of the T
    ends, `by_p` (S, R, P) by curve and systematic errors. `slack` (S, R) is the variance with which
    a condition holds. `normal_N` is (S, T).
    """

    g: Floats
    by_z: Floats
    by_c: Floats
    by_p: Floats
    slack: Floats
    normal_N: Floats


@dataclass(frozen=True)
class Balance:
    """The conditions for a rig, a form of the curve and systematic errors.

    `extra` (S, h, e) are further columns of hinge torque, for all stages. Unknowns p (P,) are the
    coefficients of the form, those of the further columns, and the systematic errors.
    """

    rig: RigModel
    basis: Basis
    systematic_errors: SystematicErrors
    extra: Floats

    @property
    def curve_size(self) -> int:
        return self.basis.size + int(self.extra.shape[2])

    @property
    def L(self) -> Floats:
        return np.array(self.rig.leg.link_lengths_m)

    @property
    def weight_moment(self) -> Floats:
        """w (n,), the first moment of weight of each link and of all links beyond it, in N m."""
        mass = np.array(self.rig.leg.link_masses_kg)
        beyond = np.cumsum(mass[::-1])[::-1] - mass
        return np.asarray(GRAVITY_M_S2 * self.L * (0.5 * mass + beyond))

    @property
    def weight_N(self) -> float:
        return GRAVITY_M_S2 * sum(self.rig.leg.link_masses_kg)

    def systematic_error(self, p: Floats, name: str) -> float:
        """Its value in p (P,), 0 where it is not an unknown."""
        index = self.systematic_errors.place(name)
        if index is None:
            return 0.0
        return float(p[self.curve_size + index])

    def rest_rad(self, p: Floats) -> Floats:
        """Angles (h,) at which the hinges bear nothing: the nominal ones plus their errors in p
        (P,).
        """
        nominal = np.array(self.rig.leg.rest_angles_rad or (0.0,) * (self.L.size - 1))
        return nominal + [
            self.systematic_error(p, rest_name(hinge)) for hinge in range(nominal.size)
        ]

    def correct_readings(self, z: Floats, p: Floats, recording: NDArray[np.intp]) -> Floats:
        """Measured values z (S, m) corrected for zeros, tares and the sensor's gain, as given by
        p (P,); `recording` is (S,).
        """
        mended = z.copy()
        for index, systematic_error in enumerate(self.systematic_errors.errors):
            if systematic_error.column is not None:
                mended[:, systematic_error.column] -= np.where(
                    (systematic_error.recording == ALL_RECORDINGS)
                    | (recording == systematic_error.recording),
                    p[self.curve_size + index],
                    0.0,
                )
        # Zeros and tares are subtracted before.
        return np.asarray(mended / self.scales(p))

    def scales(self, p: Floats) -> Floats:
        """Factors (m,) by which the measured values are too large: the scales of the hinge angles
        and the gain of the sensor, as given by p (P,).
        """
        factors = np.ones(self.L.size + 3)
        for hinge in range(self.L.size - 1):
            factors[hinge] += self.systematic_error(p, scale_name(hinge))
        # Columns after the n angles are the forces.
        factors[self.L.size :] += self.systematic_error(p, "gain")
        return factors

    def depth_m(self, z: Floats, p: Floats, group: Group) -> Floats:
        """Depth (S, n) of every link end in the floor, for corrected angles z (S, m) and
        unknowns p (P,).
        """
        offset_m = np.array([self.systematic_error(p, f"height_{i}") for i in group.height])
        q = link_angles(z, self.L.size)
        down_m = np.cumsum(self.L * np.sin(q), axis=1)
        along_m = np.cumsum(self.L * np.cos(q), axis=1)
        floor_m = (group.height_m + offset_m)[:, None] - self.systematic_error(p, "slope") * along_m
        return np.asarray(down_m + self.rig.leg.link_radius_m - floor_m)

    def linear(self, group: Group, z: Floats, c: Floats, p: Floats) -> LinearConditions:
        """Evaluate the conditions and their derivatives.

        Parameters
        ----------
        group : stages with the same ends on the floor
        z : (S, m) angles in rad and readings in N, N m
        c : (S, 2 T) depths in m and friction in N of the ends
        p : (P,) curve and systematic errors
        """
        return _Conditions(self, group, self.correct_readings(z, p, group.recording), c, p).linear()


def link_angles(z: Floats, links: int) -> Floats:
    """Angles of the links (S, n) from hinge angles and shaft angle in z (S, m)."""
    return np.asarray(
        np.cumsum(np.concatenate([z[:, links - 1 : links], z[:, : links - 1]], axis=1), axis=1)
    )


def sum_to_tip(per_link: Floats) -> Floats:
    """Sums over links i = j.. to the tip, (S, n)."""
    return np.asarray(np.cumsum(per_link[:, ::-1], axis=1)[:, ::-1])


class _Conditions:
    """One evaluation. Rows: hinges, torque of the shaft, fz, fy, positions of the ends, their
    shares of friction.
    """

    def __init__(self, balance: Balance, group: Group, z: Floats, c: Floats, p: Floats) -> None:
        self.of = balance
        self.group = group
        self.z = z
        self.p = p
        self.n = balance.L.size
        self.T = len(group.ends)
        self.h = self.n - 1
        R = self.h + 3 + self.T + max(self.T - 1, 0)
        self.g = np.zeros((len(z), R))
        self.slack = np.zeros((len(z), R))
        self.by_z, self.by_c, self.by_p = (
            np.zeros((len(z), R, columns)) for columns in (self.h + 4, 2 * self.T, p.size)
        )
        self.deep_m = c[:, : self.T]
        self.F = c[:, self.T :]
        nominal = balance.rig.ground.stiffness_N_per_m1p5
        stiffness = nominal * np.exp(balance.systematic_error(p, "contact"))
        # Gauss-Newton needs a smooth force. Depth is replaced by a hyperbola that is smooth where
        # the end leaves the floor.
        round_m = 0.5 * (NEGLIGIBLE_N / nominal) ** (
            2.0 / 3.0
        )  # rounds the corner where an end begins to press
        far_m = np.hypot(self.deep_m, round_m)
        root = np.sqrt(0.5 * (self.deep_m + far_m))
        # Hertz, N = k d^1.5, and its derivative by depth.
        self.N = stiffness * root**3
        self.N_deep = 0.75 * stiffness * root * (1.0 + self.deep_m / far_m)
        q = link_angles(z, self.n)
        self.across = balance.L * np.cos(q)
        self.down = balance.L * np.sin(q)
        # (n, T): whether joint i comes before end k, since a force on an end loads only the joints
        # before it.
        self.reach = (np.arange(self.n)[:, None] <= np.array(group.ends, dtype=int)).astype(float)

    def linear(self) -> LinearConditions:
        self._loads()
        self._hinges()
        self._sensor()
        self._positions()
        self._shares()
        self._shifts()
        return LinearConditions(self.g, self.by_z, self.by_c, self.by_p, self.slack, self.N)

    def _loads(self) -> None:
        """load_j (S, n) with its derivatives by joint angles (S, n, n), by depths and friction
        (S, n, 2 T), and by systematic errors.
        """
        w = self.of.weight_moment / self.of.L
        mass = 1.0 + self.of.systematic_error(self.p, "mass")
        lever = self.of.rig.friction_lever_m + self.of.systematic_error(self.p, "friction_lever")
        rise = self.of.rig.ground.friction_rise_share
        up = mass * w - self.N @ self.reach.T
        along = self.F @ self.reach.T
        arm_m = lever - rise * self.deep_m
        self.load = (
            sum_to_tip(up * self.across - along * self.down) - (arm_m * self.F) @ self.reach.T
        )
        # Turning joint i or j moves the same links where both come before them, hence the maximum
        # of both indices.
        turn = sum_to_tip(-up * self.down - along * self.across)
        joints = np.arange(self.n)
        self.load_q = turn[:, np.maximum(joints[:, None], joints)]
        if self.T:
            self.arms = np.stack(
                [sum_to_tip(self.across * reach) for reach in self.reach.T], axis=2
            )
        else:
            self.arms = np.zeros((*turn.shape, 0))
        self.load_N = -self.arms
        if self.T:
            # Friction acts below the end by the lever, so its arm is the height of the end plus
            # that lever.
            levers = [
                sum_to_tip(self.down * reach) + np.outer(arm, reach)
                for arm, reach in zip(arm_m.T, self.reach.T, strict=True)
            ]
            by_depth = self.load_N * self.N_deep[:, None] + rise * self.F[:, None] * self.reach
            self.load_c = np.concatenate([by_depth, -np.stack(levers, axis=2)], axis=2)
        else:
            self.load_c = self.arms
        self.load_contact = np.einsum("sjk,sk->sj", self.load_N, self.N)
        self.load_mass = sum_to_tip(w * self.across)
        self.load_lever = -along

    def _hinges(self) -> None:
        """Torque of every hinge minus its load."""
        h = self.h
        size = self.of.basis.size
        whole = self.of.curve_size
        phi = self.z[:, :h] - self.of.rest_rad(self.p)
        extra = self.of.extra[self.group.rows]
        columns = self.of.basis.columns(phi)
        self.g[:, :h] = columns @ self.p[:size] + extra @ self.p[size:whole] - self.load[:, 1:]
        self.by_z[:, :h, :h] = -self.load_q[:, 1:, 1:]
        stiffness = self.of.basis.slopes(phi) @ self.p[:size]
        self.by_z[:, np.arange(h), np.arange(h)] += stiffness
        self.by_z[:, :h, h] = -self.load_q[:, 1:, 0]
        self.by_c[:, :h] = -self.load_c[:, 1:]
        self.by_p[:, :h, :size] = columns
        self.by_p[:, :h, size:whole] = extra
        for name, slope in (
            ("mass", self.load_mass),
            ("friction_lever", self.load_lever),
            ("contact", self.load_contact),
        ):
            self._add_by_error(slice(0, h), name, -slope[:, 1:])
        for hinge in range(h):
            self._add_by_error(
                slice(hinge, hinge + 1), rest_name(hinge), -stiffness[:, hinge : hinge + 1]
            )

    def _sensor(self) -> None:
        """Readings of torque, fz and fy minus the forces of leg and floor."""
        h = self.h
        T = self.T
        below_m = self.of.rig.sensor.below_shaft_m
        mass = 1.0 + self.of.systematic_error(self.p, "mass")
        # The sensor sits below the shaft, so the horizontal force adds to the torque that it reads.
        self.g[:, h] = self.z[:, h + 3] + self.load[:, 0] + below_m * self.F.sum(1)
        self.g[:, h + 1] = self.z[:, h + 2] - mass * self.of.weight_N + self.N.sum(1)
        self.g[:, h + 2] = self.z[:, h + 1] + self.F.sum(1)
        self.by_z[:, [h, h + 1, h + 2], [h + 3, h + 2, h + 1]] = 1.0
        self.by_z[:, h, :h] = self.load_q[:, 0, 1:]
        self.by_z[:, h, h] = self.load_q[:, 0, 0]
        self.by_c[:, h] = self.load_c[:, 0]
        self.by_c[:, h, T:] += below_m
        self.by_c[:, h + 1, :T] = self.N_deep
        self.by_c[:, h + 2, T:] = 1.0
        weight = np.full(len(self.z), -self.of.weight_N)
        self._add_by_error(
            slice(h, h + 2), "mass", np.stack([self.load_mass[:, 0], weight], axis=1)
        )
        self._add_by_error(slice(h, h + 1), "friction_lever", self.load_lever[:, :1])
        self._add_by_error(
            slice(h, h + 2), "contact", np.stack([self.load_contact[:, 0], self.N.sum(1)], axis=1)
        )

    def _positions(self) -> None:
        """Every end is as deep as the angles state."""
        rows = slice(self.h + 3, self.h + 3 + self.T)
        ends = np.arange(self.T)
        self.g[:, rows] = (
            self.of.depth_m(self.z, self.p, self.group)[:, list(self.group.ends)] - self.deep_m
        )
        slope = self.of.systematic_error(self.p, "slope")
        along_m = np.cumsum(self.across, axis=1)[:, list(self.group.ends)]
        if self.T:
            sinks = self.arms - slope * np.stack(
                [sum_to_tip(self.down * reach) for reach in self.reach.T], axis=2
            )
        else:
            sinks = self.arms
        by_joint = np.swapaxes(sinks, 1, 2)  # (S, T, n)
        self.by_z[:, rows, : self.h] = by_joint[:, :, 1:]
        self.by_z[:, rows, self.h] = by_joint[:, :, 0]
        self.by_c[:, self.h + 3 + ends, ends] = -1.0
        self._add_by_error(rows, "slope", along_m)
        for i in np.unique(self.group.height):
            self._add_by_error(
                rows,
                f"height_{i}",
                -np.repeat((self.group.height == i)[:, None], self.T, axis=1).astype(float),
            )
        self.slack[:, rows] = (
            FLOOR_FLAT_M**2 + (HERTZ_MISFIT_SHARE * np.maximum(self.deep_m, 0.0)) ** 2
        )

    def _shares(self) -> None:
        """Each of several ends has about its share of the friction, within the limit of
        friction, and none where it does not press.
        """
        whole = np.maximum(self.N.sum(1), NEGLIGIBLE_N)
        F = self.F.sum(1)
        mu = self.of.rig.ground.friction_coefficient
        # The last end needs no row: the sum of all is already fixed by fy.
        for k in range(self.T - 1):
            row = self.h + 3 + self.T + k
            share = self.N[:, k] / whole
            self.g[:, row] = self.F[:, k] - share * F
            self.by_c[:, row, : self.T] = (share * F / whole)[:, None] * self.N_deep
            self.by_c[:, row, k] -= F / whole * self.N_deep[:, k]
            self.by_c[:, row, self.T :] = -share[:, None]
            self.by_c[:, row, self.T + k] += 1.0
            self.slack[:, row] = (SHARE_STD * mu * np.maximum(self.N[:, k], NEGLIGIBLE_N)) ** 2

    def _add_by_error(self, rows: slice, name: str, slope: Floats) -> None:
        index = self.of.systematic_errors.place(name)
        if index is not None:
            self.by_p[:, rows, self.of.curve_size + index] += slope

    def _shifts(self) -> None:
        """Zeros, tares and scales act through the measured values. The chain rule converts
        derivatives by corrected readings into those by raw ones.
        """
        scales = self.of.scales(self.p)
        self.by_z /= scales
        by_scale = -self.by_z * self.z[:, None]
        self._add_by_error(slice(None), "gain", by_scale[:, :, self.n :].sum(axis=2))
        for hinge in range(self.h):
            self._add_by_error(slice(None), scale_name(hinge), by_scale[:, :, hinge])
        for index, systematic_error in enumerate(self.of.systematic_errors.errors):
            if systematic_error.column is not None:
                rows = (systematic_error.recording == ALL_RECORDINGS) | (
                    self.group.recording == systematic_error.recording
                )
                self.by_p[rows, :, self.of.curve_size + index] -= self.by_z[
                    rows, :, systematic_error.column
                ]
