"""[camera] in a rig file: one section per kind of camera, told apart by `device`; and the marks that it looks at."""

from collections.abc import Sequence
from typing import Annotated, Literal

from pydantic import Field

from rfca_rig.description.sections import NotNegative, Positive, Section
from rfca_rig.twins.image_noise import Disturbance
from rfca_rig.vision.leg_marks import MarkPlan, PlannedMark

Waiting = Annotated[float, Field(gt=0, le=3600)]
Share = Annotated[float, Field(ge=0, le=1)]


class MarkSection(Section):
    """A mark on a link, 1 the one at the shaft: along it from its hinge, and across it, positive to the side of growing angle."""

    link: Annotated[int, Field(ge=1)]
    along_mm: NotNegative
    across_mm: float = 0.0


class MarksSection(Section):
    """[camera.marks]: red discs on black. Without `places`: one at every hinge axis, the shaft's too, and one at the tip."""

    diameter_mm: Positive = 8.0
    places: Annotated[tuple[MarkSection, ...], Field(strict=False)] = ()

    def plan(self, link_lengths_m: Sequence[float]) -> MarkPlan:
        """Raises BadInput where the places are not in their order from the shaft outwards."""
        if not self.places:
            return MarkPlan.at_hinges(link_lengths_m, self.diameter_mm / 1e3)
        marks = tuple(PlannedMark(place.link, place.along_mm / 1e3, place.across_mm / 1e3) for place in self.places)
        return MarkPlan(marks, self.diameter_mm / 1e3)


class OpenCvCameraSection(Section):
    """A camera that OpenCV can open. `calibration_file`, from the rig file's folder, is what `calibrate camera` wrote.

    A stage goes without its photo where none has come `photo_limit_s` after it was asked for.
    """

    device: Literal["opencv"]
    calibration_file: Annotated[str, Field(min_length=1)]
    number: Annotated[int, Field(ge=0)] = 0
    photo_limit_s: Waiting = 5.0
    marks: MarksSection = MarksSection()


class PhotoFolderSection(Section):
    """A camera that puts its photos into a folder by itself: each stage takes the first that comes there after it was asked for.

    Paths are from the rig file's folder. What is in the folder before is left alone.
    """

    device: Literal["photo-folder"]
    calibration_file: Annotated[str, Field(min_length=1)]
    folder: Annotated[str, Field(min_length=1)]
    photo_limit_s: Waiting = 120.0
    marks: MarksSection = MarksSection()


CameraSection = Annotated[OpenCvCameraSection | PhotoFolderSection, Field(discriminator="device")]


class TwinCameraSection(Section):
    """[twin.camera]: what comes between the twin's leg and its photos; see `twins.disturbance.Disturbance`, which says what each is."""

    defocus_px: NotNegative = 0.7
    noise_counts: NotNegative = 2.0
    uneven_light: Share = 0.3
    glints: Annotated[int, Field(ge=0)] = 4
    red_things: Annotated[int, Field(ge=0)] = 1
    reflection: Share = 0.1
    hidden_mark: Annotated[int, Field(ge=0)] | None = None
    hidden_share: Share = 0.5
    jpeg_quality: Annotated[int, Field(ge=1, le=100)] | None = None

    def disturbance(self) -> Disturbance:
        return Disturbance(**self.model_dump())
