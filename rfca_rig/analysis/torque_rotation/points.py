"""The measured points of the curve: at every stage and hinge its angle, and the torque that statics asks of it there."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.balance import LinearConditions
from rfca_rig.analysis.torque_rotation.recovery import Recovered
from rfca_rig.analysis.torque_rotation.stages import StageData

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Points:
    """All (S, h), NaN where no angle was measured. The angles count from rest.

    The torques follow from the angles as measured, before any curve is supposed; `turned` is +1 where a hinge had bent farther to its
    angle, -1 where it had come back, 0 where that is not clear.
    """

    phi_rad: Floats
    phi_std_rad: Floats
    torque_Nm: Floats
    torque_std_Nm: Floats
    turned: Floats


def points_of(found: Recovered, data: StageData) -> Points:
    """Zeros, tares, shares of several touching ends, and angles that were not measured are taken as found."""
    balance, h = found.adjusted.balance, data.hinges
    p, curve = found.adjusted.point.p, slice(0, found.adjusted.balance.curve_size)
    z, C = _as_measured(found, data)
    angle = balance.mended(z, p, data.recording)[:, :h] - balance.rest_rad(p)
    torque, std = np.empty(data.seen.shape), np.empty(data.seen.shape)
    for group, c in zip(found.adjusted.groups, found.adjusted.point.c, strict=True):
        line = balance.linear(group, z[group.rows], c, p)
        torque[group.rows] = line.by_p[:, :h, curve] @ p[curve] - line.g[:, :h]
        by_z = -line.by_z[:, :h] + _through_floor(line, h)
        by_z[:, np.arange(h), np.arange(h)] += balance.basis.slopes(angle[group.rows]) @ p[: balance.basis.size]
        std[group.rows] = np.sqrt(np.einsum("sji,sik,sjk->sj", by_z, C[group.rows], by_z))
    angle_std = np.sqrt(np.diagonal(C, axis1=1, axis2=2))[:, :h]
    angle, angle_std, torque, std = (np.where(data.seen, each, np.nan) for each in (angle, angle_std, torque, std))
    return Points(angle, angle_std, torque, std, data.turned * np.sign(data.measured[:, :h]))


def _as_measured(found: Recovered, data: StageData) -> tuple[Floats, Floats]:
    """Readings (S, m) and their covariance, those that are missing as found and without error."""
    known = np.concatenate([data.seen, np.ones((len(data.seen), 4), dtype=bool)], axis=1)
    C = found.errors.covariance(data, found.adjusted.balance.rig.leg.link_lengths_m)
    return np.where(known, data.measured, found.adjusted.point.z), C * known[:, :, None] * known[:, None, :]


def _through_floor(line: LinearConditions, hinges: int) -> Floats:
    """How the torques (S, h) follow the readings of fy and fz by way of the floor's forces, shares kept: (S, h, m)."""
    by_z = np.zeros((len(line.g), hinges, hinges + 4))
    ends = line.normal_N.shape[1]
    if not ends:
        return by_z
    N = np.maximum(line.normal_N, 1e-9)
    share = N / N.sum(axis=1, keepdims=True)
    deeper = line.by_c[:, hinges + 1, :ends]  # N by depth
    by_N = line.by_c[:, :hinges, :ends] / np.maximum(deeper, 1e-9)[:, None]
    by_z[:, :, hinges + 1] = np.einsum("sjk,sk->sj", line.by_c[:, :hinges, ends:], share)
    by_z[:, :, hinges + 2] = np.einsum("sjk,sk->sj", by_N, share)
    return by_z
