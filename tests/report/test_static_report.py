"""static.html and the tables beside it."""

import csv
import io
import json
import re
from base64 import b64decode
from dataclasses import replace

import cv2
import numpy as np
import pytest

from rfca_rig.analysis.torque_rotation.evaluate import StageAssumptions, evaluate
from rfca_rig.description.model_file import read_model_file
from rfca_rig.errors import RigError
from rfca_rig.exam.nominal_world import nominal_world
from rfca_rig.exam.sampled_rig import with_effect
from rfca_rig.reports.static.files import write_static_report
from rfca_rig.reports.static.tables import StaticSource, static_sources
from tests.analysis.torque_rotation.tables import (
    KNOWN_TO,
    SECTIONS,
    by_exam,
    noisy,
    plain,
    recording,
)
from tests.report.outline import Outline

NEVER = ("script", "link", "iframe", "object")  # photos stand in the page
TABLES = [f"{name}.{kind}" for name in ("curve", "hinges", "values") for kind in ("csv", "tex")]
FILES = sorted(
    [*TABLES, "model-curve.toml", "model.toml", "stages.csv", "static.html", "static.json"]
)


def written(folder, stages, run=None, known_to=KNOWN_TO):
    recorded = recording(stages, "A <bold> run & more", known_to=known_to)
    result = evaluate([recorded], StageAssumptions(SECTIONS, known_to))
    write_static_report(
        result,
        [StaticSource("A <bold> run & more", run or folder, recorded)],
        folder,
        SECTIONS,
        known_to,
    )
    return result, (folder / "static.html").read_text()


@pytest.fixture(scope="module")
def quiet():
    return noisy(plain(), np.random.default_rng(2))


def test_the_page_stands_alone_and_says_what_was_found(tmp_path, quiet):
    result, page = written(tmp_path, quiet)
    outline = Outline(page, NEVER)
    assert sorted(path.name for path in tmp_path.iterdir()) == FILES
    assert all(one.startswith("#") for one in outline.fetched)
    assert len(outline.ids) == len(set(outline.ids))
    assert page.count("<svg viewBox") >= 3
    assert "nan" not in outline.text.lower().replace("nano", "")
    assert "A <bold> run & more" in outline.text
    assert f"{result.values.k0_Nm_per_rad:.3f}" in outline.text
    assert "the law k₀ (φ + k₂ φ³) holds" in outline.text
    assert 'class="remarks"' not in page
    assert "no loop is seen" in outline.text


@pytest.mark.slow
def test_the_same_table_gives_the_same_bytes(tmp_path, quiet):
    for name in ("one", "two"):
        written(tmp_path / name, quiet)
    for file in FILES:
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes()


def test_tables_for_other_programs(tmp_path, quiet):
    result, _ = written(tmp_path, quiet)
    stages = list(csv.DictReader(io.StringIO((tmp_path / "stages.csv").read_text())))
    assert len(stages) == 16 * 6
    assert float(stages[0]["angle_deg"]) == pytest.approx(
        quiet[0].hinge_deg[0], abs=0.15
    )  # less what its mark is found to be off
    assert {row["links_touching"] for row in stages} == {"7"}
    off = np.array([float(row["torque_Nm"]) - float(row["curve_torque_Nm"]) for row in stages])
    assert np.abs(off).max() < 4.0 * 33.0 * np.radians(
        0.1
    )  # the angle's noise at the greatest stiffness
    curve = list(csv.DictReader(io.StringIO((tmp_path / "curve.csv").read_text())))
    low, torque, high = (
        np.array([float(row[name]) for row in curve])
        for name in ("torque_low_Nm", "torque_Nm", "torque_high_Nm")
    )
    assert ((low < torque) & (torque < high)).all()
    document = json.loads((tmp_path / "static.json").read_text())
    assert document["format"] == "rfca-static/1"
    assert (
        document["k0_Nm_per_rad"]["interval_95"][0]
        < 11.0
        < document["k0_Nm_per_rad"]["interval_95"][1]
    )
    assert document["curve"][0]["torque_Nm"] == pytest.approx(torque[0], abs=1e-6)
    assert read_model_file(tmp_path / "model.toml").leg.k0_Nm_per_rad == pytest.approx(
        result.values.k0_Nm_per_rad, rel=1e-6
    )


def test_the_largest_bend_is_told_with_its_stage(tmp_path, quiet):
    _, page = written(tmp_path, quiet)
    most = max(quiet, key=lambda stage: abs(sum(stage.hinge_deg)))
    told = json.loads((tmp_path / "static.json").read_text())["most_bent"]
    assert (told["stage"], told["height_mm"]) == (most.stage, 1e3 * most.height_m) == (6, 215.0)
    assert told["bend_deg"] == pytest.approx(abs(sum(most.hinge_deg)), abs=1e-3)
    assert (
        f"The leg was bent most at 215 mm, stage 6: by {told['bend_deg']:.1f} degrees"
        in Outline(page, NEVER).text.replace("\u00a0", " ")
    )


