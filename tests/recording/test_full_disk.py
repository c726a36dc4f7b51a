"""A disk that fills up: the run is told to stop, everything acknowledged stays, and what was
under way is kept too.
"""

import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.errors import BadInput, DiskFull, RigError
from rfca_rig.recording import run_folder, run_writer
from rfca_rig.recording.atomic import ErrorDeferringFile
from rfca_rig.recording.backend import InProcessRecorder, RecorderClient
from rfca_rig.recording.journal import event_block
from rfca_rig.recording.layout import journals
from rfca_rig.recording.run_text import events_of
from rfca_rig.recording.run_writer import DiskReserve, check_room
from tests.recording.dying import BrokenStageFile, FullDisk, instead
from tests.recording.growing import (
    begun,
    grown,
    header,
    run_blocks,
    stroke_blocks,
    wait_until_acknowledged,
)

ROOT = Path(__file__).parents[2]


def told_to_stop(keeper: InProcessRecorder, count: int = 10**6) -> int:
    """Hands over until the keeper has enough; returns how many stages were acknowledged then."""
    with pytest.raises(DiskFull, match=r"^stopped: disk full: .*No space left on device"):
        for number in range(1, count):
            for block in stroke_blocks(number):
                keeper.give(block)
    return keeper.acknowledged


@pytest.mark.parametrize("room", [300, 3_000, 10_000, 30_001, 77_777, 100_002])
def test_a_full_disk_stops_the_run_and_costs_nothing_that_was_recorded(tmp_path: Path, room: int):
    folder = tmp_path / "run"
    keeper = grown(folder, 0)
    disk = FullDisk(folder, 0)
    disk.room = disk.used + room
    with instead(disk):
        safe = told_to_stop(keeper)
        assert disk.used <= disk.room, "the ballast made room"
        keeper.finish("stopped: disk full")
    found = run_folder.read_stages(folder)
    assert safe <= len(found.strokes) <= safe + 1
    assert [stroke.repeat for stroke in found.strokes] == list(range(1, len(found.strokes) + 1))
    assert journals(folder) == []
    for raw in found.raw:
        assert raw.cut_short == "stopped: disk full"


