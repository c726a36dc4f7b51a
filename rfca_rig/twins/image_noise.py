"""Images of the camera twin: anti-aliased polygons in linear light, and what a camera adds to them.

These are uneven light, defocus, sensor noise, sRGB encoding and JPEG.
"""

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Light = NDArray[np.float32]

# Supersampling factor per axis: fine for small shapes, coarse from LARGE_PX pixels on.
FINE = 8
COARSE = 2
LARGE_PX = 400_000
# Fractional bits of OpenCV's fixed-point outlines.
SHIFT = 6
# Coordinates are clipped here, so that they fit OpenCV's 32 bit fixed-point numbers.
MAX_COORDINATE_PX = 30_000.0

# So many rows of a picture stay in the processor's cache with what is computed from them.
ROWS_AT_ONCE = 16
# Bits of a light's 32 bit floating point number that do not choose its interval in the table of
# counts.
TABLE_SHIFT = np.uint32(15)

# Linear light at which `noise_counts` applies.
MID_GREY = 0.2
# Share of white: the noise of a dark pixel equals that of this much light.
DARK_SHARE = 0.02


def paint(
    picture: Light, outline_px: Floats, colour: tuple[float, float, float], opacity: float = 1.0
) -> None:
    """Paints `colour` (blue, green, red; 1 is white) over the inside of a closed outline (n, 2)
    in `picture` (rows, columns, 3).
    """
    covered = compute_coverage(picture.shape[:2], outline_px)
    if covered is None:
        return
    rows, columns, share = covered
    region = picture[rows, columns]
    region += (opacity * share)[..., None] * (np.array(colour, np.float32) - region)


def compute_coverage(
    shape: tuple[int, ...], outline_px: Floats
) -> tuple[slice, slice, Light] | None:
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
        Row slice, column slice and shares (rows, columns) in 0..1 of the bounding box; None if it
        is outside the image.
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
    share = cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA).astype(
        np.float32
    ) / np.float32(255.0)
    return slice(first[1], last[1]), slice(first[0], last[0]), share


@dataclass(frozen=True)
class ImageDisturbance:
    """Image disturbances; by default there are none.

    `defocus_px`: radius of the disc into which a point is blurred. `noise_counts`: standard
    deviation at mid grey in counts of 255; it grows with the square root of the light.
    `uneven_light`: share of the light missing at the darkest edge, on a random side. `glints`:
    number of bright streaks on the shells. `hidden_mark`: index from 0 of a mark that the rig's
    frame partly hides, by `hidden_share` of its diameter. `red_things`: number of red discs and
    strips behind the leg. `reflection`: share of the light that the ground reflects, if there is
    one. `jpeg_quality`: None or 1 to 100, with chroma stored at half the resolution, as in cameras.
    """

    defocus_px: float = 0.0
    noise_counts: float = 0.0
    uneven_light: float = 0.0
    glints: int = 0
    hidden_mark: int | None = None
    hidden_share: float = 0.5
    red_things: int = 0
    reflection: float = 0.0
    jpeg_quality: int | None = None


def apply_uneven_light(
    scene: Light, disturbance: ImageDisturbance, random: np.random.Generator
) -> Light:
    """The scene (rows, columns, 3), in linear light, under a light that falls off from one side
    of the image to the other.
    """
    turn = random.uniform(0.0, 2.0 * np.pi)
    rows, columns = scene.shape[:2]
    across = np.linspace(-1.0, 1.0, columns, dtype=np.float32) * np.float32(np.cos(turn))
    down = np.linspace(-1.0, 1.0, rows, dtype=np.float32) * np.float32(np.sin(turn))
    # -1 at the darkest corner, +1 at the brightest, for any direction of the light.
    toward = (across[None, :] + down[:, None]) / np.float32(abs(np.cos(turn)) + abs(np.sin(turn)))
    light = np.float32(1.0) - np.float32(0.5 * disturbance.uneven_light) * (
        np.float32(1.0) - toward
    )
    return np.asarray(scene * light[..., None])


