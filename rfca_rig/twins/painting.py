"""Anti-aliased painting of polygons into an image of linear light."""

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Light = NDArray[np.float32]

# Supersampling factor per axis: fine for small shapes, coarse from LARGE_PX pixels on.
FINE, COARSE = 8, 2
LARGE_PX = 400_000
# Fractional bits of OpenCV's fixed-point outlines.
SHIFT = 6
# Coordinates are clipped here, so that they fit OpenCV's 32 bit fixed-point numbers.
MAX_COORDINATE_PX = 30_000.0


def paint(picture: Light, outline_px: Floats, colour: tuple[float, float, float], opacity: float = 1.0) -> None:
    """Paints `colour` (blue, green, red; 1 is white) over the inside of a closed outline (n, 2) in `picture` (rows, columns, 3)."""
    covered = compute_coverage(picture.shape[:2], outline_px)
    if covered is None:
        return
    rows, columns, share = covered
    region = picture[rows, columns]
    region += (opacity * share)[..., None] * (np.array(colour, np.float32) - region)


def compute_coverage(shape: tuple[int, ...], outline_px: Floats) -> tuple[slice, slice, Light] | None:
    """Share of each pixel that lies inside an outline.

    Parameters
    ----------
    shape : tuple
        Rows and columns of the image.
    outline_px : ndarray, shape (n, 2)
        Closed outline as (x, y) in pixels; the centre of the first pixel is (0, 0).

    Returns
    -------
    tuple or None
        Row slice, column slice and shares (rows, columns) in 0..1 of the bounding box; None if it is outside the image.
    """
    outline = np.clip(outline_px, -MAX_COORDINATE_PX, MAX_COORDINATE_PX)
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