def test_where_not_even_the_ballast_is_room_enough_the_journal_waits_for_recovery(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(run_writer, "RESERVE_BYTES", 6_000)
    folder = tmp_path / "run"
    keeper = grown(folder, 1)
    disk = FullDisk(folder, 0)
    disk.room = disk.used + 1_000
    given = iter(begun(2, ticks=10**4))
    with instead(disk):
        with pytest.raises(DiskFull, match=r"^stopped: disk full"):
            for block in given:
                keeper.give(block)
        with pytest.raises(DiskFull, match="cannot be added"):
            for block in given:
                keeper._writer.take(block)
                keeper._writer.flush()
        with pytest.raises(DiskFull):
            keeper.finish("stopped: disk full")
        assert len(run_folder.read_stages(folder).strokes) == 1
    run_folder.close_journals(folder)
    (raw,) = run_folder.read_stages(folder).raw
    assert len(raw.streams["shaft"].t_s) > 6


def test_a_disk_with_too_little_room_is_refused_before_anything_is_made(tmp_path: Path):
    with pytest.raises(
        BadInput,
        match=(
            r"MB free, the run may need 2000\d{6} MB; make room, or choose another disk with "
            r"--runs"
        ),
    ):
        check_room(tmp_path / "not" / "there" / "yet", 10**15)
    check_room(tmp_path / "not" / "there" / "yet", 10**3)
    assert list(tmp_path.iterdir()) == []


def test_no_room_for_the_ballast_is_no_beginning(tmp_path: Path):
    with (
        instead(FullDisk(tmp_path, 200_000)),
        pytest.raises(DiskFull, match=r"no room for 4\.2 MB in reserve"),
    ):
        DiskReserve(tmp_path).lay()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_hdf5_on_a_disk_that_fills_up_at_any_of_its_writes_is_one_line_and_takes_nothing_down(
    tmp_path: Path,
):
    """In a process of its own, because HDF5 takes a process down only when it exits."""
    program = f"""
        from pathlib import Path
        import numpy as np
        from rfca_rig.errors import DiskFull
        from rfca_rig.recording.store import read_recording, write_recording
        from tests.recording.dying import BrokenStageFile, FullDisk, instead
        from tests.recording.samples import recording
        folder = Path({str(tmp_path)!r})
        whole = recording(2)
        before = write_recording(whole, folder / "run.h5").read_bytes()
        for room in np.linspace(0, len(before) - 1, 25, dtype=int):
            with instead(FullDisk(folder, len(before) + int(room))):
                try:
                    write_recording(whole, folder / "run.h5")
                except DiskFull as full:
                    assert "No space left on device" in str(full), full
                else:
                    raise AssertionError(f"{{room}} bytes were room enough")
            assert [file.name for file in folder.iterdir()] == ["run.h5"]
            assert (folder / "run.h5").read_bytes() == before
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_what_a_full_disk_refuses_can_be_read_back_until_the_file_is_given_up(tmp_path: Path):
    """HDF5 may want to see again what it believes to be written."""
    file = ErrorDeferringFile(tmp_path / "a.h5")
    random = np.random.default_rng(4)
    like = bytearray()
    with instead(FullDisk(tmp_path, 700)):
        for _ in range(40):
            at = int(random.integers(0, 1000))
            piece = random.bytes(int(random.integers(1, 90)))
            like.extend(bytes(max(0, at + len(piece) - len(like))))
            like[at : at + len(piece)] = piece
            file.seek(at)
            file.write(memoryview(piece))
            at = int(random.integers(0, len(like)))
            target = bytearray(50)
            file.seek(at)
            length = file.readinto(memoryview(target))
            assert target[:length] == like[at : at + 50]
        with pytest.raises(DiskFull, match="No space left on device"):
            file.put_in_place()
        file.discard()
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def small_disk(tmp_path: Path):
    """A file system of its own, where this system lets one mount it."""
    place = tmp_path / "disk"
    place.mkdir()
    try:
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", "size=6m", "none", str(place)],
            capture_output=True,
            check=False,
        )
    except OSError:
        pytest.skip("no mount here")
    if done.returncode:
        pytest.skip("may not mount here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_disk_filled_by_others_stops_the_run_and_the_recorder_ends_in_good_order(
    small_disk: Path,
):
    folder = small_disk / "run"
    run_folder.create(folder, header())
    keeper = RecorderClient(folder, patient=True)
    first, *_ = run_blocks(1)
    for block in first:
        keeper.give(block)
    wait_until_acknowledged(keeper, 1)
    with (
        (small_disk / "others").open("wb", buffering=0) as others,
        pytest.raises(OSError, match="No space left"),
    ):
        while True:
            others.write(bytes(4096))
    with pytest.raises(DiskFull, match="stopped: disk full"):
        for block in begun(2, ticks=10**5):
            keeper.give(block)
    with pytest.raises(DiskFull, match="stopped: disk full"):
        keeper.give(event_block({"event": "motor off"}))
    safe = keeper.acknowledged
    keeper.finish("stopped: disk full")
    assert [event["event"] for event in events_of(folder)][-3:] == [
        "motor off",
        "stage cut short",
        "run ends",
    ], "said, and kept as well"
    assert keeper._process.returncode == 0
    found = run_folder.read_stages(folder)
    assert (safe, len(found.strokes)) == (1, 1)
    assert found.raw[0].cut_short == "stopped: disk full"


def test_a_stage_whose_file_cannot_be_made_keeps_its_journal_for_recovery(tmp_path: Path):
    folder = tmp_path / "run"
    keeper = grown(folder, 1)
    with instead(BrokenStageFile()):
        with pytest.raises(RigError, match="Input/output error"):
            for block in stroke_blocks(2):
                keeper.give(block)
        with pytest.raises(RigError, match="Input/output error"):
            keeper.finish("the disk failed")
    assert keeper.acknowledged == 1
    assert len(journals(folder)) == 1
    run_folder.close_journals(folder)
    assert [stroke.repeat for stroke in run_folder.read_stages(folder).strokes] == [1, 2]
