"""The ChArUco board: its pattern, its sheet for printing, and its corners in a photo.

A chessboard with a numbered marker in every white square, so that any visible part can be located.
The sheet is in true scale: PDF with vector squares, or PNG with its resolution. Corners are found
to a part of a pixel, and photos checked for being usable.
"""

import re
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.errors import BadInput

Floats = NDArray[np.float64]

DICTIONARIES = {
    "4x4": cv2.aruco.DICT_4X4_1000,
    "5x5": cv2.aruco.DICT_5X5_1000,
    "6x6": cv2.aruco.DICT_6X6_1000,
}
# Limits of the number of squares in each direction.
MIN_SQUARES = 4
MAX_SQUARES = 40

_WRITTEN = re.compile(r"(\d+)x(\d+),([0-9.]+),([0-9.]+)(?:,([456]x[456]))?")

MARGIN_M = 0.012
PER_INCH_M = 0.0254
POINT_M = PER_INCH_M / 72.0
# Length of the line that is checked with a ruler.
RULE_M = 0.1
PNG_PER_INCH = 600

Rectangle = tuple[float, float, float, float]

MIN_CORNERS = 12
# Rows and columns of the board that must be seen: a photo of a single row says nothing about the
# camera.
MIN_LINES = 3
# Largest width of an edge, in squares. Wider edges merge the markers' bits, which are about a tenth
# of a square.
MAX_EDGE = 0.08
# An edge this narrow is sharp, however small the board is in the picture.
SHARP_EDGE_PX = 3.0
# Width from 10 % to 90 % of an edge that a Gaussian blurs, in its standard deviations.
EDGE_SIGMAS = 2.563


@dataclass(frozen=True)
class Board:
    """`columns` x `rows` squares of `square_m`, the markers `marker_m` wide, of `bits` x `bits`
    (4x4, 5x5 or 6x6), numbered from 0.

    The board's frame has its origin at the upper left corner; the first axis points right, the
    second downwards.
    """

    columns: int
    rows: int
    square_m: float
    marker_m: float
    bits: str = "4x4"

    def to_text(self) -> str:
        """The board as text that `parse_board` reads."""
        lengths_mm = f"{1e3 * self.square_m:g},{1e3 * self.marker_m:g}"
        return f"{self.columns}x{self.rows},{lengths_mm},{self.bits}"

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
        return cv2.aruco.CharucoBoard(
            (self.columns, self.rows), self.square_m, self.marker_m, markers
        )


def parse_board(text: str) -> Board:
    """Parse COLUMNSxROWS,SQUARE_MM,MARKER_MM, optionally followed by ,4x4, ,5x5 or ,6x6. Raises
    BadInput for anything else.
    """
    match = _WRITTEN.fullmatch(text.replace(" ", "").lower())
    if match is None:
        raise BadInput(
            f"board {text!r}: should be COLUMNSxROWS,SQUARE_MM,MARKER_MM such as "
            "10x7,25,18, and ,5x5 for other markers"
        )
    columns = int(match[1])
    rows = int(match[2])
    try:
        square_mm = float(match[3])
        marker_mm = float(match[4])
    except ValueError:
        raise BadInput(
            f"board {text!r}: {match[3]} and {match[4]} should be two lengths in mm"
        ) from None
    if not (MIN_SQUARES <= columns <= MAX_SQUARES and MIN_SQUARES <= rows <= MAX_SQUARES):
        raise BadInput(
            f"board {text!r}: {columns} x {rows} squares; should be {MIN_SQUARES} to "
            f"{MAX_SQUARES} each way"
        )
    if not 1.0 <= square_mm <= 500.0:
        raise BadInput(f"board {text!r}: squares of {square_mm:g} mm; should be 1 to 500 mm")
    # Rounded, so that a ratio of exactly 0.4 or 0.8 passes in spite of floating point.
    if not 0.4 <= round(marker_mm / square_mm, 6) <= 0.8:
        raise BadInput(
            f"board {text!r}: markers of {marker_mm:g} mm in squares of {square_mm:g} mm; "
            "should be 0.4 to 0.8 of them"
        )
    return Board(columns, rows, square_mm / 1e3, marker_mm / 1e3, match[5] or "4x4")


def board_pdf(board: Board) -> bytes:
    """A PDF page with the board, a line of 100 mm for checking the printer's scale, and the
    option that describes the board.
    """
    width_m, height_m = (side + 2 * MARGIN_M for side in board.size_m())
    fills = "\n".join(
        _pdf_rectangle(rectangle, height_m) for rectangle in (*_black_m(board), *_ruler_m(board))
    )
    caption = (
        f"{board.to_text()}   the line is {1e3 * _rule_m(board):g} mm long: print at 100 %, "
        "measure it"
    )
    text = (
        f"BT /F1 7 Tf {MARGIN_M / POINT_M:.3f} {0.2 * MARGIN_M / POINT_M:.3f} Td ({caption}) Tj ET"
    )
    return _pdf(width_m / POINT_M, height_m / POINT_M, f"0 g\n{fills}\n{text}\n".encode("ascii"))


