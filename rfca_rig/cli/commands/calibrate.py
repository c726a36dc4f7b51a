"""rfca-rig calibrate camera"""

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rfca_rig.cli.options import Command, Json
from rfca_rig.cli.terminal import echo

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rfca_rig.cli.terminal import Say
    from rfca_rig.description.camera_file import CameraFile, PlaneSection
    from rfca_rig.vision.board import Board, BoardPhoto, RefusedPhoto
    from rfca_rig.vision.camera_calibration import BoardPlacement, CameraCalibration


app = typer.Typer(help="Find the values that a rig's devices have.", no_args_is_help=True)

# Board that is assumed without --board: 10 x 7 squares of 25 mm with markers of 18 mm.
BOARD = "10x7,25,18"
# Share of the picture's width and height below which the user is asked for more photos.
WELL_COVERED = 0.8


class Reach(StrEnum):
    """The side of the picture to which the leg reaches out."""

    RIGHT = "right"
    LEFT = "left"


@app.callback()
def _group() -> None:
    """Keeps `camera` a command of its own."""


@app.command(cls=Command)
def camera(
    photos: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="PHOTOS", help="Photos of the board, or folders of them: 15, tilted all ways."
        ),
    ] = None,
    board: Annotated[
        str,
        typer.Option(
            "--board",
            metavar="CxR,MM,MM",
            help="Columns x rows of squares, width of a square, width of a marker.",
        ),
    ] = BOARD,
    make_board: Annotated[
        Path | None,
        typer.Option(
            "--make-board",
            metavar="FILE",
            help="Write the board to be printed, .pdf or .png, and leave.",
        ),
    ] = None,
    plane: Annotated[
        Path | None,
        typer.Option(
            "--plane", metavar="PHOTO", help="A photo of the board held in the plane of the marks."
        ),
    ] = None,
    board_at: Annotated[
        str | None,
        typer.Option(
            "--board-at",
            metavar="MM,MM",
            help="There: its upper left corner from the shaft axis, to the right and up.",
        ),
    ] = None,
    shaft_px: Annotated[
        str | None,
        typer.Option(
            "--shaft-px",
            metavar="PX,PX",
            help="Instead: where the shaft axis is in that photo, to the right and down.",
        ),
    ] = None,
    turned: Annotated[
        float,
        typer.Option(
            "--turned",
            metavar="DEG",
            min=-180,
            max=180,
            help="There: its upper edge from the horizontal, clockwise.",
        ),
    ] = 0.0,
    nearer: Annotated[
        float,
        typer.Option(
            "--nearer",
            metavar="MM",
            min=-500,
            max=500,
            help="There: how much nearer to the camera than the marks.",
        ),
    ] = 0.0,
    reach: Annotated[
        Reach,
        typer.Option(
            "--reach",
            metavar="SIDE",
            help="The side of the picture to which the leg reaches out: right, left.",
        ),
    ] = Reach.RIGHT,
    out: Annotated[
        Path, typer.Option("--out", metavar="FILE", help="The camera file to write.")
    ] = Path("calibration/camera.toml"),
    as_json: Json = False,
) -> None:
    """Camera matrix, lens distortion and the place of the plane of motion, from photos of a ChArUco
    board.

    Example: rfca-rig calibrate camera board/ --plane plane.jpg --board-at 20,15
    """
    from rfca_rig.cli.options import out_file
    from rfca_rig.cli.progress import make_marked_say
    from rfca_rig.errors import BadInput
    from rfca_rig.vision.board import parse_board

    described = parse_board(board)
    if make_board is not None:
        _make_board(described, make_board)
        return
    if not photos:
        raise BadInput(
            "no photos named; print the board first: rfca-rig calibrate camera --board "
            f"{board} --make-board board.pdf"
        )
    # Before the work, not after it.
    out_file(out)
    placement = _place(plane, board_at, shaft_px, turned, nearer, reach)
    say = make_marked_say("REAL", as_json)
    file = write_calibration(
        _files(photos), described, PlanePhoto(plane, placement, shaft_px), out, say
    )
    if as_json:
        echo(file.model_dump_json(indent=1))
        return
    for line in describe_calibration(file, out):
        say(line)


