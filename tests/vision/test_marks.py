"""Middles of marks on drawn photos: how far off they are, and whether the finder knows it."""

import cv2
import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.vision.camera_model import Floats
from rfca_rig.vision.identify import identify
from rfca_rig.vision.leg_marks import mark_positions
from rfca_rig.vision.marks import Mark, find_marks, find_marks_and_rejected
from tests.vision.drawing import Look, draw
from tests.vision.scenes import LENGTHS_M, PLAN, camera, pose


def found_and_true(
    look: Look, seed: int = 4, width_px: int = 1000
) -> tuple[tuple[Mark, ...], Floats]:
    random = np.random.default_rng(seed)
    model = camera(width_px)
    angles = pose(random)
    places = mark_positions(angles, LENGTHS_M, PLAN)
    photo = draw(angles, LENGTHS_M, PLAN, model, look, random)
    expected = float(np.mean(model.disc_diameter_px(places, PLAN.diameter_m)))
    return find_marks(photo, expected), model.project(places) + model.circle_shift_px(
        places, PLAN.diameter_m
    )


def errors(
    marks: tuple[Mark, ...], true_px: Floats, of: tuple[int, ...] = tuple(range(8))
) -> tuple[Floats, Floats]:
    """Error of each wanted mark (n, 2) px, and in standard deviations."""
    nearest = [min(marks, key=lambda mark: float(np.linalg.norm(mark.px - true_px[i]))) for i in of]
    miss = np.array([mark.px - true_px[i] for i, mark in zip(of, nearest, strict=True)])
    return miss, miss / np.array([mark.std_px for mark in nearest])


@pytest.mark.slow
@pytest.mark.parametrize(
    "look",
    [
        Look(),
        Look(noise_counts=6.0),
        Look(defocus_px=3.5),
        Look(light_fall=1.0),
        Look(exposure=3.0),
        Look(exposure=0.3),
    ],
    ids=["plain", "noise", "defocus", "uneven light", "blooming", "dark"],
)
def test_whole_marks_are_found_to_a_small_part_of_a_pixel(look: Look) -> None:
    marks, true_px = found_and_true(look)
    miss, sigmas = errors(marks, true_px)
    assert len(marks) == 8
    assert np.abs(miss).max() < 0.12
    assert np.sqrt(np.mean(sigmas**2)) < 1.6


def test_a_glint_across_a_mark_does_not_split_or_move_it() -> None:
    marks, true_px = found_and_true(Look(glint_on=(1, 4, 6)))
    miss, sigmas = errors(marks, true_px)
    assert len(marks) == 8
    assert np.abs(miss).max() < 0.1
    assert np.abs(sigmas).max() < 4.0


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_partly_hidden_mark_keeps_its_middle_and_says_what_is_hidden(seed: int) -> None:
    covered = (1, 3, 6)
    marks, true_px = found_and_true(
        Look(covers=tuple((i, 1.0 + i + seed, 0.4) for i in covered)), seed
    )
    miss, sigmas = errors(marks, true_px, covered)
    assert np.abs(miss).max() < 0.35  # the centre of mass is off by more than 2 px
    assert np.abs(sigmas).max() < 3.5
    assert sum(not mark.whole for mark in marks) == 3


def test_hardly_anything_of_a_mark_is_no_mark() -> None:
    marks, _ = found_and_true(Look(covers=((2, 0.5, 0.85), (5, 2.0, 1.0))))
    assert len(marks) == 6


def test_red_bars_are_no_marks() -> None:
    marks, true_px = found_and_true(Look(red_bars=3))
    assert len(marks) == 8
    assert np.abs(errors(marks, true_px)[0]).max() < 0.1


def test_an_empty_or_white_picture_has_no_marks() -> None:
    noise = np.random.default_rng(0).normal(30, 6, (300, 400, 3)).clip(0, 255).astype(np.uint8)
    assert find_marks(noise, 20.0) == ()
    assert find_marks(np.full((300, 400, 3), 255, np.uint8), 20.0) == ()


def test_refuses_other_pictures_and_marks_too_small() -> None:
    with pytest.raises(BadInput, match="8 bit colour"):
        find_marks(np.zeros((30, 40), np.uint8), 20.0)
    with pytest.raises(BadInput, match="too small"):
        find_marks(np.zeros((30, 40, 3), np.uint8), 3.0)


