"""Camera twin: renders the leg in the present configuration of the plant.

Black nylon shells with red marks, a black cloth behind, an acrylic plate below. Outlines are
projected point by point and painted in linear light. The module shares no drawing or geometry code
with the image analysis, so that the images are an independent test of it.
"""

from typing import Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput
from rfca_rig.twins.image_noise import (
    ImageDisturbance,
    Light,
    apply_uneven_light,
    compute_coverage,
    paint,
    render_sensor_image,
)
from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.leg_marks import MarkPlan

Floats = NDArray[np.float64]
Colour = tuple[float, float, float]

# The leg of the paper is 15 mm thick.
HALF_THICKNESS_M = 0.0075
# Reflectances in linear light, 1 is white; colours are blue, green, red.
CLOTH = 0.012
FOLDS = 0.003
# Darkest and lightest shell.
SHELL = (0.015, 0.03)
PLATE: Colour = (0.05, 0.05, 0.045)
FRAME: Colour = (0.38, 0.38, 0.38)
RED: Colour = (0.025, 0.03, 0.5)
# Distance of red objects behind the plane of the leg in m.
RED_THING_DISTANCE_M = 0.15
FRAME_WIDTH_M = 0.02
# Number of corners of the polygon for a circle.
CIRCLE_CORNERS = 96

__all__ = ["CameraTwin", "ImageDisturbance", "StandingLeg", "render_leg"]


def render_leg(
    q_rad: Floats,
    link_lengths_m: Floats,
    plan: MarkPlan,
    camera: CameraModel,
    disturbance: ImageDisturbance,
    random: np.random.Generator,
    ground_depth_m: float | None = None,
) -> NDArray[np.uint8]:
    """Renders the leg.

    Parameters
    ----------
    q_rad : ndarray, shape (n,)
        Absolute angles of the links.
    link_lengths_m : ndarray, shape (n,)
        Lengths of the links.
    plan : MarkPlan
        Positions and diameter of the red marks.
    camera : CameraModel
        Pose, projection and image size.
    disturbance : Disturbance
        Image disturbances.
    random : Generator
        Source of all random choices; the same state gives the same image.
    ground_depth_m : float or None
        Depth of the plate below the shaft axis; None draws no plate.

    Returns
    -------
    ndarray, shape (rows, columns, 3)
        The image, uint8, in BGR order.

    Raises
    ------
    BadInput
        If the plan has marks beyond the leg, or no mark with the index that is to be hidden.
    """
    _check(plan, len(link_lengths_m), disturbance.hidden_mark)
    # Painted from back to front: cloth, red objects, plate, shells, glints, marks, frame.
    scene = _cloth(camera, random)
    hinges_m = _hinges(np.asarray(q_rad, np.float64), np.asarray(link_lengths_m, np.float64))
    shades = random.uniform(*SHELL, size=len(hinges_m) - 1)
    for _ in range(disturbance.red_things):
        _paint_red_thing(scene, hinges_m, plan, camera, random)
    if ground_depth_m is not None:
        _paint_plate(scene, hinges_m, shades, plan, camera, ground_depth_m, disturbance.reflection)
    _paint_shells(scene, hinges_m, shades, camera)
    for _ in range(disturbance.glints):
        _paint_glint(scene, hinges_m, camera, random)
    _paint_marks(scene, hinges_m, plan, camera)
    if disturbance.hidden_mark is not None:
        _paint_frame(
            scene, hinges_m, plan, camera, disturbance.hidden_mark, disturbance.hidden_share, random
        )
    return render_sensor_image(apply_uneven_light(scene, disturbance, random), disturbance, random)


def _check(plan: MarkPlan, links: int, hidden_mark: int | None) -> None:
    farthest = max(mark.link for mark in plan.marks)
    if farthest > links:
        raise BadInput(f"marks: one is to be on link {farthest}, the leg has {links}")
    if hidden_mark is not None and not 0 <= hidden_mark < len(plan.marks):
        raise BadInput(
            f"hidden_mark {hidden_mark}: should be 0 to {len(plan.marks) - 1}, the number of a mark"
        )


def _hinges(q_rad: Floats, link_lengths_m: Floats) -> Floats:
    """Points (n + 1, 2) in m: shaft axis, hinges and tip, as (y, z) with z up."""
    steps = link_lengths_m[:, None] * np.column_stack([np.cos(q_rad), -np.sin(q_rad)])
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])


