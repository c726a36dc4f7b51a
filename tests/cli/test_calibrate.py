"""rfca-rig calibrate camera, from the board's sheet to the camera file."""

import json

import cv2
import numpy as np
import pytest

from rfca_rig.description.camera_file import read_camera_file
from rfca_rig.errors import BadInput
from rfca_rig.vision.board import parse_board
from tests.cli.typed import typed
from tests.vision.board_scenes import TrueCamera, board_photo, tilted_all_ways, turn

BOARD = parse_board("10x7,25,18")
SMALL = TrueCamera((655.0, 652.0), (327.0, 235.0), (-0.21, 0.09, 0.0007, -0.0005, 0.0), (640, 480))
PLANE = (turn(4.0, -7.0, 0.0), np.array([-0.11, -0.07, 0.5]))


@pytest.fixture(scope="module")
def photos(tmp_path_factory):
    """Nine of the board, one that shows none, one cut short; and one with the board in the
    plane.
    """
    folder = tmp_path_factory.mktemp("photos")
    random = np.random.default_rng(4)
    for at, pose in enumerate(tilted_all_ways(BOARD)[:9]):
        cv2.imwrite(str(folder / f"board-{at}.png"), board_photo(BOARD, SMALL, *pose, random))
    cv2.imwrite(str(folder / "lens-cap.png"), np.zeros((480, 640, 3), np.uint8))
    (folder / "cut.png").write_bytes((folder / "board-0.png").read_bytes()[:5000])
    cv2.imwrite(
        str(folder.parent / "plane.jpg"),
        board_photo(BOARD, SMALL, *PLANE, random),
        [cv2.IMWRITE_JPEG_QUALITY, 95],
    )
    return folder


@pytest.fixture
def call(monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(tmp_path)
    return lambda *words: typed(monkeypatch, capsys, "calibrate", "camera", *words)


@pytest.mark.slow
def test_from_photos_to_a_camera_before_the_plane(call, photos, tmp_path):
    said = call(
        photos,
        "--plane",
        photos.parent / "plane.jpg",
        "--board-at",
        "20,15",
        "--out",
        tmp_path / "camera.toml",
    )
    assert said.exit_code == 0, said.err
    assert "REAL cut.png: REFUSED, a PNG that is cut short" in said.err
    assert "REAL lens-cap.png: REFUSED, shows 0 of the board's 54 corners" in said.err
    assert "9 photos used, 2 refused, reprojection error 0.0" in said.err
    file = read_camera_file(tmp_path / "camera.toml")
    assert [photo.name for photo in file.refused] == ["cut.png", "lens-cap.png"]
    assert len(file.photos) == 9
    assert "the board was seen in" not in said.err
    left, top, right, bottom = file.camera.covered_px
    assert 0.0 <= left < 0.15 * 640 < 0.85 * 640 < right <= 640.0
    assert 0.0 <= top < 0.15 * 480 < 0.85 * 480 < bottom <= 480.0
    assert all(0.0 < photo.reprojection_error_px < 0.2 for photo in file.photos)
    assert file.camera.focal_px == pytest.approx(SMALL.focal, rel=0.002)
    camera = file.model()
    # a point 30 mm along and 40 mm below the board's upper left corner, which is held at (20, 15)
    # mm
    on_board = PLANE[0] @ np.array([0.03, 0.04, 0.0]) + PLANE[1]
    seen_px = cv2.projectPoints(
        on_board[None], np.zeros(3), np.zeros(3), true_matrix(), np.array(SMALL.distortion)
    )[0].ravel()
    assert camera.project(np.array([0.05, -0.025])) == pytest.approx(seen_px, abs=0.2)
    assert camera.on_plane(seen_px) == pytest.approx([0.05, -0.025], abs=2e-4)


def true_matrix():
    return np.array(
        [[SMALL.focal[0], 0, SMALL.centre[0]], [0, SMALL.focal[1], SMALL.centre[1]], [0, 0, 1.0]]
    )


@pytest.mark.slow
def test_the_shaft_axis_by_its_pixel_and_the_result_as_json(call, photos, tmp_path):
    fewest = [photos / f"board-{at}.png" for at in range(6)]
    said = call(
        *fewest,
        "--plane",
        photos.parent / "plane.jpg",
        "--shaft-px",
        "200.5,150.25",
        "--out",
        "c.toml",
        "--json",
    )
    assert said.exit_code == 0, said.err
    assert said.err == ""
    told = json.loads(said.out)
    assert told["plane"]["origin_from"] == "shaft axis at pixel 200.5,150.25"
    assert read_camera_file(tmp_path / "c.toml").model().project(np.zeros(2)) == pytest.approx(
        [200.5, 150.25], abs=1e-3
    )


@pytest.mark.slow
def test_without_a_plane_the_file_says_what_is_missing(call, photos, tmp_path):
    said = call(photos, "--out", "c.toml")
    assert said.exit_code == 0
    assert "where it stands is unknown yet: --plane PHOTO adds it" in said.err
    with pytest.raises(BadInput, match=r"no \[plane\]: where the camera stands is unknown"):
        read_camera_file(tmp_path / "c.toml").model()


@pytest.mark.slow
def test_a_part_of_the_picture_that_no_board_was_in_is_told(call, photos):
    """Of these the board's corners reach no farther than a part of the height."""
    said = call(*(photos / f"board-{at}.png" for at in (0, 1, 2, 3, 4, 6)), "--out", "c.toml")
    assert said.exit_code == 0
    assert (
        "beyond that the lens is only supposed; add photos with the board in the corners"
        in said.err
    )


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (
            (),
            (
                "no photos named; print the board first: rfca-rig calibrate camera --board "
                "10x7,25,18 --make-board board.pdf"
            ),
        ),
        (("nowhere.jpg", "--out", "c.toml"), "nowhere.jpg: no such photo; name photos, or folders"),
        (
            ("PHOTOS",),
            (
                "calibration/camera.toml: there is no folder calibration; make it, or name "
                "another file"
            ),
        ),
        (
            ("PHOTOS", "--out", "c.toml", "--plane", "x.jpg"),
            "--plane needs to know where the shaft axis is: either --board-at",
        ),
        (
            ("PHOTOS", "--out", "c.toml", "--board-at", "1,2"),
            "--board-at and --shaft-px speak of the photo with the board",
        ),
        (
            ("PHOTOS", "--out", "c.toml", "--plane", "x.jpg", "--board-at", "1;2"),
            "--board-at 1;2: should be two numbers with a comma",
        ),
        (("PHOTOS", "--out", "c.toml", "--board", "9x7"), "board '9x7': should be COLUMNSxROWS"),
        (
            ("PHOTOS/board-0.png", "PHOTOS/lens-cap.png", "--out", "c.toml"),
            "1 usable photos of the board, 6 are needed, 15 are good; 1 refused",
        ),
        (("--make-board", "board.doc"), "board.doc: a board is written as .pdf or .png"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_writes_nothing(call, photos, tmp_path, words, line):
    said = call(*(word.replace("PHOTOS", str(photos)) for word in words))
    assert said.exit_code == 2
    assert line in said.err.splitlines()[-1]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("name", "begin"), [("board.pdf", b"%PDF-1.4"), ("board.PNG", b"\x89PNG")])
def test_the_board_to_be_printed(call, tmp_path, name, begin):
    said = call("--make-board", name, "--board", "7x5,30,20,5x5")
    assert said.exit_code == 0
    assert "board 7x5,30,20,5x5 in" in said.err
    assert (tmp_path / name).read_bytes().startswith(begin)
