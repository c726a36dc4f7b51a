"""The photos of a run's static stages, read once the rig stands still: hinge angles, what could not be told, overlays."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np

from rfca_rig.description.rig_file import RigFile
from rfca_rig.description.toml import model_of
from rfca_rig.drivers.picture_file import read_picture
from rfca_rig.errors import BadInput
from rfca_rig.progress import Watcher, counted, unwatched
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.model import Recording, StaticStage
from rfca_rig.recording.picture import FOLDER
from rfca_rig.recording.sums import sum_line
from rfca_rig.vision.hinge_angles import TELLABLE_STD_RAD, HingeAngles
from rfca_rig.vision.leg_photo import Eye, LegPhoto, read_leg_photo
from rfca_rig.vision.red_mask import Pixels

OVERLAYS = "overlays"
OVERLAY_QUALITY = 90
SHAFT_APART_DEG = 2.0  # a photo of another stage, or a drive or camera whose zero is not the other's


def read_stage_photos(stages: Sequence[StaticStage], run_folder: Path, eye: Eye, told: Watcher = unwatched) -> tuple[StaticStage, ...]:
    """The stages with what their photos show.

    A photo that cannot be read leaves its stage without angles, and says so; stages without a photo stay as they are.
    """
    return tuple(_with_photo_read(stage, run_folder, eye) if stage.photo else stage for stage in counted(stages, told))


def _with_photo_read(stage: StaticStage, run_folder: Path, eye: Eye) -> StaticStage:
    if not (run_folder / stage.photo).is_file():
        return replace(stage, photo="", photo_doubts=f"the photo was lost: {stage.photo} did not reach the disk")
    try:
        seen = read_leg_photo(read_picture(run_folder / stage.photo), eye)
    except BadInput as error:
        return replace(stage, photo_doubts=str(error))
    return _seen(replace(stage, overlay=_keep_overlay(seen.overlay, run_folder, stage.photo)), seen)


def _keep_overlay(picture: Pixels, run_folder: Path, photo: str) -> str:
    name = f"{OVERLAYS}/{Path(photo).stem}.jpg"
    (run_folder / OVERLAYS).mkdir(exist_ok=True)
    packed = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, OVERLAY_QUALITY])[1]
    write_atomically(run_folder / name, packed.tobytes())
    return name


def _seen(stage: StaticStage, seen: LegPhoto) -> StaticStage:
    doubts = [doubt.words for doubt in seen.identified.doubts]
    if other := _another_shaft_angle(stage, seen.angles):
        return replace(stage, photo_doubts="; ".join([other, *doubts]))
    return replace(
        stage,
        hinge_deg=_degrees(seen.angles.hinge_rad),
        hinge_std_deg=_degrees(seen.angles.hinge_std_rad),
        photo_doubts="; ".join([*doubts, *_left_out(seen)]),
    )


def _left_out(seen: LegPhoto) -> list[str]:
    """The hinges without an angle, by their numbers."""
    numbers = [str(number) for number, angle in enumerate(seen.angles.hinge_rad, start=1) if angle is None and number > 1]
    if not numbers:
        return []
    why = f", known to worse than {np.degrees(TELLABLE_STD_RAD):.1f} deg" if seen.identified.complete else ""
    return [f"hinge {', '.join(numbers)} left out{why}"]


def _degrees(angles_rad: Sequence[float | None]) -> tuple[float, ...]:
    """Of the hinges; the first angle is the shaft's."""
    return tuple(float("nan") if angle is None else float(np.degrees(angle)) for angle in angles_rad[1:])


def _another_shaft_angle(stage: StaticStage, angles: HingeAngles) -> str:
    """What is wrong with a photo on which the shaft does not stand where the drive says, "" for nothing."""
    if angles.hinge_rad[0] is None:
        return ""
    shown_deg, told_deg = np.degrees(angles.hinge_rad[0]), np.degrees(stage.shaft_angle_rad)
    if abs((shown_deg - told_deg + 180.0) % 360.0 - 180.0) <= SHAFT_APART_DEG:
        return ""
    return (
        f"the photo shows the shaft at {shown_deg:.1f} deg, the drive says {told_deg:.1f} deg: not this stage's photo, or a zero is wrong; "
        "no angles taken"
    )


def with_photos_read(recording: Recording, run_folder: Path) -> Recording:
    """A recording of a run that ended before its photos were read, with what they show; any other as it is.

    Raises BadInput where what the run kept of its rig and camera files cannot be used.
    """
    kept = recording.provenance
    waiting = [stage for stage in recording.static if stage.photo and not stage.overlay]
    if not waiting or "camera_file" not in kept:
        return recording
    rig = model_of(kept["rig_file"], RigFile, run_folder / "rig_file")
    eye = rig.eye_behind(kept["camera_file"], run_folder / "camera_file")
    if eye is None:
        return recording
    static = read_stage_photos(recording.static, run_folder, eye)
    return replace(recording, static=static, provenance={**kept, **photo_hashes(run_folder)})


def photo_hashes(run_folder: Path) -> dict[str, str]:
    """For a run's provenance: SHA-256 of each photo and overlay, a line each as sha256sum writes them; nothing where there are none."""
    files = [file for folder in (FOLDER, OVERLAYS) for file in sorted((run_folder / folder).glob("*"))]
    return {"photos_sha256": "\n".join(sum_line(file, run_folder) for file in files)} if files else {}
