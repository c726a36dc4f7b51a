"""Runs that begin at the same moment get folders of their own, and one of two resumes goes on."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from rfca_rig.bench.resume import RESUMED
from rfca_rig.cli.paths import make_run_folder
from rfca_rig.errors import BadInput, RigError
from rfca_rig.recording import run_folder
from rfca_rig.recording.run_text import events_of
from tests.recording.growing import grown


def test_runs_that_begin_together_get_folders_of_their_own(tmp_path):
    with ThreadPoolExecutor(16) as pool:
        folders = list(
            pool.map(lambda _: make_run_folder(tmp_path / "runs", "SIM", "Table 2"), range(64))
        )
    assert sorted(folder.name for folder in folders) == [
        f"SIM-table-2-{number:03d}" for number in range(1, 65)
    ]


def test_a_place_that_takes_no_folder_is_one_line(tmp_path):
    (tmp_path / "runs").write_text("no folder")
    with pytest.raises(RigError, match="SIM-a-001: cannot be made: Not a directory"):
        make_run_folder(tmp_path / "runs", "SIM", "a")


def test_of_two_resumes_of_one_run_the_second_is_refused(tmp_path):
    grown(tmp_path / "run", 1).finish("stopped")
    seen_by_both = 0
    run_folder.reopen(tmp_path / "run", {"event": RESUMED}, seen_by_both)
    with pytest.raises(BadInput, match="another process has resumed the run at this moment"):
        run_folder.reopen(tmp_path / "run", {"event": RESUMED}, seen_by_both)
    assert [event["event"] for event in events_of(tmp_path / "run")].count(RESUMED) == 1
