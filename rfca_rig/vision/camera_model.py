"""How a camera sees the plane of motion: pinhole, lens distortion, and where the camera stands.

Plane frame: the shaft axis is the origin, y runs along the ground, z up in the plane of motion, x completes the right-handed frame.
A link at the absolute angle a (from +y, positive downwards) therefore ends at (y, z) = (L cos a, -L sin a). The plane meant is
the one the marks lie in. Camera frame and distortion as OpenCV has them: x right, y down, z along the view; coefficients k1, k2, p1, p2, k3
(Brown 1966; OpenCV, "Camera Calibration and 3D Reconstruction").
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]
NEWTON_STEPS = 30
CIRCLE_POINTS = 64


@dataclass(frozen=True)
class CameraModel:
    """matrix (3, 3) px; distortion (5,); image_size_px (width, height); rotation (3, 3), translation_m (3,) from plane to camera frame."""

    matrix: Floats
    distortion: Floats
    image_size_px: tuple[int, int]
    rotation: Floats
    translation_m: Floats

    def __post_init__(self) -> None:
        shapes = {"matrix": (3, 3), "distortion": (5,), "rotation": (3, 3), "translation_m": (3,)}
        for name, shape in shapes.items():
            value = np.array(getattr(self, name), dtype=np.float64)
            if value.shape != shape or not np.isfinite(value).all():
                raise BadInput(f"camera: {name} must be finite numbers of shape {shape}, not {value.shape}; calibrate the camera again")
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        if not np.allclose(self.rotation @ self.rotation.T, np.eye(3), atol=1e-6) or np.linalg.det(self.rotation) < 0:
            raise BadInput("camera: rotation must be a rotation matrix (orthonormal, determinant +1); calibrate the camera again")

    def project(self, points_m: ArrayLike) -> Floats:
        """Pixels (..., 2) of points (..., 2) (y, z) in the plane, or (..., 3) (x, y, z) anywhere in front of the camera, in metres."""
        seen = self._in_camera(_spatial(points_m))
        return self._pixels(_distorted(seen[..., :2] / seen[..., 2:], self.distortion))

    def project_jacobian(self, points_m: ArrayLike) -> Floats:
        """d px / d (y, z), (..., 2, 2) in px/m, at points (..., 2) in the plane."""
        seen = self._in_camera(_spatial(points_m))
        depth = seen[..., 2:]
        ideal = seen[..., :2] / depth
        columns = self.rotation[:, 1:]
        by_plane = (columns[:2] - ideal[..., :, None] * columns[2]) / depth[..., None]
        return np.asarray(self.matrix[:2, :2] @ _distortion_jacobian(ideal, self.distortion) @ by_plane)

    def on_plane(self, px: ArrayLike) -> Floats:
        """Points (..., 2) (y, z) in metres in the plane that are seen at pixels (..., 2).

        Raises BadInput where the lens model has no inverse, which happens only far outside of the picture it was calibrated on.
        """
        target = np.asarray(px, dtype=np.float64)
        point = self._without_lens(target)
        for _ in range(NEWTON_STEPS):
            miss = self.project(point) - target
            point = point - np.linalg.solve(self.project_jacobian(point), miss[..., None])[..., 0]
            if not np.isfinite(point).all():
                break
            if not miss.size or np.max(np.abs(miss)) < 1e-8:
                if not self._unfolded(point):
                    break
                return point
        raise BadInput(
            "camera: a pixel cannot be traced back through the lens distortion; calibrate with photos that fill the whole picture"
        )

    def on_plane_jacobian(self, px: ArrayLike) -> Floats:
        """d (y, z) / d px, (..., 2, 2) in m/px, at pixels (..., 2)."""
        return np.asarray(np.linalg.inv(self.project_jacobian(self.on_plane(px))))

    def circle_shift_px(self, centres_m: ArrayLike, diameter_m: float) -> Floats:
        """How far (..., 2) the middle of a circle's picture lies from the picture of its middle, by perspective and lens."""
        centres = np.asarray(centres_m, dtype=np.float64)
        turn = np.linspace(0.0, 2.0 * np.pi, CIRCLE_POINTS, endpoint=False)
        rim = centres[..., None, :] + 0.5 * diameter_m * np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        return _centroid(self.project(rim)) - self.project(centres)

    def disc_diameter_px(self, centres_m: ArrayLike, diameter_m: float) -> Floats:
        """Diameter (...) of the disc in the picture that has the area of a flat disc at points (..., 2) in the plane."""
        area = np.abs(np.linalg.det(self.project_jacobian(centres_m)))
        return np.asarray(diameter_m * np.sqrt(area))

    def discs_on_plane(self, px: ArrayLike, diameter_m: float) -> Floats:
        """Centres (..., 2) in the plane of discs whose pictures have their middles at pixels (..., 2)."""
        centres = np.asarray(px, dtype=np.float64)
        for _ in range(2):
            centres = np.asarray(px) - self.circle_shift_px(self.on_plane(centres), diameter_m)
        return self.on_plane(centres)

    def _in_camera(self, points_m: Floats) -> Floats:
        return np.asarray(points_m @ self.rotation.T + self.translation_m)

    def _unfolded(self, points_m: Floats) -> bool:
        """The lens model is one to one from the middle of the picture out to the points; beyond, it maps the scene back onto itself."""
        seen = self._in_camera(_spatial(points_m))
        outwards = np.linspace(0.1, 1.0, 10).reshape(-1, *[1] * seen.ndim)
        slopes = _distortion_jacobian(outwards * (seen[..., :2] / seen[..., 2:]), self.distortion)
        return bool((np.linalg.det(slopes) > 0.0).all() and (seen[..., 2] > 0.0).all())

    def _pixels(self, normal: Floats) -> Floats:
        return np.asarray(normal @ self.matrix[:2, :2].T + self.matrix[:2, 2])

    def _without_lens(self, px: Floats) -> Floats:
        """Where straight rays through the pixels meet the plane: the start of the search with the lens."""
        rays = np.linalg.solve(self.matrix, np.concatenate([px, np.ones((*px.shape[:-1], 1))], axis=-1)[..., None])[..., 0]
        directions = rays @ self.rotation
        origin = -self.translation_m @ self.rotation
        return np.asarray(origin[1:] - directions[..., 1:] * (origin[0] / directions[..., :1]))