@dataclass(frozen=True)
class PlanePhoto:
    """The photo that places the plane of motion, None without one; where the board is in it, and
    the pixel of the shaft axis where that was given instead.
    """

    file: Path | None
    placement: "BoardPlacement"
    shaft_px: str | None = None


def write_calibration(
    files: "Sequence[Path]", board: "Board", plane: PlanePhoto, out: Path, say: "Say"
) -> "CameraFile":
    """Calibrate a camera from photos of the board, and write its file.

    Raises BadInput where the photos do not suffice.
    """
    from rfca_rig.description.camera_file import camera_file, write_camera_file
    from rfca_rig.vision.camera_calibration import calibrate

    calibration = calibrate([_find_board_in(file, board, say) for file in files])
    section = None
    if plane.file is not None:
        section = _plane(plane.file, calibration, board, plane.placement, plane.shaft_px)
    file = camera_file(calibration, board.to_text(), section)
    write_camera_file(
        out,
        file,
        [f"A camera, calibrated with {len(calibration.photos)} photos of a ChArUco board."],
    )
    return file


def _make_board(board: "Board", path: Path) -> None:
    from rfca_rig.cli.options import out_file
    from rfca_rig.errors import BadInput
    from rfca_rig.recording.atomic import write_atomically
    from rfca_rig.vision.board import board_pdf, board_png

    makers = {".pdf": board_pdf, ".png": board_png}
    if path.suffix.lower() not in makers:
        raise BadInput(f"{path}: a board is written as .pdf or .png; name such a file")
    out_file(path)
    write_atomically(path, makers[path.suffix.lower()](board))
    echo(
        (
            f"board {board.to_text()} in {path}; print it at 100 %, check its line with a "
            "ruler, glue it flat"
        ),
        err=True,
    )


def _files(photos: list[Path]) -> list[Path]:
    from rfca_rig.drivers.photo_files import list_photos
    from rfca_rig.errors import BadInput

    files = []
    for path in photos:
        if path.is_dir():
            files += list_photos(path)
        else:
            files.append(path)
    if missing := next((file for file in files if not file.is_file()), None):
        raise BadInput(f"{missing}: no such photo; name photos, or folders that hold them")
    return files


def _find_board_in(file: Path, board: "Board", say: "Say") -> "BoardPhoto | RefusedPhoto":
    """The board in a file; a damaged picture is refused like one without a board."""
    from rfca_rig.drivers.photo_files import read_picture
    from rfca_rig.errors import BadInput
    from rfca_rig.vision.board import BoardPhoto, RefusedPhoto, find_board

    try:
        result = find_board(read_picture(file), board, file.name)
    except BadInput as error:
        result = RefusedPhoto(file.name, str(error).removeprefix(f"{file}: "))
    if isinstance(result, BoardPhoto):
        say(f"{file.name}: {len(result.px)} corners")
    else:
        say(f"{file.name}: REFUSED, {result.why}")
    return result


def _place(
    plane: Path | None,
    board_at: str | None,
    shaft_px: str | None,
    turned_deg: float,
    nearer_mm: float,
    reach: Reach,
) -> "BoardPlacement":
    from math import radians

    from rfca_rig.errors import BadInput
    from rfca_rig.vision.camera_calibration import BoardPlacement

    if plane is None and (board_at or shaft_px):
        raise BadInput(
            "--board-at and --shaft-px speak of the photo with the board in the plane; "
            "name it with --plane"
        )
    # Exactly one of the two: each places the origin, and both together could contradict each other.
    if plane is not None and (board_at is None) == (shaft_px is None):
        raise BadInput(
            "--plane needs to know where the shaft axis is: either --board-at Y,Z or --shaft-px U,V"
        )
    corner_mm = (0.0, 0.0)
    if board_at is not None:
        corner_mm = _pair(board_at, "--board-at")
    if shaft_px is not None:
        _pair(shaft_px, "--shaft-px")
    return BoardPlacement(
        (corner_mm[0] / 1e3, corner_mm[1] / 1e3), reach.value, radians(turned_deg), nearer_mm / 1e3
    )


