"""Legs with springs of any law and glued marks: MuJoCo's equilibria, seen by a camera.

Neither the torques nor the marks are computed by the code under test, except for the projection of
points into the picture.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.analysis.torque_rotation.evaluate import StageAssumptions, evaluate
from rfca_rig.analysis.torque_rotation.static_result import StaticResult
from rfca_rig.recording.model import StaticStage
from rfca_rig.vision.hinge_angles import LegFit, fit_leg
from rfca_rig.vision.identify import IdentifiedMarks
from rfca_rig.vision.leg_marks import MarkPlan, PlannedMark, mark_positions
from rfca_rig.vision.leg_photo import PhotoSetup, read_marks
from rfca_rig.vision.marks import Mark
from tests.analysis.torque_rotation.tables import (
    ANGLES_DEG,
    HEIGHTS_M,
    KNOWN_TO,
    NOISE,
    RIG,
    SECTIONS,
    by_mujoco,
    recording,
)
from tests.vision.drawing import Look, draw
from tests.vision.scenes import camera

Floats = NDArray[np.float64]

LENGTHS_M = np.array(RIG.leg.link_lengths_m)
HINGES = len(LENGTHS_M) - 1
PLAN = MarkPlan.at_hinges(LENGTHS_M.tolist())
CAMERA = camera()
# One mark, in a sharp photo of two megapixels.
MARK_STD_PX = 0.05
# From a stage to the next one, 15 degrees of the shaft apart, a hinge turns by some 5 degrees.
MOST_TURN_RAD = float(np.radians(15.0))
# Thickness of marks that are glued to one plane.
OFFSET_STD_M = 5e-5
GLUING_STD_M = 1e-4
LOOK = Look(defocus_px=0.7, light_fall=0.3, glints=4)

# Torque of a hinge in N m over its angle in rad. Each has 11 N m/rad at rest.
LAWS = {
    "cubic": lambda phi: 11.0 * (phi + 4.2 * phi**3),
    "softening, tanh": lambda phi: 11.0 * np.tanh(1.6 * phi) / 1.6,
    "hardening, exp": lambda phi: 11.0 * np.sign(phi) * np.expm1(2.0 * np.abs(phi)) / 2.0,
    "hardening, sinh": lambda phi: 11.0 * np.sinh(4.0 * phi) / 4.0,
}


@dataclass(frozen=True)
class Leg:
    """A leg whose hinges follow a law of `LAWS`, each `stiffness` (h,) times as stiff and at rest
    at `rest_rad` (h,).
    """

    law: str
    stiffness: Floats
    rest_rad: Floats

    def torque_Nm(self, hinges_rad: Floats) -> Floats:
        return np.asarray(self.stiffness * LAWS[self.law](hinges_rad - self.rest_rad))


def plain_leg(law: str) -> Leg:
    return Leg(law, np.ones(HINGES), np.zeros(HINGES))


def stand(leg: Leg, random: np.random.Generator) -> tuple[StaticStage, ...]:
    """The leg's stages without any error of measurement."""
    stages: list[StaticStage] = []
    for height_m in HEIGHTS_M:
        stages += by_mujoco(RIG, height_m, ANGLES_DEG, random, leg.torque_Nm, MOST_TURN_RAD)
    return tuple(stages)


