"""Finds the board's corners in a photo, to a part of a pixel, and checks whether the photo is usable."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.vision.board import Board

Floats = NDArray[np.float64]

MIN_CORNERS = 12
# Rows and columns of the board that must be seen: a photo of a single row says nothing about the camera.
MIN_LINES = 3
# Largest width of an edge, in squares. Wider edges merge the markers' bits, which are about a tenth of a square.
MAX_EDGE = 0.08
# An edge this narrow is sharp, however small the board is in the picture.
SHARP_EDGE_PX = 3.0
# Width from 10 % to 90 % of an edge that a Gaussian blurs, in its standard deviations.
EDGE_SIGMAS = 2.563


@dataclass(frozen=True, eq=False)
class BoardPhoto:
    """Corners of one photo: `on_board_m` (n, 2) in the board's frame, `px` (n, 2); `size_px` (width, height) of the photo.

    `edge_px` is the width of its edges, 10 % to 90 %.
    """

    name: str
    size_px: tuple[int, int]
    on_board_m: Floats
    px: Floats
    edge_px: float


@dataclass(frozen=True)
class RefusedPhoto:
    """A rejected photo, with the reason in one line."""

    name: str
    why: str


def find_board(image: NDArray[np.uint8], board: Board, name: str) -> BoardPhoto | RefusedPhoto:
    """Find the board in a picture, of shape (rows, columns) or (rows, columns, 3) uint8; returns its corners or why it is unusable."""
    grey = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image, np.uint8)
    numbers, px = _corners(grey, board)
    found = f"{len(numbers)} of the board's {(board.columns - 1) * (board.rows - 1)} corners"
    if len(numbers) < MIN_CORNERS:
        return RefusedPhoto(name, f"shows {found}, {MIN_CORNERS} are needed: bring the board nearer, into light and focus")
    rows, columns = (len(np.unique(lines)) for lines in np.divmod(numbers, board.columns - 1))
    if min(rows, columns) < MIN_LINES:
        return RefusedPhoto(name, f"shows {found}, on {min(rows, columns)} line: bring more of the board into the picture")
    edge_px, square_px = _edges(grey, board, numbers, px)
    limit_px = max(MAX_EDGE * square_px, SHARP_EDGE_PX)
    if edge_px > limit_px:
        return RefusedPhoto(name, f"is blurred: edges {edge_px:.1f} px wide, at most {limit_px:.1f} px: hold the board still, focus")
    return BoardPhoto(name, (grey.shape[1], grey.shape[0]), board.corners_m()[numbers], px, edge_px)


def _corners(grey: NDArray[np.uint8], board: Board) -> tuple[NDArray[np.int64], Floats]:
    """Numbers (n,) and positions (n, 2) in px of the corners found."""
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(board.opencv()).detectBoard(grey)
    if numbers is None or not len(numbers):
        return np.empty(0, np.int64), np.empty((0, 2))
    return np.asarray(numbers, np.int64).ravel(), np.asarray(corners, np.float64).reshape(-1, 2)


def _edges(grey: NDArray[np.uint8], board: Board, numbers: NDArray[np.int64], px: Floats) -> tuple[float, float]:
    """Median width in px of the edges between neighbouring corners, and that of a square, each the larger of the board's two directions.

    Camera shake blurs one direction only, so the worse one counts.
    """
    place = {int(number): at for number, at in zip(numbers, px, strict=True)}
    in_a_row = board.columns - 1
    # The profile ends before the marker in the white square.
    reach = 0.45 * (1.0 - board.marker_m / board.square_m)
    # Corners are numbered row by row, so neighbours differ by 1 or by the length of a row.
    pairs = (
        [(at, place.get(number + step)) for number, at in place.items() if step > 1 or (number + 1) % in_a_row] for step in (1, in_a_row)
    )
    both = [[_edge(grey, first, second, reach) for first, second in ends if second is not None] for ends in pairs]
    widths = [np.median(each, axis=0) for each in both if each]
    return max((float(width) for width, _ in widths), default=0.0), max((float(square) for _, square in widths), default=0.0)


def _edge(grey: NDArray[np.uint8], first: Floats, second: Floats, reach: float) -> tuple[float, float]:
    """Width and length in px of the edge between two corners (2,), measured at its middle.

    The width is the total rise over the steepest slope, converted as for a Gaussian blur.
    """
    along = second - first
    length = float(np.hypot(*along))
    across = np.array([-along[1], along[0]]) / length
    steps = np.linspace(-reach, reach, 25) * length
    at = (0.5 * (first + second) + steps[:, None] * across).astype(np.float32)
    profile = cv2.remap(grey, at[None, :, 0], at[None, :, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)[0].astype(np.float64)
    steepest = float(np.abs(np.gradient(profile, steps)).max())
    return (EDGE_SIGMAS * float(np.ptp(profile)) / (np.sqrt(2 * np.pi) * steepest) if steepest > 0 else length), length
