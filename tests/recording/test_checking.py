"""rfca-rig check: sound runs are found sound; any damage is found, and in the file in which it is."""

from pathlib import Path

import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.recording import run_folder
from rfca_rig.recording.checking import check_run
from rfca_rig.recording.run_text import Ending, write_ending
from rfca_rig.recording.store import write_recording
from tests.cli.typed import typed
from tests.recording.growing import begun, grown
from tests.recording.samples import recording

FILES = ["run.json", "events.jsonl", "stages/0001.h5", "stages/0002.h5", "end.json", "run.h5", "photos/001.png"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "run"
    grown(folder, 2).finish("done")
    write_ending(folder, Ending({"ended": "done"}))
    run_folder.build(folder)
    return folder


def damaged_files(folder: Path) -> list[str]:
    return [finding.file for finding in check_run(folder) if not finding.is_sound]


def test_a_sound_run_has_a_line_for_each_of_its_files(whole: Path):
    findings = {finding.file: finding.words for finding in check_run(whole)}
    assert list(findings) == FILES
    assert damaged_files(whole) == []
    assert findings["run.h5"] == "1 strokes, 1 static stages, 1 raw, 360 samples"
    assert findings["stages/0002.h5"] == "0 strokes, 1 static stages, 1 raw, 180 samples"


@pytest.mark.parametrize("name", FILES)
def test_a_flipped_bit_is_found_in_its_file(whole: Path, name: str):
    file = whole / name
    before = file.read_bytes()
    damaged = bytearray(before)
    damaged[int(np.random.default_rng(len(before)).integers(len(before)))] ^= 4
    file.write_bytes(damaged)
    found = damaged_files(whole)
    file.write_bytes(before)
    assert found == [name]


@pytest.mark.parametrize("name", FILES[1:])
def test_a_file_that_is_gone_is_missed(whole: Path, name: str):
    file = whole / name
    before = file.read_bytes()
    file.unlink()
    found = {finding.file: finding.words for finding in check_run(whole) if not finding.is_sound}
    file.write_bytes(before)
    assert found[name] == "is missing"


def test_damage_to_the_hashes_is_told(whole: Path):
    sums = whole / "SHA256SUMS"
    before = sums.read_bytes()
    sums.write_bytes(b"x" + before)
    assert damaged_files(whole) == ["SHA256SUMS"]
    sums.write_bytes(before)


def test_a_stage_of_another_run_in_its_place_is_found_by_the_events_alone(tmp_path: Path):
    for name, count in (("one", 2), ("other", 3)):
        grown(tmp_path / name, count).finish("done")
    (tmp_path / "one" / "stages" / "0001.h5").write_bytes((tmp_path / "other" / "stages" / "0003.h5").read_bytes())
    assert damaged_files(tmp_path / "one") == ["stages/0001.h5"]


def test_a_run_that_crashed_says_what_to_type(tmp_path: Path):
    keeper = grown(tmp_path / "run", 1)
    for block in begun(2):
        keeper.give(block)
    findings = list(check_run(tmp_path / "run"))
    assert all(finding.is_sound for finding in findings)
    assert findings[-1].file == "stages/0002.journal"
    assert findings[-1].words.startswith("a stage in progress, 14 whole blocks; 0 bytes behind them; type rfca-rig recover")


def test_an_older_run_is_one_file(tmp_path: Path):
    (tmp_path / "run").mkdir()
    write_recording(recording(2, 1), tmp_path / "run" / "run.h5")
    assert [finding.file for finding in check_run(tmp_path / "run")] == ["run.h5"]
    with pytest.raises(BadInput, match="is not there"):
        list(check_run(tmp_path / "nothing"))


def test_the_command_ends_with_code_2_and_the_name_of_the_file(whole: Path, monkeypatch, capsys):
    said = typed(monkeypatch, capsys, "check", whole)
    assert said.exit_code == 0
    assert said.out.splitlines()[2] == "ok      stages/0001.h5: 1 strokes, 0 static stages, 0 raw, 180 samples"
    file = whole / "stages" / "0001.h5"
    before = file.read_bytes()
    file.write_bytes(before[:-1])
    said = typed(monkeypatch, capsys, "check", whole)
    file.write_bytes(before)
    assert said.exit_code == 2
    assert "DAMAGED stages/0001.h5: is not what was written" in said.out
    assert said.err.startswith(f"rfca-rig: {whole}: damaged: stages/0001.h5;")
    assert len(said.err.splitlines()) == 1
