"""Photos of static stages, small enough to stand in the page."""

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from rfca_rig.drivers.photo_files import read_picture
from rfca_rig.errors import BadInput, RigError
from rfca_rig.recording.model import StaticStage
from rfca_rig.reports.static.tables import StaticSource

# Photos are embedded in the page: reduced to this width, and with this JPEG quality, to keep it
# small.
WIDTH_PX = 420
QUALITY = 82


@dataclass(frozen=True)
class StagePhoto:
    """Photo of one stage: `data` is the data URI of an <img>; where there is none, `missing`
    states why.
    """

    stage: StaticStage
    data: str
    missing: str
    doubts: str


def photos_of(source: StaticSource) -> list[StagePhoto]:
    """Photos of the stages that have one, preferring the overlay. A missing file is reported on
    the page, and is not an error.
    """
    with_photo = [stage for stage in source.recording.static if stage.photo or stage.overlay]
    return [_picture(source, stage) for stage in with_photo]


def _picture(source: StaticSource, stage: StaticStage) -> StagePhoto:
    path = source.folder / (stage.overlay or stage.photo)
    try:
        image = read_picture(path)
    except BadInput as error:
        return StagePhoto(
            stage, "", str(error).split(";")[0].replace(f"{path.parent}/", ""), stage.photo_doubts
        )
    # As JPEG: the same image gives the same bytes.
    rows, columns = image.shape[:2]
    if columns > WIDTH_PX:
        image = np.asarray(
            cv2.resize(
                image,
                (WIDTH_PX, max(1, round(rows * WIDTH_PX / columns))),
                interpolation=cv2.INTER_AREA,
            ),
            np.uint8,
        )
    done, content = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise RigError(f"a picture of {columns} x {rows} pixels cannot be written as JPEG")
    return StagePhoto(
        stage,
        "data:image/jpeg;base64," + b64encode(content.tobytes()).decode("ascii"),
        "",
        stage.photo_doubts,
    )


def photos_by_source(sources: Sequence[StaticSource]) -> list[tuple[str, list[StagePhoto]]]:
    """Photos by source, of the sources that have any."""
    return [(source.name, strip) for source in sources if (strip := photos_of(source))]
