import errno
import os
from pathlib import Path

import pytest

from rfca_rig.campaign.opening import import_campaign, open_recordings, open_with_nominal_model
from rfca_rig.campaign.reading import read_campaign
from rfca_rig.errors import BadInput, RigError
from rfca_rig.recording import atomic
from rfca_rig.recording.store import write_recording
from tests.campaign.small import SMALL
from tests.recording.growing import grown
from tests.recording.same import assert_same
from tests.recording.samples import recording


def test_an_imported_campaign_is_the_campaign(tmp_path: Path):
    path = import_campaign(SMALL, tmp_path / "a" / "b")
    assert path == tmp_path / "a" / "b" / "run.h5"
    assert [found.name for found in (tmp_path / "a").iterdir()] == ["b"]
    assert_same(*open_recordings([SMALL, tmp_path / "a" / "b"]))


def test_importing_twice_gives_the_same_bytes(tmp_path: Path):
    assert (
        import_campaign(SMALL, tmp_path / "one").read_bytes()
        == import_campaign(SMALL, tmp_path / "two").read_bytes()
    )


def test_a_folder_that_is_there_is_not_written_into(tmp_path: Path):
    (tmp_path / "mine").mkdir()
    with pytest.raises(
        BadInput, match=r"mine: is there already; name a folder that does not exist yet"
    ):
        import_campaign(SMALL, tmp_path / "mine")
    assert [found.name for found in (tmp_path / "mine").iterdir()] == []


def test_a_full_disk_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(atomic.os, "fsync", _full_disk)
    with pytest.raises(RigError, match="No space left on device"):
        import_campaign(SMALL, tmp_path / "a" / "b")
    assert [found.name for found in tmp_path.iterdir()] == []


def _full_disk(_: int) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_a_place_that_cannot_hold_a_folder_is_one_line(tmp_path: Path):
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match=r"file/out: cannot be made: there is a file in its way"):
        import_campaign(SMALL, tmp_path / "file" / "out")


def test_recordings_open_from_folders_and_files_in_the_order_given(tmp_path: Path):
    (tmp_path / "run").mkdir()
    write_recording(recording(2), tmp_path / "run" / "run.h5")
    found = open_recordings([tmp_path / "run", SMALL, tmp_path / "run" / "run.h5"])
    assert [one.source for one in found] == ["SIM", "IMPORT", "SIM"]
    assert_same(found[0], recording(2))
    assert_same(found[1], read_campaign(SMALL))


def test_a_run_that_crashed_opens_with_what_it_had_and_says_so(tmp_path: Path):
    grown(tmp_path / "run", 1)
    (found,) = open_recordings([tmp_path / "run"])
    assert len(found.strokes) == 1
    assert (
        found.provenance["interrupted"]
        == "the run ended without being finished, after 1 strokes and 0 static stages"
    )


def test_a_belief_that_makes_no_model_is_told_with_the_place_of_its_recording(tmp_path: Path):
    (tmp_path / "run").mkdir()
    write_recording(recording(1, 0), tmp_path / "run" / "run.h5")
    with pytest.raises(BadInput, match=rf"{tmp_path}/run: the nominal model: .*missing"):
        open_with_nominal_model([SMALL, tmp_path / "run"])
    assert len(open_with_nominal_model([SMALL])) == 1


def test_anything_else_is_refused(tmp_path: Path):
    (tmp_path / "notes.txt").write_text("x")
    for path, said in (
        (tmp_path / "absent", "is not there"),
        (tmp_path, r"holds neither campaign.toml nor run.h5"),
        (
            tmp_path / "notes.txt",
            r"is not a recording; give a folder with campaign.toml or run.h5, or an .h5 file",
        ),
    ):
        with pytest.raises(BadInput, match=said):
            open_recordings([path])
