import dataclasses
import errno
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from rfca_rig.errors import BadInput, RigError
from rfca_rig.recording import atomic
from rfca_rig.recording.run_file import RunFile, partial_of, read_partial, recover
from rfca_rig.recording.store import read_recording, write_recording
from tests.recording.same import assert_same
from tests.recording.samples import recording, stage, stroke

ROOT = Path(__file__).parents[2]


def grown(path: Path, **finish: dict[str, str]) -> Path:
    run = RunFile.create(path, recording(0, 0))
    for k in (1, 2, 3):
        run.add_stroke(stroke(k))
        run.add_static_stage(stage(k))
    return run.finish(**finish)


def test_a_recording_grown_piece_by_piece_is_the_one_written_at_once(tmp_path: Path):
    path = grown(tmp_path / "a" / "run.h5")
    assert path.read_bytes() == write_recording(recording(3, 3), tmp_path / "whole.h5").read_bytes()
    assert [found.name for found in (tmp_path / "a").iterdir()] == ["run.h5"]


def test_the_end_of_a_run_adds_to_its_provenance(tmp_path: Path):
    found = read_recording(grown(tmp_path / "run.h5", provenance={"ended": "tripped", "seed": "8"})).provenance
    assert (found["ended"], found["seed"], len(found["plan"])) == ("tripped", "8", 120_000)


def test_what_was_added_is_readable_before_the_run_ends(tmp_path: Path):
    run = RunFile.create(tmp_path / "run.h5", recording(0, 0))
    for k in (1, 2):
        run.add_stroke(stroke(k))
        found = read_partial(tmp_path / "run.h5")
        assert [done.repeat for done in found.strokes] == list(range(1, k + 1))
    assert not (tmp_path / "run.h5").exists()


def test_recordings_are_never_written_over(tmp_path: Path):
    path = grown(tmp_path / "run.h5")
    with pytest.raises(BadInput, match=r"run\.h5: is there already"):
        RunFile.create(path, recording(0, 0))
    RunFile.create(tmp_path / "other.h5", recording(0, 0))
    with pytest.raises(BadInput, match=r"other\.h5\.partial: is there already"):
        RunFile.create(tmp_path / "other.h5", recording(0, 0))


def test_a_discarded_run_leaves_nothing(tmp_path: Path):
    RunFile.create(tmp_path / "run.h5", recording(0, 0)).discard()
    assert list(tmp_path.iterdir()) == []


def crash_at(folder: Path, write_number: int) -> int:
    """Runs a writer that dies inside its n-th call of fsync; returns the pieces it had been told were safe."""
    program = f"""
        import os
        from pathlib import Path
        from rfca_rig.recording import atomic
        from rfca_rig.recording.run_file import RunFile
        from tests.recording.samples import recording, stage, stroke
        calls, forced = 0, os.fsync
        def fsync(handle):
            global calls
            calls += 1
            if calls == {write_number}:
                os._exit(9)
            forced(handle)
        atomic.os.fsync = fsync
        run = RunFile.create(Path({str(folder / "run.h5")!r}), recording(0, 0))
        for k in (1, 2, 3):
            run.add_stroke(stroke(k)); print("safe", flush=True)
            run.add_static_stage(stage(k)); print("safe", flush=True)
        run.finish(); print("finished", flush=True)
    """
    done = subprocess.run([sys.executable, "-c", textwrap.dedent(program)], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 9), done.stderr
    return done.stdout.count("safe")


@pytest.mark.parametrize("write_number", [4, 5, 6, 7, 11, 16])
def test_a_crash_never_takes_back_what_was_safe(tmp_path: Path, write_number: int):
    safe = crash_at(tmp_path, write_number)
    found = read_partial(tmp_path / "run.h5")
    assert safe <= len(found.strokes) + len(found.static) <= safe + 1
    assert safe == (write_number - 4) // 2
    assert_same(dataclasses.replace(found, provenance={}), dataclasses.replace(expected(found), provenance={}))
    assert "ended without being finished" in found.provenance["interrupted"]


def expected(found):
    return recording(len(found.strokes), len(found.static))


def test_a_crash_while_finishing_loses_nothing(tmp_path: Path):
    assert crash_at(tmp_path, 16) == 6
    found = read_recording(recover(tmp_path / "run.h5"))
    assert (len(found.strokes), len(found.static)) == (3, 3)
    assert not partial_of(tmp_path / "run.h5").exists()


def test_a_recording_that_was_whole_when_the_crash_came_is_not_written_over(tmp_path: Path):
    run = RunFile.create(tmp_path / "run.h5", recording(0, 0))
    for k in (1, 2, 3):
        run.add_stroke(stroke(k))
    parts = {part.name: part.read_bytes() for part in partial_of(tmp_path / "run.h5").iterdir()}
    whole = run.finish().read_bytes()
    partial_of(tmp_path / "run.h5").mkdir()
    for name in sorted(parts)[2:]:  # the crash came while the parts were being taken away
        (partial_of(tmp_path / "run.h5") / name).write_bytes(parts[name])
    assert recover(tmp_path / "run.h5").read_bytes() == whole
    assert not partial_of(tmp_path / "run.h5").exists()


def test_where_nothing_was_interrupted_there_is_nothing_to_recover(tmp_path: Path):
    with pytest.raises(BadInput, match="is not there, and there is no interrupted run"):
        recover(tmp_path / "run.h5")
    RunFile.create(tmp_path / "run.h5", recording(1, 0)).finish()
    with pytest.raises(BadInput, match="is whole, and there is no interrupted run"):
        recover(tmp_path / "run.h5")


def test_a_run_that_died_before_it_began_says_so(tmp_path: Path):
    crash_at(tmp_path, 2)
    with pytest.raises(BadInput, match="interrupted before it began"):
        read_partial(tmp_path / "run.h5")


def test_a_full_disk_keeps_what_was_safe_and_the_run_may_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    run = RunFile.create(tmp_path / "run.h5", recording(0, 0))
    run.add_stroke(stroke(1))
    with monkeypatch.context() as full:
        full.setattr(atomic.os, "fsync", _full_disk)
        with pytest.raises(RigError, match="No space left on device"):
            run.add_stroke(stroke(2))
    run.add_stroke(stroke(2))
    assert [found.repeat for found in read_recording(run.finish()).strokes] == [1, 2]


def _full_disk(_: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
