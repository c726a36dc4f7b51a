"""A second way to make a photo of the leg: outlines projected by OpenCV, filled many times finer
than the picture, seen in linear light.

Nothing of the finder is used here, neither its camera formulas nor its idea of an edge.
"""

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.vision.camera_model import CameraModel, Floats
from rfca_rig.vision.leg_marks import MarkPlan, mark_positions

FINER = 4
SHIFT = 6
RED = np.array([0.03, 0.035, 0.62])  # blue, green, red reflectance
BLACK = np.array([0.012, 0.012, 0.013])
SHELL = np.array([0.022, 0.021, 0.021])


@dataclass(frozen=True)
class Look:
    """What disturbs the photo; covers are (mark, side rad, hidden share of the diameter), red
    discs (y, z, diameter).
    """

    defocus_px: float = 0.8
    noise_counts: float = 2.0
    light_fall: float = 0.2
    exposure: float = 1.0
    glints: int = 0
    covers: tuple[tuple[int, float, float], ...] = ()
    left_out: tuple[int, ...] = ()
    red_discs_m: tuple[tuple[float, float, float], ...] = ()
    red_bars: int = 0
    jpeg_quality: int | None = None
    glint_on: tuple[int, ...] = field(default=())


def draw(
    angles_rad: Floats,
    lengths_m: Floats,
    plan: MarkPlan,
    camera: CameraModel,
    look: Look,
    random: np.random.Generator,
) -> NDArray[np.uint8]:
    """Photo (height, width, 3) BGR of a leg with absolute link angles (links,)."""
    width, height = camera.image_size_px
    light = np.empty((height * FINER, width * FINER, 3), np.float32)
    light[:] = BLACK
    places = mark_positions(angles_rad, lengths_m, plan)
    _background(light, camera, look, random)
    _shells(light, angles_rad, lengths_m, camera)
    for index, place in enumerate(places):
        if index not in look.left_out:
            _fill(light, camera, _circle(place, plan.diameter_m / 2), RED)
    for y, z, diameter in look.red_discs_m:
        _fill(
            light, camera, _circle(np.array([y, z]), diameter / 2), RED * random.uniform(0.8, 1.1)
        )
    _glints(light, camera, places, plan, look, random)
    for index, side, share in look.covers:
        _cover(light, camera, places[index], plan.diameter_m, side, share)
    photo = cv2.resize(light, (width, height), interpolation=cv2.INTER_AREA)
    return _exposed(_defocused(photo, look.defocus_px), look, random)


def _fill(
    light: NDArray[np.float32], camera: CameraModel, outline_m: Floats, colour: Floats
) -> None:
    points = np.column_stack([np.zeros(len(outline_m)), outline_m])
    turn, _ = cv2.Rodrigues(camera.rotation)
    px, _ = cv2.projectPoints(points, turn, camera.translation_m, camera.matrix, camera.distortion)
    fine = (px.reshape(-1, 2) + 0.5) * FINER - 0.5
    cv2.fillPoly(
        light, [np.rint(fine * 2**SHIFT).astype(np.int32)], colour.tolist(), cv2.LINE_8, SHIFT
    )


def _circle(centre_m: Floats, radius_m: float, stretch: float = 1.0) -> Floats:
    turn = np.linspace(0, 2 * np.pi, 180, endpoint=False)
    return np.asarray(centre_m + radius_m * np.column_stack([stretch * np.cos(turn), np.sin(turn)]))


def _box(middle_m: Floats, along_rad: float, long_m: float, wide_m: float) -> Floats:
    u = np.array([np.cos(along_rad), np.sin(along_rad)])
    v = np.array([-u[1], u[0]])
    return np.array(
        [
            middle_m + a * long_m / 2 * u + b * wide_m / 2 * v
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
    )


def _shells(
    light: NDArray[np.float32], angles_rad: Floats, lengths_m: Floats, camera: CameraModel
) -> None:
    steps = lengths_m[:, None] * np.column_stack([np.cos(angles_rad), -np.sin(angles_rad)])
    for middle, angle, length in zip(
        np.cumsum(steps, axis=0) - steps / 2, angles_rad, lengths_m, strict=True
    ):
        _fill(light, camera, _box(middle, -angle, length + 0.008, 0.015), SHELL)


def _background(
    light: NDArray[np.float32], camera: CameraModel, look: Look, random: np.random.Generator
) -> None:
    for _ in range(look.red_bars):
        middle = np.array([random.uniform(0.0, 0.25), random.choice([0.05, -0.24])])
        _fill(
            light,
            camera,
            _box(middle, random.uniform(0, 3), random.uniform(0.03, 0.06), 0.012),
            RED,
        )


def _glints(
    light: NDArray[np.float32],
    camera: CameraModel,
    places: Floats,
    plan: MarkPlan,
    look: Look,
    random: np.random.Generator,
) -> None:
    for _ in range(look.glints):
        at = places[random.integers(len(places))] + random.normal(0, 0.008, 2)
        _fill(
            light,
            camera,
            _circle(at, random.uniform(0.0004, 0.0015), random.uniform(1, 4)),
            np.full(3, random.uniform(0.3, 1.5)),
        )
    for index in look.glint_on:
        _fill(
            light,
            camera,
            _box(places[index], random.uniform(0, 3), 1.3 * plan.diameter_m, 0.0012),
            np.full(3, 1.2),
        )


def _cover(
    light: NDArray[np.float32],
    camera: CameraModel,
    place: Floats,
    diameter_m: float,
    side: float,
    share: float,
) -> None:
    u = np.array([np.cos(side), np.sin(side)])
    middle = place + u * diameter_m * (0.5 - share + 1.0)
    _fill(
        light,
        camera,
        _box(middle, side, 2 * diameter_m, 2.5 * diameter_m),
        np.array([0.05, 0.05, 0.05]),
    )


def _defocused(photo: NDArray[np.float32], radius_px: float) -> NDArray[np.float32]:
    size = 2 * int(np.ceil(radius_px + 1)) + 1
    disc = np.zeros((size * 8, size * 8), np.float32)
    cv2.circle(disc, (size * 4, size * 4), max(1, round(radius_px * 8)), 1.0, -1)
    kernel = cv2.resize(disc, (size, size), interpolation=cv2.INTER_AREA)
    kernel = (kernel + kernel[::-1] + kernel[:, ::-1] + kernel[::-1, ::-1]) / 4
    return np.asarray(cv2.GaussianBlur(cv2.filter2D(photo, -1, kernel / kernel.sum()), (0, 0), 0.5))


def _exposed(
    photo: NDArray[np.float32], look: Look, random: np.random.Generator
) -> NDArray[np.uint8]:
    height, width = photo.shape[:2]
    down, across = np.mgrid[-1 : 1 : height * 1j, -1 : 1 : width * 1j]
    side = random.uniform(0, 2 * np.pi)
    fall = 1 - look.light_fall * (0.5 + 0.35 * (np.cos(side) * across + np.sin(side) * down))
    linear = np.clip(photo * (look.exposure * fall)[..., None], 0, 1)
    coded = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055) * 255
    noisy = coded + random.normal(0, 1, coded.shape).astype(np.float32) * look.noise_counts
    image = np.clip(np.rint(noisy), 0, 255).astype(np.uint8)
    if look.jpeg_quality is None:
        return image
    _, packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, look.jpeg_quality])
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)
