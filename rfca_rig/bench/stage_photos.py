"""Reads the photos of static stages: those of a run once the rig stands still, and those taken
by hand.
"""

import shutil
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import cv2
import numpy as np

from rfca_rig.description.camera_file import CameraFile, MarksSection
from rfca_rig.description.rig_file import RigFile
from rfca_rig.drivers.photo_files import read_picture
from rfca_rig.errors import BadInput
from rfca_rig.executors.parallel import map_in_threads
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.recording.layout import OVERLAYS, PHOTOS, sum_line
from rfca_rig.recording.model import Recording, StaticStage
from rfca_rig.toml import model_of, read_text
from rfca_rig.vision.hinge_angles import MAX_REPORTED_STD_RAD, HingeAngles, LegFit, fit_leg
from rfca_rig.vision.identify import IdentifiedMarks
from rfca_rig.vision.leg_marks import MarkPlan
from rfca_rig.vision.leg_photo import PhotoSetup, draw_overlay, read_marks

OVERLAY_QUALITY = 90
# More difference between photo and drive means a photo of another stage, or different zeros of
# drive and camera.
SHAFT_APART_DEG = 2.0
# Distance from the plane of the marks that is reported, and how many standard deviations it must
# be.
REPORTED_OFFSET_M = 0.3e-3
OFFSET_SIGMAS = 4.0


def read_stage_photos(
    stages: Sequence[StaticStage],
    run_folder: Path,
    eye: PhotoSetup,
    report_progress: ProgressCount = ignore_progress,
    known: Mapping[str, IdentifiedMarks] = MappingProxyType({}),
) -> tuple[StaticStage, ...]:
    """The stages with the angles from their photos; `report_progress` is called with the progress.

    All photos are of one leg, so they are fitted together: what one pose leaves open about the
    marks, others determine. A photo that cannot be read leaves its stage without angles, with the
    reason. Stages without a photo stay unchanged. `known` are the marks of photos that are read
    already, by their path in the run's folder.
    """
    marks: list[IdentifiedMarks | StaticStage] = []
    for stage in iterate_with_progress(stages, report_progress):
        if stage.photo:
            marks.append(known.get(stage.photo) or _read_marks(stage, run_folder, eye))
        else:
            marks.append(stage)
    results: list[StaticStage] = []
    read: list[tuple[int, IdentifiedMarks]] = []
    for number, (stage, outcome) in enumerate(zip(stages, marks, strict=True)):
        if isinstance(outcome, IdentifiedMarks):
            read.append((number, outcome))
            results.append(stage)
        else:
            results.append(outcome)
    fit = fit_leg([outcome for _, outcome in read], eye.camera, eye.plan, eye.link_lengths_m)

    def add_angles(task: tuple[tuple[int, IdentifiedMarks], HingeAngles]) -> StaticStage:
        (number, identified), angles = task
        return _with_angles(results[number], run_folder, eye, identified, angles, fit)

    # In threads: decoding, drawing and encoding are OpenCV's, which releases the interpreter.
    with_angles = map_in_threads(add_angles, list(zip(read, fit.angles, strict=True)))
    for (number, _), stage in zip(read, with_angles, strict=True):
        results[number] = stage
    return tuple(results)


def _read_marks(
    stage: StaticStage, run_folder: Path, eye: PhotoSetup
) -> IdentifiedMarks | StaticStage:
    """The marks of a stage's photo, or the stage with the reason why there are none."""
    # A photo may be lost, for example where the disk refused it; its stage is then kept but not
    # acknowledged.
    if not (run_folder / stage.photo).is_file():
        return replace(
            stage,
            photo="",
            photo_doubts=f"the photo was lost: {stage.photo} did not reach the disk",
        )
    try:
        return read_marks(read_picture(run_folder / stage.photo), eye)
    except BadInput as error:
        return replace(stage, photo_doubts=str(error))


