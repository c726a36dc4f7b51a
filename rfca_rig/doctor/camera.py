"""The camera of the static experiment: its calibration, and the marks in one photo of the hanging leg. Nothing moves."""

from contextlib import ExitStack
from dataclasses import dataclass

from rfca_rig.bench.sensors import make_camera
from rfca_rig.clock import Clock
from rfca_rig.description.camera_file import OpenCvCameraSection
from rfca_rig.devices.checks import Finding, green, red, shorten_error, yellow
from rfca_rig.drivers.roles import Photo, Photographer
from rfca_rig.errors import DeviceError, RigError
from rfca_rig.vision.leg_photo import PhotoSetup, read_leg_photo

CAMERA, CALIBRATION = "camera", "camera file"
# Reprojection error from which a new calibration is advised.
MAX_REPROJECTION_ERROR_PX = 1.0

LOOK_EVERY_S = 0.02


@dataclass(frozen=True)
class CameraObservation:
    """Observed photo. `fault` is why there was none, else None. It showed `stated` of `planned` marks, with these doubts."""

    fault: str | None
    stated: int = 0
    planned: int = 0
    doubts: tuple[str, ...] = ()


def judge_camera_file(path: str, fault: str | None, error_px: float) -> Finding:
    """Finding on the calibration. `fault` is why it cannot be used, None if it can; `error_px` is its reprojection error."""
    calibrate = "rfca-rig calibrate camera --help"
    if fault is not None:
        return red(CALIBRATION, fault, "calibrate the camera, and name the file in calibration_file; docs/camera.md says how:", calibrate)
    if error_px > MAX_REPROJECTION_ERROR_PX:
        return yellow(CALIBRATION, f"{path}: reprojection error {error_px:.2f} px", "calibrate again with a flat board:", calibrate)
    return green(CALIBRATION, f"{path}: reprojection error {error_px:.2f} px")


def judge_camera(seen: CameraObservation) -> Finding:
    if seen.fault is not None:
        return red(CAMERA, seen.fault, "put the camera right before the next static run; without [camera] forces are measured all the same")
    shown = f"{seen.stated} of {seen.planned} marks found"
    if seen.stated == seen.planned:
        return green(CAMERA, shown)
    message = f"{shown}: {'; '.join(seen.doubts)}"
    return yellow(CAMERA, message, "bring the leg into the picture, light it evenly, take red things away")


def judge_photo_folder(folder: str, fault: str | None) -> Finding:
    """Finding on the photo folder. `fault` is why it cannot be read, None if it can."""
    if fault is not None:
        return red(CAMERA, fault, "make the folder, and tell the camera's program to put its photos there:", f"mkdir -p {folder}")
    return green(CAMERA, f"photos are to come into {folder}")


def look_at_camera(section: OpenCvCameraSection, eye: PhotoSetup, clock: Clock) -> CameraObservation:
    try:
        with ExitStack() as stack:
            photo = _one_photo(make_camera(section, eye, clock, stack), clock, section.photo_limit_s)
        identified = read_leg_photo(photo.image, eye).identified
    except RigError as error:
        return CameraObservation(shorten_error(error))
    count = sum(mark is not None for mark in identified.marks)
    return CameraObservation(None, count, len(identified.marks), tuple(doubt.words for doubt in identified.doubts))


def _one_photo(camera: Photographer, clock: Clock, limit_s: float) -> Photo:
    camera.begin()
    until_s = clock.now_s() + limit_s
    while clock.now_s() < until_s:
        if photo := camera.fetch_photo():
            return photo
        clock.wait_until(clock.now_s() + LOOK_EVERY_S)
    raise DeviceError(f"the camera gave no photo within {limit_s:g} s; check its cable and power")
