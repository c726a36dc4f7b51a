"""The camera's side of a rig."""

from collections.abc import Iterator
from pathlib import Path

from rfca_rig.clock import Clock
from rfca_rig.description.camera_file import read_camera_file
from rfca_rig.description.camera_sections import PhotoFolderSection
from rfca_rig.description.rig_file import RigFile
from rfca_rig.doctor.finding import Finding
from rfca_rig.doctor.judging.camera import judge_camera, judge_camera_file, judge_photo_folder
from rfca_rig.doctor.looking.camera import look_at_camera
from rfca_rig.drivers.photo_folder import pictures_in
from rfca_rig.errors import BadInput


def check_camera(rig: RigFile, clock: Clock) -> Iterator[Finding]:
    """Nothing where the rig has none. A camera that OpenCV opens is asked for one photo."""
    camera = rig.camera
    if camera is None:
        return
    try:
        eye = rig.eye()
        error_px = read_camera_file(Path(camera.calibration_file)).camera.reprojection_error_px
    except BadInput as error:
        yield judge_camera_file(camera.calibration_file, str(error), 0.0)
        return
    yield judge_camera_file(camera.calibration_file, None, error_px)
    if isinstance(camera, PhotoFolderSection):
        yield _folder(camera.folder)
    elif eye is not None:
        yield judge_camera(look_at_camera(camera, eye, clock))


def _folder(folder: str) -> Finding:
    try:
        pictures_in(Path(folder))
    except BadInput as error:
        return judge_photo_folder(folder, str(error))
    return judge_photo_folder(folder, None)
