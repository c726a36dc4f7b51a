"""A recording without a seal is looked through before it is exported or shown: no checksum says
that it is as a run wrote it.
"""

import os
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest

from rfca_rig.campaign.stored import open_stored
from rfca_rig.errors import BadInput
from rfca_rig.recording.store import write_recording
from tests.cli.typed import typed
from tests.engine.rigs import twin_rig
from tests.export.recordings import recording

SEAL_BYTES = 41


@pytest.fixture
def unsealed(tmp_path) -> Path:
    """A recording as a version before seals wrote it."""
    path = write_recording(
        replace(recording(140), nominal=twin_rig().nominal()), tmp_path / "run.h5"
    )
    os.truncate(path, path.stat().st_size - SEAL_BYTES)
    with h5py.File(path, "r+") as file:
        del file.attrs["sealed"]
    return path


def reverse_time(file: h5py.File) -> None:
    times = file["strokes/002/force/t_s"]
    times[...] = times[:][::-1]


def reverse_time_of_raw_stage(file: h5py.File) -> None:
    times = file["raw/001/force/t_s"]
    times[...] = 50.0 * times[:][::-1]


def forget_angle(file: h5py.File) -> None:
    file["strokes/001/shaft/shaft_angle_rad"][3] = np.nan


def exaggerate(file: h5py.File) -> None:
    file["strokes/001/shaft/shaft_angle_rad"][3] = 1e200


def describe_another_model(file: h5py.File) -> None:
    del file["believed"]
    text = b'{"leg": {"wings": 2}}'
    file.create_dataset("believed", data=text, dtype=h5py.string_dtype("utf-8", len(text)))


EDITS = {
    reverse_time: "should run forwards",
    reverse_time_of_raw_stage: "time runs backwards",
    forget_angle: "shaft_angle_rad holds a value that is no number",
    exaggerate: "which no sensor gives",
    describe_another_model: "leg",
}


def test_a_sound_file_without_a_seal_opens(unsealed):
    assert len(open_stored(unsealed).strokes) == 2


@pytest.mark.parametrize(("edit", "said"), EDITS.items(), ids=[edit.__name__ for edit in EDITS])
def test_what_no_run_writes_is_neither_exported_nor_shown(
    unsealed, tmp_path, monkeypatch, capsys, edit, said
):
    with h5py.File(unsealed, "r+") as file:
        edit(file)
    with pytest.raises(BadInput, match=said):
        open_stored(unsealed)
    for words in (("export", "csv", unsealed, "--out", tmp_path / "out"), ("view", unsealed)):
        refused = typed(monkeypatch, capsys, *words)
        assert refused.exit_code == 2
        assert said in refused.err
        assert refused.err.count("\n") == 1
    assert not (tmp_path / "out").exists()
