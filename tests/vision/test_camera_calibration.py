"""Calibration against cameras that are known, on photos drawn by rays from every pixel."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.vision.board import BoardPhoto, RefusedPhoto, find_board, parse_board
from rfca_rig.vision.camera_calibration import BoardPlacement, calibrate, find_plane, with_origin_at
from tests.vision.board_scenes import TrueCamera, board_photo, centred, tilted_all_ways, turn

BOARD = parse_board("10x7,25,18")
TRUE = TrueCamera()
MATRIX = np.array(
    [[TRUE.focal[0], 0.0, TRUE.centre[0]], [0.0, TRUE.focal[1], TRUE.centre[1]], [0.0, 0.0, 1.0]]
)
DISTORTION = np.array(TRUE.distortion)


@pytest.fixture(scope="module")
def found() -> list[BoardPhoto]:
    random = np.random.default_rng(1)
    photos = (board_photo(BOARD, TRUE, *pose, random) for pose in tilted_all_ways(BOARD))
    return [find_board(photo, BOARD, f"p{at}") for at, photo in enumerate(photos)]


def points(rotation, translation_m, noise_px=0.05, seed=0) -> BoardPhoto:
    """The corners of a board as seen, without a picture."""
    flat = np.column_stack([BOARD.corners_m(), np.zeros(len(BOARD.corners_m()))])
    px = cv2.projectPoints(flat, cv2.Rodrigues(rotation)[0], translation_m, MATRIX, DISTORTION)[
        0
    ].reshape(-1, 2)
    px = px + np.random.default_rng(seed).normal(0.0, noise_px, px.shape)
    return BoardPhoto(f"p{seed}", TRUE.size, BOARD.corners_m(), px, 2.0)


@pytest.mark.long
def test_corners_lie_where_the_board_was(found):
    for photo, (rotation, translation_m) in zip(found, tilted_all_ways(BOARD), strict=True):
        flat = np.column_stack([photo.on_board_m, np.zeros(len(photo.px))])
        true_px = cv2.projectPoints(
            flat, cv2.Rodrigues(rotation)[0], translation_m, MATRIX, DISTORTION
        )[0].reshape(-1, 2)
        assert len(photo.px) >= 50
        assert np.abs((photo.px - true_px).mean(axis=0)).max() < 0.05
        assert np.sqrt(np.mean((photo.px - true_px) ** 2)) < 0.1


@pytest.mark.slow
def test_the_camera_is_recovered_within_its_own_uncertainty(found):
    made = calibrate(found)
    assert not made.refused
    assert made.error_px < 0.12
    assert np.abs(made.matrix[[0, 1], [0, 1]] - TRUE.focal).max() < 0.001 * TRUE.focal[0]
    assert np.abs(made.matrix[:2, 2] - TRUE.centre).max() < 1.5
    assert np.abs((made.matrix[[0, 1], [0, 1]] - TRUE.focal) / made.focal_std_px).max() < 4.0
    assert np.abs((made.matrix[:2, 2] - TRUE.centre) / made.centre_std_px).max() < 4.0
    assert made.distortion[4] == 0.0
    # single coefficients trade against each other; what they do to a picture, from its middle to a
    # corner, is known
    rays = np.array([[0.4, 0.3, 1.0], [0.0, 0.0, 1.0]])
    there, mine = (
        cv2.projectPoints(rays, np.zeros(3), np.zeros(3), matrix, lens)[0].reshape(2, 2)
        for matrix, lens in ((MATRIX, DISTORTION), (made.matrix, made.distortion))
    )
    assert np.hypot(*((there[0] - there[1]) - (mine[0] - mine[1]))) < 0.4


def test_standard_deviations_are_those_of_repeated_calibrations():
    poses = tilted_all_ways(BOARD)
    made = [
        calibrate([points(*pose, seed=100 * run + at) for at, pose in enumerate(poses)])
        for run in range(30)
    ]
    scatter = np.std([each.matrix[[0, 1], [0, 1]] for each in made], axis=0, ddof=1)
    assert scatter == pytest.approx(np.mean([each.focal_std_px for each in made], axis=0), rel=0.5)
    assert np.mean([each.error_px for each in made]) == pytest.approx(0.05 * np.sqrt(2), rel=0.1)


def test_a_strong_lens_keeps_its_third_coefficient():
    lens = np.array([-0.35, 0.2, 0.0, 0.0, -0.15])
    flat = np.column_stack([BOARD.corners_m(), np.zeros(54)])
    photos = []
    for at, (rotation, translation_m) in enumerate(tilted_all_ways(BOARD)):
        near_m = translation_m * [1.0, 1.0, 0.6]
        px = cv2.projectPoints(flat, cv2.Rodrigues(rotation)[0], near_m, MATRIX, lens)[0].reshape(
            -1, 2
        )
        photos.append(
            BoardPhoto(
                f"p{at}",
                TRUE.size,
                BOARD.corners_m(),
                px + np.random.default_rng(at).normal(0, 0.02, px.shape),
                2.0,
            )
        )
    assert calibrate(photos).distortion == pytest.approx(lens, abs=0.06)


def test_an_odd_photo_is_left_out_and_the_rest_is_used():
    photos = [points(*pose, seed=at) for at, pose in enumerate(tilted_all_ways(BOARD))]
    bent = replace(
        photos[3], px=photos[3].px + 3.0 * (photos[3].on_board_m[:, :1] / 0.1 - 1.2) ** 2
    )
    made = calibrate([*photos[:3], bent, *photos[4:]])
    assert [photo.name for photo in made.refused] == ["p3"]
    assert re.match(
        r"its corners lie [\d.]+ px off, those of the others 0.\d\d px", made.refused[0].why
    )
    assert len(made.photos) == 9
    assert np.abs(made.matrix[[0, 1], [0, 1]] - TRUE.focal).max() < 0.001 * TRUE.focal[0]


@pytest.mark.parametrize("tilt", [(0, 0), (30, 0), (-20, 25)])
def test_photos_from_one_side_only_are_refused(tilt):
    photos = []
    for at in range(10):
        rotation = turn(tilt[0] + 2 * np.sin(at), tilt[1] + 2 * np.cos(at), 36 * at)
        photos.append(
            points(
                rotation,
                centred(
                    BOARD, rotation, np.array([0.02 * np.sin(7 * at), 0.02 * np.cos(5 * at), 0.5])
                ),
                seed=at,
            )
        )
    with pytest.raises(
        BadInput,
        match=r"all 10 photos show the board from about the same side, within \d+\.\d degrees",
    ):
        calibrate(photos)


def test_too_few_photos_and_a_turned_one():
    photos = [points(*pose, seed=at) for at, pose in enumerate(tilted_all_ways(BOARD))]
    turned = replace(photos[6], size_px=(960, 1280))
    made = calibrate([*photos[:6], turned, *photos[7:]])
    assert made.refused == (
        RefusedPhoto(
            "p6",
            (
                "is 960 x 1280 pixels, the others 1280 x 960: take all with one setting of "
                "the camera, held one way"
            ),
        ),
    )
    dark = RefusedPhoto("dark.jpg", "shows 0 of the board's 54 corners")
    with pytest.raises(
        BadInput,
        match=(
            r"5 usable photos of the board, 6 are needed, 15 are good; 1 refused; dark.jpg "
            r"shows 0 of"
        ),
    ):
        calibrate([*photos[:5], dark])


def one_photo(**changes):
    return board_photo(BOARD, TRUE, *tilted_all_ways(BOARD)[1], np.random.default_rng(2), **changes)


@pytest.mark.slow
def test_a_blurred_photo_is_refused():
    refused = find_board(one_photo(blur_px=2.7), BOARD, "b")
    assert isinstance(refused, RefusedPhoto)
    assert re.match(r"is blurred: edges [\d.]+ px wide, at most [\d.]+ px", refused.why)
    assert isinstance(find_board(one_photo(blur_px=1.5), BOARD, "b"), BoardPhoto)


@pytest.mark.slow
def test_a_shaken_photo_is_refused_though_half_of_its_edges_are_sharp():
    sharp = board_photo(
        BOARD,
        TRUE,
        np.eye(3),
        centred(BOARD, np.eye(3), np.array([0.0, 0.0, 0.4])),
        np.random.default_rng(2),
    )
    shaken = cv2.blur(sharp, (9, 1))
    refused = find_board(shaken, BOARD, "b")
    assert isinstance(refused, RefusedPhoto)
    assert refused.why.startswith("is blurred")
    assert isinstance(find_board(sharp, BOARD, "b"), BoardPhoto)


def test_width_of_an_edge_is_that_of_its_blur():
    """10 % to 90 % of a Gaussian's edge is 2.56 of its standard deviations; pixels, and the
    steps of the profile, add to it.
    """
    found = find_board(
        board_photo(
            BOARD,
            TRUE,
            *tilted_all_ways(BOARD)[0],
            np.random.default_rng(2),
            blur_px=1.5,
            noise=0.0,
        ),
        BOARD,
        "b",
    )
    assert found.edge_px == pytest.approx(2.563 * np.hypot(1.5, 0.6), rel=0.08)


@pytest.mark.slow
def test_too_little_of_the_board_is_refused():
    photo = one_photo()
    nothing = find_board(np.full_like(photo, 80), BOARD, "b")
    assert nothing.why.startswith("shows 0 of the board's 54 corners, 12 are needed")
    flat = board_photo(
        BOARD,
        TRUE,
        np.eye(3),
        centred(BOARD, np.eye(3), np.array([0.0, 0.0, 0.3])),
        np.random.default_rng(2),
    )
    covered = flat.copy()
    covered[430:] = 80
    few = find_board(covered, BOARD, "b")
    assert isinstance(few, RefusedPhoto)
    assert "corners" in few.why


@pytest.mark.slow
def test_another_board_is_no_board():
    other = find_board(one_photo(), parse_board("10x7,25,18,5x5"), "b")
    assert isinstance(other, RefusedPhoto)


@pytest.mark.parametrize("reach", ["right", "left"])
def test_the_plane_is_found_with_the_shaft_axis_as_its_origin(reach):
    """A board held behind, turned and moved by known amounts; its corners' places in the plane
    are worked out here.
    """
    place = BoardPlacement(
        corner_m=(0.03, 0.02), reach=reach, turned_rad=np.radians(7.0), nearer_m=0.004
    )
    rotation = turn(6.0, -9.0, 3.0)
    translation_m = np.array([-0.1, -0.08, 0.7])
    pose = find_plane(points(rotation, translation_m, noise_px=0.02), MATRIX, DISTORTION, place)
    assert np.linalg.det(pose.rotation) == pytest.approx(1.0)
    way = 1.0 if reach == "right" else -1.0
    turned = np.radians(7.0)
    for right_m, down_m in ((0.0, 0.0), (0.2, 0.0), (0.05, 0.15)):
        level = right_m * np.cos(turned) - down_m * np.sin(turned)
        below = right_m * np.sin(turned) + down_m * np.cos(turned)
        # the printed face is nearer to the camera than the marks; +x points at it where +y is to
        # the right
        in_plane = np.array([way * 0.004, 0.03 + way * level, 0.02 - below])
        seen = pose.rotation @ in_plane + pose.translation_m
        assert seen == pytest.approx(
            rotation @ np.array([right_m, down_m, 0.0]) + translation_m, abs=3e-4
        )


def test_tilt_and_distance_of_the_plane_scatter_as_they_say():
    rotation = turn(6.0, -9.0, 3.0)
    place = BoardPlacement((0.0, 0.0))
    poses = [
        find_plane(
            points(rotation, np.array([-0.1, -0.08, 0.7]), 0.1, seed), MATRIX, DISTORTION, place
        )
        for seed in range(60)
    ]
    normals = np.array([pose.rotation[:, 0] for pose in poses])
    turns = np.cross(normals.mean(axis=0), normals)[
        :, :2
    ]  # small turns about the picture's two directions
    assert turns.std(axis=0) == pytest.approx(
        np.mean([pose.tilt_std_rad for pose in poses], axis=0), rel=0.35
    )
    middles = [
        (pose.rotation @ np.array([0.0, 0.125, -0.0875]) + pose.translation_m)[2] for pose in poses
    ]
    assert np.std(middles) == pytest.approx(
        np.mean([pose.distance_std_m for pose in poses]), rel=0.35
    )


def test_a_photo_of_another_zoom_does_not_fit():
    photo = points(turn(25.0, -9.0, 3.0), np.array([-0.1, -0.08, 0.5]))
    with pytest.raises(BadInput, match=r"p0: the board's corners lie [\d.]+ px off, at most 1.5"):
        find_plane(
            photo, MATRIX * np.array([[1.4], [1.4], [1.0]]), 3 * DISTORTION, BoardPlacement()
        )


@pytest.mark.slow
def test_the_origin_moves_to_the_pixel_of_the_shaft(found):
    made = calibrate(found)
    pose = find_plane(
        points(turn(6.0, -9.0, 3.0), np.array([-0.1, -0.08, 0.7])),
        made.matrix,
        made.distortion,
        BoardPlacement(),
    )
    camera = made.camera(pose.rotation, pose.translation_m)
    shaft_px = camera.project(np.array([0.02, 0.03]))
    moved = with_origin_at(camera, (float(shaft_px[0]), float(shaft_px[1])))
    assert moved.project(np.zeros(2)) == pytest.approx(shaft_px, abs=1e-6)
    assert moved.project(np.array([0.05, 0.01])) == pytest.approx(
        camera.project(np.array([0.07, 0.04])), abs=1e-6
    )
