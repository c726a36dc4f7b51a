"""Legs before the ray tracer with everything that disturbs a photo, drawn from a seed: `draw_leg`,
then `photograph` for each stage.

A leg keeps its camera, its glued marks, its lights and its clutter over all its stages; only the
pose changes, as in a static run.
"""

from dataclasses import dataclass, replace
from itertools import pairwise

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.vision.camera_model import CameraModel, Floats
from tests.vision.ray_photo import CAPSULE, DISC, SHELL, Lens, Lighting, Sensor, Surface, take_photo
from tests.vision.scenes import LENGTHS_M

TOWARDS_CAMERA = np.array([1.0, 0.0, 0.0])
DIAMETER_M = 0.008
RED = np.array([0.52, 0.028, 0.035])
DEMOSAICING = (cv2.COLOR_BayerBG2BGR, cv2.COLOR_BayerBG2BGR_EA)
# Error of gluing within the plane, standard deviation in each direction.
GLUED_STD_M = 5e-5
# Half the thickness of marks and half the range of the offsets out of the plane, by kind of leg.
# Half the width of the shells: between a mark and a cable behind its shell a dark gap of 0.2 to
# 0.45 diameters remains.
SHELL_M = (0.0056, 0.0075)
OFFSETS_M = {"one plane": 5e-5, "up to 1 mm": 1e-3, "up to 3 mm": 3e-3}


@dataclass(frozen=True)
class Leg:
    """One leg before its camera: glued errors (8, 2) m in the plane, offsets (8,) m out of it,
    and the scene around it.
    """

    lens: Lens
    lighting: Lighting
    sensor: Sensor
    glued_m: Floats
    offsets_m: Floats
    gloss: tuple[float, float, float]
    shell: Floats
    clutter: tuple[Surface, ...]
    covers: tuple[tuple[int, float, float], ...]
    background: tuple[float, float]
    poses_rad: Floats
    kinds: dict[str, str]
    shell_m: float = SHELL_M[1]


def draw_leg(seed: int, width_px: int, stages: int) -> Leg:
    """The leg of a seed."""
    random = np.random.default_rng([seed, width_px])
    plane = str(random.choice(list(OFFSETS_M), p=[0.4, 0.3, 0.3]))
    low = -OFFSETS_M[plane] if plane == "one plane" else 0.0
    light = str(
        random.choice(["even", "cool shadow", "dark", "bright"], p=[0.35, 0.25, 0.25, 0.15])
    )
    surface = str(random.choice(["matt", "satin", "glossy"], p=[0.4, 0.3, 0.3]))
    gloss = {"matt": (0.0, 10.0, 0.0), "satin": (0.04, 12.0, 0.05), "glossy": (0.25, 60.0, 0.12)}[
        surface
    ]
    lens, blur = _lens(random, width_px)
    clutter, kinds = _clutter(random)
    covers = tuple(
        (int(i), float(random.uniform(0, 6.28)), float(random.uniform(0.1, 0.8)))
        for i in _chosen(random, 0.35)
    )
    exposure = {
        "even": random.uniform(0.8, 1.3),
        "cool shadow": random.uniform(0.8, 1.4),
        "dark": random.uniform(0.12, 0.3),
    }
    sensor = Sensor(
        exposure=float(exposure.get(light, random.uniform(1.6, 2.6))),
        full_well=float(random.choice([3000.0, 9000.0, 25000.0])),
        read_electrons=float(random.uniform(2.0, 8.0)),
        blur_px=float(random.uniform(0.4, 0.8)),
        demosaicing=DEMOSAICING[int(random.integers(2))],
        saturation=float(random.uniform(1.0, 1.4)),
        sharpening=float(random.choice([0.0, 0.0, 0.6])),
        jpeg_quality=int(random.integers(75, 98)) if random.random() < 0.8 else None,
    )
    lighting = _lighting(random, light)
    glued = random.normal(0.0, GLUED_STD_M, (8, 2))
    offsets = random.uniform(low, OFFSETS_M[plane], 8)
    shell = np.full(3, random.uniform(0.008, 0.05)) * random.uniform(0.85, 1.15, 3)
    background = (
        float(random.uniform(0.08, 0.4)),
        float(random.choice([0.01, 0.03, 0.12, 0.4], p=[0.4, 0.3, 0.2, 0.1])),
    )
    poses = _poses(random, stages)
    if random.random() < 0.3:
        if kinds == "none":
            kinds = "cable at marks"
        else:
            kinds = f"{kinds}+cable at marks"
        clutter = (*clutter, *_cable_at_marks(random, poses))
    return Leg(
        lens,
        lighting,
        sensor,
        glued,
        offsets,
        gloss,
        shell,
        clutter,
        covers,
        background,
        poses,
        {"plane": plane, "light": light, "surface": surface, "blur": blur, "clutter": kinds},
        float(random.uniform(*SHELL_M)),
    )


