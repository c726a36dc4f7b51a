"""Gauss-Helmert adjustment: least squares where all measured values have errors, with conditions
and unknowns.

The measured values z with covariance C are moved as little as possible, in units of their errors,
until the conditions g(z, c, p) = 0 hold. This applies to angles and forces alike; no axis is taken
to be exact. c are unknowns of one stage, p those of all. Gauss-Newton, linearised again at the
moved z in each step (Deming 1943; Britt and Luecke, Technometrics 15 (1973) 233).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.balance import Balance, Group, LinearConditions

Floats = NDArray[np.float64]

# Limits of Gauss-Newton: steps, and turn of an angle in one step, beyond which the conditions are
# not nearly linear.
MAX_STEPS = 100
LONGEST_STEP_RAD = 0.1
# Factor of a damped step's length from step to step, and its lower limit.
DAMPING = 0.9
MIN_STEP_SHARE = 0.2
# Factor on the tolerance while steps are damped.
DAMPED_TOLERANCE_FACTOR = 30.0
# Where an end barely touches, whole steps with changing weights may alternate for ever.
DAMP_AFTER_STEPS = 20
# Largest last step of a common unknown, in its standard deviations.
CONVERGED_STD = 1e-3
# The same for the measured values.
CONVERGED_Z_STD = 5e-3
# Prior deviation of a curve's coefficient: it has no prior.
FREE_STD = 1e6


class NotConverged(Exception):
    """The adjustment did not converge; stage `row` is farthest from its measured values."""

    def __init__(self, row: int) -> None:
        super().__init__(row)
        self.row = row


@dataclass(frozen=True)
class Point:
    """Point of linearisation: z (S, m) of all stages, c (S_g, 2 T_g) of each group, p (P,)."""

    z: Floats
    c: tuple[Floats, ...]
    p: Floats


@dataclass(frozen=True)
class WhitenedConditions:
    """The whitened conditions of one group, split by the stages' own unknowns c.

    `factor` (S, R, R) whitens. `beside` (S, R, 1 + P + e) holds the whitened conditions, their
    derivatives by p, and further columns. `q`, `r` are the QR decomposition of the derivatives by
    c. The last R - 2 T directions of q do not depend on c.
    """

    line: LinearConditions
    C: Floats
    factor: Floats
    beside: Floats
    q: Floats
    r: Floats

    @property
    def unknowns(self) -> int:
        return int(self.r.shape[2])

    @property
    def rows(self) -> Floats:
        """Rows (m, 1 + P + e) with c eliminated, of variance 1."""
        # Projection on the directions that c cannot change eliminates c exactly, without solving
        # for it.
        free = np.swapaxes(self.q, 1, 2)[:, self.unknowns :] @ self.beside
        return np.asarray(free.reshape(-1, free.shape[2]))

    @property
    def log_det(self) -> float:
        """Log determinant of the covariance of the conditions, without the part that c takes up."""
        of_c = np.diagonal(self.r[:, : self.unknowns], axis1=1, axis2=2)
        whole = np.diagonal(self.factor, axis1=1, axis2=2)
        return 2.0 * float(np.log(np.abs(whole)).sum() + np.log(np.abs(of_c)).sum())

    def moves(self, dp: Floats) -> tuple[Floats, Floats]:
        """Distance of z from the measured values, (S, m), and the change of c (S, 2 T), for a
        change of p (P,).
        """
        v = self.beside[:, :, 0] + self.beside[:, :, 1 : 1 + dp.size] @ dp
        turned = np.einsum("srk,sr->sk", self.q, v)
        dc = -np.linalg.solve(self.r[:, : self.unknowns], turned[:, : self.unknowns, None])[:, :, 0]
        # These directions are met by c alone and leave nothing for z to correct.
        turned[:, : self.unknowns] = 0.0
        pull = np.linalg.solve(
            np.swapaxes(self.factor, 1, 2), np.einsum("srk,sk->sr", self.q, turned)[:, :, None]
        )
        return -(self.C @ np.swapaxes(self.line.by_z, 1, 2) @ pull)[:, :, 0], dc


@dataclass(frozen=True)
class Adjustment:
    """The solution; `covariance` (P, P) is that of p.

    `chi2` is that of data and systematic errors together, `freedom` its degrees of freedom.
    `log_likelihood` is that of the noise, with curve and unknowns integrated out (REML).
    """

    balance: Balance
    groups: tuple[Group, ...]
    point: Point
    covariance: Floats
    chi2: float
    freedom: int
    log_likelihood: float

    @property
    def curve(self) -> Floats:
        """Coefficients of the curve, (size,)."""
        return self.point.p[: self.balance.basis.size]


@dataclass(frozen=True)
class NormalRows:
    """Rows of all groups and of the systematic errors: `matrix` (m, P), `right` (m,), further
    columns `extra` (m, e).
    """

    matrix: Floats
    right: Floats
    extra: Floats
    log_det: float
    freedom: int

    @property
    def information(self) -> Floats:
        return self.matrix.T @ self.matrix

    def step(self) -> Floats:
        return np.asarray(np.linalg.lstsq(self.matrix, -self.right, rcond=None)[0])

    def log_likelihood(self) -> float:
        # Restricted likelihood (REML): the determinant of the information integrates the unknowns
        # out.
        left = self.right + self.matrix @ self.step()
        return -0.5 * (
            float(left @ left) + self.log_det + float(np.linalg.slogdet(self.information)[1])
        )


def linearise_groups(
    balance: Balance,
    groups: Sequence[Group],
    measured: Floats,
    C: Floats,
    point: Point,
    extra: Floats | None = None,
    slack: Sequence[Floats] = (),
) -> tuple[WhitenedConditions, ...]:
    """Linearise and whiten the groups' conditions about a point.

    Parameters
    ----------
    balance, groups
        The conditions, and the stages they apply to.
    measured
        (S, m) measured values.
    C
        (S, m, m) their covariance.
    point
        Point of linearisation.
    extra
        (S, h, e) columns of hinge torque to be tested.
    slack
        Of each group (S_g, R), in place of the conditions' own.
    """
    lines = [
        balance.linear(group, point.z[group.rows], c, point.p)
        for group, c in zip(groups, point.c, strict=True)
    ]
    if slack:
        lines = [
            replace(line, slack=group_slack) for line, group_slack in zip(lines, slack, strict=True)
        ]
    return tuple(
        _whiten(line, measured[g.rows] - point.z[g.rows], C[g.rows], _of(extra, g))
        for line, g in zip(lines, groups, strict=True)
    )


def rewhiten_groups(
    parts: Sequence[WhitenedConditions], groups: Sequence[Group], moved: Floats, C: Floats
) -> tuple[WhitenedConditions, ...]:
    """The same conditions for another covariance C (S, m, m); `moved` (S, m) is measured values
    minus the point of linearisation.
    """
    return tuple(
        _whiten(part.line, moved[g.rows], C[g.rows], None)
        for part, g in zip(parts, groups, strict=True)
    )


def _of(extra: Floats | None, group: Group) -> Floats | None:
    if extra is None:
        return None
    return extra[group.rows]


def _whiten(
    line: LinearConditions, moved: Floats, C: Floats, extra: Floats | None
) -> WhitenedConditions:
    V = line.by_z @ C @ np.swapaxes(line.by_z, 1, 2)
    diagonal = np.arange(V.shape[1])
    V[:, diagonal, diagonal] += line.slack
    # Covariance of the conditions: that of the measured values, carried over to first order, plus
    # each condition's own slack.
    factor = np.asarray(np.linalg.cholesky(V), np.float64)
    w = line.g + np.einsum("srm,sm->sr", line.by_z, moved)
    parts = [w[:, :, None], line.by_p]
    if extra is not None:
        parts.append(
            np.concatenate(
                [extra, np.zeros((len(w), V.shape[1] - extra.shape[1], extra.shape[2]))], axis=1
            )
        )
    q, r = np.linalg.qr(np.linalg.solve(factor, line.by_c), mode="complete")
    return WhitenedConditions(
        line, C, factor, np.linalg.solve(factor, np.concatenate(parts, axis=2)), q, r
    )


def stack_rows(balance: Balance, parts: Sequence[WhitenedConditions], p: Floats) -> NormalRows:
    """Stack the rows of all groups, with those of the systematic errors' priors below, at
    unknowns p (P,).
    """
    rows = np.concatenate([part.rows for part in parts])
    std = np.concatenate([np.full(balance.curve_size, FREE_STD), balance.systematic_errors.std])
    matrix = np.concatenate([rows[:, 1 : 1 + p.size], np.diag(1.0 / std)])
    # A coefficient of the curve has no prior; its row is there only to keep the matrix regular.
    prior = np.where(std < FREE_STD, p / std, 0.0)
    right = np.concatenate([rows[:, 0], prior])
    extra = np.concatenate([rows[:, 1 + p.size :], np.zeros((p.size, rows.shape[1] - 1 - p.size))])
    return NormalRows(
        matrix, right, extra, sum(part.log_det for part in parts), len(rows) - balance.curve_size
    )


def adjust(
    balance: Balance, groups: Sequence[Group], measured: Floats, C: Floats, start: Point
) -> Adjustment:
    """Adjust the measured values and unknowns from `start` until the conditions hold.

    Parameters
    ----------
    balance, groups
        The conditions, and the stages they apply to.
    measured
        (S, m) measured values.
    C
        (S, m, m) their covariance.
    start
        Point to begin from.

    Raises
    ------
    Unbalanced
        Where Gauss-Newton does not converge.

    References
    ----------
    Deming (1943); Britt and Luecke, Technometrics 15 (1973) 233.
    """
    try:
        return _iterate(balance, groups, measured, C, start)
    except np.linalg.LinAlgError:
        raise NotConverged(0) from None


def _iterate(
    balance: Balance, groups: Sequence[Group], measured: Floats, C: Floats, start: Point
) -> Adjustment:
    point = start
    slack = list[Floats]()
    for count in range(MAX_STEPS):
        # Damping sets in late, so that ordinary cases keep the fast convergence of whole steps.
        most = max(DAMPING ** max(count - DAMP_AFTER_STEPS, 0), MIN_STEP_SHARE)
        parts = linearise_groups(balance, groups, measured, C, point, slack=slack)
        # The slack depends on the solution. Freezing it stops steps and weights from alternating.
        if count == DAMP_AFTER_STEPS:
            slack = [part.line.slack for part in parts]
        rows = stack_rows(balance, parts, point.p)
        dp = rows.step()
        covariance = np.asarray(np.linalg.inv(rows.information), np.float64)
        before = point
        (point, whole) = _step_from(point, groups, parts, measured, dp, most)
        in_std = np.abs(dp) / np.sqrt(np.abs(np.diag(covariance)))
        z_in_std = np.abs(point.z - before.z) / most / np.sqrt(np.diagonal(C, axis1=1, axis2=2))
        close = 1.0 if most == 1.0 else DAMPED_TOLERANCE_FACTOR
        if (
            whole
            and in_std.max() < close * CONVERGED_STD
            and z_in_std.max() < close * CONVERGED_Z_STD
        ):
            left = rows.right + rows.matrix @ dp
            return Adjustment(
                balance,
                tuple(groups),
                point,
                covariance,
                float(left @ left),
                rows.freedom,
                rows.log_likelihood(),
            )
    raise NotConverged(
        int(
            np.abs((point.z - measured) / np.sqrt(np.diagonal(C, axis1=1, axis2=2)))
            .max(axis=1)
            .argmax()
        )
    )


def _step_from(
    point: Point,
    groups: Sequence[Group],
    parts: Sequence[WhitenedConditions],
    measured: Floats,
    dp: Floats,
    most: float,
) -> tuple[Point, bool]:
    """The next point, at the share `most` of the step, and whether the step was not cut.

    A step is cut where an angle would turn farther than the conditions are nearly linear.
    """
    moves = [part.moves(dp) for part in parts]
    z = measured.copy()
    for group, (dz, _) in zip(groups, moves, strict=True):
        z[group.rows] += dz
    turned = float(np.abs(z - point.z)[:, : measured.shape[1] - 3].max())
    longest = LONGEST_STEP_RAD / max(turned, 1e-12)
    share = min(most, longest)
    c = tuple(group_c + share * dc for group_c, (_, dc) in zip(point.c, moves, strict=True))
    return Point(point.z + share * (z - point.z), c, point.p + share * dp), longest >= 1.0