def _pair(text: str, option: str) -> tuple[float, float]:
    from math import isfinite

    from rfca_rig.errors import BadInput

    try:
        first, second = (float(part) for part in text.split(","))
    except ValueError:
        raise BadInput(
            f"{option} {text}: should be two numbers with a comma between them, such as 20,-15"
        ) from None
    if not (isfinite(first) and isfinite(second)):
        raise BadInput(f"{option} {text}: should be two finite numbers, such as 20,-15")
    return first, second


def _plane(
    photo: Path,
    calibration: "CameraCalibration",
    board: "Board",
    placement: "BoardPlacement",
    shaft_px: str | None,
) -> "PlaneSection":
    from dataclasses import replace

    from rfca_rig.description.camera_file import plane_section
    from rfca_rig.drivers.photo_files import read_picture
    from rfca_rig.errors import BadInput
    from rfca_rig.vision.board import RefusedPhoto, find_board
    from rfca_rig.vision.camera_calibration import find_plane, with_origin_at

    picture = find_board(read_picture(photo), board, photo.name)
    if isinstance(picture, RefusedPhoto):
        raise BadInput(f"{photo}: {picture.why}")
    if picture.size_px != calibration.size_px:
        raise BadInput(
            f"{photo}: is {picture.size_px[0]} x {picture.size_px[1]} pixels, the photos of "
            f"the board {calibration.size_px}"
        )
    pose = find_plane(picture, calibration.matrix, calibration.distortion, placement)
    if shaft_px is None:
        return plane_section(
            pose,
            photo.name,
            f"board at {1e3 * placement.corner_m[0]:g}, {1e3 * placement.corner_m[1]:g} mm",
        )
    # Orientation from the board, origin from the pixel of the shaft axis.
    moved = with_origin_at(
        calibration.camera(pose.rotation, pose.translation_m), _pair(shaft_px, "--shaft-px")
    )
    return plane_section(
        replace(pose, translation_m=moved.translation_m),
        photo.name,
        f"shaft axis at pixel {shaft_px}",
    )


def describe_calibration(file: "CameraFile", out: Path) -> list[str]:
    """Lines for a terminal."""
    lens = file.camera
    lines = [
        (
            f"{len(file.photos)} photos used, {len(file.refused)} refused, reprojection error "
            f"{lens.reprojection_error_px:.3f} px"
        ),
        (
            f"focal length {lens.focal_px[0]:.1f} +- {lens.focal_std_px[0]:.1f} px, "
            f"{lens.focal_px[1]:.1f} +- {lens.focal_std_px[1]:.1f} px"
        ),
    ]
    left, top, right, bottom = lens.covered_px
    across = (right - left) / lens.image_size_px[0]
    down = (bottom - top) / lens.image_size_px[1]
    if min(across, down) < WELL_COVERED:
        lines.append(
            f"the board was seen in {100 * across:.0f} % of the picture's width and "
            f"{100 * down:.0f} % of its height: beyond that the "
            "lens is only supposed; add photos with the board in the corners"
        )
    written = f"camera file {out}"
    if plane := file.plane:
        tilt_deg = max(plane.tilt_std_deg)
        lines.append(
            f"plane from {plane.photo}: {plane.reprojection_error_px:.3f} px off, tilt "
            f"known to {tilt_deg:.3f} degrees"
        )
    else:
        written += "; where it stands is unknown yet: --plane PHOTO adds it"
    return [*lines, written]