def _chosen(random: np.random.Generator, share: float) -> NDArray[np.int64]:
    return random.choice(
        8, int(random.random() < share) + int(random.random() < 0.3 * share), False
    )


def _lens(random: np.random.Generator, width_px: int) -> tuple[Lens, str]:
    """A camera in front of the plane, the leg somewhere about the middle of its picture."""
    distance = float(random.uniform(0.6, 1.1))
    height_px = width_px * 3 // 4
    focal = width_px * distance / float(random.uniform(0.44, 0.50))
    turn, _ = cv2.Rodrigues(np.radians(random.uniform([-9, -9, -2], [9, 9, 2])))
    axes = turn @ np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])
    # The point that the camera looks at.
    middle = np.array([0.0, random.uniform(0.03, 0.11), random.uniform(-0.15, -0.11)])
    position = middle - distance * axes[2]
    centre = (width_px / 2 + random.uniform(-8, 8), height_px / 2 + random.uniform(-8, 8))
    distortion = tuple(
        float(value)
        for value in random.uniform([-0.15, -0.05, -8e-4, -8e-4, 0.0], [0.05, 0.1, 8e-4, 8e-4, 0.0])
    )
    blur = str(random.choice(["sharp", "soft", "out of focus"], p=[0.5, 0.3, 0.2]))
    # Blur of the leg as a share of a mark's diameter, by a lens that is focused somewhat behind or
    # before it.
    share = {
        "sharp": random.uniform(0.0, 0.03),
        "soft": random.uniform(0.03, 0.1),
        "out of focus": random.uniform(0.1, 0.2),
    }[blur]
    aperture = float(random.uniform(0.002, 0.006))
    defocus = share * DIAMETER_M / aperture
    focus = distance / (1.0 + float(random.choice([-1, 1])) * min(0.3, defocus))
    return Lens(
        position, axes, focal, centre, distortion, (width_px, height_px), aperture, focus
    ), blur


def _lighting(random: np.random.Generator, kind: str) -> Lighting:
    key = np.array([random.uniform(0.5, 1.0), random.uniform(-0.7, 0.7), random.uniform(0.0, 0.8)])
    fill = np.array(
        [random.uniform(0.4, 1.0), random.uniform(-0.8, 0.8), random.uniform(-0.3, 0.8)]
    )
    warm = np.array([1.15, 1.0, 0.8])
    cool = np.array([0.6, 0.95, 1.45])
    strength = 0.8 * float(key @ key)
    blockers: tuple[Surface, ...] = ()
    if kind == "cool shadow":
        # A bar between the warm light and some part of the leg.
        target = np.array([0.0, random.uniform(0.0, 0.12), random.uniform(-0.2, -0.02)])
        middle = target + random.uniform(0.15, 0.5) * (key - target)
        along = np.array([0.0, *random.normal(0.0, 1.0, 2)])
        along *= 0.3 / np.linalg.norm(along)
        blockers = (
            Surface(
                CAPSULE,
                middle - along,
                middle + along,
                float(random.uniform(0.01, 0.04)),
                RED,
                TOWARDS_CAMERA,
            ),
        )
    share = float(random.uniform(0.15, 0.5)) * float(fill @ fill)
    colours = np.array([strength * warm, share * cool])
    return Lighting(
        np.array([key, fill]),
        colours,
        random.uniform(0.01, 0.15, 2),
        cool * float(random.uniform(0.03, 0.12)),
        blockers,
    )


