"""Least squares where everything measured is in error: adjustment of conditions with unknowns.

What was measured, z with covariance C, is moved as little as its errors ask for until the conditions g(z, c, p) = 0 hold: angles and
forces alike, no axis is taken to be exact. c are unknowns of one stage, p those of all. Gauss-Newton, linearised anew at the moved z
each time (Deming 1943; Britt and Luecke, Technometrics 15 (1973) 233).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.balance import Balance, Group, LinearConditions

Floats = NDArray[np.float64]

MOST_STEPS = 100
LONGEST_STEP_RAD = 0.1
CALMING, LEAST_SHARE = 0.9, 0.2  # by which a step is shorter than the one before, and what it keeps of its length
CALM_CLOSE = 30.0  # times: how much less close then suffices
CALM_AFTER = 20  # steps: where an end barely touches, whole ones with weights that change may go to and fro for ever
SETTLED = 1e-3  # of a standard deviation of every common unknown
SETTLED_Z = 5e-3  # the same of everything measured
FREE_STD = 1e6  # of a curve's coefficient: nothing is known of it beforehand


class Unbalanced(Exception):
    """No balance was found; stage `row` is farthest from one."""

    def __init__(self, row: int) -> None:
        super().__init__(row)
        self.row = row


@dataclass(frozen=True)
class Point:
    """Where the conditions are looked at: z (S, m) of all stages, c (S_g, 2 T_g) of each group, p (P,)."""

    z: Floats
    c: tuple[Floats, ...]
    p: Floats


@dataclass(frozen=True)
class Freed:
    """The conditions of one group in units of their own errors, split by the stages' own unknowns c.

    `factor` (S, R, R) whitens; `beside` (S, R, 1 + P + e) are the whitened conditions, their derivatives by p, and by further columns;
    `q`, `r` from the derivatives by c. The last R - 2 T directions of q know nothing of c.
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
        """(m, 1 + P + e) without c, of variance 1."""
        free = np.swapaxes(self.q, 1, 2)[:, self.unknowns :] @ self.beside
        return np.asarray(free.reshape(-1, free.shape[2]))

    @property
    def log_det(self) -> float:
        """Of the covariance of the conditions, less what c takes up."""
        own = np.diagonal(self.r[:, : self.unknowns], axis1=1, axis2=2)
        whole = np.diagonal(self.factor, axis1=1, axis2=2)
        return 2.0 * float(np.log(np.abs(whole)).sum() + np.log(np.abs(own)).sum())

    def moves(self, dp: Floats) -> tuple[Floats, Floats]:
        """How far z is from what was measured, (S, m), and the change of c (S, 2 T), for a change of p."""
        v = self.beside[:, :, 0] + self.beside[:, :, 1 : 1 + dp.size] @ dp
        turned = np.einsum("srk,sr->sk", self.q, v)
        dc = -np.linalg.solve(self.r[:, : self.unknowns], turned[:, : self.unknowns, None])[:, :, 0]
        turned[:, : self.unknowns] = 0.0
        pull = np.linalg.solve(np.swapaxes(self.factor, 1, 2), np.einsum("srk,sk->sr", self.q, turned)[:, :, None])
        return -(self.C @ np.swapaxes(self.line.by_z, 1, 2) @ pull)[:, :, 0], dc