def _spatial(points_m: ArrayLike) -> Floats:
    points = np.asarray(points_m, dtype=np.float64)
    if points.shape[-1] == 3:
        return points
    return np.concatenate([np.zeros((*points.shape[:-1], 1)), points], axis=-1)


def _distorted(ideal: Floats, distortion: Floats) -> Floats:
    k1, k2, p1, p2, k3 = distortion
    x, y = ideal[..., 0], ideal[..., 1]
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    across = x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x)
    down = y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack([across, down], axis=-1)


def _distortion_jacobian(ideal: Floats, distortion: Floats) -> Floats:
    k1, k2, p1, p2, k3 = distortion
    x, y = ideal[..., 0], ideal[..., 1]
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    slope = 2.0 * (k1 + square * (2.0 * k2 + square * 3.0 * k3))
    mixed = x * y * slope + 2.0 * (p1 * x + p2 * y)
    xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return np.stack([np.stack([xx, mixed], axis=-1), np.stack([mixed, yy], axis=-1)], axis=-2)


def _centroid(rim: Floats) -> Floats:
    """Centre of area (..., 2) of closed outlines (..., n, 2)."""
    middle = rim.mean(axis=-2, keepdims=True)
    here = rim - middle
    after = np.roll(here, -1, axis=-2)
    cross = here[..., 0] * after[..., 1] - after[..., 0] * here[..., 1]
    moment = ((here + after) * cross[..., None]).sum(axis=-2)
    return np.asarray(middle[..., 0, :] + moment / (3.0 * cross.sum(axis=-1)[..., None]))