def _clutter(random: np.random.Generator) -> tuple[tuple[Surface, ...], str]:
    """Red cables, balls and discs behind the leg, and a grey bar below it."""
    things: list[Surface] = []
    words = []
    if random.random() < 0.45:
        words.append("cable")
        points = np.column_stack(
            [
                -random.uniform(0.008, 0.06, 5),
                random.uniform(-0.02, 0.16, 5),
                random.uniform(-0.24, 0.02, 5),
            ]
        )
        radius = float(random.uniform(0.0015, 0.004))
        colour = RED * random.uniform(0.6, 1.2)
        things += [
            Surface(CAPSULE, a, b, radius, colour, TOWARDS_CAMERA, 0.0, 0.08, 40.0)
            for a, b in pairwise(points)
        ]
    if random.random() < 0.4:
        words.append("red things")
        for _ in range(random.integers(1, 4)):
            place = np.array(
                [
                    -random.uniform(0.012, 0.07),
                    random.uniform(-0.05, 0.25),
                    random.uniform(-0.27, 0.05),
                ]
            )
            radius = float(random.uniform(0.003, 0.012))
            kind = int(random.choice([CAPSULE, DISC]))
            things.append(
                Surface(
                    kind,
                    place,
                    place,
                    radius,
                    RED * random.uniform(0.6, 1.2),
                    TOWARDS_CAMERA,
                    0.0,
                    0.1,
                    60.0,
                )
            )
    if random.random() < 0.5:
        grey = np.full(3, random.uniform(0.05, 0.4))
        ends = [np.array([-0.02, y, -0.33]) for y in (-0.4, 0.6)]
        things.append(
            Surface(CAPSULE, ends[0], ends[1], 0.03, grey, TOWARDS_CAMERA, 0.0, 0.2, 30.0)
        )
    if random.random() < 0.3:
        # Screws: small bright balls on the shells' level.
        for _ in range(4):
            place = np.array([-0.001, random.uniform(0.0, 0.12), random.uniform(-0.22, 0.0)])
            things.append(
                Surface(
                    CAPSULE, place, place, 0.0012, np.full(3, 0.3), TOWARDS_CAMERA, 0.0, 0.8, 40.0
                )
            )
    return tuple(things), "+".join(words) or "none"


def _cable_at_marks(random: np.random.Generator, poses_rad: Floats) -> list[Surface]:
    """A red cable close behind the shells, through the places of two marks in one of the poses."""
    angles = poses_rad[int(random.integers(len(poses_rad)))]
    chain = np.vstack(
        [
            np.zeros(2),
            np.cumsum(
                LENGTHS_M[:, None] * np.column_stack([np.cos(angles), -np.sin(angles)]), axis=0
            ),
        ]
    )
    first, last = np.sort(random.choice(8, 2, False))
    near = [chain[first] + random.normal(0.0, 0.003, 2), chain[last] + random.normal(0.0, 0.003, 2)]
    points = np.array(
        [near[0] + random.normal(0.0, 0.06, 2), *near, near[1] + random.normal(0.0, 0.06, 2)]
    )
    behind = -random.uniform(0.007, 0.02, 4)
    radius = float(random.uniform(0.0015, 0.004))
    ways = pairwise(np.column_stack([behind, points]))
    return [
        Surface(
            CAPSULE, a, b, radius, RED * random.uniform(0.6, 1.2), TOWARDS_CAMERA, 0.0, 0.08, 40.0
        )
        for a, b in ways
    ]


def _poses(random: np.random.Generator, stages: int) -> Floats:
    """Absolute link angles (stages, 7) rad of a leg that is pressed on the ground further and
    further, then let back.
    """
    first = np.radians(np.linspace(random.uniform(60.0, 80.0), random.uniform(95.0, 130.0), stages))
    strength = np.radians(
        np.linspace(random.uniform(-4.0, 0.0), random.uniform(-22.0, -10.0), stages)
    )
    shape = np.linspace(1.2, 0.4, 6) + random.normal(0.0, 0.12, 6)
    hinges = strength[:, None] * shape + np.radians(random.normal(0.0, 0.7, (stages, 6)))
    return np.column_stack([first, first[:, None] + np.cumsum(hinges, axis=1)])


