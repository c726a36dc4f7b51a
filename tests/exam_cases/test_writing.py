"""Cases as folders: readable by the package, the same each time, and silent about what they
conceal.
"""

import base64
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.campaign.reading import read_campaign
from rfca_rig.cli.terminal import WIDTH
from rfca_rig.errors import BadInput, RigError
from rfca_rig.exam import cases
from rfca_rig.exam.cases import Case, ExamDesign, draw_cases
from rfca_rig.exam.hidden_laws import NAMES
from rfca_rig.exam.nominal_world import NominalErrors
from rfca_rig.exam.sampled_rig import EFFECTS, ExamScatter, build_world
from rfca_rig.exam.score import score
from rfca_rig.exam.scoring import format_scores, score_folder
from rfca_rig.exam.sealing import open_all
from rfca_rig.exam.simulate_campaign import add_experiment, write_campaign
from rfca_rig.exam.simulator.experiment import stroke_traces
from rfca_rig.exam.write import write_cases

SMALL = ExamDesign(conditions=((215.0, 3.0), (235.0, 2.0)), repeats=2, static_heights_mm=(215.0,))


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> tuple[Case, Path]:
    case = replace(next(case for case in draw_cases(1, {cases.SINGLE: 1})), design=SMALL)
    folder = tmp_path_factory.mktemp("exam") / "case"
    write_campaign(case, folder)
    return case, folder


def test_the_package_reads_it(written):
    recording = read_campaign(written[1])
    assert len(recording.strokes) == 4
    assert len(recording.static) == 8
    assert recording.strokes[0].channel("fz_N")[1].std() > 1.0


def test_strokes_and_stages_are_counted_on_through_the_experiments_that_follow(written, tmp_path):
    case, folder = written
    longer = Path(shutil.copytree(folder, tmp_path / "longer"))
    add_experiment(case, longer, {"height_mm": 225.0, "speed_rad_s": 2.5, "repeats": 2}, 1)
    add_experiment(
        case,
        longer,
        {"height_mm": 225.0, "stages": [{"angle_deg": 90.0, "direction": "loading"}]},
        2,
    )
    recording = read_campaign(longer)
    assert [stroke.strokes_before for stroke in recording.strokes] == [0, 1, 2, 3, 4, 5]
    assert [stage.strokes_before for stage in recording.static] == [4] * 8 + [6]


def test_it_is_the_same_again(written, tmp_path):
    case, folder = written
    write_campaign(case, tmp_path / "again")
    for file in folder.rglob("*.*"):
        assert file.read_bytes() == (tmp_path / "again" / file.relative_to(folder)).read_bytes()


def test_repeats_differ_by_scatter_and_noise(written):
    strokes = read_campaign(written[1]).strokes
    first, second = (stroke.channel("fz_N")[1] for stroke in strokes[:2])
    swing = slice(100, 400)
    assert 0.15 < np.std(first[swing] - second[swing]) < 0.5
    assert (
        strokes[0].channel("shaft_angle_rad")[1][50] != strokes[1].channel("shaft_angle_rad")[1][50]
    )


def test_scatter_reaches_floor_height_and_start():
    case = draw_cases(1, {cases.NOTHING: 1})[0]
    plain, other = (
        build_world(case, 0.215, scatter, 1)
        for scatter in (ExamScatter(), ExamScatter(1e-4, 5e-3, 2e-3))
    )
    assert other.floor.mu - plain.floor.mu == pytest.approx(5e-3)
    assert other.mount.height_m - plain.mount.height_m == pytest.approx(1e-4)
    assert other.drive.start_angle_rad - plain.drive.start_angle_rad == pytest.approx(2e-3)


def test_a_drive_obeys_as_late_as_the_case_has_it():
    late = replace(
        draw_cases(1, {cases.SINGLE: 1})[0],
        effects={},
        off=NominalErrors(),
        structured=None,
        late_s=2.5e-3,
    )
    soon = replace(late, late_s=0.0)
    angle_rad = [
        stroke_traces(build_world(case, 0.3, ExamScatter(), 1), 2.433).motor_angle_rad
        for case in (late, soon)
    ]
    assert (angle_rad[1] - angle_rad[0])[-100:] == pytest.approx(2.5e-3 * 2.433, rel=1e-3)
    assert 0.0 < max(case.late_s for case in draw_cases(1) if case.kind in cases.LEG_KINDS) < 3e-3


def test_nothing_in_the_folder_tells(written):
    text = "".join(file.read_text() for file in written[1].rglob("*.*"))
    for word in (*EFFECTS, *NAMES, "truth", "strength", "conceal"):
        assert word not in text


@pytest.mark.slow
def test_truths_are_sealed_and_open(tmp_path):
    folders = write_cases(tmp_path / "out", 1, {cases.POOR_DATA: 2})
    truths = open_all(tmp_path / "out")
    assert [folder.name for folder in folders] == [truth["case"] for truth in truths]
    assert sorted(len(truth["effects"]) for truth in truths) == [0, 1]
    assert truths[0]["kind"] == cases.POOR_DATA
    assert not any(
        word in (tmp_path / "out" / "sealed" / f"{folders[0].name}.sealed").read_text()
        for word in EFFECTS
    )


def test_a_truth_that_was_changed_is_refused(tmp_path):
    write_cases(tmp_path / "out", 1, {cases.POOR_DATA: 1})
    sealed = next((tmp_path / "out" / "sealed").iterdir())
    sealed.write_bytes(
        base64.encodebytes(
            base64.decodebytes(sealed.read_bytes()).replace(b"poor data", b"rich data")
        )
    )
    with pytest.raises(BadInput, match="is not what was sealed"):
        open_all(tmp_path / "out")


def test_truths_are_sealed_before_the_first_campaign(tmp_path, monkeypatch):
    from rfca_rig.exam import write

    def fail(case: Case, folder: Path) -> None:
        raise RuntimeError

    monkeypatch.setattr(write, "write_campaign", fail)
    with pytest.raises(
        RigError, match="case-0001 not with RuntimeError; the same command tries them again"
    ):
        write.write_cases(tmp_path / "out", 1, {cases.POOR_DATA: 1})
    assert len(open_all(tmp_path / "out")) == 1


def test_a_folder_in_use_and_an_unknown_kind_are_refused(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(BadInput, match="not empty"):
        write_cases(tmp_path, 1, {cases.POOR_DATA: 1})
    with pytest.raises(BadInput, match="'odd' is unknown"):
        write_cases(tmp_path / "new", 1, {"odd": 1})


@pytest.mark.slow
def test_a_folder_of_diagnoses_is_marked(tmp_path):
    folders = write_cases(tmp_path / "out", 1, {cases.POOR_DATA: 2})
    told = tmp_path / "told" / folders[0].name
    told.mkdir(parents=True)
    (told / "diagnosis.json").write_text(
        '{"format": "rfca-diagnosis/1", "verdict": "not enough data", "effects": [], "fit": null}'
    )
    marks = score_folder(tmp_path / "out", tmp_path / "told")
    assert marks.outcomes == {cases.POOR_DATA: {"right": 2}}
    text = "\n".join(format_scores(marks))
    assert "poor data: wrong effects" in text and "0 of 2" in text


def test_the_table_of_all_kinds_fits_a_terminal():
    marks = replace(score([], {}), outcomes={kind: {"right": 3} for kind in cases.KINDS})
    heading, *lines = format_scores(marks)
    assert max(map(len, (heading, *lines[: len(cases.KINDS)]))) <= WIDTH