def _with_angles(
    stage: StaticStage,
    run_folder: Path,
    eye: PhotoSetup,
    identified: IdentifiedMarks,
    angles: HingeAngles,
    fit: LegFit,
) -> StaticStage:
    # Read a second time: the photos of a whole run may not fit into memory.
    picture = draw_overlay(
        read_picture(run_folder / stage.photo), identified, eye.camera, eye.plan, angles
    )
    name = f"{OVERLAYS}/{Path(stage.photo).stem}.jpg"
    (run_folder / OVERLAYS).mkdir(exist_ok=True)
    encoded = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, OVERLAY_QUALITY])[1]
    write_atomically(run_folder / name, encoded.tobytes())
    stage = replace(stage, overlay=name)
    doubts = []
    if fit.refused:
        doubts.append(fit.refused)
    doubts += [doubt.words for doubt in identified.doubts]
    doubts += _marks_out_of_plane(fit, eye.plan)
    # Angles of another stage would be worse than none, so this doubt discards them all.
    if other := _another_shaft_angle(stage, angles):
        return replace(stage, photo_doubts="; ".join([other, *doubts]))
    return replace(
        stage,
        hinge_deg=_degrees(angles.hinge_rad),
        hinge_std_deg=_degrees(angles.hinge_std_rad),
        hinge_reading_std_deg=_degrees(angles.hinge_reading_std_rad),
        photo_doubts="; ".join([*doubts, *_describe_hinges(identified, angles, eye.plan)]),
    )


def _marks_out_of_plane(fit: LegFit, plan: MarkPlan) -> list[str]:
    """A message for each mark whose distance from the plane of the others is significant."""
    return [
        f"the {plan.name(i)} is {1e3 * abs(offset):.1f}+-{1e3 * std:.1f} mm "
        f"{'before' if offset > 0 else 'behind'} the plane of the marks, corrected"
        for i, (offset, std) in enumerate(zip(fit.offsets_m, fit.offset_std_m, strict=True))
        if abs(offset) > max(REPORTED_OFFSET_M, OFFSET_SIGMAS * std)
    ]


def _describe_hinges(identified: IdentifiedMarks, angles: HingeAngles, plan: MarkPlan) -> list[str]:
    """Messages with the numbers of hinges without an angle, and of those whose angle needed the
    lengths of the links.
    """
    known = [
        (number, angle is not None)
        for number, angle in enumerate(angles.hinge_rad, start=1)
        if number > 1
    ]
    unknown = [str(number) for number, has_angle in known if not has_angle]
    hidden = {
        plan.marks[i].link
        for i, mark in enumerate(identified.marks)
        if mark is None and plan.marks[i].along_m == 0.0
    }
    by_lengths = [str(number) for number, has_angle in known if has_angle and number in hidden]
    if by_lengths:
        words = [f"hinge {', '.join(by_lengths)} without its mark, from the lengths of its links"]
    else:
        words = []
    if unknown:
        if identified.is_complete:
            why = f", known to worse than {np.degrees(MAX_REPORTED_STD_RAD):.1f} deg"
        else:
            why = ""
        words.append(f"hinge {', '.join(unknown)} left out{why}")
    return words


def _degrees(angles_rad: Sequence[float | None]) -> tuple[float, ...]:
    """Hinge angles in degrees, NaN where unknown; the first angle, which is the shaft's, is left
    out.
    """
    return tuple(
        float("nan") if angle is None else float(np.degrees(angle)) for angle in angles_rad[1:]
    )


def _another_shaft_angle(stage: StaticStage, angles: HingeAngles) -> str:
    """Message where photo and drive show different shaft angles, else ""."""
    if angles.hinge_rad[0] is None:
        return ""
    shown_deg = np.degrees(angles.hinge_rad[0])
    drive_deg = np.degrees(stage.shaft_angle_rad)
    # Difference of angles, brought to the range of -180 to 180 degrees.
    if abs((shown_deg - drive_deg + 180.0) % 360.0 - 180.0) <= SHAFT_APART_DEG:
        return ""
    return (
        f"the photo shows the shaft at {shown_deg:.1f} deg, the drive says "
        f"{drive_deg:.1f} deg: not this stage's photo, or a zero is "
        "wrong; no angles taken"
    )


