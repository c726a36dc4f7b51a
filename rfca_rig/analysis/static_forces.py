"""Forces of a leg at rest: under a force on its tip, and as a measure of how its stiffness drifts.

`load_tip` gives the shape for a force, `find_tip_force` the force for a shape. Section III.B of the
paper: a leg that grasps or holds. There is no floor contact, effects are ignored, and the weight of
the links counts.

`stiffness_drift` compares forces at the same shaft angles with those of the first check. At a given
height and shaft angle, a leg of springs pushes in proportion to their stiffness. One factor between
two checks therefore measures the change. The residual of that factor contains the weight, and
friction that differs from touchdown to touchdown.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.model.paper.statics import (
    equilibrium_under_tip_force,
    tip_chain_of,
    tip_force_weighing_angles,
)
from rfca_rig.model.parameters import Leg
from rfca_rig.recording.model import StaticStage

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class LoadedShape:
    """The equilibrium under a tip force.

    Parameters
    ----------
    force_N
        (2,) along the floor and down.
    angles_rad
        (n,) the shaft, then the hinges from their links.
    torques_Nm
        (n,) what holds the shaft, then the springs' torques.
    ends_mm, unloaded_mm
        (n + 1, 2) along and down, from the shaft to the tip, under the force and under the weight
        alone.
    snapped_at
        Share of weight and force at which the leg snapped into another shape for the last time,
        None if it bends steadily.
    """

    force_N: Floats
    angles_rad: Floats
    torques_Nm: Floats
    ends_mm: Floats
    unloaded_mm: Floats
    snapped_at: float | None

    def lines(self) -> Iterator[str]:
        """The result as lines for a terminal."""
        along_N, down_N = self.force_N
        yield (
            f"force at the tip: {along_N:+.2f} N along, {down_N:+.2f} N down; torque of the "
            f"shaft {self.torques_Nm[0]:+.3f} N m"
        )
        for hinge, (angle, torque) in enumerate(
            zip(np.degrees(self.angles_rad[1:]), self.torques_Nm[1:], strict=True), start=2
        ):
            yield f"hinge {hinge}: {angle:+7.2f} deg  {torque:+7.3f} N m"
        along_mm, down_mm = self.ends_mm[-1]
        moved_mm = float(np.hypot(*(self.ends_mm[-1] - self.unloaded_mm[-1])))
        yield (
            f"tip at {along_mm:.1f} mm along, {down_mm:.1f} mm down; the force moves it by "
            f"{moved_mm:.1f} mm"
        )
        if self.snapped_at is not None:
            yield (
                f"the leg snaps into this shape at {100.0 * self.snapped_at:.1f} % of weight and "
                "force"
            )

    def summary(self) -> dict[str, object]:
        """The result as plain data for JSON."""
        return {
            "force_N": self.force_N.tolist(),
            "angles_deg": np.degrees(self.angles_rad).tolist(),
            "torques_Nm": self.torques_Nm.tolist(),
            "ends_mm": self.ends_mm.tolist(),
            "unloaded_ends_mm": self.unloaded_mm.tolist(),
            "snapped_at_share": self.snapped_at,
        }


@dataclass(frozen=True)
class FoundTipForce:
    """A tip force and its standard errors (2,), along and down, and the largest hinge moment
    that the solution leaves unbalanced.
    """

    force_N: Floats
    std_N: Floats
    residual_Nm: float


def load_tip(leg: Leg, shaft_rad: float, force_N: Floats) -> LoadedShape:
    """The stable shape under a dead force (2,) at the tip, along the floor and down, with the
    shaft held.

    Raises
    ------
    SimulationFailed
        Where the leg does not carry the force.

    References
    ----------
    Equations (9) and (10), with the springs' own law and the links' weight.
    """
    chain = tip_chain_of(leg)
    # The second equilibrium, without the force, shows what the weight alone does.
    equilibrium = equilibrium_under_tip_force(chain, shaft_rad, force_N)
    alone = equilibrium_under_tip_force(chain, shaft_rad, np.zeros(2))
    # The first angle is the shaft's, which has no spring: its torque is that of the drive.
    torques = np.append(equilibrium.shaft_torque_Nm, chain.springs.torque_Nm(equilibrium.phi)[1:])
    return LoadedShape(
        force_N,
        equilibrium.phi,
        torques,
        _ends_mm(chain.L, equilibrium.phi),
        _ends_mm(chain.L, alone.phi),
        equilibrium.snapped_at,
    )


def find_tip_force(leg: Leg, angles_rad: Sequence[float], angle_std_rad: float) -> FoundTipForce:
    """The force at the tip that bends the leg into this shape, by least squares weighted with the
    errors of the angles.

    Parameters
    ----------
    leg
        Its springs and masses.
    angles_rad
        (n,) the shaft from the horizontal, then the hinges.
    angle_std_rad
        One standard deviation of each angle.

    Raises
    ------
    BadInput
        Where the number of angles differs from that of the links, or the angles do not determine
        the force.

    References
    ----------
    Equation (10), solved by singular values.
    """
    chain = tip_chain_of(leg)
    links = len(leg.link_lengths_m)
    if len(angles_rad) != links:
        raise BadInput(
            f"{len(angles_rad)} angles: this leg has {links}, of the shaft and of "
            f"{links - 1} hinges; give all of them in degrees"
        )
    if angle_std_rad <= 0.0:
        raise BadInput(
            f"a standard deviation of {np.degrees(angle_std_rad):g} deg for the angles: "
            "it must be above 0"
        )
    estimate = tip_force_weighing_angles(
        chain, np.array(angles_rad, dtype=np.float64), angle_std_rad
    )
    residual = estimate.residual_Nm
    return FoundTipForce(
        estimate.force_N, estimate.standard_errors_N, float(np.abs(residual).max())
    )


def _ends_mm(lengths_m: Floats, phi: Floats) -> Floats:
    angles = np.cumsum(phi)
    ends = 1e3 * np.cumsum(
        lengths_m[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]), axis=0
    )
    return np.vstack([np.zeros(2), ends])


@dataclass(frozen=True)
class StiffnessDrift:
    """Relative change of the forces since the first check, and its standard error (nan from a
    single force).
    """

    relative: float
    std: float

    def text(self) -> str:
        return f"{100.0 * self.relative:+.2f} +- {100.0 * self.std:.2f} %"


def stiffness_drift(stages: Sequence[StaticStage], holds: int, check: int) -> StiffnessDrift | None:
    """Drift of check number `check`; None where this check or the first one is incomplete.

    Parameters
    ----------
    stages
        Static stages; each check consists of `holds` of them.
    holds
        Stages in one check.
    check
        Number of the check, from 1.

    Notes
    -----
    Least squares of fy and fz at all angles on those of the first check; the standard error comes
    from the residual.
    """
    by_number = {stage.stage: stage for stage in stages}
    first = _forces(by_number, holds, 1)
    now = _forces(by_number, holds, check)
    if first is None or now is None:
        return None
    # Regression through the origin: now = factor * first.
    weight = float(first @ first)
    factor = float(first @ now) / weight
    residual = now - factor * first
    if len(first) > 1:
        variance = float(residual @ residual) / (len(first) - 1)
    else:
        variance = np.nan
    return StiffnessDrift(factor - 1.0, float(np.sqrt(variance / weight)))


def _forces(stages: Mapping[int, StaticStage], holds: int, check: int) -> np.ndarray | None:
    """(2 holds,) fy and fz of one check."""
    numbers = range((check - 1) * holds + 1, check * holds + 1)
    if not all(number in stages for number in numbers):
        return None
    return np.array(
        [force for number in numbers for force in (stages[number].fy_N, stages[number].fz_N)]
    )
