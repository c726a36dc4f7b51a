"""The ChArUco board: a chessboard with a numbered marker in every white square, so that any visible part can be located."""

import re
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]

DICTIONARIES = {"4x4": cv2.aruco.DICT_4X4_1000, "5x5": cv2.aruco.DICT_5X5_1000, "6x6": cv2.aruco.DICT_6X6_1000}
# Limits of the number of squares in each direction.
MIN_SQUARES, MAX_SQUARES = 4, 40

_WRITTEN = re.compile(r"(\d+)x(\d+),([0-9.]+),([0-9.]+)(?:,([456]x[456]))?")


@dataclass(frozen=True)
class Board:
    """`columns` x `rows` squares of `square_m`, the markers `marker_m` wide, of `bits` x `bits` (4x4, 5x5 or 6x6), numbered from 0.

    The board's frame has its origin at the upper left corner; the first axis points right, the second downwards.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    bits: str = "4x4"

    def to_text(self) -> str:
        """The board as text that `parse_board` reads."""
        return f"{self.columns}x{self.rows},{1e3 * self.square_m:g},{1e3 * self.marker_m:g},{self.bits}"

    def size_m(self) -> tuple[float, float]:
        """Width and height in metres."""
        return self.columns * self.square_m, self.rows * self.square_m

    def corners_m(self) -> Floats:
        """The inner corners (n, 2) in metres, in the order of their numbers."""
        across, down = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        return self.square_m * np.stack([across.ravel(), down.ravel()], axis=1).astype(np.float64)

    def opencv(self) -> Any:
        """The board as an OpenCV object."""
        markers = cv2.aruco.getPredefinedDictionary(DICTIONARIES[self.bits])
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, markers)


def parse_board(text: str) -> Board:
    """Parse COLUMNSxROWS,SQUARE_MM,MARKER_MM, optionally followed by ,4x4, ,5x5 or ,6x6. Raises BadInput for anything else."""
    match = _WRITTEN.fullmatch(text.replace(" ", "").lower())
    if match is None:
        raise BadInput(f"board {text!r}: should be COLUMNSxROWS,SQUARE_MM,MARKER_MM such as 10x7,25,18, and ,5x5 for other markers")
    columns, rows = int(match[1]), int(match[2])
    try:
        square_mm, marker_mm = float(match[3]), float(match[4])
    except ValueError:
        raise BadInput(f"board {text!r}: {match[3]} and {match[4]} should be two lengths in mm") from None
    if not (MIN_SQUARES <= columns <= MAX_SQUARES and MIN_SQUARES <= rows <= MAX_SQUARES):
        raise BadInput(f"board {text!r}: {columns} x {rows} squares; should be {MIN_SQUARES} to {MAX_SQUARES} each way")
    if not 1.0 <= square_mm <= 500.0:
        raise BadInput(f"board {text!r}: squares of {square_mm:g} mm; should be 1 to 500 mm")
    # Rounded, so that a ratio of exactly 0.4 or 0.8 passes in spite of floating point.
    if not 0.4 <= round(marker_mm / square_mm, 6) <= 0.8:
        raise BadInput(f"board {text!r}: markers of {marker_mm:g} mm in squares of {square_mm:g} mm; should be 0.4 to 0.8 of them")
    return Board(columns, rows, square_mm / 1e3, marker_mm / 1e3, match[5] or "4x4")
