"""Photos of stages read: angles with their deviations where the marks tell them, and words where
they do not. Never a guess.
"""

import hashlib
import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from rfca_rig.bench.stage_photos import photo_hashes, read_missing_photos, read_stage_photos
from rfca_rig.description.rig_file import read_rig
from rfca_rig.recording.model import Recording, StaticStage
from rfca_rig.twins.camera import ImageDisturbance, render_leg
from rfca_rig.vision.leg_marks import MarkPlan, mark_positions
from rfca_rig.vision.leg_photo import PhotoSetup

ROOT = Path(__file__).parents[2]
CALIBRATION = ROOT / "calibration"
EYE = read_rig(CALIBRATION / "twin.toml").eye()
HINGES_DEG = np.array([-15.0, -14.0, -12.0, -10.0, -7.0, -4.0])
PLAIN = ImageDisturbance(noise_counts=1.0)
ANGLES = np.radians(90.0) + np.concatenate([[0.0], np.cumsum(np.radians(HINGES_DEG))])


@cache
def png(disturbance: ImageDisturbance, plan: MarkPlan) -> bytes:
    """The photo as a file. Most tests have the same one, and rendering it takes longer than
    reading it.
    """
    lengths = np.array(EYE.link_lengths_m)
    picture = render_leg(
        ANGLES, lengths, plan, EYE.camera, disturbance, np.random.default_rng(3), 0.235
    )
    return cv2.imencode(".png", picture)[1].tobytes()


def photographed(folder, disturbance=PLAIN, plan=EYE.plan, **changes):
    """A stage of a leg that stands at 90 degrees, with a photo of it in the run's folder."""
    (folder / "photos").mkdir(exist_ok=True)
    (folder / "photos" / "001.png").write_bytes(png(disturbance, plan))
    stage = StaticStage(
        0.235,
        1,
        "loading",
        np.radians(90.0),
        (math.nan,) * 6,
        -1.0,
        -2.0,
        0.3,
        photo="photos/001.png",
    )
    return replace(stage, **changes)


def read(stage, folder, eye=EYE):
    (seen,) = read_stage_photos([stage], folder, eye)
    assert (seen.fy_N, seen.fz_N, seen.tx_Nm, seen.shaft_angle_rad) == (
        stage.fy_N,
        stage.fz_N,
        stage.tx_Nm,
        stage.shaft_angle_rad,
    )
    return seen


def test_hinge_angles_are_the_campaign_s_relative_ones_with_their_deviations(tmp_path):
    seen = read(photographed(tmp_path), tmp_path)
    miss = np.array(seen.hinge_deg) - HINGES_DEG
    assert np.abs(miss).max() < 0.1
    assert (np.abs(miss) < 4.0 * np.array(seen.hinge_std_deg)).all()
    assert (seen.photo_doubts, seen.overlay) == ("", "overlays/001.jpg")
    assert cv2.imread(str(tmp_path / seen.overlay)).shape == (1000, 1600, 3)


def test_a_missing_mark_is_told_and_its_hinges_are_not(tmp_path):
    without_hinge_4 = MarkPlan(tuple(mark for mark in EYE.plan.marks if mark.link != 4))
    seen = read(photographed(tmp_path, plan=without_hinge_4), tmp_path)
    assert seen.photo_doubts == "mark at hinge 4: not seen; hinge 3, 4, 5 left out"
    unknown = [math.isnan(angle) for angle in seen.hinge_deg]
    assert (
        unknown
        == [math.isnan(std) for std in seen.hinge_std_deg]
        == [False, True, True, True, False, False]
    )


def test_a_half_hidden_mark_leaves_out_what_it_tells_too_badly_and_says_so(tmp_path):
    half = ImageDisturbance(
        defocus_px=2.5, noise_counts=7.0, uneven_light=0.8, hidden_mark=5, hidden_share=0.5
    )
    seen = read(photographed(tmp_path, half), tmp_path)
    told = np.isfinite(seen.hinge_deg)
    left_out = ", ".join(str(number) for number in np.flatnonzero(~told) + 2)
    assert left_out
    assert seen.photo_doubts == f"hinge {left_out} left out, known to worse than 0.3 deg"
    assert np.abs(np.array(seen.hinge_deg) - HINGES_DEG)[told].max() < 0.3


def test_an_extra_mark_is_told_and_taken_for_none_of_the_leg_s(tmp_path):
    stage = photographed(tmp_path)
    path = str(tmp_path / stage.photo)
    picture = cv2.imread(path)
    cv2.circle(picture, (1300, 200), 12, (30, 30, 180), -1, cv2.LINE_AA)
    cv2.imwrite(path, picture)
    seen = read(stage, tmp_path)
    assert seen.photo_doubts == "red mark at (1300, 200) px is none of the leg's"
    assert np.abs(np.array(seen.hinge_deg) - HINGES_DEG).max() < 0.1