def _black_m(board: Board) -> Iterator[Rectangle]:
    """Black rectangles (left, top, width, height) from the sheet's upper left corner."""
    drawn = board.opencv()
    square_m = board.square_m
    for row in range(board.rows):
        for column in range(board.columns):
            if (row + column) % 2 == 0:
                yield MARGIN_M + column * square_m, MARGIN_M + row * square_m, square_m, square_m
    for number, corners in zip(drawn.getIds().ravel().tolist(), drawn.getObjPoints(), strict=True):
        yield from _marker_m(board, number, float(corners[0][0]), float(corners[0][1]))


def _marker_m(board: Board, number: int, left_m: float, top_m: float) -> Iterator[Rectangle]:
    """Runs of black bits of one marker, row by row, so that there are no seams within a row."""
    # The marker's bits have a black border of one cell on every side.
    cells = int(board.bits[0]) + 2
    bits = cv2.aruco.generateImageMarker(board.opencv().getDictionary(), number, cells)
    cell_m = board.marker_m / cells
    for row in range(cells):
        # Changes between white and black: pairs of a run's first cell and the one after its last.
        edges = np.flatnonzero(
            np.diff(np.concatenate(([False], bits[row] == 0, [False])).astype(np.int8))
        )
        for first, last in edges.reshape(-1, 2).tolist():
            yield (
                MARGIN_M + left_m + first * cell_m,
                MARGIN_M + top_m + row * cell_m,
                (last - first) * cell_m,
                cell_m,
            )


def _rule_m(board: Board) -> float:
    return min(RULE_M, board.size_m()[0])


def _ruler_m(board: Board) -> Iterator[Rectangle]:
    top_m = 1.5 * MARGIN_M + board.size_m()[1]
    yield MARGIN_M, top_m - 1e-4, _rule_m(board), 2e-4
    for end_m in (MARGIN_M, MARGIN_M + _rule_m(board) - 2e-4):
        yield end_m, top_m - 1e-3, 2e-4, 2e-3


def _pdf_rectangle(rectangle: Rectangle, sheet_m: float) -> str:
    """A filled rectangle as PDF operators."""
    # PDF counts upwards from the lower edge, in points.
    left, top, width, height = rectangle
    return (
        " ".join(
            f"{value / POINT_M:.4f}" for value in (left, sheet_m - top - height, width, height)
        )
        + " re f"
    )


def _pdf(width: float, height: float, drawing: bytes) -> bytes:
    """A PDF 1.4 document (ISO 32000) of one page: catalogue, pages, page, font and content, then
    the table of their positions.
    """
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        (
            f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 5 0 R"
        ).encode()
        + b" /Resources << /Font << /F1 4 0 R >> >> >>",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        b"<< /Length %d >>\nstream\n" % len(drawing) + drawing + b"endstream",
    ]
    document = b"%PDF-1.4\n"
    places = []
    # The cross-reference table holds the byte offset of every object.
    for number, content in enumerate(objects, start=1):
        places.append(len(document))
        document += b"%d 0 obj\n" % number + content + b"\nendobj\n"
    table = b"".join(b"%010d 00000 n \n" % offset for offset in places)
    size = len(objects) + 1
    ending = b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (
        size,
        len(document),
    )
    return document + b"xref\n0 %d\n0000000000 65535 f \n" % size + table + ending


def board_picture(board: Board, px_per_m: float) -> NDArray[np.uint8]:
    """The sheet as a grey picture (rows, columns) uint8, with the rectangles of the PDF but
    without its line of text.
    """
    width_m, height_m = (side + 2 * MARGIN_M for side in board.size_m())
    sheet = np.full((round(height_m * px_per_m), round(width_m * px_per_m)), 255, np.uint8)
    for left, top, width, height in (*_black_m(board), *_ruler_m(board)):
        # At least one pixel wide, so that the ruler does not vanish.
        rows = slice(
            round(top * px_per_m), max(round((top + height) * px_per_m), round(top * px_per_m) + 1)
        )
        columns = slice(
            round(left * px_per_m),
            max(round((left + width) * px_per_m), round(left * px_per_m) + 1),
        )
        sheet[rows, columns] = 0
    return sheet