def test_a_stage_that_lacks_an_angle_has_no_bend(tmp_path, quiet):
    def hidden(stage):
        return replace(stage, hinge_deg=(np.nan, *stage.hinge_deg[1:]))

    bent_most = max(range(len(quiet)), key=lambda row: quiet[row].bend_deg)
    some, _ = written(
        tmp_path, [hidden(stage) if row == bent_most else stage for row, stage in enumerate(quiet)]
    )
    assert (
        np.isnan(some.data.stages[bent_most].bend_deg)
        and some.most_bent.bend_deg < quiet[bent_most].bend_deg
    )
    none, page = written(tmp_path, [hidden(stage) for stage in quiet])
    assert (
        none.most_bent is None
        and json.loads((tmp_path / "static.json").read_text())["most_bent"] is None
    )
    assert "the bend from first to last link is not known" in page


@pytest.mark.slow
def test_a_law_that_fails_is_told_first_and_drawn_second(tmp_path):
    world = with_effect(nominal_world(0.215), "hinge_backlash", {"half_gap_deg": 1.2})
    _, page = written(tmp_path, noisy(by_exam(world), np.random.default_rng(5)))
    text = Outline(page, NEVER).text
    assert "The law k₀ (φ + k₂ φ³) does not hold: splines fit better" in text
    assert "the nearest law" in text
    assert "splines, with 95 % band" in text
    assert json.loads((tmp_path / "static.json").read_text())["law"]["holds"] is False


def test_photos_are_shrunk_into_the_page_and_missing_ones_are_said(tmp_path, quiet):
    run = tmp_path / "run"
    (run / "overlays").mkdir(parents=True)
    picture = np.zeros((900, 1600, 3), np.uint8)
    picture[:, 800:] = (0, 0, 255)
    cv2.imwrite(str(run / "overlays" / "001.png"), picture)
    first = replace(
        quiet[0], photo="photos/001.png", overlay="overlays/001.png", photo_doubts="a red <thing>"
    )
    gone = replace(quiet[1], photo="photos/002.png")
    _, page = written(tmp_path / "report", (first, gone, *quiet[2:]), run)
    outline = Outline(page, NEVER)
    (shown,) = [one for one in outline.fetched if not one.startswith("#")]
    small = cv2.imdecode(
        np.frombuffer(b64decode(shown.removeprefix("data:image/jpeg;base64,")), np.uint8),
        cv2.IMREAD_COLOR,
    )
    assert small.shape == (236, 420, 3)
    assert small[100, 400, 2] > 200
    assert small[100, 20, 2] < 50
    assert "a red <thing>" in outline.text
    assert "002.png: cannot be read" in outline.text
    assert str(tmp_path) not in page


@pytest.mark.slow
def test_hinges_that_soften_leave_no_model_behind(tmp_path, quiet):
    world = nominal_world(0.215)
    softening = by_exam(
        replace(
            world, hinges=replace(world.hinges, k0_Nm_per_rad=(14.0,) * 6, k2_per_rad2=(-0.7,) * 6)
        )
    )
    (tmp_path / "model.toml").write_text("of an earlier report")
    _, page = written(tmp_path, noisy(softening, np.random.default_rng(1)))
    assert not (tmp_path / "model.toml").exists()
    assert "The hinges soften" in page
    assert "model.toml" not in Outline(page, NEVER).text


def test_several_recordings_are_told_apart(tmp_path, quiet):
    rng = np.random.default_rng(3)
    recordings = [recording(noisy(plain(), rng), "same title") for _ in range(2)]
    paths = [tmp_path / "a", tmp_path / "b"]
    result = evaluate(recordings, StageAssumptions(SECTIONS, KNOWN_TO))
    write_static_report(
        result,
        static_sources(paths, recordings),
        tmp_path / "out",
        SECTIONS,
        KNOWN_TO,
        "given.toml",
    )
    text = Outline((tmp_path / "out" / "static.html").read_text(), NEVER).text
    assert "same title (1)" in text
    assert "same title (2)" in text
    assert "Recording by recording" in text
    assert "the model in given.toml" in text
    assert len(re.findall(r"tare of fz, recording \d", text)) == 2


def test_a_folder_that_cannot_be_made_is_said(tmp_path, quiet):
    (tmp_path / "taken").write_text("")
    with pytest.raises(RigError, match="the folder for the report cannot be made"):
        written(tmp_path / "taken" / "report", quiet)