@pytest.mark.slow
def test_a_mark_that_touches_another_red_disc_is_not_measured() -> None:
    random = np.random.default_rng(4)
    model = camera(1000)
    angles = pose(random)
    places = mark_positions(angles, LENGTHS_M, PLAN)
    for apart_m, side in ((0.0065, 0.4), (0.0085, 2.0), (0.0075, 4.5)):
        y_m, z_m = places[3] + apart_m * np.array([np.cos(side), np.sin(side)])
        photo = draw(angles, LENGTHS_M, PLAN, model, Look(red_discs_m=((y_m, z_m, 0.008),)), random)
        found = find_marks(photo, float(np.mean(model.disc_diameter_px(places, PLAN.diameter_m))))
        true_px = model.project(places)
        assert len(found) == 7
        assert all(np.linalg.norm(mark.px - true_px, axis=1).min() < 0.2 for mark in found)


def paint(
    things: list[tuple[float, float, float, tuple[int, int, int]]], noise: float = 2.0
) -> np.ndarray:
    """Picture (300, 400, 3) with discs (x, y, radius px, BGR) on black."""
    fine = np.full((1200, 1600, 3), 25, np.uint8)
    for x, y, radius, colour in things:
        cv2.circle(fine, (round(4 * x), round(4 * y)), round(4 * radius), colour, -1)
    picture = cv2.GaussianBlur(
        cv2.resize(fine, (400, 300), interpolation=cv2.INTER_AREA), (0, 0), 0.8
    )
    return np.clip(
        picture + np.random.default_rng(0).normal(0.0, noise, picture.shape), 0, 255
    ).astype(np.uint8)


def test_a_mark_in_cool_shadow_is_found_beside_a_bright_one() -> None:
    marks = find_marks(paint([(100, 100, 13, (30, 30, 240)), (250, 150, 13, (46, 34, 70))]), 26.0)
    assert len(marks) == 2
    np.testing.assert_allclose(marks[1].px, [250, 150], atol=0.6)


@pytest.mark.parametrize("darkness", [0.5, 0.7])
def test_a_shadow_across_a_mark_widens_its_deviation(darkness: float) -> None:
    """The edge of a shadow through a disc, at five distances from its centre: without the
    spread, errors of up to 5 deviations.
    """
    picture = paint(
        [
            (60, 60, 13, (24, 24, 230)),
            (240, 60, 13, (24, 24, 230)),
            (340, 240, 13, (24, 24, 230)),
            (150, 150, 13, (24, 24, 230)),
        ]
    )
    x, y = np.meshgrid(np.arange(400) - 150, np.arange(300) - 150)
    for edge_px in (-6, -3, 0, 3, 6):
        lit = 1.0 / (1.0 + np.exp(edge_px - x * np.cos(0.4) - y * np.sin(0.4)))
        shade = np.where(np.hypot(x, y) < 40, darkness + (1.0 - darkness) * lit, 1.0)
        (mark,) = (
            one
            for one in find_marks((picture * shade[..., None]).astype(np.uint8), 26.0)
            if np.hypot(*(one.px - 150)) < 10
        )
        assert np.abs((mark.px - 150) / mark.std_px).max() < 3.3, edge_px


def test_a_red_cable_beside_a_mark_does_not_hide_it() -> None:
    picture = paint([(150, 150, 13, (30, 30, 220))])
    cable = cv2.line(picture.copy(), (172, 0), (172, 299), (30, 30, 220), 6, cv2.LINE_AA)
    (mark,) = find_marks(cable, 26.0)
    np.testing.assert_allclose(mark.px, [150, 150], atol=0.5)


def test_noise_of_a_dark_photo_is_no_glare() -> None:
    marks = find_marks(
        paint([(100, 100, 13, (22, 22, 75)), (250, 150, 13, (22, 22, 75))], noise=7.0), 26.0
    )
    assert [mark.whole for mark in marks] == [True, True]


def test_what_was_found_and_not_measured_is_said() -> None:
    random = np.random.default_rng(4)
    model = camera(1000)
    angles = pose(random)
    places = mark_positions(angles, LENGTHS_M, PLAN)
    photo = draw(angles, LENGTHS_M, PLAN, model, Look(covers=((3, 0.5, 0.7),)), random)
    marks, rejected = find_marks_and_rejected(
        photo, float(np.mean(model.disc_diameter_px(places, PLAN.diameter_m)))
    )
    assert len(marks) == 7
    assert "rim is seen" in rejected[0].reason
    (doubt,) = identify(marks, model, PLAN, LENGTHS_M.tolist(), rejected=rejected).doubts
    assert (doubt.kind, doubt.planned) == ("dropped", 3)
    assert "found at" in doubt.words
