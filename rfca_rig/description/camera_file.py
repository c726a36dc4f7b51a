"""The camera: [camera] in a rig file, one section per kind, and camera.toml, a calibrated camera
with its pose before the plane.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator

from rfca_rig.errors import BadInput
from rfca_rig.escaping import toml_comment
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.toml import NotNegative, Positive, Section, format_value, read_toml, table
from rfca_rig.twins.image_noise import ImageDisturbance
from rfca_rig.vision.camera_calibration import CameraCalibration, PlanePose
from rfca_rig.vision.camera_model import CameraModel
from rfca_rig.vision.leg_marks import MarkPlan, PlannedMark

Floats = NDArray[np.float64]
# The file states its axes in words, so that no reader has to guess them.
AXES: Literal["y along the ground, z up"] = "y along the ground, z up"
Pixels = Annotated[int, Field(ge=16, le=65535)]
Pair = Annotated[tuple[float, float], Field(strict=False)]
Size = Annotated[tuple[Pixels, Pixels], Field(strict=False)]
PositivePair = Annotated[tuple[Positive, Positive], Field(strict=False)]
NotNegativePair = Annotated[tuple[NotNegative, NotNegative], Field(strict=False)]
Box = Annotated[tuple[float, float, float, float], Field(strict=False)]
Triple = Annotated[tuple[float, float, float], Field(strict=False)]
Matrix = Annotated[tuple[Triple, Triple, Triple], Field(strict=False)]
Coefficients = Annotated[tuple[float, float, float, float, float], Field(strict=False)]

Waiting = Annotated[float, Field(gt=0, le=3600)]
Share = Annotated[float, Field(ge=0, le=1)]


class LensSection(Section):
    """[camera]: pinhole and lens. `distortion` is k1, k2, p1, p2, k3 in OpenCV's order; standard
    deviations are one each.

    `covered_px` is left, top, right, bottom of the part of the image in which the board was seen.
    """

    image_size_px: Size
    focal_px: PositivePair
    focal_std_px: NotNegativePair
    centre_px: Pair
    centre_std_px: NotNegativePair
    distortion: Coefficients
    covered_px: Box
    board: str
    reprojection_error_px: NotNegative


class PlaneSection(Section):
    """[plane]: a point (x, y, z) of the plane frame is seen from the camera at `rotation` times it
    plus `translation_mm`.

    The plane frame's origin is the shaft axis; x completes the right-handed frame.
    """

    axes: Literal["y along the ground, z up"]
    rotation: Matrix
    translation_mm: Triple
    photo: str
    reprojection_error_px: NotNegative
    tilt_std_deg: NotNegativePair
    distance_std_mm: NotNegative
    origin_from: str

    @field_validator("rotation")
    @classmethod
    def _is_a_turn(cls, rows: Matrix) -> Matrix:
        rotation = np.array(rows)
        # The digits in the file allow errors below 1e-5.
        if (
            not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-5)
            or np.linalg.det(rotation) < 0
        ):
            raise ValueError(
                "should be three rows of a rotation, perpendicular and of length 1; calibrate again"
            )
        return rows


class PhotoSection(Section):
    """[[photos]]: a photo that was used; the width of its edges, 10 % to 90 %, measures its
    sharpness.
    """

    name: str
    corners: Annotated[int, Field(ge=1)]
    edge_px: NotNegative
    reprojection_error_px: NotNegative


class RefusedSection(Section):
    """[[refused]]: a photo that was not used, and why."""

    name: str
    why: str


class CameraFile(Section):
    """A camera as `calibrate camera` writes it. Without [plane] the lens is known, but not the
    camera's pose.
    """

    camera: LensSection
    plane: PlaneSection | None = None
    photos: Annotated[tuple[PhotoSection, ...], Field(strict=False)] = ()
    refused: Annotated[tuple[RefusedSection, ...], Field(strict=False)] = ()

    def matrix(self) -> Floats:
        """Camera matrix (3, 3), in px."""
        (across, down) = self.camera.focal_px
        (centre_x, centre_y) = self.camera.centre_px
        return np.array([[across, 0.0, centre_x], [0.0, down, centre_y], [0.0, 0.0, 1.0]])

    def distortion(self) -> Floats:
        """Distortion coefficients (5,), in OpenCV's order."""
        return np.array(self.camera.distortion)

    def model(self) -> CameraModel:
        """The camera with its pose before the plane of motion. Raises BadInput where the file
        has no [plane].
        """
        if self.plane is None:
            raise BadInput(
                "the camera file has no [plane]: where the camera stands is unknown; "
                "calibrate camera --plane PHOTO adds it"
            )
        translation_m = np.array(self.plane.translation_mm) / 1e3
        # The numbers of the file are rounded.
        # Orthogonal Procrustes: dropping the singular values gives the nearest orthogonal matrix.
        left, _, right = np.linalg.svd(np.array(self.plane.rotation))
        turn: Floats = left @ right
        return CameraModel(
            self.matrix(), self.distortion(), self.camera.image_size_px, turn, translation_m
        )


def read_camera_file(path: Path) -> CameraFile:
    """Read the camera in `path`. Raises BadInput, with file and line, where it cannot be used."""
    return read_toml(path, CameraFile)


