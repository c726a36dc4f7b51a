"""A session in which the twin's camera takes photos of the board, as a lab does before its first
static run.
"""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.description.rig_file import RigFile
from rfca_rig.errors import BadInput
from rfca_rig.progress import ProgressCount, ignore_progress, iterate_with_progress
from rfca_rig.recording.atomic import write_atomically
from rfca_rig.twins.board_photos import photograph_board, pose_in_plane, poses_for_calibration
from rfca_rig.vision.board import Board

PLANE_PHOTO = "plane.png"
# Upper left corner of the board in that photo, from the shaft axis: to the right and up.
PLANE_CORNER_MM = (20.0, 15.0)


def write_board_photos(
    rig: RigFile,
    board: Board,
    folder: Path,
    seed: int | None = None,
    report_progress: ProgressCount = ignore_progress,
) -> list[Path]:
    """Photos of the board through the twin's own camera, the last one with the board in the plane
    of the marks.

    Parameters
    ----------
    rig
        A twin with a camera.
    board
        What is printed on the sheet.
    folder
        Receives the photos; made where it does not exist.
    seed
        Of the camera's noise; the rig file's own if None.
    report_progress
        Called with the number of photos taken and their number.

    Raises
    ------
    BadInput
        Where the rig is no twin, has no camera, or one for which the leg reaches out to the left.
    """
    eye = rig.eye()
    if rig.is_real or rig.twin is None or eye is None:
        raise BadInput(
            f"{rig.rig.title}: the photos are those of a twin's camera; name a rig file of kind "
            "twin with [camera]"
        )
    if eye.camera.rotation[0, 1] < 0.0:
        raise BadInput(
            f"{rig.rig.title}: the leg reaches out to the left of the picture, where these poses "
            "of the board do not fit; take a camera on the other side"
        )
    if seed is None:
        seed = rig.twin.seed
    random = np.random.default_rng([seed, 3])
    disturbance = rig.twin.camera.disturbance()
    corner_m = (1e-3 * PLANE_CORNER_MM[0], 1e-3 * PLANE_CORNER_MM[1])
    poses = poses_for_calibration(board, eye.camera)
    names = [f"{number:02d}.png" for number in range(1, len(poses) + 1)]
    posed = [
        *zip(names, poses, strict=True),
        (PLANE_PHOTO, pose_in_plane(eye.camera, corner_m)),
    ]
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for name, pose in iterate_with_progress(posed, report_progress):
        photo = photograph_board(board, eye.camera, pose, disturbance, random)
        write_atomically(folder / name, _as_png(photo))
        files.append(folder / name)
    return files


def _as_png(photo: NDArray[np.uint8]) -> bytes:
    _, encoded = cv2.imencode(".png", photo)
    return encoded.tobytes()