def render_sensor_image(
    light: Light, disturbance: ImageDisturbance, random: np.random.Generator
) -> NDArray[np.uint8]:
    """Image of the sensor: defocus, noise, sRGB encoding (IEC 61966-2-1) in 256 steps, and JPEG
    compression.

    Parameters
    ----------
    light : ndarray, shape (rows, columns, 3)
        Linear light, 1 is white.
    disturbance : Disturbance
        Kinds and sizes of the disturbances.
    random : Generator
        Source of the noise.

    Returns
    -------
    ndarray, shape (rows, columns, 3)
        The image, uint8, in BGR order.
    """
    if disturbance.defocus_px > 0.0:
        light = np.asarray(
            cv2.filter2D(light, -1, _disc(disturbance.defocus_px), borderType=cv2.BORDER_REPLICATE),
            np.float32,
        )
    counts = np.empty(light.shape, np.uint8)
    for first in range(0, len(light), ROWS_AT_ONCE):
        rows = light[first : first + ROWS_AT_ONCE]
        if disturbance.noise_counts > 0.0:
            rows = rows + _noise(rows, disturbance.noise_counts, random)
        counts[first : first + ROWS_AT_ONCE] = _encode(rows)
    if disturbance.jpeg_quality is None:
        return counts
    stored = cv2.imencode(".jpg", counts, [cv2.IMWRITE_JPEG_QUALITY, disturbance.jpeg_quality])[1]
    return np.asarray(cv2.imdecode(stored, cv2.IMREAD_COLOR), np.uint8)


def _disc(radius_px: float) -> Light:
    """Image of a point: a disc (n, n) with partly covered pixels at its edge, normalised to sum
    1.
    """
    # Nine points per pixel and axis give the covered share of edge pixels.
    reach = int(np.ceil(radius_px))
    finer = 9
    steps = (np.arange((2 * reach + 1) * finer) + 0.5) / finer - 0.5 - reach
    inside = (steps[:, None] ** 2 + steps[None, :] ** 2 <= radius_px**2).astype(np.float32)
    kernel = cv2.resize(inside, (2 * reach + 1, 2 * reach + 1), interpolation=cv2.INTER_AREA)
    return np.asarray(kernel / kernel.sum(), np.float32)


def _noise(light: Light, counts: float, random: np.random.Generator) -> Light:
    """Sensor noise (rows, columns, 3) in linear light: shot noise with the square root of the
    light, and a floor.
    """
    # Slope of the sRGB curve at mid grey, to convert the noise from counts to linear light.
    counts_per_light = 255.0 * 1.055 / 2.4 * MID_GREY ** (1 / 2.4 - 1.0)
    scale = np.float32(counts / counts_per_light / np.sqrt(MID_GREY + DARK_SHARE))
    spread = np.sqrt(np.maximum(light, 0.0) + np.float32(DARK_SHARE))
    return np.asarray(scale * spread * random.standard_normal(light.shape, dtype=np.float32))


def _srgb(light: Light) -> Light:
    return np.asarray(
        np.where(
            light <= 0.0031308,
            12.92 * light,
            1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055,
        ),
        np.float32,
    )


def _round_to_count(light: Light) -> NDArray[np.uint8]:
    """Light, from 0 to 1, in 256 steps of the sRGB curve."""
    return np.asarray(np.round(255.0 * _srgb(light)), np.float32).astype(np.uint8)


def _encode(light: Light) -> NDArray[np.uint8]:
    """The same from a table, in less than half of the time; light is clipped to 0 to 1."""
    least, next_from = _make_count_table()
    # Contiguous, so that its bits can be looked at.
    clipped = np.ascontiguousarray(np.clip(light, 0.0, 1.0))
    interval = clipped.view(np.uint32) >> TABLE_SHIFT
    return np.asarray(least.take(interval) + (clipped >= next_from.take(interval)), np.uint8)


@cache
def _make_count_table() -> tuple[NDArray[np.uint8], Light]:
    """The count at the lower end of each interval of light, and the light from which on it is one
    more.

    An interval has all numbers with the same leading bits. It is 0.4 % of the light wide, so no
    interval has a third count.
    """
    ends = (
        np.arange(1, (int(np.float32(1.0).view(np.uint32)) >> TABLE_SHIFT) + 2, dtype=np.uint32)
        << TABLE_SHIFT
    )
    # Bisection of the bits, whose order is that of the numbers they stand for.
    low = ends - (1 << TABLE_SHIFT)
    high = ends
    least = _round_to_count(low.view(np.float32))
    while (middle := low + (high - low) // 2)[0] > low[0]:
        is_more = _round_to_count(middle.view(np.float32)) > least
        low = np.where(is_more, low, middle)
        high = np.where(is_more, middle, high)
    return least, high.view(np.float32)
