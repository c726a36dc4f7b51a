"""Image degradation of the camera twin: uneven light, defocus, sensor noise, sRGB encoding, JPEG."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.twins.painting import Light

# Linear light at which `noise_counts` applies.
MID_GREY = 0.2
# Share of white: the noise of a dark pixel equals that of this much light.
DARK_SHARE = 0.02


@dataclass(frozen=True)
class ImageDisturbance:
    """Image disturbances; by default there are none.

    `defocus_px`: radius of the disc into which a point is blurred. `noise_counts`: standard deviation at mid grey in counts of 255;
    it grows with the square root of the light. `uneven_light`: share of the light missing at the darkest edge, on a random side.
    `glints`: number of bright streaks on the shells. `hidden_mark`: index from 0 of a mark that the rig's frame partly hides, by
    `hidden_share` of its diameter. `red_things`: number of red discs and strips behind the leg. `reflection`: share of the light that
    the ground reflects, if there is one. `jpeg_quality`: None or 1 to 100, with chroma stored at half the resolution, as in cameras.
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


def apply_uneven_light(scene: Light, disturbance: ImageDisturbance, random: np.random.Generator) -> Light:
    """The scene (rows, columns, 3), in linear light, under a light that falls off from one side of the image to the other."""
    turn = random.uniform(0.0, 2.0 * np.pi)
    rows, columns = scene.shape[:2]
    across = np.linspace(-1.0, 1.0, columns, dtype=np.float32) * np.float32(np.cos(turn))
    down = np.linspace(-1.0, 1.0, rows, dtype=np.float32) * np.float32(np.sin(turn))
    # -1 at the darkest corner, +1 at the brightest, for any direction of the light.
    toward = (across[None, :] + down[:, None]) / np.float32(abs(np.cos(turn)) + abs(np.sin(turn)))
    light = np.float32(1.0) - np.float32(0.5 * disturbance.uneven_light) * (np.float32(1.0) - toward)
    return np.asarray(scene * light[..., None])


def render_sensor_image(light: Light, disturbance: ImageDisturbance, random: np.random.Generator) -> NDArray[np.uint8]:
    """Image of the sensor: defocus, noise, sRGB encoding (IEC 61966-2-1) in 256 steps, and JPEG compression.

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
        light = np.asarray(cv2.filter2D(light, -1, _disc(disturbance.defocus_px), borderType=cv2.BORDER_REPLICATE), np.float32)
    if disturbance.noise_counts > 0.0:
        light = light + _noise(light, disturbance.noise_counts, random)
    counts = np.round(255.0 * _srgb(np.clip(light, 0.0, 1.0))).astype(np.uint8)
    if disturbance.jpeg_quality is None:
        return counts
    stored = cv2.imencode(".jpg", counts, [cv2.IMWRITE_JPEG_QUALITY, disturbance.jpeg_quality])[1]
    return np.asarray(cv2.imdecode(stored, cv2.IMREAD_COLOR), np.uint8)


def _disc(radius_px: float) -> Light:
    """Image of a point: a disc (n, n) with partly covered pixels at its edge, normalised to sum 1."""
    # Nine points per pixel and axis give the covered share of edge pixels.
    reach, finer = int(np.ceil(radius_px)), 9
    steps = (np.arange((2 * reach + 1) * finer) + 0.5) / finer - 0.5 - reach
    inside = (steps[:, None] ** 2 + steps[None, :] ** 2 <= radius_px**2).astype(np.float32)
    kernel = cv2.resize(inside, (2 * reach + 1, 2 * reach + 1), interpolation=cv2.INTER_AREA)
    return np.asarray(kernel / kernel.sum(), np.float32)


def _noise(light: Light, counts: float, random: np.random.Generator) -> Light:
    """Sensor noise (rows, columns, 3) in linear light: shot noise with the square root of the light, and a floor."""
    # Slope of the sRGB curve at mid grey, to convert the noise from counts to linear light.
    counts_per_light = 255.0 * 1.055 / 2.4 * MID_GREY ** (1 / 2.4 - 1.0)
    scale = np.float32(counts / counts_per_light / np.sqrt(MID_GREY + DARK_SHARE))
    spread = np.sqrt(np.maximum(light, 0.0) + np.float32(DARK_SHARE))
    return np.asarray(scale * spread * random.standard_normal(light.shape, dtype=np.float32))


def _srgb(light: Light) -> Light:
    return np.asarray(np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055), np.float32)