def board_png(board: Board) -> bytes:
    """The sheet as PNG with 600 pixels per inch, stated in the chunk pHYs (W3C PNG, 11.3.5.3),
    which printing programs use.
    """
    px_per_m = PNG_PER_INCH / PER_INCH_M
    content = cv2.imencode(".png", board_picture(board, px_per_m))[1].tobytes()
    body = b"pHYs" + struct.pack(">IIB", round(px_per_m), round(px_per_m), 1)
    chunk = struct.pack(">I", 9) + body + struct.pack(">I", zlib.crc32(body))
    # Lengths of the signature and of IHDR, which pHYs has to follow.
    header = 8 + 25
    return content[:header] + chunk + content[header:]


@dataclass(frozen=True, eq=False)
class BoardPhoto:
    """Corners of one photo: `on_board_m` (n, 2) in the board's frame, `px` (n, 2); `size_px`
    (width, height) of the photo.

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
    """Find the board in a picture, of shape (rows, columns) or (rows, columns, 3) uint8; returns
    its corners or why it is unusable.
    """
    grey = np.asarray(
        cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 else image, np.uint8
    )
    numbers, px = _corners(grey, board)
    corners = f"{len(numbers)} of the board's {(board.columns - 1) * (board.rows - 1)} corners"
    if len(numbers) < MIN_CORNERS:
        return RefusedPhoto(
            name,
            (
                f"shows {corners}, {MIN_CORNERS} are needed: bring the board nearer, into light "
                "and focus"
            ),
        )
    rows, columns = (len(np.unique(lines)) for lines in np.divmod(numbers, board.columns - 1))
    if min(rows, columns) < MIN_LINES:
        return RefusedPhoto(
            name,
            (
                f"shows {corners}, on {min(rows, columns)} line: bring more of the board into "
                "the picture"
            ),
        )
    edge_px, square_px = _edges(grey, board, numbers, px)
    limit_px = max(MAX_EDGE * square_px, SHARP_EDGE_PX)
    if edge_px > limit_px:
        return RefusedPhoto(
            name,
            (
                f"is blurred: edges {edge_px:.1f} px wide, at most {limit_px:.1f} px: hold "
                "the board still, focus"
            ),
        )
    return BoardPhoto(name, (grey.shape[1], grey.shape[0]), board.corners_m()[numbers], px, edge_px)


def _corners(grey: NDArray[np.uint8], board: Board) -> tuple[NDArray[np.int64], Floats]:
    """Numbers (n,) and positions (n, 2) in px of the corners found."""
    corners, numbers, _, _ = cv2.aruco.CharucoDetector(board.opencv()).detectBoard(grey)
    # OpenCV gives None for both where it finds no corner; its types do not say so.
    if cast(NDArray[np.int32] | None, numbers) is None:
        return np.empty(0, np.int64), np.empty((0, 2))
    return np.asarray(numbers, np.int64).ravel(), np.asarray(corners, np.float64).reshape(-1, 2)


def _edges(
    grey: NDArray[np.uint8], board: Board, numbers: NDArray[np.int64], px: Floats
) -> tuple[float, float]:
    """Median width in px of the edges between neighbouring corners, and that of a square, each the
    larger of the board's two directions.

    Camera shake blurs one direction only, so the worse one counts.
    """
    positions = {int(number): at for number, at in zip(numbers, px, strict=True)}
    in_a_row = board.columns - 1
    # The profile ends before the marker in the white square.
    reach = 0.45 * (1.0 - board.marker_m / board.square_m)
    # Corners are numbered row by row, so neighbours differ by 1 or by the length of a row.
    widths = []
    for step in (1, in_a_row):
        edges = []
        for number, first in positions.items():
            is_last_in_row = (number + 1) % in_a_row == 0
            second = positions.get(number + step)
            if second is None or (step == 1 and is_last_in_row):
                continue
            edges.append(_edge(grey, first, second, reach))
        if edges:
            widths.append(np.median(edges, axis=0))
    return max((float(width) for width, _ in widths), default=0.0), max(
        (float(square) for _, square in widths), default=0.0
    )


def _edge(
    grey: NDArray[np.uint8], first: Floats, second: Floats, reach: float
) -> tuple[float, float]:
    """Width and length in px of the edge between two corners (2,), measured at its middle.

    The width is the total rise over the steepest slope, converted as for a Gaussian blur.
    """
    along = second - first
    length = float(np.hypot(*along))
    across = np.array([-along[1], along[0]]) / length
    steps = np.linspace(-reach, reach, 25) * length
    at = (0.5 * (first + second) + steps[:, None] * across).astype(np.float32)
    profile = cv2.remap(
        grey, at[None, :, 0], at[None, :, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )[0].astype(np.float64)
    steepest = float(np.abs(np.gradient(profile, steps)).max())
    if steepest > 0:
        return EDGE_SIGMAS * float(np.ptp(profile)) / (np.sqrt(2 * np.pi) * steepest), length
    return length, length
