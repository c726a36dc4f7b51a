"""Photos of a board through a known camera, by rays from every pixel: nothing of the calibration
is used.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.vision.board import MARGIN_M, Board, board_picture

Floats = NDArray[np.float64]
FINER = 2
PX_PER_M = 10_000.0


@dataclass(frozen=True)
class TrueCamera:
    """focal (2,), centre (2,), distortion k1 k2 p1 p2 k3, size (width, height)."""

    focal: tuple[float, float] = (1310.0, 1304.0)
    centre: tuple[float, float] = (655.0, 470.0)
    distortion: tuple[float, float, float, float, float] = (-0.21, 0.09, 0.0007, -0.0005, 0.0)
    size: tuple[int, int] = (1280, 960)


@cache
def rays(camera: TrueCamera) -> tuple[Floats, Floats]:
    """Undistorted (x, y) at depth 1 of FINER x FINER points in each pixel, by iteration from the
    distorted ones.
    """
    across, down = (
        ((np.arange(FINER * n) + 0.5) / FINER - 0.5 - c) / f
        for n, c, f in zip(camera.size, camera.centre, camera.focal, strict=True)
    )
    xd, yd = np.meshgrid(across, down)
    x = xd.copy()
    y = yd.copy()
    k1, k2, p1, p2, k3 = camera.distortion
    for _ in range(12):
        square = x * x + y * y
        radial = 1 + square * (k1 + square * (k2 + square * k3))
        x, y = (
            (xd - 2 * p1 * x * y - p2 * (square + 2 * x * x)) / radial,
            (yd - p1 * (square + 2 * y * y) - 2 * p2 * x * y) / radial,
        )
    return x.astype(np.float32), y.astype(np.float32)


@cache
def sheet_of(board: Board) -> NDArray[np.float32]:
    return cv2.GaussianBlur(board_picture(board, PX_PER_M), (0, 0), 1.0).astype(np.float32)


def turn(about_right_deg: float, about_down_deg: float, about_view_deg: float) -> Floats:
    vector = [
        np.radians([about_right_deg, 0, 0]),
        np.radians([0, about_down_deg, 0]),
        np.radians([0, 0, about_view_deg]),
    ]
    right, down, view = (cv2.Rodrigues(each)[0] for each in vector)
    return down @ right @ view


def board_photo(
    board: Board,
    camera: TrueCamera,
    rotation: Floats,
    translation_m: Floats,
    random: np.random.Generator,
    blur_px: float = 0.6,
    noise: float = 2.0,
) -> NDArray[np.uint8]:
    """The board's upper left corner at `translation_m` from the camera, its axes the columns of
    `rotation`.
    """
    sheet = sheet_of(board)
    x, y = rays(camera)
    normal = rotation[:, 2]
    depth = (normal @ translation_m) / (normal[0] * x + normal[1] * y + normal[2])
    offsets = [x * depth - translation_m[0], y * depth - translation_m[1], depth - translation_m[2]]
    on_sheet = [
        (sum(rotation[axis, way] * offsets[axis] for axis in range(3)) + MARGIN_M) * PX_PER_M - 0.5
        for way in (0, 1)
    ]
    seen = cv2.remap(
        sheet, *(each.astype(np.float32) for each in on_sheet), cv2.INTER_LINEAR, borderValue=90.0
    )
    photo = cv2.resize(seen, camera.size, interpolation=cv2.INTER_AREA)
    photo = (
        25 + 0.75 * cv2.GaussianBlur(photo, (0, 0), blur_px) + random.normal(0, noise, photo.shape)
    )
    return cv2.cvtColor(np.clip(np.round(photo), 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)


def centred(board: Board, rotation: Floats, middle_m: Floats) -> Floats:
    """Translation that puts the board's middle at `middle_m`."""
    width, height = board.size_m()
    return np.asarray(middle_m - rotation @ np.array([width / 2, height / 2, 0.0]))


def tilted_all_ways(board: Board) -> list[tuple[Floats, Floats]]:
    tilts = [
        (0, 0, 0),
        (30, 0, 5),
        (-30, 5, 0),
        (0, 32, -8),
        (5, -32, 0),
        (25, 25, 90),
        (-25, 25, 10),
        (25, -25, 0),
        (-22, -28, -90),
        (10, 10, 180),
    ]
    middles = [
        (0, 0),
        (-60, 40),
        (60, -40),
        (-80, -50),
        (80, 50),
        (-70, 0),
        (70, 10),
        (0, -60),
        (0, 60),
        (-40, -30),
    ]
    poses = []
    for at, (tilt, middle) in enumerate(zip(tilts, middles, strict=True)):
        rotation = turn(*tilt)
        poses.append(
            (
                rotation,
                centred(
                    board, rotation, np.array([middle[0] / 1e3, middle[1] / 1e3, 0.40 + 0.012 * at])
                ),
            )
        )
    return poses
