"""rfca-rig check: sound runs are found sound; any damage is found, and in the file in which it
is.
"""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from rfca_rig.errors import BadInput
from rfca_rig.recording import run_folder, store
from rfca_rig.recording.checking import check_run, needs_no_recovery
from rfca_rig.recording.hdf5_file import read_seal
from rfca_rig.recording.layout import write_sums
from rfca_rig.recording.run_text import Ending, write_ending
from rfca_rig.recording.store import write_recording
from tests.cli.typed import typed
from tests.recording.dying import calls_of, killed_at
from tests.recording.edits import find_fault, finish_run, random_edits, whole_file_edits
from tests.recording.growing import begun, grown
from tests.recording.samples import recording

FILES = [
    "run.json",
    "events.jsonl",
    "stages/0001.h5",
    "stages/0002.h5",
    "end.json",
    "run.h5",
    "photos/001.png",
]


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole") / "run"
    grown(folder, 2).finish("done")
    write_ending(folder, Ending({"ended": "done"}))
    run_folder.build_recording(folder)
    return folder


def damaged_files(folder: Path) -> list[str]:
    return [finding.file for finding in check_run(folder) if not finding.is_sound]


def test_a_sound_run_has_a_line_for_each_of_its_files(whole: Path):
    findings = {finding.file: finding.words for finding in check_run(whole)}
    assert list(findings) == FILES
    assert damaged_files(whole) == []
    assert findings["run.h5"] == "1 strokes, 1 static stages, 1 raw, 360 samples"
    assert findings["stages/0002.h5"] == "0 strokes, 1 static stages, 1 raw, 180 samples"


@pytest.mark.slow
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


def test_a_run_that_ended_without_its_end_is_no_run_that_goes_on(whole: Path, tmp_path: Path):
    folder = tmp_path / "run"
    shutil.copytree(whole, folder)
    for name in ("end.json", "run.h5", "SHA256SUMS"):
        (folder / name).unlink()
    found = {finding.file: finding.words for finding in check_run(folder)}
    assert (
        "though the run ended: it was cut off while it was closed, or end.json was removed"
        in found["end.json"]
    )
    assert f"rfca-rig recover {folder}" in found["end.json"]


def test_damage_to_the_hashes_is_told(whole: Path):
    sums = whole / "SHA256SUMS"
    before = sums.read_bytes()
    sums.write_bytes(b"x" + before)
    assert damaged_files(whole) == ["SHA256SUMS"]
    sums.write_bytes(before)


def test_a_stage_of_another_run_in_its_place_is_found_by_the_events_alone(tmp_path: Path):
    for name, count in (("one", 2), ("other", 3)):
        grown(tmp_path / name, count).finish("done")
    (tmp_path / "one" / "stages" / "0001.h5").write_bytes(
        (tmp_path / "other" / "stages" / "0003.h5").read_bytes()
    )
    assert damaged_files(tmp_path / "one") == ["stages/0001.h5"]


def test_a_run_that_crashed_says_what_to_type(tmp_path: Path):
    keeper = grown(tmp_path / "run", 1)
    for block in begun(2):
        keeper.give(block)
    findings = list(check_run(tmp_path / "run"))
    assert all(finding.is_sound for finding in findings)
    assert findings[-1].file == "stages/0002.journal"
    assert findings[-1].words.startswith(
        "a stage in progress, 14 whole blocks; 0 bytes behind them; type rfca-rig recover"
    )


def test_an_older_run_is_one_file(tmp_path: Path):
    (tmp_path / "run").mkdir()
    write_recording(recording(2, 1), tmp_path / "run" / "run.h5")
    assert [finding.file for finding in check_run(tmp_path / "run")] == ["run.h5"]
    with pytest.raises(BadInput, match="is not there"):
        list(check_run(tmp_path / "nothing"))


def test_the_command_ends_with_code_2_and_the_name_of_the_file(whole: Path, monkeypatch, capsys):
    said = typed(monkeypatch, capsys, "check", whole)
    assert said.exit_code == 0
    assert (
        said.out.splitlines()[2]
        == "ok      stages/0001.h5: 1 strokes, 0 static stages, 0 raw, 180 samples"
    )
    file = whole / "stages" / "0001.h5"
    before = file.read_bytes()
    file.write_bytes(before[:-1])
    said = typed(monkeypatch, capsys, "check", whole)
    file.write_bytes(before)
    assert said.exit_code == 2
    assert "DAMAGED stages/0001.h5: is not what was written" in said.out
    assert said.err.startswith(f"rfca-rig: {whole}: damaged: stages/0001.h5;")
    assert len(said.err.splitlines()) == 1