def camera_file(
    calibration: CameraCalibration, board: str, plane: PlaneSection | None
) -> CameraFile:
    """The content of a camera file from a calibration; `board` is the description that the user
    gave.
    """
    matrix = calibration.matrix
    covered_px = calibration.covered_px().tolist()
    lens = LensSection(
        image_size_px=calibration.size_px,
        focal_px=(float(matrix[0, 0]), float(matrix[1, 1])),
        focal_std_px=_pair(calibration.focal_std_px.tolist()),
        centre_px=(float(matrix[0, 2]), float(matrix[1, 2])),
        centre_std_px=_pair(calibration.centre_std_px.tolist()),
        distortion=tuple(calibration.distortion.tolist()),
        covered_px=(covered_px[0], covered_px[1], covered_px[2], covered_px[3]),
        board=board,
        reprojection_error_px=calibration.error_px,
    )
    photos = tuple(
        PhotoSection(
            name=photo.name,
            corners=len(photo.px),
            edge_px=photo.edge_px,
            reprojection_error_px=error_px,
        )
        for photo, error_px in zip(calibration.photos, calibration.errors_px.tolist(), strict=True)
    )
    refused = tuple(RefusedSection(name=photo.name, why=photo.why) for photo in calibration.refused)
    return CameraFile(camera=lens, plane=plane, photos=photos, refused=refused)


def plane_section(pose: PlanePose, photo: str, origin_from: str) -> PlaneSection:
    """[plane] for a pose found in `photo`; `origin_from` states how the shaft axis was found."""
    rows = [(float(row[0]), float(row[1]), float(row[2])) for row in pose.rotation]
    shift = (1e3 * pose.translation_m).tolist()
    return PlaneSection(
        axes=AXES,
        rotation=(rows[0], rows[1], rows[2]),
        translation_mm=(shift[0], shift[1], shift[2]),
        photo=photo,
        reprojection_error_px=pose.error_px,
        tilt_std_deg=_pair(np.degrees(pose.tilt_std_rad).tolist()),
        distance_std_mm=1e3 * pose.distance_std_m,
        origin_from=origin_from,
    )


def _pair(values: Sequence[float]) -> tuple[float, float]:
    return values[0], values[1]


def write_camera_file(path: Path, file: CameraFile, comments: Sequence[str]) -> None:
    """Write the file, all or nothing, with `comments` at its head. Raises RigError where the
    disk refuses.
    """
    plain = file.model_dump(mode="json", exclude_none=True)
    parts = ["".join(toml_comment(line) for line in comments), table("camera", plain["camera"])]
    if file.plane:
        parts.append(table("plane", plain["plane"]))
    parts += [_entry("photos", entry) for entry in plain["photos"]]
    parts += [_entry("refused", entry) for entry in plain["refused"]]
    write_atomically(path, "\n".join(parts).encode("utf-8"))


def _entry(name: str, keys: dict[str, object]) -> str:
    return f"[[{name}]]\n" + "".join(
        f"{key} = {format_value(value)}\n" for key, value in keys.items()
    )


class MarkSection(Section):
    """A mark on a link, counted from 1 at the shaft: its place along the link from the hinge, and
    across, positive towards growing angles.
    """

    link: Annotated[int, Field(ge=1)]
    along_mm: NotNegative
    across_mm: float = 0.0


class MarksSection(Section):
    """[camera.marks]: red discs on black. Without `places`: one at every hinge axis including
    the shaft's, and one at the tip.
    """

    diameter_mm: Positive = 8.0
    places: Annotated[tuple[MarkSection, ...], Field(strict=False)] = ()

    def plan(self, link_lengths_m: Sequence[float]) -> MarkPlan:
        """The marks of the leg. Raises BadInput where the places are not in their order from the
        shaft outwards.
        """
        if not self.places:
            return MarkPlan.at_hinges(link_lengths_m, self.diameter_mm / 1e3)
        marks = tuple(
            PlannedMark(place.link, place.along_mm / 1e3, place.across_mm / 1e3)
            for place in self.places
        )
        return MarkPlan(marks, self.diameter_mm / 1e3)


class OpenCvCameraSection(Section):
    """A camera that OpenCV can open. `calibration_file`, relative to the rig file's folder, was
    written by `calibrate camera`.

    A stage has no photo if none arrives within `photo_limit_s` after the request.
    """

    device: Literal["opencv"]
    calibration_file: Annotated[str, Field(min_length=1)]
    number: Annotated[int, Field(ge=0)] = 0
    photo_limit_s: Waiting = 5.0
    marks: MarksSection = MarksSection()


class PhotoFolderSection(Section):
    """A camera that stores its photos in a folder by itself. Each stage takes the first photo that
    arrives there after the request.

    Paths are relative to the rig file's folder. Photos that were in the folder before are ignored.
    """

    device: Literal["photo-folder"]
    calibration_file: Annotated[str, Field(min_length=1)]
    folder: Annotated[str, Field(min_length=1)]
    photo_limit_s: Waiting = 120.0
    marks: MarksSection = MarksSection()


CameraSection = Annotated[OpenCvCameraSection | PhotoFolderSection, Field(discriminator="device")]


class TwinCameraSection(Section):
    """[twin.camera]: degradation of the twin's photos; the keys are explained in
    `twins.image_noise.ImageDisturbance`.
    """

    defocus_px: NotNegative = 0.7
    noise_counts: NotNegative = 2.0
    uneven_light: Share = 0.3
    glints: Annotated[int, Field(ge=0)] = 4
    red_things: Annotated[int, Field(ge=0)] = 1
    reflection: Share = 0.1
    hidden_mark: Annotated[int, Field(ge=0)] | None = None
    hidden_share: Share = 0.5
    jpeg_quality: Annotated[int, Field(ge=1, le=100)] | None = None

    def disturbance(self) -> ImageDisturbance:
        return ImageDisturbance(**self.model_dump())
