"""The board for printing, in true scale: PDF with vector squares, or PNG with its resolution."""

import struct
import zlib
from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from rfca_rig.vision.board import Board

MARGIN_M = 0.012
PER_INCH_M = 0.0254
POINT_M = PER_INCH_M / 72.0
# Length of the line that is checked with a ruler.
RULE_M = 0.1
PNG_PER_INCH = 600

Rectangle = tuple[float, float, float, float]


def board_pdf(board: Board) -> bytes:
    """A PDF page with the board, a line of 100 mm for checking the printer's scale, and the option that describes the board."""
    width_m, height_m = (side + 2 * MARGIN_M for side in board.size_m())
    fills = "\n".join(_pdf_rectangle(rectangle, height_m) for rectangle in (*_black_m(board), *_ruler_m(board)))
    caption = f"{board.to_text()}   the line is {1e3 * _rule_m(board):g} mm long: print at 100 %, measure it"
    text = f"BT /F1 7 Tf {MARGIN_M / POINT_M:.3f} {0.2 * MARGIN_M / POINT_M:.3f} Td ({caption}) Tj ET"
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
        edges = np.flatnonzero(np.diff(np.concatenate(([False], bits[row] == 0, [False])).astype(np.int8)))
        for first, last in edges.reshape(-1, 2).tolist():
            yield MARGIN_M + left_m + first * cell_m, MARGIN_M + top_m + row * cell_m, (last - first) * cell_m, cell_m


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
    return " ".join(f"{value / POINT_M:.4f}" for value in (left, sheet_m - top - height, width, height)) + " re f"


def _pdf(width: float, height: float, drawing: bytes) -> bytes:
    """A PDF 1.4 document (ISO 32000) of one page: catalogue, pages, page, font and content, then the table of their positions."""
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R /ViewerPreferences << /PrintScaling /None >> >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 5 0 R".encode()
        + b" /Resources << /Font << /F1 4 0 R >> >> >>",
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica >>",
        b"<< /Length %d >>\nstream\n" % len(drawing) + drawing + b"endstream",
    ]
    document, places = b"%PDF-1.4\n", []
    # The cross-reference table holds the byte offset of every object.
    for number, content in enumerate(objects, start=1):
        places.append(len(document))
        document += b"%d 0 obj\n" % number + content + b"\nendobj\n"
    table = b"".join(b"%010d 00000 n \n" % place for place in places)
    size = len(objects) + 1
    ending = b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (size, len(document))
    return document + b"xref\n0 %d\n0000000000 65535 f \n" % size + table + ending


def board_picture(board: Board, px_per_m: float) -> NDArray[np.uint8]:
    """The sheet as a grey picture (rows, columns) uint8, with the rectangles of the PDF but without its line of text."""
    width_m, height_m = (side + 2 * MARGIN_M for side in board.size_m())
    sheet = np.full((round(height_m * px_per_m), round(width_m * px_per_m)), 255, np.uint8)
    for left, top, width, height in (*_black_m(board), *_ruler_m(board)):
        # At least one pixel wide, so that the ruler does not vanish.
        rows = slice(round(top * px_per_m), max(round((top + height) * px_per_m), round(top * px_per_m) + 1))
        columns = slice(round(left * px_per_m), max(round((left + width) * px_per_m), round(left * px_per_m) + 1))
        sheet[rows, columns] = 0
    return sheet


def board_png(board: Board) -> bytes:
    """The sheet as PNG with 600 pixels per inch, stated in the chunk pHYs (W3C PNG, 11.3.5.3), which printing programs use."""
    px_per_m = PNG_PER_INCH / PER_INCH_M
    content = cv2.imencode(".png", board_picture(board, px_per_m))[1].tobytes()
    body = b"pHYs" + struct.pack(">IIB", round(px_per_m), round(px_per_m), 1)
    chunk = struct.pack(">I", 9) + body + struct.pack(">I", zlib.crc32(body))
    # Lengths of the signature and of IHDR, which pHYs has to follow.
    header = 8 + 25
    return content[:header] + chunk + content[header:]
