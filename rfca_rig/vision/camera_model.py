"""Camera model for the plane of motion: pinhole, lens distortion, and the pose of the camera.

Plane frame: the shaft axis is the origin, y runs along the ground, z up in the plane of motion, x
completes the right-handed frame. A link at the absolute angle a (from +y, positive downwards)
therefore ends at (y, z) = (L cos a, -L sin a). The plane is the one in which the marks lie. Camera
frame and distortion are OpenCV's: x right, y down, z along the view; coefficients k1, k2, p1, p2,
k3 (Brown 1966; OpenCV, "Camera Calibration and 3D Reconstruction").
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
    """matrix (3, 3) px; distortion (5,); image_size_px (width, height); rotation (3, 3),
    translation_m (3,) from plane to camera frame.
    """

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
                raise BadInput(
                    f"camera: {name} must be finite numbers of shape {shape}, not "
                    f"{value.shape}; calibrate the camera again"
                )
            value.flags.writeable = False
            object.__setattr__(self, name, value)
        if (
            not np.allclose(self.rotation @ self.rotation.T, np.eye(3), atol=1e-6)
            or np.linalg.det(self.rotation) < 0
        ):
            raise BadInput(
                "camera: rotation must be a rotation matrix (orthonormal, determinant "
                "+1); calibrate the camera again"
            )

    def project(self, points_m: ArrayLike) -> Floats:
        """Pixels (..., 2) of points (..., 2) (y, z) in the plane, or (..., 3) (x, y, z) anywhere
        in front of the camera, in metres.
        """
        seen = self._to_camera(_to_space(points_m))
        return np.asarray(
            _distort(seen[..., :2] / seen[..., 2:], self.distortion) @ self.matrix[:2, :2].T
            + self.matrix[:2, 2]
        )

    def project_jacobian(self, points_m: ArrayLike) -> Floats:
        """d px / d (y, z), (..., 2, 2) in px/m, at points (..., 2) in the plane."""
        seen = self._to_camera(_to_space(points_m))
        depth = seen[..., 2:]
        ideal = seen[..., :2] / depth
        columns = self.rotation[:, 1:]
        by_plane = (columns[:2] - ideal[..., :, None] * columns[2]) / depth[..., None]
        return np.asarray(
            self.matrix[:2, :2] @ _distortion_jacobian(ideal, self.distortion) @ by_plane
        )

    def on_plane(self, px: ArrayLike) -> Floats:
        """Points (..., 2) (y, z) in metres in the plane that are seen at pixels (..., 2), by
        Newton's method to 1e-8 px.

        Raises BadInput where the lens model has no inverse, which happens only far outside the
        picture that it was calibrated on.
        """
        target = np.asarray(px, dtype=np.float64)
        # Start of the search: points where straight rays through the pixels meet the plane.
        rays = np.linalg.solve(
            self.matrix,
            np.concatenate([target, np.ones((*target.shape[:-1], 1))], axis=-1)[..., None],
        )[..., 0]
        directions = rays @ self.rotation
        origin = -self.translation_m @ self.rotation
        point: Floats = np.asarray(
            origin[1:] - directions[..., 1:] * (origin[0] / directions[..., :1])
        )
        for _ in range(NEWTON_STEPS):
            miss = self.project(point) - target
            point = point - np.linalg.solve(self.project_jacobian(point), miss[..., None])[..., 0]
            if not np.isfinite(point).all():
                break
            if not miss.size or np.max(np.abs(miss)) < 1e-8:
                # Newton may also converge to a point that the polynomial maps back into the
                # picture.
                if not self._is_one_to_one(point):
                    break
                return point
        raise BadInput(
            "camera: a pixel cannot be traced back through the lens distortion; "
            "calibrate with photos that fill the whole picture"
        )

    def on_plane_jacobian(self, px: ArrayLike) -> Floats:
        """d (y, z) / d px, (..., 2, 2) in m/px, at pixels (..., 2)."""
        return np.asarray(np.linalg.inv(self.project_jacobian(self.on_plane(px))))

    def circle_shift_px(self, centres_m: ArrayLike, diameter_m: float) -> Floats:
        """Offset (..., 2) px of the centroid of a circle's picture from the picture of its centre,
        by perspective and lens.

        `centres_m` is (..., 2) in the plane.
        """
        centres = np.asarray(centres_m, dtype=np.float64)
        turn = np.linspace(0.0, 2.0 * np.pi, CIRCLE_POINTS, endpoint=False)
        rim = centres[..., None, :] + 0.5 * diameter_m * np.stack(
            [np.cos(turn), np.sin(turn)], axis=-1
        )
        return _centroid(self.project(rim)) - self.project(centres)

    def disc_diameter_px(self, centres_m: ArrayLike, diameter_m: float) -> Floats:
        """Diameter (...) px of the circle with the same area as the picture of a disc at points
        (..., 2) in the plane.
        """
        area = np.abs(np.linalg.det(self.project_jacobian(centres_m)))
        return np.asarray(diameter_m * np.sqrt(area))

    def discs_on_plane(self, px: ArrayLike, diameter_m: float) -> Floats:
        """Centres (..., 2) in metres in the plane of discs whose pictures have their centroids
        at pixels (..., 2).
        """
        # The shift is small and varies slowly, so two fixed-point iterations are enough.
        centres = np.asarray(px, dtype=np.float64)
        for _ in range(2):
            centres = np.asarray(px) - self.circle_shift_px(self.on_plane(centres), diameter_m)
        return self.on_plane(centres)

    def _to_camera(self, points_m: Floats) -> Floats:
        return np.asarray(points_m @ self.rotation.T + self.translation_m)

    def _is_one_to_one(self, points_m: Floats) -> bool:
        """Whether the lens model is one to one from the centre of the picture out to the points;
        beyond, it folds the scene back.
        """
        seen = self._to_camera(_to_space(points_m))
        outwards = np.linspace(0.1, 1.0, 10).reshape(-1, *[1] * seen.ndim)
        jacobian = _distortion_jacobian(outwards * (seen[..., :2] / seen[..., 2:]), self.distortion)
        return bool((np.linalg.det(jacobian) > 0.0).all() and (seen[..., 2] > 0.0).all())


def _to_space(points_m: ArrayLike) -> Floats:
    points = np.asarray(points_m, dtype=np.float64)
    if points.shape[-1] == 3:
        return points
    return np.concatenate([np.zeros((*points.shape[:-1], 1)), points], axis=-1)


def _distort(ideal: Floats, distortion: Floats) -> Floats:
    k1, k2, p1, p2, k3 = distortion
    x = ideal[..., 0]
    y = ideal[..., 1]
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    across = x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x)
    down = y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y
    return np.stack([across, down], axis=-1)


def _distortion_jacobian(ideal: Floats, distortion: Floats) -> Floats:
    k1, k2, p1, p2, k3 = distortion
    x = ideal[..., 0]
    y = ideal[..., 1]
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    slope = 2.0 * (k1 + square * (2.0 * k2 + square * 3.0 * k3))
    mixed = x * y * slope + 2.0 * (p1 * x + p2 * y)
    xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return np.stack([np.stack([xx, mixed], axis=-1), np.stack([mixed, yy], axis=-1)], axis=-2)


def _centroid(rim: Floats) -> Floats:
    """Centre of area (..., 2) of closed outlines (..., n, 2)."""
    # The shoelace formula about the mean point, which keeps its digits where the outline is far
    # from the origin.
    middle = rim.mean(axis=-2, keepdims=True)
    points = rim - middle
    after = np.roll(points, -1, axis=-2)
    cross = points[..., 0] * after[..., 1] - after[..., 0] * points[..., 1]
    moment = ((points + after) * cross[..., None]).sum(axis=-2)
    return np.asarray(middle[..., 0, :] + moment / (3.0 * cross.sum(axis=-1)[..., None]))
