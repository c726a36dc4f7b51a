"""A power cut leaves what was being written cut off at any byte, or zeros from there on: nothing
acknowledged is lost, nothing made up.
"""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.recording import run_folder
from rfca_rig.recording.checking import REMADE, check_run
from rfca_rig.recording.hdf5_file import run_to_completion
from rfca_rig.recording.layout import journals
from rfca_rig.recording.model import Recording
from rfca_rig.recording.stage_file import write_stage
from tests.recording.growing import begun, expected, grown, header, streams
from tests.recording.same import assert_same
from tests.recording.test_crashes import recovered

ACKNOWLEDGED = 2
IN_FLIGHT = ACKNOWLEDGED + 1
KINDS = (
    "journal",
    "journal of zeros",
    "stage file",
    "stage file of zeros",
    "events",
    "run.h5",
    "SHA256SUMS",
    "photo",
)
POINTS = 35


@pytest.fixture(scope="module")
def crashed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two stages acknowledged, the third under way."""
    folder = tmp_path_factory.mktemp("crashed") / "run"
    keeper = grown(folder, ACKNOWLEDGED)
    for block in begun(IN_FLIGHT):
        keeper.give(block)
    keeper._writer.force()
    keeper._writer._events.close()  # as the death of its process does
    return folder


def being_written(folder: Path, kind: str) -> Path:
    """Puts the folder where it is when that file is being written, and gives the file, as yet
    whole.
    """
    (journal,) = journals(folder)
    match kind.removesuffix(" of zeros"):
        case "journal":
            return journal
        case "events":
            return folder / "events.jsonl"
        case "stage file":
            whole = journal.with_suffix(".h5")
            run_to_completion(write_stage(journal, whole, header()))
        case "photo":
            whole = folder / "photos" / "002.png"
            shutil.copy(folder / "photos" / "001.png", whole)
        case "run.h5":
            run_folder.close_journals(folder)
            whole = run_folder.build_recording(folder)
            (folder / "SHA256SUMS").unlink()
        case _:
            run_folder.close_journals(folder)
            run_folder.build_recording(folder)
            whole = folder / "SHA256SUMS"
    return whole.rename(whole.with_name(whole.name + ".writing"))


def cut(file: Path, place: int, kind: str) -> None:
    length = file.stat().st_size
    os.truncate(file, place)
    if kind.endswith("of zeros"):
        os.truncate(file, length)


def survives(crashed: Path, copy: Path, kind: str, share: float) -> None:
    """One cut, at that share of the file: nothing is lost, and nothing is there that was not
    recorded.
    """
    shutil.copytree(crashed, copy)
    file = being_written(copy, kind)
    cut(file, round(share * file.stat().st_size), kind)
    assert_whole(run_folder.read_stages(copy))
    # Hashes that were cut off are damage, which recovery makes good.
    assert all(finding.is_sound or finding.file in REMADE for finding in check_run(copy)), list(
        check_run(copy)
    )
    assert_whole(recovered(copy))
    shutil.rmtree(copy)


def assert_whole(found: Recording) -> None:
    """The acknowledged stages to the last bit, and of the third no more than its first samples."""
    recorded = replace(found, nominal={}, known_to={}, provenance={})
    cut_short = [raw for raw in found.raw if raw.cut_short]
    assert_same(
        replace(recorded, raw=tuple(raw for raw in found.raw if not raw.cut_short)),
        expected(ACKNOWLEDGED),
    )
    assert len(cut_short) <= 1
    for raw in cut_short:
        for name, stream in streams(IN_FLIGHT).items():
            for column, known in stream.columns.items():
                there = raw.streams[name].columns[column].data
                np.testing.assert_array_equal(there, known.data[: len(there)])


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_cut_at_any_of_three_bytes(crashed: Path, tmp_path: Path, kind: str):
    for share in (0.0, 0.37, 0.999):
        survives(crashed, tmp_path / "copy", kind, share)


@pytest.mark.long
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("kind", KINDS)
def test_files_cut_at_over_200_bytes(crashed: Path, tmp_path: Path, kind: str):
    for share in np.linspace(0.0, 1.0, POINTS):
        survives(crashed, tmp_path / "copy", kind, float(share))
