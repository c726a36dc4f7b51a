"""Photos of the stages, small, as pieces of a page that needs no other file."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from rfca_rig.drivers.picture_file import Image, read_picture
from rfca_rig.errors import BadInput, RigError
from rfca_rig.recording.model import StaticStage
from rfca_rig.report.static_source import StaticSource

WIDTH_PX = 420
QUALITY = 82


@dataclass(frozen=True)
class StripPicture:
    """One stage: its picture as the address of an <img>, or, where there is none to show, why."""

    stage: StaticStage
    data: str
    missing: str
    doubts: str


def strip_of(source: StaticSource) -> list[StripPicture]:
    """The stages of which a photo was kept, the overlay before the bare photo. A file that is gone is said to be, not refused."""
    kept = [stage for stage in source.recording.static if stage.photo or stage.overlay]
    return [_picture(source, stage) for stage in kept]


def _picture(source: StaticSource, stage: StaticStage) -> StripPicture:
    path = source.folder / (stage.overlay or stage.photo)
    try:
        image = read_picture(path)
    except BadInput as error:
        return StripPicture(stage, "", str(error).split(";")[0].replace(f"{path.parent}/", ""), stage.photo_doubts)
    return StripPicture(stage, _address(image), "", stage.photo_doubts)


def _address(image: Image) -> str:
    """As JPEG; the same picture gives the same bytes."""
    rows, columns = image.shape[:2]
    if columns > WIDTH_PX:
        image = np.asarray(cv2.resize(image, (WIDTH_PX, max(1, round(rows * WIDTH_PX / columns))), interpolation=cv2.INTER_AREA), np.uint8)
    done, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise RigError(f"a picture of {columns} x {rows} pixels cannot be written as JPEG")
    return "data:image/jpeg;base64," + b64encode(content.tobytes()).decode("ascii")


def strips_of(sources: Sequence[StaticSource]) -> list[tuple[str, list[StripPicture]]]:
    """By source, those with pictures only."""
    return [(source.name, strip) for source in sources if (strip := strip_of(source))]
