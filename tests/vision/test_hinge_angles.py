"""Hinge angles: exact for exact marks, with the scatter they say, none where the marks do not
tell; and from whole drawn photos.
"""

from dataclasses import replace

import numpy as np
import pytest

from rfca_rig.vision.camera_model import Floats
from rfca_rig.vision.hinge_angles import HingeAngles, hinge_angles
from rfca_rig.vision.identify import IdentifiedMarks, identify
from rfca_rig.vision.leg_marks import MarkPlan, PlannedMark, mark_positions
from rfca_rig.vision.leg_photo import draw_overlay
from rfca_rig.vision.marks import Mark, find_marks
from tests.vision.drawing import Look, draw
from tests.vision.scenes import LENGTHS_M, PLAN, camera, pose

CAMERA = camera()
LENGTHS = LENGTHS_M.tolist()


def told(
    angles: Floats,
    plan: MarkPlan = PLAN,
    lengths_m: Floats = LENGTHS_M,
    error_px: Floats | float = 0.0,
) -> IdentifiedMarks:
    places = mark_positions(angles, lengths_m, plan)
    px = CAMERA.project(places) + CAMERA.circle_shift_px(places, plan.diameter_m) + error_px
    return IdentifiedMarks(
        tuple(Mark(here, np.array([0.05, 0.08]), 25.0, 1.0, 100.0) for here in px), (), ()
    )


def without(identified: IdentifiedMarks, *gone: int) -> IdentifiedMarks:
    return replace(
        identified,
        marks=tuple(None if i in gone else mark for i, mark in enumerate(identified.marks)),
    )


def as_numbers(values: tuple[float | None, ...]) -> Floats:
    return np.array([np.nan if value is None else value for value in values])


@pytest.mark.parametrize("seed", range(5))
def test_exact_marks_give_exact_angles(seed: int) -> None:
    angles = pose(np.random.default_rng(seed))
    result = hinge_angles(told(angles), CAMERA, PLAN, LENGTHS)
    np.testing.assert_allclose(as_numbers(result.link_rad), angles, atol=2e-6)
    np.testing.assert_allclose(
        as_numbers(result.hinge_rad), np.diff(angles, prepend=0.0), atol=2e-6
    )


def test_two_marks_on_every_link_tell_as_well() -> None:
    plan = MarkPlan(
        tuple(PlannedMark(link, along, 0.004) for link in range(1, 8) for along in (0.008, 0.030))
    )
    angles = pose(np.random.default_rng(1))
    result = hinge_angles(told(angles, plan), CAMERA, plan, LENGTHS)
    np.testing.assert_allclose(as_numbers(result.link_rad), angles, atol=2e-6)


def test_lengths_that_are_a_little_wrong_do_not_bend_angles() -> None:
    angles = pose(np.random.default_rng(2))
    longer = LENGTHS_M + np.random.default_rng(3).normal(0.0, 2e-4, 7)
    exact_tip = MarkPlan((*PLAN.marks[:-1], PlannedMark(7, float(longer[-1]))))
    result = hinge_angles(
        told(angles, exact_tip, longer), CAMERA, PLAN, LENGTHS, offset_std_m=(1e-4,)
    )
    # One photo does not tell a mark glued beside its place from a longer link.
    assert np.abs(as_numbers(result.link_rad) - angles).max() < np.radians(0.03)


@pytest.mark.slow
def test_scatter_is_what_the_covariance_says() -> None:
    random = np.random.default_rng(6)
    angles = pose(np.random.default_rng(4))
    errors = random.normal(0.0, [0.05, 0.08], (400, 8, 2))
    # One deviation of the offsets: a mixture of several is wider than the scatter of one.
    all_ones = [
        hinge_angles(
            told(angles, error_px=error),
            CAMERA,
            PLAN,
            LENGTHS,
            offset_std_m=(1e-4,),
            gluing_std_m=0.0,
        )
        for error in errors
    ]
    hinges = np.array([as_numbers(one.hinge_rad) for one in all_ones])
    np.testing.assert_allclose(hinges.std(axis=0), as_numbers(all_ones[0].hinge_std_rad), rtol=0.15)
    ratio = np.cov(hinges.T) / all_ones[0].hinge_covariance_rad2
    np.testing.assert_allclose(np.diag(ratio, 1), 1.0, atol=0.25)


@pytest.mark.parametrize(
    ("gone", "links", "hinges"),
    [
        ((3,), {2, 3}, {2, 3, 4}),
        ((7,), {6}, {6}),
        ((0,), {0}, {0, 1}),
        ((3, 4), {2, 3, 4}, {2, 3, 4, 5}),
    ],
)
def test_what_marks_do_not_tell_is_none(
    gone: tuple[int, ...], links: set[int], hinges: set[int]
) -> None:
    angles = pose(np.random.default_rng(7))
    result = hinge_angles(without(told(angles), *gone), CAMERA, PLAN, LENGTHS)
    assert {i for i, angle in enumerate(result.link_rad) if angle is None} == links
    assert {i for i, angle in enumerate(result.hinge_rad) if angle is None} == hinges
    assert set(np.flatnonzero(np.isnan(np.diag(result.hinge_covariance_rad2)))) == hinges
    kept = [i for i in range(7) if i not in hinges]
    np.testing.assert_allclose(
        as_numbers(result.hinge_rad)[kept], np.diff(angles, prepend=0.0)[kept], atol=1e-5
    )


def test_nothing_seen_tells_nothing() -> None:
    result = hinge_angles(IdentifiedMarks((None,) * 8, (), ()), CAMERA, PLAN, LENGTHS)
    assert result.hinge_rad == (None,) * 7
    assert np.isnan(result.link_covariance_rad2).all()


def from_photo(look: Look, seed: int) -> tuple[Floats, HingeAngles, IdentifiedMarks]:
    random = np.random.default_rng(seed)
    tilt = (
        float(random.uniform(-9, 9)),
        float(random.uniform(-9, 9)),
        float(random.uniform(-2, 2)),
    )
    model = camera(1000, tilt)
    angles = pose(random)
    photo = draw(angles, LENGTHS_M, PLAN, model, look, random)
    expected = float(
        np.mean(model.disc_diameter_px(mark_positions(angles, LENGTHS_M, PLAN), PLAN.diameter_m))
    )
    identified = identify(find_marks(photo, expected), model, PLAN, LENGTHS)
    result = hinge_angles(identified, model, PLAN, LENGTHS)
    drawn = draw_overlay(photo, identified, model, PLAN, result)
    assert drawn.shape == photo.shape
    assert (drawn != photo).any()
    return np.diff(angles, prepend=0.0), result, identified


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_disturbed_photos_give_angles_as_good_as_they_say(seed: int) -> None:
    random = np.random.default_rng(seed)
    look = Look(
        defocus_px=float(random.uniform(0.3, 3.0)),
        noise_counts=float(random.uniform(1.0, 5.0)),
        light_fall=0.8,
        glints=6,
        covers=((int(random.integers(8)), float(random.uniform(0, 6)), 0.35),),
        red_discs_m=((0.02, -0.19, 0.008),),
        red_bars=1,
    )
    true, result, identified = from_photo(look, seed)
    tellable = [i for i, angle in enumerate(result.hinge_rad) if angle is not None]
    miss = as_numbers(result.hinge_rad)[tellable] - true[tellable]
    assert len(tellable) >= 2
    assert np.abs(np.degrees(miss)).max() < 0.3
    assert (np.abs(miss) < 4.0 * as_numbers(result.hinge_std_rad)[tellable]).all()
    assert any(doubt.kind == "extra" for doubt in identified.doubts)