@dataclass(frozen=True)
class Adjusted:
    """The solution: `covariance` (P, P) of p. `chi2` is the data's and the systematic errors' together, `freedom` the conditions left over.

    `log_likelihood` is that of the noise, curve and unknowns integrated over (REML).
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
        """The coefficients of the curve."""
        return self.point.p[: self.balance.basis.size]

    @property
    def curve_covariance(self) -> Floats:
        size = self.balance.basis.size
        return self.covariance[:size, :size]


@dataclass(frozen=True)
class Weighed:
    """The rows of all groups and of the systematic errors: `matrix` (m, P), `right` (m,), further columns `extra` (m, e)."""

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
        left = self.right + self.matrix @ self.step()
        return -0.5 * (float(left @ left) + self.log_det + float(np.linalg.slogdet(self.information)[1]))


def freed(
    balance: Balance,
    groups: Sequence[Group],
    measured: Floats,
    C: Floats,
    point: Point,
    extra: Floats | None = None,
    slack: Sequence[Floats] = (),
) -> tuple[Freed, ...]:
    """The groups' conditions about a point, for errors C (S, m, m). `extra` (S, h, e) are columns of hinge torque to be tried.

    `slack` of each group stands in for what the conditions themselves say.
    """
    lines = [balance.linear(group, point.z[group.rows], c, point.p) for group, c in zip(groups, point.c, strict=True)]
    lines = [replace(line, slack=own) for line, own in zip(lines, slack, strict=True)] if slack else lines
    return tuple(_freed(line, measured[g.rows] - point.z[g.rows], C[g.rows], _of(extra, g)) for line, g in zip(lines, groups, strict=True))


def refreed(parts: Sequence[Freed], groups: Sequence[Group], moved: Floats, C: Floats) -> tuple[Freed, ...]:
    """The same conditions for other errors; `moved` (S, m) is what was measured less where they were linearised."""
    return tuple(_freed(part.line, moved[g.rows], C[g.rows], None) for part, g in zip(parts, groups, strict=True))


def _of(extra: Floats | None, group: Group) -> Floats | None:
    return None if extra is None else extra[group.rows]


def _freed(line: LinearConditions, moved: Floats, C: Floats, extra: Floats | None) -> Freed:
    V = line.by_z @ C @ np.swapaxes(line.by_z, 1, 2)
    every = np.arange(V.shape[1])
    V[:, every, every] += line.slack
    factor = np.asarray(np.linalg.cholesky(V), np.float64)
    w = line.g + np.einsum("srm,sm->sr", line.by_z, moved)
    parts = [w[:, :, None], line.by_p]
    if extra is not None:
        parts.append(np.concatenate([extra, np.zeros((len(w), V.shape[1] - extra.shape[1], extra.shape[2]))], axis=1))
    q, r = np.linalg.qr(np.linalg.solve(factor, line.by_c), mode="complete")
    return Freed(line, C, factor, np.linalg.solve(factor, np.concatenate(parts, axis=2)), q, r)


def weighed(balance: Balance, parts: Sequence[Freed], p: Floats) -> Weighed:
    """All rows together, those of the systematic errors below."""
    rows = np.concatenate([part.rows for part in parts])
    std = np.concatenate([np.full(balance.curve_size, FREE_STD), balance.systematic_errors.std])
    matrix = np.concatenate([rows[:, 1 : 1 + p.size], np.diag(1.0 / std)])
    prior = np.where(std < FREE_STD, p / std, 0.0)
    right = np.concatenate([rows[:, 0], prior])
    extra = np.concatenate([rows[:, 1 + p.size :], np.zeros((p.size, rows.shape[1] - 1 - p.size))])
    return Weighed(matrix, right, extra, sum(part.log_det for part in parts), len(rows) - balance.curve_size)


def adjust(balance: Balance, groups: Sequence[Group], measured: Floats, C: Floats, start: Point) -> Adjusted:
    """From `start` to where the conditions hold. Raises Unbalanced where Gauss-Newton does not settle."""
    try:
        return _adjusted(balance, groups, measured, C, start)
    except np.linalg.LinAlgError:
        raise Unbalanced(0) from None


def _adjusted(balance: Balance, groups: Sequence[Group], measured: Floats, C: Floats, start: Point) -> Adjusted:
    point, slack = start, list[Floats]()
    for count in range(MOST_STEPS):
        most = max(CALMING ** max(count - CALM_AFTER, 0), LEAST_SHARE)
        parts = freed(balance, groups, measured, C, point, slack=slack)
        if count == CALM_AFTER:
            slack = [part.line.slack for part in parts]
        rows = weighed(balance, parts, point.p)
        dp = rows.step()
        covariance = np.asarray(np.linalg.inv(rows.information), np.float64)
        before, (point, whole) = point, _moved(point, groups, parts, measured, dp, most)
        in_std = np.abs(dp) / np.sqrt(np.abs(np.diag(covariance)))
        z_in_std = np.abs(point.z - before.z) / most / np.sqrt(np.diagonal(C, axis1=1, axis2=2))
        close = 1.0 if most == 1.0 else CALM_CLOSE
        if whole and in_std.max() < close * SETTLED and z_in_std.max() < close * SETTLED_Z:
            left = rows.right + rows.matrix @ dp
            return Adjusted(balance, tuple(groups), point, covariance, float(left @ left), rows.freedom, rows.log_likelihood())
    raise Unbalanced(int(np.abs((point.z - measured) / np.sqrt(np.diagonal(C, axis1=1, axis2=2))).max(axis=1).argmax()))


def _moved(point: Point, groups: Sequence[Group], parts: Sequence[Freed], measured: Floats, dp: Floats, most: float) -> tuple[Point, bool]:
    """The next point, `most` of the step away, and whether it was not cut: no angle may turn farther than conditions are nearly linear."""
    moves = [part.moves(dp) for part in parts]
    z = measured.copy()
    for group, (dz, _) in zip(groups, moves, strict=True):
        z[group.rows] += dz
    turned = float(np.abs(z - point.z)[:, : measured.shape[1] - 3].max())
    longest = LONGEST_STEP_RAD / max(turned, 1e-12)
    share = min(most, longest)
    c = tuple(own + share * dc for own, (_, dc) in zip(point.c, moves, strict=True))
    return Point(point.z + share * (z - point.z), c, point.p + share * dp), longest >= 1.0
