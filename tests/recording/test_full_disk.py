"""A disk that fills up: the run is told to stop, everything acknowledged stays, and what was under way is kept too."""

import subprocess
from pathlib import Path

import pytest

from rfca_rig.errors import BadInput, DiskFull
from rfca_rig.recording import ballast, run_folder
from rfca_rig.recording.ballast import Ballast, check_room
from rfca_rig.recording.keeper import DirectKeeper
from rfca_rig.recording.layout import journals
from rfca_rig.recording.process_keeper import ProcessKeeper
from tests.recording.dying import FullDisk, instead
from tests.recording.growing import begun, grown, header, run_blocks, stroke_blocks, wait_until_acknowledged


def told_to_stop(keeper: DirectKeeper, count: int = 10**6) -> int:
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


def test_where_not_even_the_ballast_is_room_enough_the_journal_waits_for_recovery(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(ballast, "BALLAST_BYTES", 6_000)
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
    with pytest.raises(BadInput, match=r"MB free, the run may need 2000\d{6} MB; make room, or choose another disk with --runs"):
        check_room(tmp_path / "not" / "there" / "yet", 10**15)
    check_room(tmp_path / "not" / "there" / "yet", 10**3)
    assert list(tmp_path.iterdir()) == []


def test_no_room_for_the_ballast_is_no_beginning(tmp_path: Path):
    with instead(FullDisk(tmp_path, 200_000)), pytest.raises(DiskFull, match=r"no room for 4\.2 MB in reserve"):
        Ballast(tmp_path).lay()
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def small_disk(tmp_path: Path):
    """A file system of its own, where this system lets one mount it."""
    place = tmp_path / "disk"
    place.mkdir()
    try:
        done = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=6m", "none", str(place)], capture_output=True, check=False)
    except OSError:
        pytest.skip("no mount here")
    if done.returncode:
        pytest.skip("may not mount here")
    yield place
    subprocess.run(["umount", str(place)], check=True)


def test_a_disk_filled_by_others_stops_the_run_and_the_recorder_ends_in_good_order(small_disk: Path):
    folder = small_disk / "run"
    run_folder.create(folder, header())
    keeper = ProcessKeeper(folder, patient=True)
    first, *_ = run_blocks(1)
    for block in first:
        keeper.give(block)
    wait_until_acknowledged(keeper, 1)
    with (small_disk / "others").open("wb", buffering=0) as others, pytest.raises(OSError, match="No space left"):
        while True:
            others.write(bytes(4096))
    with pytest.raises(DiskFull, match="stopped: disk full"):
        for block in begun(2, ticks=10**5):
            keeper.give(block)
    safe = keeper.acknowledged
    keeper.finish("stopped: disk full")
    assert keeper._process.returncode == 0
    found = run_folder.read_stages(folder)
    assert (safe, len(found.strokes)) == (1, 1)
    assert found.raw[0].cut_short == "stopped: disk full"
