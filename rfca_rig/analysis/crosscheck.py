"""Comparison of the model with MuJoCo: contact force curves under the paper's conditions, as the
paper compares with RecurDyn.

There are two comparisons. With the nominal ground, MuJoCo's mechanics must agree to the accuracy of
the integrators. With MuJoCo's own contact, a linear spring replaces Hertz, and the two laws differ
physically. The ground is then made so stiff on both sides that the loading no longer depends on the
law. Touchdown and release always do.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.mujoco_leg import MujocoStroke, stroke_in_mujoco, stroke_on_springs
from rfca_rig.analysis.phases import (
    TOUCHDOWN_LASTS_S,
    StrokePhases,
    Undetermined,
    Valley,
    find_valley,
    phases_of_simulation,
    valley_time_s,
)
from rfca_rig.analysis.prediction import SAMPLE_S
from rfca_rig.errors import BadInput
from rfca_rig.model.chain import Tolerance
from rfca_rig.model.parameters import RigModel
from rfca_rig.model.stroke import SimulatedStroke, simulate_stroke_at_speed
from rfca_rig.protocol.experiments import PlannedCondition

Floats = NDArray[np.float64]

PAPER_PCT = 4.91  # section IV: theoretical model against RecurDyn
# Factor on the contact stiffness in the comparison with MuJoCo's own contact.
STIFFENING_FACTOR = 100.0
# The stiff ground is compared at a tight tolerance, so that the integrator's error does not count
# as a difference of laws.
TIGHT_TOLERANCE = Tolerance(angle_rad=1e-7, speed_rad_s=3e-4)


@dataclass(frozen=True)
class CheckedCondition:
    """One condition, `ours` by the model and `theirs` by MuJoCo at the same times; `contact_N`
    is (m,).
    """

    condition: PlannedCondition
    ours: SimulatedStroke
    theirs: MujocoStroke

    @property
    def label(self) -> str:
        return f"{1e3 * self.condition.height_m:g} mm, {self.condition.speed_rad_s:g} rad/s"

    @cached_property
    def contact_N(self) -> Floats:
        """The model's contact force curve (m,): normal force summed over the link ends."""
        return np.asarray(self.ours.normal_N.sum(axis=1))

    @cached_property
    def phases(self) -> StrokePhases:
        """Those of the model's stroke."""
        valley = find_valley(self.ours.t_s, self.ours.fz_N)
        return phases_of_simulation(self.ours, valley_time_s(valley))

    @property
    def stroke_pct(self) -> float:
        """Difference of the contact force curves over the whole stroke."""
        return difference_pct(self.contact_N, self.theirs.normal_N)

    @property
    def loading_pct(self) -> float | None:
        """The difference from 30 ms after touchdown to the valley; None where there is no
        valley.
        """
        if not np.isfinite(self.phases.valley_s):
            return None
        t_s = self.ours.t_s
        loading = (t_s >= self.phases.touchdown_s + TOUCHDOWN_LASTS_S) & (
            t_s <= self.phases.valley_s
        )
        return difference_pct(self.contact_N[loading], self.theirs.normal_N[loading])

    def summary(self) -> dict[str, object]:
        """The figures by name, each with its unit; both codes' valleys [s, N], None where there
        is none.
        """
        return {
            "height_mm": round(1e3 * self.condition.height_m, 6),
            "speed_rad_s": self.condition.speed_rad_s,
            "contact_force_difference_pct": _round_or_none(self.stroke_pct),
            "contact_force_difference_loading_pct": _round_or_none(self.loading_pct),
            "fz_difference_pct": _round_or_none(difference_pct(self.ours.fz_N, self.theirs.fz_N)),
            "valley_ours": _valley(self.ours.t_s, self.ours.fz_N),
            "valley_mujoco": _valley(self.theirs.t_s, self.theirs.fz_N),
            "mujoco_steps": self.theirs.steps,
            "shaft_speed_error": float(f"{self.theirs.speed_error:.1e}"),
        }


