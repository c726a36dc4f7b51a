"""The index is a cache: with it, without it, and with any other in its place the list is the
same.
"""

import os
import random
import shutil
import sqlite3
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest

from rfca_rig.errors import BadInput
from rfca_rig.logbook import listing
from rfca_rig.logbook.listing import NAME, VERSION, list_runs, read_index
from tests.logbook.made import DONE, STOPPED, TRIPPED, plan, run

PLAN = plan("flapping")


@pytest.fixture
def runs(tmp_path, monkeypatch):
    """Nine runs, one a second, some of them in folders of folders."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "runs"
    for number, ending in enumerate([DONE, TRIPPED, None] * 3):
        made = run(
            folder / ("" if number % 2 else f"2026/month-{number}") / f"SIM-{number}",
            PLAN,
            ending=ending,
            sample=f"leg {number}",
        )
        os.utime(made / "run.json", (1e9 + number, 1e9 + number))
    return folder


@pytest.fixture
def read(monkeypatch):
    """The folders that were read, not taken from the index."""
    folders = []
    entry_in = listing.read_entry
    monkeypatch.setattr(
        listing,
        "read_entry",
        lambda runs, folder, measure_s: (folders.append(folder), entry_in(runs, folder, measure_s))[
            1
        ],
    )
    return folders


def test_newest_first_however_deep(runs):
    assert [entry.sample for entry in list_runs(runs)] == [
        f"leg {number}" for number in reversed(range(9))
    ]


def test_what_did_not_change_is_not_read_again(runs, read):
    first = list_runs(runs)
    assert len(read) == 9
    assert list_runs(runs) == first
    assert len(read) == 9


def test_what_changed_is_read_again_and_only_that(runs, read):
    list_runs(runs)
    read.clear()
    (runs / "SIM-5" / "end.json").write_text((runs / "SIM-1" / "end.json").read_text())
    shutil.rmtree(runs / "SIM-7")
    run(runs / "SIM-new", PLAN, ending=STOPPED)
    found = {entry.folder: entry.ended for entry in list_runs(runs)}
    assert sorted(read) == ["SIM-5", "SIM-new"]
    assert (found["SIM-5"], found["SIM-new"], "SIM-7" in found) == ("tripped", "stopped", False)


def test_a_file_of_the_same_size_and_age_in_place_of_another_is_read(runs, read):
    list_runs(runs)
    header = runs / "SIM-1" / "run.json"
    age = header.stat()
    other = runs / "other"
    other.write_text(header.read_text().replace("leg 1", "leg X"))
    os.utime(other, ns=(age.st_atime_ns, age.st_mtime_ns))
    other.replace(header)
    assert "leg X" in [entry.sample for entry in list_runs(runs)]


def test_a_flipped_bit_anywhere_in_the_index_changes_nothing(runs):
    expected = list_runs(runs)
    content = (runs / NAME).read_bytes()
    rng = random.Random(5)
    for _ in range(60):
        damaged = bytearray(content)
        damaged[rng.randrange(len(content))] ^= 1 << rng.randrange(8)
        (runs / NAME).write_bytes(damaged)
        assert list_runs(runs) == expected


@pytest.mark.parametrize("content", [b"", b"SQLite format 3\0", b"what is this", bytes(8192)])
def test_an_index_that_is_none_is_replaced(runs, content):
    expected = list_runs(runs)
    (runs / NAME).write_bytes(content)
    assert list_runs(runs) == expected
    assert len(read_index(runs)) == 9


def test_an_index_cut_anywhere_is_replaced(runs):
    expected = list_runs(runs)
    content = (runs / NAME).read_bytes()
    for length in range(0, len(content), 1997):
        (runs / NAME).write_bytes(content[:length])
        assert list_runs(runs) == expected


def test_an_index_of_another_version_is_not_believed(runs, read):
    list_runs(runs)
    with closing(sqlite3.connect(runs / NAME)) as base:
        base.execute(f"PRAGMA user_version = {VERSION + 1}")
        base.commit()
    read.clear()
    list_runs(runs)
    assert len(read) == 9
    assert len(read_index(runs)) == 9


def test_where_the_folder_takes_no_file_the_list_is_the_same(runs, monkeypatch):
    expected = list_runs(runs)
    (runs / NAME).unlink()
    (runs / NAME).mkdir()  # holds for root, too, as a folder without write permission would not
    (runs / NAME / "kept").touch()
    assert list_runs(runs) == expected
    assert [path.name for path in runs.iterdir() if path.name.startswith(".")] == [NAME]


def test_many_at_once_agree_and_leave_one_index(runs):
    expected = list_runs(runs)

    def one(number):
        if number % 3 == 0:
            (runs / NAME).unlink(missing_ok=True)
        return list_runs(runs)

    with ThreadPoolExecutor(4) as pool:
        assert all(found == expected for found in pool.map(one, range(20)))
    list_runs(runs)
    assert len(read_index(runs)) == 9


def test_a_run_s_own_folder_is_not_written_into(runs):
    before = sorted((runs / "SIM-1").iterdir())
    (entry,) = list_runs(runs / "SIM-1")
    assert (entry.folder, sorted((runs / "SIM-1").iterdir())) == (".", before)


def test_a_link_that_leads_in_a_circle_is_no_trap(runs):
    (runs / "2026" / "again").symlink_to(runs)
    assert len(list_runs(runs)) == 9
    (runs / "elsewhere").symlink_to(shutil.move(runs / "SIM-1", runs.parent / "disk"))
    assert sorted(Path(entry.folder).name for entry in list_runs(runs))[-1] == "elsewhere", (
        "a link to a run elsewhere is one"
    )


def test_no_folder_is_told_with_the_option_to_name_one(tmp_path):
    with pytest.raises(BadInput, match=r"nowhere: is no folder; .*--runs"):
        list_runs(tmp_path / "nowhere")


def test_progress_counts_only_what_is_read(runs):
    said = []
    list_runs(runs, lambda done, of: said.append((done, of)))
    assert said == [(number, 9) for number in range(10)]
    said.clear()
    list_runs(runs, lambda done, of: said.append((done, of)))
    assert said == []
