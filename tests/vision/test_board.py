"""The board: what is typed for it, and what comes out of the printer."""

import re
import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rfca_rig.errors import BadInput
from rfca_rig.vision.board import (
    MARGIN_M,
    Board,
    BoardPhoto,
    board_pdf,
    board_picture,
    board_png,
    find_board,
    parse_board,
)


@given(
    st.integers(4, 40),
    st.integers(4, 40),
    st.integers(5, 60),
    st.integers(40, 80),
    st.sampled_from(["4x4", "5x5", "6x6"]),
)
def test_what_is_written_is_read_back(columns, rows, square_mm, share_pct, bits):
    board = Board(columns, rows, square_mm / 1e3, square_mm * share_pct / 1e5, bits)
    again = parse_board(board.to_text())
    assert (again.columns, again.rows, again.bits) == (columns, rows, bits)
    assert (again.square_m, again.marker_m) == pytest.approx(
        (board.square_m, board.marker_m), rel=1e-5
    )


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("10x7", "should be COLUMNSxROWS,SQUARE_MM,MARKER_MM such as 10x7,25,18"),
        ("10x7,25,18,7x7", "should be COLUMNSxROWS"),
        ("3x7,25,18", "3 x 7 squares; should be 4 to 40 each way"),
        ("10x7,25,24", "markers of 24 mm in squares of 25 mm; should be 0.4 to 0.8"),
        ("10x7,2.5.1,18", "2.5.1 and 18 should be two lengths"),
        ("10x7,0,0", "squares of 0 mm"),
    ],
)
def test_a_board_that_cannot_be_is_one_line(text, line):
    with pytest.raises(BadInput, match=re.escape(line)):
        parse_board(text)


@pytest.mark.parametrize("text", ["10x7,25,18", "7x10,20,15,5x5", "12x9,15,10,6x6"])
def test_corners_are_numbered_and_placed_as_opencv_finds_them(text):
    """The picture is drawn here, square by square; OpenCV's detector says which corner is where."""
    board = parse_board(text)
    px_per_m = 2000.0
    found = find_board(board_picture(board, px_per_m), board, "sheet")
    assert isinstance(found, BoardPhoto)
    assert len(found.px) == (board.columns - 1) * (board.rows - 1)
    expected = (found.on_board_m + MARGIN_M) * px_per_m - 0.5
    assert np.abs(found.px - expected).max() < 0.15
    assert np.allclose(
        board.corners_m(), np.asarray(board.opencv().getChessboardCorners())[:, :2], atol=1e-6
    )


def test_the_pdf_is_in_true_scale_and_says_the_same_as_the_picture():
    """Its rectangles are drawn again here, in points of 1/72 inch."""
    board = parse_board("10x7,25,18")
    document = board_pdf(board)
    box = [float(word) for word in re.search(rb"/MediaBox \[([^]]*)\]", document)[1].split()]
    assert box == pytest.approx(
        [0, 0, (0.25 + 2 * MARGIN_M) / 0.0254 * 72, (0.175 + 2 * MARGIN_M) / 0.0254 * 72], abs=1e-3
    )
    drawn_lines = [line for line in document.split(b"\n") if line.endswith(b" re f")]
    rectangles = np.array([[float(word) for word in line.split()[:4]] for line in drawn_lines])
    widest_mm = rectangles[:, 2].max() * 25.4 / 72
    assert widest_mm == pytest.approx(100.0, abs=1e-3)  # the line to be measured
    px_per_m = 4000.0
    drawn = np.full(board_picture(board, px_per_m).shape, 255, np.uint8)
    scale = px_per_m * 0.0254 / 72
    for left, bottom, width, height in rectangles:
        top = round((box[3] - bottom - height) * scale)
        drawn[
            top : max(round((box[3] - bottom) * scale), top + 1),
            round(left * scale) : max(round((left + width) * scale), round(left * scale) + 1),
        ] = 0
    assert np.mean(drawn != board_picture(board, px_per_m)) < 1e-3


def test_every_address_in_the_pdf_leads_to_its_object():
    document = board_pdf(parse_board("5x4,30,20"))
    table = int(re.search(rb"startxref\n(\d+)", document)[1])
    assert document[table:].startswith(b"xref\n0 6\n")
    for number, place in enumerate(re.findall(rb"(\d{10}) 00000 n", document[table:]), start=1):
        assert document[int(place) :].startswith(b"%d 0 obj" % number)
    length = int(re.search(rb"/Length (\d+)", document)[1])
    stream = document.index(b"stream\n") + 7
    assert document[stream + length :].startswith(b"endstream")


def test_the_png_says_its_resolution():
    content = board_png(parse_board("10x7,25,18"))
    at = content.index(b"pHYs")
    across, down, unit = struct.unpack(">IIB", content[at + 4 : at + 13])
    assert (across, down, unit) == (23622, 23622, 1)
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
    assert picture.shape == (
        round((0.175 + 2 * MARGIN_M) * 600 / 0.0254),
        round((0.25 + 2 * MARGIN_M) * 600 / 0.0254),
    )