def edit_height(folder: Path) -> None:
    """An edit of the nominal model that leaves the file valid."""
    file = folder / "run.json"
    file.write_text(file.read_text().replace("54.0", "64.0"))


def sum_up_anew(folder: Path) -> None:
    """What `sha256sum` makes of the files as they are."""
    lines = [line.partition("  ")[2] for line in (folder / "SHA256SUMS").read_text().splitlines()]
    write_sums(folder)
    assert [
        line.partition("  ")[2] for line in (folder / "SHA256SUMS").read_text().splitlines()
    ] == lines


def drop_line(name: str):
    def drop(folder: Path) -> None:
        file = folder / "SHA256SUMS"
        file.write_text(
            "".join(
                line
                for line in file.read_text().splitlines(keepends=True)
                if not line.strip().endswith(name)
            )
        )

    return drop


def append_byte(folder: Path) -> None:
    with (folder / "run.h5").open("ab") as file:
        file.write(b"\0")


def edit_hdf5(folder: Path) -> None:
    with h5py.File(folder / "run.h5", "r+") as file:
        file["strokes/001"].attrs["height_mm"] = 430.0


def edit_event(folder: Path) -> None:
    file = folder / "events.jsonl"
    file.write_text(file.read_text().replace("stage begins", "stage begun", 1))


def edit_ending(folder: Path) -> None:
    file = folder / "end.json"
    file.write_text(file.read_text().replace('"done"', '"gone"'))


def remove_header(folder: Path) -> None:
    (folder / "run.json").unlink()


def remove_sums(folder: Path) -> None:
    (folder / "SHA256SUMS").unlink()


def remove_recording(folder: Path) -> None:
    (folder / "run.h5").unlink()


def empty_sums(folder: Path) -> None:
    (folder / "SHA256SUMS").write_text("")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("edits", "damaged"),
    [
        ((edit_height, remove_sums), ["run.json", "SHA256SUMS"]),
        ((edit_height, empty_sums), ["run.json", "SHA256SUMS"]),
        ((edit_height, drop_line("run.json")), ["run.json", "SHA256SUMS"]),
        ((edit_height, sum_up_anew), ["run.json"]),
        ((edit_event, sum_up_anew), ["events.jsonl"]),
        ((edit_ending, sum_up_anew), ["end.json"]),
        ((append_byte,), ["run.h5"]),
        ((append_byte, sum_up_anew), ["run.h5"]),
        ((edit_hdf5, sum_up_anew), ["run.h5"]),
        ((edit_hdf5, append_byte, remove_sums), ["run.h5", "SHA256SUMS"]),
        ((remove_sums,), ["SHA256SUMS"]),
        ((remove_sums, remove_recording), ["run.h5", "SHA256SUMS"]),
        ((drop_line("001.png"),), ["SHA256SUMS"]),
        ((remove_header,), ["run.json"]),
        ((remove_header, remove_sums), ["run.json", "SHA256SUMS"]),
        ((empty_sums,), ["SHA256SUMS"]),
        ((drop_line("0001.h5"),), ["SHA256SUMS"]),
    ],
)
def test_an_edit_is_found_whatever_became_of_the_hashes(
    whole: Path, tmp_path: Path, monkeypatch, capsys, edits, damaged
):
    """And check and recover agree: recover makes again what check says that it can, and refuses
    with the same words otherwise.
    """
    folder = tmp_path / "run"
    shutil.copytree(whole, folder)
    for edit in edits:
        edit(folder)
    assert damaged_files(folder) == damaged
    said = typed(monkeypatch, capsys, "check", folder)
    assert said.exit_code == 2
    again = typed(monkeypatch, capsys, "recover", folder)
    if set(damaged) <= {"run.h5", "SHA256SUMS"}:
        assert "rfca-rig recover" in said.err
        assert again.exit_code == 0
        assert damaged_files(folder) == []
        assert (
            typed(monkeypatch, capsys, "recover", folder)
            .err.strip()
            .endswith("is whole; there is nothing to recover")
        )
    else:
        assert again.exit_code == 2
        assert "recover cannot make it again" in said.err
        assert "recover cannot make it again" in again.err


@pytest.mark.slow
def test_a_crash_while_a_run_is_resumed_is_no_edit(whole: Path, tmp_path: Path):
    """Whatever is gone then, recover makes again."""

    def resume(folder: Path):
        return lambda _: run_folder.reopen(folder, {"event": "run resumed"}, 0)

    shutil.copytree(whole, tmp_path / "counted")
    for call in range(1, calls_of(resume(tmp_path / "counted")) + 1):
        folder = tmp_path / f"killed-{call}"
        shutil.copytree(whole, folder)
        killed_at(call, resume(folder))
        assert damaged_files(folder) == []