def camera_model(lens: Lens) -> CameraModel:
    """The calibrated camera of a lens, without any error of calibration."""
    matrix = np.array(
        [[lens.focal_px, 0, lens.centre_px[0]], [0, lens.focal_px, lens.centre_px[1]], [0, 0, 1.0]]
    )
    return CameraModel(
        matrix, np.array(lens.distortion), lens.size_px, lens.axes, -lens.axes @ lens.position_m
    )


def mark_places(leg: Leg, stage: int) -> Floats:
    """Centres of the marks (8, 2) m as they are glued, projected at right angles into the plane."""
    angles = leg.poses_rad[stage]
    steps = LENGTHS_M[:, None] * np.column_stack([np.cos(angles), -np.sin(angles)])
    # A mark turns with the link that it is glued to.
    turned = [_turned(angles[max(0, index - 1)]) @ error for index, error in enumerate(leg.glued_m)]
    return np.vstack([np.zeros(2), np.cumsum(steps, axis=0)]) + np.array(turned)


def _turned(angle_rad: float) -> Floats:
    cosine = np.cos(angle_rad)
    sine = np.sin(angle_rad)
    return np.array([[cosine, -sine], [-sine, -cosine]])


def project(lens: Lens, points_m: Floats) -> Floats:
    """Pixels (n, 2) of points (n, 3) (x, y, z)."""
    seen = (points_m - lens.position_m) @ lens.axes.T
    x = seen[:, 0] / seen[:, 2]
    y = seen[:, 1] / seen[:, 2]
    k1, k2, p1, p2, k3 = lens.distortion
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    distorted = [
        x * radial + 2 * p1 * x * y + p2 * (square + 2 * x * x),
        y * radial + p1 * (square + 2 * y * y) + 2 * p2 * x * y,
    ]
    return lens.focal_px * np.column_stack(distorted) + np.array(lens.centre_px)


def true_hinges_rad(leg: Leg, stage: int) -> Floats:
    """Angles (6,) of the hinges; marks beside their axes show other ones."""
    return np.asarray(np.diff(leg.poses_rad[stage]))


def photograph(leg: Leg, stage: int) -> tuple[NDArray[np.uint8], Floats]:
    """Photo of one stage, and for each mark the share of its picture that nothing hides."""
    random = np.random.default_rng([stage, *map(ord, repr(leg.sensor.exposure))])
    places = mark_places(leg, stage)
    gloss, sharpness, dome = leg.gloss
    marks = [
        Surface(
            DISC, place, place, DIAMETER_M / 2, RED, TOWARDS_CAMERA, dome, gloss, sharpness, index
        )
        for index, place in enumerate(np.column_stack([leg.offsets_m, places]))
    ]
    ends = np.column_stack(
        [np.minimum(leg.offsets_m[:-1], leg.offsets_m[1:]) - 4e-4, places[:-1], places[1:]]
    )
    shells = [
        Surface(
            SHELL,
            np.array([x, *a]),
            np.array([x, *b]),
            leg.shell_m,
            leg.shell,
            TOWARDS_CAMERA,
            0.35,
            gloss,
            sharpness,
        )
        for x, *rest in ends
        for a, b in [(rest[:2], rest[2:])]
    ]
    covers = [
        _cover(place, side, share) for index, side, share in leg.covers for place in [places[index]]
    ]
    surfaces = (*marks, *shells, *leg.clutter, *covers)
    # Things before the leg throw shadows on it.
    lighting = replace(leg.lighting, blockers=(*leg.lighting.blockers, *covers))
    return take_photo(surfaces, leg.lens, lighting, leg.sensor, leg.background, random)


def _cover(place_m: Floats, side_rad: float, share: float) -> Surface:
    """A grey rod 10 mm before the plane that hides a share of a mark's diameter, when seen
    straight on.
    """
    radius = 0.005
    out = np.array([np.cos(side_rad), np.sin(side_rad)])
    middle = place_m + out * (DIAMETER_M * (0.5 - share) + radius)
    along = 0.015 * np.array([-out[1], out[0]])
    ends = [np.array([0.01, *(middle + way * along)]) for way in (-1, 1)]
    return Surface(
        CAPSULE, ends[0], ends[1], radius, np.full(3, 0.12), TOWARDS_CAMERA, 0.0, 0.05, 30.0
    )
