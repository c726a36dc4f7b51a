"""Photos taken by hand, one for each static stage of a recording: copied beside it and read."""

import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from rfca_rig.bench.stage_photos import photo_hashes, read_stage_photos
from rfca_rig.description.camera_file import CameraFile
from rfca_rig.description.camera_sections import MarksSection
from rfca_rig.description.rig_file import RigFile
from rfca_rig.description.toml import model_of, read_text
from rfca_rig.errors import BadInput
from rfca_rig.progress import ProgressCount, ignore_progress
from rfca_rig.recording.layout import PHOTOS
from rfca_rig.recording.model import Recording
from rfca_rig.vision.leg_photo import PhotoSetup


def eye_for(recording: Recording, camera_path: Path, mark_diameter_mm: float | None) -> PhotoSetup:
    """Camera and marks for photos of the recording's leg: marks as its rig file had them, else at every hinge axis and the tip.

    Raises BadInput where the camera file cannot be used, or the recording does not state the lengths of the links.
    """
    leg = recording.nominal.get("leg")
    if not leg:
        raise BadInput(f"{recording.title}: the recording does not say how long the leg's links are; no photo can be read without")
    lengths_m = tuple(length_mm / 1e3 for length_mm in leg["link_lengths_mm"])
    marks = _marks(recording)
    if mark_diameter_mm is not None:
        marks = marks.model_copy(update={"diameter_mm": mark_diameter_mm})
    return PhotoSetup(model_of(read_text(camera_path), CameraFile, camera_path).model(), marks.plan(lengths_m), lengths_m)


def _marks(recording: Recording) -> MarksSection:
    if "rig_file" not in recording.provenance:
        return MarksSection()
    rig = model_of(recording.provenance["rig_file"], RigFile, Path("rig_file"))
    return rig.camera.marks if rig.camera else MarksSection()


def with_hand_photos(
    recording: Recording, photos: Sequence[Path], eye: PhotoSetup, run_folder: Path, told: ProgressCount = ignore_progress
) -> Recording:
    """The recording with hinge angles from the photos, in the stages' order; copies and overlays go into `run_folder`.

    Raises BadInput where there is not exactly one photo for each stage.
    """
    if len(photos) != len(recording.static):
        raise BadInput(f"{len(photos)} photos for {len(recording.static)} static stages; give one for each, named in their order")
    # Without exist_ok: photos of another recording must not mix with these.
    (run_folder / PHOTOS).mkdir(parents=True)
    stages = []
    for number, (stage, photo) in enumerate(zip(recording.static, photos, strict=True), start=1):
        name = f"{PHOTOS}/{number:03d}{photo.suffix.lower()}"
        shutil.copyfile(photo, run_folder / name)
        # Angles of an earlier reading must not survive where the new photo shows none.
        unread = (float("nan"),) * len(stage.hinge_deg)
        stages.append(replace(stage, hinge_deg=unread, hinge_std_deg=(), photo=name, overlay="", photo_doubts=""))
    read = read_stage_photos(stages, run_folder, eye, told)
    return replace(recording, static=read, provenance={**recording.provenance, **photo_hashes(run_folder)})