def photograph(
    stages: Sequence[StaticStage],
    random: np.random.Generator,
    gluing_std_m: float = GLUING_STD_M,
    drawn: bool = False,
) -> tuple[tuple[StaticStage, ...], LegFit]:
    """The stages as measured: angles from the marks of all photos, forces and shaft with noise.

    With `drawn` pictures are drawn and the marks found in them. Without, the marks are seen where
    the camera projects them, with noise.
    """
    glued = random.normal(0.0, gluing_std_m, (len(PLAN.marks), 2))
    offsets_m = random.normal(0.0, OFFSET_STD_M, len(PLAN.marks))
    marks = tuple(_glue(index, error_m) for index, error_m in enumerate(glued))
    plan = replace(PLAN, marks=marks)
    photos = []
    for stage in stages:
        links_rad = np.cumsum([stage.shaft_angle_rad, *np.radians(stage.hinge_deg)])
        if drawn:
            picture = draw(links_rad, LENGTHS_M, plan, CAMERA, LOOK, random)
            eye = PhotoSetup(CAMERA, PLAN, tuple(LENGTHS_M.tolist()))
            photos.append(read_marks(picture, eye))
        else:
            photos.append(_see(links_rad, plan, offsets_m, random))
    fit = fit_leg(photos, CAMERA, PLAN, LENGTHS_M.tolist())
    measured = [
        replace(
            stage,
            hinge_deg=_degrees(angles.hinge_rad),
            hinge_std_deg=_degrees(angles.hinge_std_rad),
            hinge_reading_std_deg=_degrees(angles.hinge_reading_std_rad),
            fy_N=stage.fy_N + random.normal(0.0, 0.1 * NOISE["fy_N"]),
            fz_N=stage.fz_N + random.normal(0.0, 0.1 * NOISE["fz_N"]),
            tx_Nm=stage.tx_Nm + random.normal(0.0, 0.1 * NOISE["tx_Nm"]),
            shaft_angle_rad=stage.shaft_angle_rad + random.normal(0.0, 1e-4),
        )
        for stage, angles in zip(stages, fit.angles, strict=True)
    ]
    return tuple(measured), fit


def _glue(index: int, error_m: Floats) -> PlannedMark:
    """The mark beside its place. One on a hinge axis turns with the link before."""
    mark = PLAN.marks[index]
    along_m, across_m = error_m.tolist()
    if mark.along_m == 0.0 and mark.link > 1:
        before = mark.link - 1
        return PlannedMark(before, float(LENGTHS_M[before - 1]) + along_m, across_m)
    return replace(mark, along_m=mark.along_m + along_m, across_m=across_m)


def _see(
    links_rad: Floats, plan: MarkPlan, offsets_m: Floats, random: np.random.Generator
) -> IdentifiedMarks:
    places = mark_positions(links_rad, LENGTHS_M, plan)
    px = (
        CAMERA.project(np.column_stack([offsets_m, places]))
        + CAMERA.circle_shift_px(places, plan.diameter_m)
        + random.normal(0.0, MARK_STD_PX, places.shape)
    )
    marks = tuple(Mark(place, np.full(2, MARK_STD_PX), 25.0, 1.0, 100.0) for place in px)
    return IdentifiedMarks(marks, (), ())


def _degrees(angles_rad: Sequence[float | None]) -> tuple[float, ...]:
    """Hinge angles in degrees without the shaft's, NaN where unknown."""
    return tuple(
        float("nan") if angle is None else float(np.degrees(angle)) for angle in angles_rad[1:]
    )


def find_curve(stages: Sequence[StaticStage]) -> StaticResult:
    return evaluate([recording(stages)], StageAssumptions(SECTIONS, KNOWN_TO))


def share_inside_band(result: StaticResult, law: str) -> float:
    """Share of the measured range over which the true torque is inside the 95 % band."""
    phi = result.curve.grid_rad()
    torque, std = result.curve.torque_Nm(phi)
    return float(np.mean(np.abs(torque - LAWS[law](phi)) <= result.curve.reach * std))


def share_inside_stiffness_band(result: StaticResult, law: str) -> float:
    """The same of the stiffness."""
    phi = result.curve.grid_rad()
    stiffness, std = result.curve.stiffness_Nm_per_rad(phi)
    step = 1e-5
    true = (LAWS[law](phi + step) - LAWS[law](phi - step)) / (2.0 * step)
    return float(np.mean(np.abs(stiffness - true) <= result.curve.reach * std))


def true_values(result: StaticResult, law: str) -> tuple[float, float]:
    """k0 and k2 of the truth: the stiffness at rest, and the hardening up to the largest angle."""
    phi = max(result.law.range_rad, key=abs)
    k0 = float((LAWS[law](1e-6) - LAWS[law](-1e-6)) / 2e-6)
    return k0, float((LAWS[law](phi) / (k0 * phi) - 1.0) / phi**2)
