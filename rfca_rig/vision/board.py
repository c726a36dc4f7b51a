"""The ChArUco board: a chessboard with a numbered marker in every white square, so that any part of it tells where it is."""

import re
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]

DICTIONARIES = {"4x4": cv2.aruco.DICT_4X4_1000, "5x5": cv2.aruco.DICT_5X5_1000, "6x6": cv2.aruco.DICT_6X6_1000}
FEWEST, MOST = 4, 40

_WRITTEN = re.compile(r"(\d+)x(\d+),([0-9.]+),([0-9.]+)(?:,([456]x[456]))?")


@dataclass(frozen=True)
class Board:
    """`columns` x `rows` squares of `square_m`, the markers `marker_m` wide, of `bits` x `bits` (4x4, 5x5 or 6x6), numbered from 0.

    The board's own frame: origin at its upper left corner, first axis along its columns to the right, second downwards.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    bits: str = "4x4"

    def written(self) -> str:
        """As `board_of` reads it."""
        return f"{self.columns}x{self.rows},{1e3 * self.square_m:g},{1e3 * self.marker_m:g},{self.bits}"

    def size_m(self) -> tuple[float, float]:
        """Width and height."""
        return self.columns * self.square_m, self.rows * self.square_m

    def corners_m(self) -> Floats:
        """The inner corners (n, 2), in the order of their numbers."""
        across, down = np.meshgrid(np.arange(1, self.columns), np.arange(1, self.rows))
        return self.square_m * np.stack([across.ravel(), down.ravel()], axis=1).astype(np.float64)

    def opencv(self) -> Any:
        """The same as OpenCV's board."""
        markers = cv2.aruco.getPredefinedDictionary(DICTIONARIES[self.bits])
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square_m, self.marker_m, markers)


def board_of(text: str) -> Board:
    """The board written as COLUMNSxROWS,SQUARE_MM,MARKER_MM or with 4x4, 5x5 or 6x6 behind. Raises BadInput."""
    said = _WRITTEN.fullmatch(text.replace(" ", "").lower())
    if said is None:
        raise BadInput(f"board {text!r}: should be COLUMNSxROWS,SQUARE_MM,MARKER_MM such as 10x7,25,18, and ,5x5 for other markers")
    columns, rows = int(said[1]), int(said[2])
    try:
        square_mm, marker_mm = float(said[3]), float(said[4])
    except ValueError:
        raise BadInput(f"board {text!r}: {said[3]} and {said[4]} should be two lengths in mm") from None
    if not (FEWEST <= columns <= MOST and FEWEST <= rows <= MOST):
        raise BadInput(f"board {text!r}: {columns} x {rows} squares; should be {FEWEST} to {MOST} each way")
    if not 1.0 <= square_mm <= 500.0:
        raise BadInput(f"board {text!r}: squares of {square_mm:g} mm; should be 1 to 500 mm")
    if not 0.4 <= round(marker_mm / square_mm, 6) <= 0.8:
        raise BadInput(f"board {text!r}: markers of {marker_mm:g} mm in squares of {square_mm:g} mm; should be 0.4 to 0.8 of them")
    return Board(columns, rows, square_mm / 1e3, marker_mm / 1e3, said[5] or "4x4")
