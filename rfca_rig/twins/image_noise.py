"""What comes between a leg and the picture of it, and what the sensor makes of the light."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.twins.painting import Light

MID_GREY = 0.2
DARK_SHARE = 0.02  # of white: noise of a dark pixel is that of so much light


@dataclass(frozen=True)
class Disturbance:
    """All of it absent unless named.

    `defocus_px`: radius of the disc into which a point is blurred. `noise_counts`: one standard deviation at mid grey, of 255;
    it grows with the root of the light. `uneven_light`: share of the light that is missing at the picture's darkest edge, which
    side by chance. `glints`: bright streaks on the shells, whose number that is. `hidden_mark`: the number, from 0, of a mark whose
    `hidden_share` (of its diameter) the rig's frame hides. `red_things`: number of red discs and strips behind the leg.
    `reflection`: share of the light that a ground mirrors, where there is one. `jpeg_quality`: None or 1 to 100, with the
    colours stored at half the resolution, as cameras do.
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


def lit(scene: Light, disturbance: Disturbance, random: np.random.Generator) -> Light:
    """The scene (rows, columns, 3) under a light that falls off from one side of the picture to the other."""
    turn = random.uniform(0.0, 2.0 * np.pi)
    rows, columns = scene.shape[:2]
    across = np.linspace(-1.0, 1.0, columns, dtype=np.float32) * np.float32(np.cos(turn))
    down = np.linspace(-1.0, 1.0, rows, dtype=np.float32) * np.float32(np.sin(turn))
    toward = (across[None, :] + down[:, None]) / np.float32(abs(np.cos(turn)) + abs(np.sin(turn)))
    light = np.float32(1.0) - np.float32(0.5 * disturbance.uneven_light) * (np.float32(1.0) - toward)
    return np.asarray(scene * light[..., None])


def seen_by_sensor(light: Light, disturbance: Disturbance, random: np.random.Generator) -> NDArray[np.uint8]:
    """Out of focus, noisy, in the steps and the curve of sRGB (IEC 61966-2-1), and through JPEG."""
    if disturbance.defocus_px > 0.0:
        light = np.asarray(cv2.filter2D(light, -1, _disc(disturbance.defocus_px), borderType=cv2.BORDER_REPLICATE), np.float32)
    if disturbance.noise_counts > 0.0:
        light = light + _noise(light, disturbance.noise_counts, random)
    counts = np.round(255.0 * _curve(np.clip(light, 0.0, 1.0))).astype(np.uint8)
    if disturbance.jpeg_quality is None:
        return counts
    stored = cv2.imencode(".jpg", counts, [cv2.IMWRITE_JPEG_QUALITY, disturbance.jpeg_quality])[1]
    return np.asarray(cv2.imdecode(stored, cv2.IMREAD_COLOR), np.uint8)


def _disc(radius_px: float) -> Light:
    """A point's picture: a disc whose rim covers its pixels in part."""
    reach, finer = int(np.ceil(radius_px)), 9
    steps = (np.arange((2 * reach + 1) * finer) + 0.5) / finer - 0.5 - reach
    inside = (steps[:, None] ** 2 + steps[None, :] ** 2 <= radius_px**2).astype(np.float32)
    kernel = cv2.resize(inside, (2 * reach + 1, 2 * reach + 1), interpolation=cv2.INTER_AREA)
    return np.asarray(kernel / kernel.sum(), np.float32)


def _noise(light: Light, counts: float, random: np.random.Generator) -> Light:
    """In linear light: the square root of the light, and a floor."""
    counts_per_light = 255.0 * 1.055 / 2.4 * MID_GREY ** (1 / 2.4 - 1.0)
    scale = np.float32(counts / counts_per_light / np.sqrt(MID_GREY + DARK_SHARE))
    spread = np.sqrt(np.maximum(light, 0.0) + np.float32(DARK_SHARE))
    return np.asarray(scale * spread * random.standard_normal(light.shape, dtype=np.float32))


def _curve(light: Light) -> Light:
    return np.asarray(np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 0.0031308) ** (1 / 2.4) - 0.055), np.float32)