def _cloth(camera: CameraModel, random: np.random.Generator) -> Light:
    """Black background (rows, columns, 3) with wide soft folds."""
    width, height = camera.image_size_px
    folds = cv2.resize(
        random.standard_normal((7, 9)).astype(np.float32),
        (width, height),
        interpolation=cv2.INTER_CUBIC,
    )
    grey = np.clip(np.float32(CLOTH) + np.float32(FOLDS) * folds, 0.002, 1.0)
    return np.asarray(cv2.merge([grey, grey, grey]), np.float32)


def _toward_camera(camera: CameraModel) -> float:
    """+1 if the camera is on the +x side of the plane of the leg, else -1."""
    return float(np.sign(-(camera.rotation.T @ camera.translation_m)[0]))


def _circle(middle_m: Floats, radius_m: float) -> Floats:
    turn = np.linspace(0.0, 2.0 * np.pi, CIRCLE_CORNERS, endpoint=False)
    return np.asarray(middle_m + radius_m * np.column_stack([np.cos(turn), np.sin(turn)]))


def _capsule(first_m: Floats, last_m: Floats, radius_m: float) -> Floats:
    """Outline (k, 2): two half circles and the straight lines between them, in small steps
    because lens distortion bends lines.
    """
    along = (last_m - first_m) / np.hypot(*(last_m - first_m))
    across = np.array([-along[1], along[0]])
    half = np.linspace(-np.pi / 2, np.pi / 2, CIRCLE_CORNERS // 2)[:, None]
    far = last_m + radius_m * (np.cos(half) * along + np.sin(half) * across)
    near = first_m - radius_m * (np.cos(half) * along + np.sin(half) * across)
    fraction = np.linspace(0.0, 1.0, 12)[1:-1, None]
    return np.vstack(
        [
            far,
            far[-1] + fraction * (near[0] - far[-1]),
            near,
            near[-1] + fraction * (far[0] - near[-1]),
        ]
    )


def _paint_shells(scene: Light, hinges_m: Floats, shades: Floats, camera: CameraModel) -> None:
    for first_m, last_m, shade in zip(hinges_m, hinges_m[1:], shades.tolist(), strict=False):
        paint(
            scene,
            camera.project(_capsule(first_m, last_m, HALF_THICKNESS_M)),
            (shade, shade, shade),
        )


def _mark_centres(hinges_m: Floats, plan: MarkPlan) -> Floats:
    centres = np.empty((len(plan.marks), 2))
    for at, mark in enumerate(plan.marks):
        link_m = hinges_m[mark.link] - hinges_m[mark.link - 1]
        along = link_m / np.hypot(*link_m)
        centres[at] = (
            hinges_m[mark.link - 1]
            + mark.along_m * along
            + mark.across_m * np.array([along[1], -along[0]])
        )
    return centres


def _paint_marks(scene: Light, hinges_m: Floats, plan: MarkPlan, camera: CameraModel) -> None:
    for centre_m in _mark_centres(hinges_m, plan):
        paint(scene, camera.project(_circle(centre_m, 0.5 * plan.diameter_m)), RED)


def _paint_glint(
    scene: Light, hinges_m: Floats, camera: CameraModel, random: np.random.Generator
) -> None:
    """Paints a streak along a link where its rounded edge reflects the lamp."""
    link = int(random.integers(len(hinges_m) - 1))
    first_m = hinges_m[link]
    last_m = hinges_m[link + 1]
    along = (last_m - first_m) / np.hypot(*(last_m - first_m))
    across = (
        np.array([-along[1], along[0]])
        * random.choice([-1.0, 1.0])
        * random.uniform(0.3, 0.9)
        * HALF_THICKNESS_M
    )
    middle_m = first_m + random.uniform(0.0, 1.0) * (last_m - first_m) + across
    half_length_m = random.uniform(0.002, 0.010)
    half_width_m = random.uniform(0.0003, 0.001)
    brightness = random.uniform(0.3, 1.5)
    outline = _capsule(
        middle_m - half_length_m * along, middle_m + half_length_m * along, half_width_m
    )
    paint(scene, camera.project(outline), (brightness, brightness, brightness))


def _paint_red_thing(
    scene: Light, hinges_m: Floats, plan: MarkPlan, camera: CameraModel, random: np.random.Generator
) -> None:
    """Paints a button or a piece of tape behind the leg. The button may be as large and as red
    as a mark.
    """
    lowest = hinges_m.min(axis=0) - 0.08
    highest = hinges_m.max(axis=0) + 0.08
    middle_m = random.uniform(lowest, highest)
    red = (RED[0], RED[1], RED[2] * random.uniform(0.6, 1.3))
    size_m = plan.diameter_m * random.uniform(0.4, 2.5)
    if random.random() < 0.5:
        outline = _circle(middle_m, 0.5 * size_m)
    else:
        turn = random.uniform(0.0, np.pi)
        outline = _capsule(
            middle_m,
            middle_m + random.uniform(2.0, 8.0) * size_m * np.array([np.cos(turn), np.sin(turn)]),
            0.3 * size_m,
        )
    behind_m = np.full(len(outline), -RED_THING_DISTANCE_M * _toward_camera(camera))
    paint(scene, camera.project(np.column_stack([behind_m, outline])), red)


def _paint_plate(
    scene: Light,
    hinges_m: Floats,
    shades: Floats,
    plan: MarkPlan,
    camera: CameraModel,
    depth_m: float,
    reflection: float,
) -> None:
    """Paints the upper face of the plate, the reflection of the leg in it, and its front edge."""
    toward = _toward_camera(camera)
    along = np.linspace(-0.15, 0.45, 40)
    front = np.column_stack([np.full(40, 0.1 * toward), along, np.full(40, -depth_m)])
    back = np.column_stack([np.full(40, -0.1 * toward), along, np.full(40, -depth_m)])
    face_px = camera.project(np.vstack([front, back[::-1]]))
    edge_px = camera.project(np.vstack([front, front[::-1] - np.array([0.0, 0.0, 0.01])]))
    paint(scene, face_px, PLATE)
    covered = compute_coverage(scene.shape[:2], face_px)
    sees_upper_face = -(camera.rotation.T @ camera.translation_m)[2] > -depth_m
    if reflection > 0.0 and covered is not None and sees_upper_face:
        mirrored = scene.copy()
        # The mirror image lies as far below the plate as the leg is above it.
        below_m = np.column_stack([hinges_m[:, 0], -2.0 * depth_m - hinges_m[:, 1]])
        _paint_shells(mirrored, below_m, shades, camera)
        _paint_marks(mirrored, below_m, plan, camera)
        rows, columns, share = covered
        scene[rows, columns] += (
            reflection * share[..., None] * (mirrored[rows, columns] - scene[rows, columns])
        )
    paint(scene, edge_px, (0.12, 0.12, 0.11))


def _paint_frame(
    scene: Light,
    hinges_m: Floats,
    plan: MarkPlan,
    camera: CameraModel,
    hidden: int,
    hidden_share: float,
    random: np.random.Generator,
) -> None:
    """Paints a bar across the link whose edge covers part of the mark. So near a mark lens
    distortion of its lines is negligible.
    """
    mark = plan.marks[hidden]
    centre_m = _mark_centres(hinges_m, plan)[hidden]
    link_m = hinges_m[mark.link] - hinges_m[mark.link - 1]
    turn = (
        np.arctan2(link_m[1], link_m[0])
        + random.choice([0.0, np.pi])
        + np.radians(random.uniform(-20.0, 20.0))
    )
    beyond = np.array([np.cos(turn), np.sin(turn)])
    sideways = np.array([-np.sin(turn), np.cos(turn)])
    edge_m = centre_m + (0.5 - hidden_share) * plan.diameter_m * beyond
    far_m = edge_m + FRAME_WIDTH_M * beyond
    reach = np.linspace(-0.25, 0.25, 60)[:, None]
    outline = np.vstack([edge_m + reach * sideways, far_m - reach * sideways])
    paint(scene, camera.project(outline), FRAME)


class StandingLeg(Protocol):
    """The present configuration of a plant's leg, as far as a camera sees it."""

    def link_angles_rad(self) -> Floats:
        """Absolute angles (n,) of the links in rad, from the shaft outwards, measured from +y,
        positive downwards.
        """
        ...

    def link_lengths_m(self) -> Floats:
        """Lengths (n,) of the links in m, from the shaft outwards."""
        ...

    def ground_depth_m(self) -> float:
        """Depth of the plate below the shaft axis in m."""
        ...


class CameraTwin:
    """Each picture gets new random disturbances from `random`; `disturbance` sets their kinds
    and sizes.
    """

    def __init__(
        self,
        leg: StandingLeg,
        plan: MarkPlan,
        camera: CameraModel,
        disturbance: ImageDisturbance,
        random: np.random.Generator,
    ) -> None:
        self._leg = leg
        self._plan = plan
        self._camera = camera
        self._disturbance = disturbance
        self._random = random

    def expose(self) -> NDArray[np.uint8]:
        """The image (rows, columns, 3) uint8 in BGR order of the leg in its present
        configuration.
        """
        leg = self._leg
        angles_rad = leg.link_angles_rad()
        lengths_m = leg.link_lengths_m()
        ground_m = leg.ground_depth_m()
        return render_leg(
            angles_rad,
            lengths_m,
            self._plan,
            self._camera,
            self._disturbance,
            self._random,
            ground_m,
        )
