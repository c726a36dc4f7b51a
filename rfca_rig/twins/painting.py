"""Shapes painted into a picture of linear light, with the share of each pixel that they cover."""

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Light = NDArray[np.float32]

FINE, COARSE = 8, 2  # points of a pixel, each way, that are asked whether they are covered
LARGE_PX = 400_000
SHIFT = 6  # bits behind the point of OpenCV's whole-numbered outlines
FARTHEST_PX = 30_000.0


def paint(picture: Light, outline_px: Floats, colour: tuple[float, float, float], opacity: float = 1.0) -> None:
    """Lays `colour` (blue, green, red; 1 is white) over the inside of a closed outline (n, 2), into `picture` (rows, columns, 3)."""
    covered = covered_share(picture.shape[:2], outline_px)
    if covered is None:
        return
    rows, columns, share = covered
    there = picture[rows, columns]
    there += (opacity * share)[..., None] * (np.array(colour, np.float32) - there)


def covered_share(shape: tuple[int, ...], outline_px: Floats) -> tuple[slice, slice, Light] | None:
    """Where the outline's box lies in a picture of that shape, and the share of each of its pixels inside; None where all is outside.

    The middle of the first pixel is (0, 0).
    """
    outline = np.clip(outline_px, -FARTHEST_PX, FARTHEST_PX)
    first = np.clip(np.floor(outline.min(axis=0) - 1.0), 0, (shape[1], shape[0])).astype(int)
    last = np.clip(np.ceil(outline.max(axis=0) + 2.0), 0, (shape[1], shape[0])).astype(int)
    width, height = (last - first).tolist()
    if width <= 0 or height <= 0:
        return None
    finer = FINE if width * height < LARGE_PX else COARSE
    mask = np.zeros((height * finer, width * finer), np.uint8)
    at = (outline - first + 0.5) * finer - 0.5
    cv2.fillPoly(mask, [np.round(at * (1 << SHIFT)).astype(np.int32)], 255, shift=SHIFT)
    share = cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA).astype(np.float32) / np.float32(255.0)
    return slice(first[1], last[1]), slice(first[0], last[0]), share