def test_a_swapped_mark_is_told_and_its_hinges_are_not(tmp_path):
    """The mark of hinge 5 glued 4 mm further along its link than planned."""
    marks = tuple(
        replace(mark, along_m=0.004) if mark.link == 5 else mark for mark in EYE.plan.marks
    )
    seen = read(photographed(tmp_path, plan=MarkPlan(marks)), tmp_path)
    assert "hinge 5" in seen.photo_doubts
    told = np.isfinite(seen.hinge_deg)
    assert not told[2:5].any()
    assert np.abs(np.array(seen.hinge_deg) - HINGES_DEG)[told].max() < 0.1


def test_a_photo_of_another_stage_gives_no_angles(tmp_path):
    seen = read(photographed(tmp_path, shaft_angle_rad=np.radians(105.0)), tmp_path)
    assert seen.photo_doubts.startswith(
        "the photo shows the shaft at 90.0 deg, the drive says 105.0 deg: not this stage's photo"
    )
    assert np.isnan([*seen.hinge_deg, *seen.hinge_std_deg]).all()
    assert seen.overlay


def test_a_shaft_that_has_turned_once_more_is_the_same_shaft(tmp_path):
    assert np.isfinite(
        read(photographed(tmp_path, shaft_angle_rad=np.radians(450.0)), tmp_path).hinge_deg
    ).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda path: path.unlink(), "did not reach the disk"),
        (lambda path: path.write_bytes(path.read_bytes()[:5000]), "cut short"),
        (
            lambda path: cv2.imwrite(str(path), np.zeros((600, 800, 3), np.uint8)),
            "a photo of 800 x 600 pixels, the camera was calibrated with",
        ),
        (
            lambda path: cv2.imwrite(str(path), np.zeros((1000, 1600, 3), np.uint8)),
            "0 of 8 marks fit the chain",
        ),
    ],
)
def test_a_photo_that_shows_nothing_says_why(tmp_path, spoil, said):
    stage = photographed(tmp_path)
    spoil(tmp_path / stage.photo)
    seen = read(stage, tmp_path)
    assert said in seen.photo_doubts
    assert np.isnan([*seen.hinge_deg, *seen.hinge_std_deg]).all()


def test_a_photo_that_never_reached_the_disk_is_none(tmp_path):
    stage = photographed(tmp_path)
    (tmp_path / stage.photo).unlink()
    seen = read(stage, tmp_path)
    assert (seen.photo, seen.overlay) == ("", "")
    assert seen.photo_doubts == "the photo was lost: photos/001.png did not reach the disk"


def test_a_stage_without_a_photo_stays_as_it_is(tmp_path):
    stage = photographed(
        tmp_path,
        photo="",
        photo_doubts="the camera gave no photo within 5 s; check its cable and power",
    )
    assert repr(read(stage, tmp_path)) == repr(stage)


def test_another_plan_of_marks_is_read_as_well(tmp_path):
    """Two marks on each link, none on a hinge."""
    places = [
        (link, share * length)
        for link, length in enumerate(EYE.link_lengths_m, start=1)
        for share in (0.25, 0.75)
    ]
    marks = tuple(
        replace(EYE.plan.marks[0], link=link, along_m=along_m) for link, along_m in places
    )
    plan = MarkPlan(marks, 0.006)
    assert mark_positions(ANGLES, EYE.link_lengths_m, plan).shape == (14, 2)
    seen = read(
        photographed(tmp_path, plan=plan),
        tmp_path,
        PhotoSetup(EYE.camera, plan, EYE.link_lengths_m),
    )
    assert np.abs(np.array(seen.hinge_deg) - HINGES_DEG).max() < 0.3


def test_hashes_are_those_of_the_files(tmp_path):
    read(photographed(tmp_path), tmp_path)
    lines = dict(
        reversed(line.split("  ")) for line in photo_hashes(tmp_path)["photos_sha256"].splitlines()
    )
    assert lines == {
        name: hashlib.sha256((tmp_path / name).read_bytes()).hexdigest()
        for name in ("photos/001.png", "overlays/001.jpg")
    }
    assert photo_hashes(tmp_path / "nowhere") == {}


def test_a_run_that_ended_before_its_photos_were_read_is_read_with_what_it_kept(tmp_path):
    kept = {
        "rig_file": (CALIBRATION / "twin.toml").read_text(),
        "camera_file": (CALIBRATION / "twin-camera.toml").read_text(),
    }
    ended = Recording("a", "SIM", {}, {}, (), (photographed(tmp_path),), kept)
    whole = read_missing_photos(ended, tmp_path)
    assert np.abs(np.array(whole.static[0].hinge_deg) - HINGES_DEG).max() < 0.1
    assert whole.provenance.items() > kept.items()
    assert "photos/001.png" in whole.provenance["photos_sha256"]
    assert read_missing_photos(whole, tmp_path) is whole
    assert read_missing_photos(replace(ended, provenance={}), tmp_path).static == ended.static