def difference_pct(ours: Floats, theirs: Floats) -> float:
    """Relative L2 difference [%] of two curves (m,) sampled at the same times: |ours - theirs| /
    |theirs|; 0 where both vanish.
    """
    size = float(np.linalg.norm(theirs))
    apart = float(np.linalg.norm(ours - theirs))
    if size:
        return 100.0 * apart / size
    if apart:
        return float("inf")
    return 0.0


def check_condition(
    rig: RigModel, condition: PlannedCondition, sweep_deg: float
) -> CheckedCondition:
    """Compare the model at its usual tolerance with MuJoCo under the nominal ground, sampled at
    1 kHz.
    """
    t_s = _times(rig, condition, sweep_deg)
    ours = simulate_stroke_at_speed(rig, condition.height_m, condition.speed_rad_s, t_s)
    _must_touch(ours, condition)
    return CheckedCondition(
        condition, ours, stroke_in_mujoco(rig, condition.height_m, condition.speed_rad_s, t_s)
    )


def check_own_contact(
    rig: RigModel, condition: PlannedCondition, sweep_deg: float
) -> CheckedCondition:
    """Compare both on `stiff_ground`, the model at a tight tolerance, so that only the contact laws
    differ.

    MuJoCo's springs have the secant stiffness of Hertz at the valley, force over indentation.
    """
    stiff = stiff_ground(rig)
    t_s = _times(rig, condition, sweep_deg)
    ours = simulate_stroke_at_speed(
        stiff, condition.height_m, condition.speed_rad_s, t_s, TIGHT_TOLERANCE
    )
    _must_touch(ours, condition)
    # Secant stiffness of Hertz, force over indentation, of the end with the largest force, at the
    # valley or else at the greatest force.
    valley = find_valley(ours.t_s, ours.fz_N)
    if isinstance(valley, Valley):
        at = int(np.abs(ours.t_s - valley.time_s).argmin())
    else:
        at = int(ours.normal_N.max(axis=1).argmax())
    N = float(ours.normal_N[at].max())
    # N = k d^1.5 gives N / d = (N k^2)^(1/3).
    spring = float(np.cbrt(N * stiff.ground.stiffness_N_per_m1p5**2))
    return CheckedCondition(
        condition,
        ours,
        stroke_on_springs(stiff, condition.height_m, condition.speed_rad_s, t_s, spring),
    )


def stiff_ground(rig: RigModel) -> RigModel:
    """`rig` over a ground a hundred times as stiff, without the damping and viscous drag that
    MuJoCo's contact lacks.
    """
    stiffness = STIFFENING_FACTOR * rig.ground.stiffness_N_per_m1p5
    return replace(
        rig,
        ground=replace(
            rig.ground, stiffness_N_per_m1p5=stiffness, damping_s_per_m=0.0, drag_N_s_per_m=0.0
        ),
    )


def average_pct(checked: Sequence[CheckedCondition]) -> float:
    """Mean difference over the whole strokes, to compare with the paper's 4.91 %."""
    return float(np.mean([condition.stroke_pct for condition in checked]))


def _times(rig: RigModel, condition: PlannedCondition, sweep_deg: float) -> Floats:
    end_s = float(np.radians(sweep_deg)) / condition.speed_rad_s + 0.5 * rig.drive.ramp_s
    return np.arange(max(int(end_s / SAMPLE_S), 1) + 1, dtype=np.float64) * SAMPLE_S


def _must_touch(stroke: SimulatedStroke, condition: PlannedCondition) -> None:
    if not (stroke.normal_N > 0.0).any():
        raise BadInput(
            f"at {1e3 * condition.height_m:g} mm the leg never touches the ground: no "
            "contact force to compare; lower the rack"
        )
    if (stroke.normal_N[0] > 0.0).any():
        raise BadInput(
            f"at {1e3 * condition.height_m:g} mm the leg lies on the ground before the "
            "stroke begins; raise the rack"
        )


def _valley(t_s: Floats, fz_N: Floats) -> tuple[float, float] | None:
    valley = find_valley(t_s, fz_N)
    if isinstance(valley, Undetermined):
        return None
    return (round(valley.time_s, 5), round(valley.fz_N, 4))


def _round_or_none(value: float | None) -> float | None:
    if value is None:
        return None
    return round(value, 5)