def read_missing_photos(recording: Recording, run_folder: Path) -> Recording:
    """The recording of a run that ended before its photos were read, with their angles; any other
    recording unchanged.

    Raises BadInput where the rig and camera files that the run stored cannot be used.
    """
    provenance_texts = recording.provenance
    # An overlay exists for every photo that was read.
    waiting = [stage for stage in recording.static if stage.photo and not stage.overlay]
    if not waiting or "camera_file" not in provenance_texts:
        return recording
    rig = model_of(provenance_texts["rig_file"], RigFile, run_folder / "rig_file")
    eye = rig.eye_behind(provenance_texts["camera_file"], run_folder / "camera_file")
    if eye is None:
        return recording
    static = read_stage_photos(recording.static, run_folder, eye)
    return replace(
        recording, static=static, provenance={**provenance_texts, **photo_hashes(run_folder)}
    )


def photo_hashes(run_folder: Path) -> dict[str, str]:
    """For a run's provenance: SHA-256 of each photo and overlay, a line each in the format of
    sha256sum; empty without any.
    """
    files = [
        file for folder in (PHOTOS, OVERLAYS) for file in sorted((run_folder / folder).glob("*"))
    ]
    if files:
        return {"photos_sha256": "\n".join(sum_line(file, run_folder) for file in files)}
    return {}


def eye_for(recording: Recording, camera_path: Path, mark_diameter_mm: float | None) -> PhotoSetup:
    """Camera and marks for photos of the recording's leg: marks as its rig file had them, else at
    every hinge axis and the tip.

    Raises BadInput where the camera file cannot be used, or the recording does not state the
    lengths of the links.
    """
    leg = recording.nominal.get("leg")
    if not leg:
        raise BadInput(
            f"{recording.title}: the recording does not say how long the leg's links are; "
            "no photo can be read without"
        )
    lengths_m = tuple(length_mm / 1e3 for length_mm in leg["link_lengths_mm"])
    marks = _marks(recording)
    if mark_diameter_mm is not None:
        marks = marks.model_copy(update={"diameter_mm": mark_diameter_mm})
    return PhotoSetup(
        model_of(read_text(camera_path), CameraFile, camera_path).model(),
        marks.plan(lengths_m),
        lengths_m,
    )


def _marks(recording: Recording) -> MarksSection:
    if "rig_file" not in recording.provenance:
        return MarksSection()
    rig = model_of(recording.provenance["rig_file"], RigFile, Path("rig_file"))
    if rig.camera:
        return rig.camera.marks
    return MarksSection()


def with_hand_photos(
    recording: Recording,
    photos: Sequence[Path],
    eye: PhotoSetup,
    run_folder: Path,
    report_progress: ProgressCount = ignore_progress,
) -> Recording:
    """The recording with hinge angles from the photos, in the stages' order; copies and overlays go
    into `run_folder`.

    Raises BadInput where there is not exactly one photo for each stage.
    """
    if len(photos) != len(recording.static):
        raise BadInput(
            f"{len(photos)} photos for {len(recording.static)} static stages; give one "
            "for each, named in their order"
        )
    # Without exist_ok: photos of another recording must not mix with these.
    (run_folder / PHOTOS).mkdir(parents=True)
    stages = []
    for number, (stage, photo) in enumerate(zip(recording.static, photos, strict=True), start=1):
        name = f"{PHOTOS}/{number:03d}{photo.suffix.lower()}"
        shutil.copyfile(photo, run_folder / name)
        # Angles of an earlier reading must not survive where the new photo shows none.
        unread = (float("nan"),) * len(stage.hinge_deg)
        stages.append(
            replace(
                stage,
                hinge_deg=unread,
                hinge_std_deg=(),
                hinge_reading_std_deg=(),
                photo=name,
                overlay="",
                photo_doubts="",
            )
        )
    read = read_stage_photos(stages, run_folder, eye, report_progress)
    return replace(
        recording, static=read, provenance={**recording.provenance, **photo_hashes(run_folder)}
    )