@pytest.mark.slow
def test_a_crash_while_a_run_is_closed_is_no_damage(tmp_path: Path, monkeypatch, capsys):
    """Check finds no damage and names recover, which makes the run whole: at every 40th write of
    the closing, and at each of the last.
    """

    def close(folder: Path):
        def work(_) -> None:
            write_ending(folder, Ending({"ended": "done"}))
            run_folder.build_recording(folder)

        return work

    grown(tmp_path / "open", 2).finish("done")
    shutil.copytree(tmp_path / "open", tmp_path / "counted")
    calls = calls_of(close(tmp_path / "counted"))
    # The last: checksums and end, each opened, written, forced, renamed, and its folder forced.
    assert calls > 60
    for call in (*range(1, calls - 12, 40), *range(calls - 12, calls + 1)):
        folder = tmp_path / f"killed-{call}"
        shutil.copytree(tmp_path / "open", folder)
        killed_at(call, close(folder))
        findings = list(check_run(folder))
        assert all(finding.is_sound for finding in findings), findings
        is_whole = needs_no_recovery(folder, findings)
        assert is_whole or any("rfca-rig recover" in finding.words for finding in findings)
        assert is_whole == typed(monkeypatch, capsys, "recover", folder).err.strip().endswith(
            "is whole; there is nothing to recover"
        )
        assert needs_no_recovery(folder, list(check_run(folder)))
        shutil.rmtree(folder)


def test_a_run_of_a_version_that_did_not_say_that_it_was_closed_is_checked_as_before(
    whole: Path, tmp_path: Path
):
    folder = tmp_path / "run"
    shutil.copytree(whole, folder)
    (folder / "end.json").write_text(json.dumps({"provenance": {"ended": "done"}, "static": None}))
    write_sums(folder)
    findings = list(check_run(folder))
    assert needs_no_recovery(folder, findings)
    remove_sums(folder)
    assert damaged_files(folder) == ["SHA256SUMS"]
    # This looks like a crash before `run.h5` was made.
    remove_recording(folder)
    assert damaged_files(folder) == []


def test_each_file_is_compared_with_its_checksum_once(whole: Path, monkeypatch):
    """Of a recording of hours this takes minutes."""
    compared: list[str] = []

    def count(path: Path) -> bool | None:
        compared.append(path.name)
        return read_seal(path)

    monkeypatch.setattr(store, "read_seal", count)
    assert damaged_files(whole) == []
    assert sorted(compared) == ["0001.h5", "0002.h5", "run.h5"]


@pytest.mark.slow
def test_edits_of_every_kind_are_found_and_check_and_recover_agree(tmp_path: Path):
    """Every 20th of the catalogue; `python -m tests.benchmarks.edits` does all."""
    finish_run(tmp_path / "run", (1, 2, 3), tmp_path / "older")
    finish_run(tmp_path / "other", (2, 3, 4))
    edits = [
        *whole_file_edits(tmp_path / "run", tmp_path / "other", tmp_path / "older"),
        *random_edits(tmp_path / "run", 200, 1),
    ]
    faults = {
        edit.name: find_fault(tmp_path / "run", edit, tmp_path / "copy") for edit in edits[::20]
    }
    assert not any(faults.values()), faults


def test_a_run_whose_recorder_never_began_has_lost_nothing(
    whole: Path, tmp_path, monkeypatch, capsys
):
    folder = tmp_path / "run"
    (folder / "stages").mkdir(parents=True)
    shutil.copyfile(whole / "run.json", folder / "run.json")
    said = typed(monkeypatch, capsys, "check", folder)
    assert said.exit_code == 0
    assert said.out.splitlines() == [
        (
            f"ok      run.json: {run_folder.read_header(folder).source} "
            f"{run_folder.read_header(folder).title}"
        ),
        "ok      events.jsonl: is not there: nothing was recorded before the run ended, "
        "or it begins right now; "
        f"rfca-rig resume {folder} does its whole plan",
    ]


def test_events_are_missed_where_a_stage_was_recorded(whole: Path, tmp_path):
    folder = tmp_path / "run"
    (folder / "stages").mkdir(parents=True)
    for name in ("run.json", "stages/0001.h5"):
        shutil.copyfile(whole / name, folder / name)
    assert damaged_files(folder) == ["events.jsonl"]
