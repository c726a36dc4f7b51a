"""[camera] in a rig file: one section per kind of camera, selected by `device`, and the marks that it observes."""

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from rfca_rig.description.sections import NotNegative, Positive, Section
from rfca_rig.twins.image_noise import ImageDisturbance
from rfca_rig.vision.leg_marks import MarkPlan, PlannedMark

Waiting = Annotated[float, Field(gt=0, le=3600)]
Share = Annotated[float, Field(ge=0, le=1)]


class MarkSection(Section):
    """A mark on a link, counted from 1 at the shaft: its place along the link from the hinge, and across, positive towards growing
    angles.
    """

    link: Annotated[int, Field(ge=1)]
    along_mm: NotNegative
    across_mm: float = 0.0


class MarksSection(Section):
    """[camera.marks]: red discs on black. Without `places`: one at every hinge axis including the shaft's, and one at the tip."""

    diameter_mm: Positive = 8.0
    places: Annotated[tuple[MarkSection, ...], Field(strict=False)] = ()

    def plan(self, link_lengths_m: Sequence[float]) -> MarkPlan:
        """The marks of the leg. Raises BadInput where the places are not in their order from the shaft outwards."""
        if not self.places:
            return MarkPlan.at_hinges(link_lengths_m, self.diameter_mm / 1e3)
        marks = tuple(PlannedMark(place.link, place.along_mm / 1e3, place.across_mm / 1e3) for place in self.places)
        return MarkPlan(marks, self.diameter_mm / 1e3)


class OpenCvCameraSection(Section):
    """A camera that OpenCV can open. `calibration_file`, relative to the rig file's folder, was written by `calibrate camera`.

    A stage has no photo if none arrives within `photo_limit_s` after the request.
    """

    device: Literal["opencv"]
    calibration_file: Annotated[str, Field(min_length=1)]
    number: Annotated[int, Field(ge=0)] = 0
    photo_limit_s: Waiting = 5.0
    marks: MarksSection = MarksSection()


class PhotoFolderSection(Section):
    """A camera that stores its photos in a folder by itself. Each stage takes the first photo that arrives there after the request.

    Paths are relative to the rig file's folder. Photos that were in the folder before are ignored.
    """

    device: Literal["photo-folder"]
    calibration_file: Annotated[str, Field(min_length=1)]
    folder: Annotated[str, Field(min_length=1)]
    photo_limit_s: Waiting = 120.0
    marks: MarksSection = MarksSection()


CameraSection = Annotated[OpenCvCameraSection | PhotoFolderSection, Field(discriminator="device")]


class TwinCameraSection(Section):
    """[twin.camera]: degradation of the twin's photos; the keys are explained in `twins.image_noise.ImageDisturbance`."""

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
