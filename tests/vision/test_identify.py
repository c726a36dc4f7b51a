"""Which mark is which, on made-up marks: what is missing, beyond the leg or uncertain is said,
and nothing wrong is told.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rfca_rig.errors import BadInput
from rfca_rig.vision.camera_model import Floats
from rfca_rig.vision.identify import IdentifiedMarks, identify
from rfca_rig.vision.leg_marks import MarkPlan, PlannedMark, mark_positions
from rfca_rig.vision.marks import Mark
from tests.vision.scenes import LENGTHS_M, PLAN, camera, pose

CAMERA = camera()


def mark_at(place_m: Floats, diameter_px: float | None = None) -> Mark:
    px = CAMERA.project(place_m) + CAMERA.circle_shift_px(place_m, PLAN.diameter_m)
    if diameter_px is None:
        size = float(CAMERA.disc_diameter_px(place_m, PLAN.diameter_m))
    else:
        size = diameter_px
    return Mark(px, np.full(2, 0.03), size, 1.0, 100.0)


def read(places_m: Sequence[Floats], plan: MarkPlan = PLAN) -> IdentifiedMarks:
    return identify([mark_at(place) for place in places_m], CAMERA, plan, LENGTHS_M.tolist())


def wrong(result: IdentifiedMarks, places_m: Floats) -> list[int]:
    """Planned marks that were told to be something else than they are."""
    px = CAMERA.project(places_m)
    return [
        i
        for i, mark in enumerate(result.marks)
        if mark is not None and np.linalg.norm(mark.px - px[i]) > 2.0
    ]


def kinds(result: IdentifiedMarks) -> list[str]:
    return sorted(doubt.kind for doubt in result.doubts)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_whole_legs_are_read_in_any_order_of_marks(seed: int) -> None:
    random = np.random.default_rng(seed)
    places = mark_positions(pose(random), LENGTHS_M, PLAN)
    result = read(list(random.permutation(places)))
    assert result.is_complete
    assert not wrong(result, places)
    assert result.doubts == ()


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.integers(0, 3), st.integers(0, 4))
@settings(max_examples=80, deadline=None)
def test_with_marks_gone_and_red_things_about_nothing_wrong_is_told(
    seed: int, gone: int, more: int
) -> None:
    random = np.random.default_rng(seed)
    places = mark_positions(pose(random), LENGTHS_M, PLAN)
    left = np.delete(places, random.choice(8, gone, replace=False), axis=0)
    others = random.uniform([-0.05, -0.24], [0.28, 0.05], (more, 2))
    far = [other for other in others if _off_the_leg(other, left)]
    result = read([*random.permutation(left), *far])
    assert not wrong(result, places)
    assert (gone == 0) or result.doubts


def _off_the_leg(place: Floats, left: Floats) -> bool:
    """Not where, by chance, a mark of the leg could be: no judge of geometry alone could tell it
    from one.
    """
    apart = np.linalg.norm(np.vstack([left, np.zeros(2)]) - place, axis=1)
    return bool(
        (np.abs(apart - LENGTHS_M[1]) > 0.002).all()
        and (np.abs(apart - LENGTHS_M[0]) > 0.007).all()
        and apart.min() > 0.005
    )


@pytest.mark.parametrize("gone", [0, 1, 2, 3, 4, 5, 7])
def test_a_missing_mark_is_named(gone: int) -> None:
    places = mark_positions(pose(np.random.default_rng(3)), LENGTHS_M, PLAN)
    result = read(list(np.delete(places, gone, axis=0)))
    assert [i for i, mark in enumerate(result.marks) if mark is None] == [gone]
    assert [(doubt.kind, doubt.planned) for doubt in result.doubts] == [("missing", gone)]
    assert PLAN.name(gone) in result.doubts[0].words


def test_a_lone_mark_beyond_a_missing_one_could_be_any_red_thing() -> None:
    places = mark_positions(pose(np.random.default_rng(3)), LENGTHS_M, PLAN)
    result = read(list(np.delete(places, 6, axis=0)))
    assert result.marks[6:] == (None, None)
    assert kinds(result) == ["ambiguous", "missing"]


def test_a_red_thing_is_named() -> None:
    places = mark_positions(pose(np.random.default_rng(3)), LENGTHS_M, PLAN)
    result = read([*places, np.array([0.02, -0.2])])
    assert result.is_complete
    assert kinds(result) == ["extra"]


def test_a_mark_stuck_in_a_wrong_place_is_not_taken() -> None:
    places = mark_positions(pose(np.random.default_rng(3)), LENGTHS_M, PLAN)
    places[3] += np.array([0.003, 0.002])
    result = read(list(places))
    assert result.marks[3] is None
    assert kinds(result) == ["extra", "misplaced"]
    assert "mm" in next(doubt.words for doubt in result.doubts if doubt.kind == "misplaced")


def test_links_put_together_in_another_order_are_not_read_as_if_they_were_not() -> None:
    swapped = LENGTHS_M[[1, 0, 2, 3, 4, 5, 6]]
    places = mark_positions(pose(np.random.default_rng(5)), swapped, PLAN)
    result = read(list(places))
    assert result.marks[1] is None
    assert result.doubts


def test_two_marks_that_fit_equally_are_both_doubted() -> None:
    angles = pose(np.random.default_rng(3))
    places = mark_positions(angles, LENGTHS_M, PLAN)
    otherwise = mark_positions(angles + np.array([0, 0, 0, 0, 0, 0, 0.4]), LENGTHS_M, PLAN)[7]
    result = read([*places, otherwise])
    assert result.marks[7] is None
    assert "ambiguous" in kinds(result)
    assert all(mark is not None for mark in result.marks[:7])


def test_a_blurred_reflection_does_not_compete_with_a_sharp_mark() -> None:
    angles = pose(np.random.default_rng(3))
    places = mark_positions(angles, LENGTHS_M, PLAN)
    otherwise = mark_positions(angles + np.array([0, 0, 0, 0, 0, 0, 0.4]), LENGTHS_M, PLAN)[7]
    reflected = replace(mark_at(otherwise), std_px=np.full(2, 10.0))
    result = identify([*map(mark_at, places), reflected], CAMERA, PLAN, LENGTHS_M.tolist())
    assert result.is_complete
    assert not wrong(result, places)
    assert kinds(result) == ["extra"]


def test_a_disc_of_another_size_is_none_of_the_legs() -> None:
    places = mark_positions(pose(np.random.default_rng(3)), LENGTHS_M, PLAN)
    marks = [mark_at(place) for place in places[:7]] + [mark_at(places[7], 14.0)]
    assert identify(marks, CAMERA, PLAN, LENGTHS_M.tolist()).marks[7] is None
    a_little = [*marks[:7], mark_at(places[7], 0.88 * mark_at(places[7]).diameter_px)]
    result = identify(a_little, CAMERA, PLAN, LENGTHS_M.tolist())
    assert result.marks[7] is None
    assert "size" in result.doubts[0].words


def test_too_little_of_the_leg_is_refused() -> None:
    places = mark_positions(pose(np.random.default_rng(3)), LENGTHS_M, PLAN)
    assert kinds(read(list(places[[0, 3, 6]]))) == ["refused"]
    assert kinds(read([])) == ["refused"]


def test_two_marks_on_every_link_are_read_as_well() -> None:
    plan = MarkPlan(
        tuple(PlannedMark(link, along, 0.004) for link in range(1, 8) for along in (0.008, 0.030))
    )
    places = mark_positions(pose(np.random.default_rng(8)), LENGTHS_M, plan)
    result = identify([mark_at(place) for place in places[::-1]], CAMERA, plan, LENGTHS_M.tolist())
    assert result.is_complete
    assert not wrong(result, places)


def test_a_plan_for_another_leg_is_refused() -> None:
    with pytest.raises(BadInput, match="link 7"):
        identify([], CAMERA, PLAN, [0.05, 0.04])
