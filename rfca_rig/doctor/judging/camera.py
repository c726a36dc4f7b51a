"""The camera of the static experiment: its calibration, and what it sees of the marks."""

from dataclasses import dataclass

from rfca_rig.doctor.finding import Finding, green, red, yellow

CAMERA, CALIBRATION = "camera", "camera file"
MANY_PX = 1.0


@dataclass(frozen=True)
class CameraSeen:
    """`fault` says why there was no photo, None where there was one; it showed `told` of `planned` marks, and these doubts."""

    fault: str | None
    told: int = 0
    planned: int = 0
    doubts: tuple[str, ...] = ()


def judge_camera_file(path: str, fault: str | None, error_px: float) -> Finding:
    """`fault` is why the calibration cannot be used, None where it can; `error_px` its reprojection error."""
    calibrate = "rfca-rig calibrate camera --help"
    if fault is not None:
        return red(CALIBRATION, fault, "calibrate the camera, and name the file in calibration_file; docs/camera.md says how:", calibrate)
    if error_px > MANY_PX:
        return yellow(CALIBRATION, f"{path}: reprojection error {error_px:.2f} px", "calibrate again with a flat board:", calibrate)
    return green(CALIBRATION, f"{path}: reprojection error {error_px:.2f} px")


def judge_camera(seen: CameraSeen) -> Finding:
    if seen.fault is not None:
        return red(CAMERA, seen.fault, "put the camera right before the next static run; without [camera] forces are measured all the same")
    shown = f"{seen.told} of {seen.planned} marks told"
    if seen.told == seen.planned:
        return green(CAMERA, shown)
    said = f"{shown}: {'; '.join(seen.doubts)}"
    return yellow(CAMERA, said, "bring the leg into the picture, light it evenly, take red things away")


def judge_photo_folder(folder: str, fault: str | None) -> Finding:
    """`fault` is why the folder cannot be read, None where it can."""
    if fault is not None:
        return red(CAMERA, fault, "make the folder, and tell the camera's program to put its photos there:", f"mkdir -p {folder}")
    return green(CAMERA, f"photos are to come into {folder}")
