"""Recordings that somebody made to read other files of the user, or to never end."""

import os
from pathlib import Path

import h5py
import numpy as np
import pytest

from rfca_rig.campaign.recorded_files import list_columns
from rfca_rig.errors import BadInput
from rfca_rig.recording.store import read_recording, write_recording
from tests.cli.typed import typed
from tests.recording.samples import recording

FORCE = "strokes/001/force"
SECRET = b"the private key of somebody else"


def keep_outside(file, secret):
    del file[FORCE]["fz_N"]
    file[FORCE].create_dataset("fz_N", (8,), np.int32, external=[(str(secret), 0, 32)])


def link_outside(file, secret):
    other = secret.with_suffix(".h5")
    with h5py.File(other, "w") as there:
        there["fz_N"] = np.frombuffer(SECRET, np.int32)
    del file[FORCE]["fz_N"]
    file[FORCE]["fz_N"] = h5py.ExternalLink(str(other), "fz_N")


def link_within(file, secret):
    del file[FORCE]["fz_N"]
    file[FORCE]["fz_N"] = h5py.SoftLink(f"/{FORCE}/fx_N")


def show_virtually(file, secret):
    layout = h5py.VirtualLayout((8,), np.int32)
    layout[:] = h5py.VirtualSource(str(secret.with_suffix(".h5")), "fz_N", (8,))
    del file[FORCE]["fz_N"]
    file[FORCE].create_virtual_dataset("fz_N", layout)


def claim_rows(file, secret):
    del file[FORCE]["fz_N"]
    file[FORCE].create_dataset("fz_N", (10**11,), np.int32, chunks=(1 << 20,), compression="gzip")


def claim_rows_at_once(file, secret):
    del file[FORCE]["fz_N"]
    file[FORCE].create_dataset("fz_N", (10**9,), np.int32)


def show_twice(file, secret):
    del file[FORCE]["fz_N"]
    file[FORCE]["fz_N"] = file[FORCE]["fx_N"]


def show_often(file, secret):
    for number in range(2, 3000):
        file[f"strokes/{number + 10:04d}"] = file["strokes/001"]


def turn_in_a_circle(file, secret):
    file["strokes/004"] = file["strokes"]


KINDS = {
    keep_outside: "keeps its bytes in another file",
    link_outside: "is a link to elsewhere",
    link_within: "is a link to elsewhere",
    show_virtually: "is a virtual dataset",
    claim_rows: "claims 400000 MB",
    claim_rows_at_once: "claims 4000 MB",
    show_twice: "shows an object that the file holds under another name",
    show_often: "shows an object that the file holds under another name",
    turn_in_a_circle: "shows an object that the file holds under another name",
}


@pytest.fixture(params=KINDS, ids=lambda kind: kind.__name__)
def hostile(request, tmp_path: Path):
    secret = tmp_path / "secret"
    secret.write_bytes(SECRET)
    path = write_recording(recording(), tmp_path / "run.h5")
    os.truncate(path, path.stat().st_size - 41)  # without its seal, as after any edit
    with h5py.File(path, "r+") as file:
        request.param(file, secret)
    return path, KINDS[request.param]


def test_a_recording_that_leads_elsewhere_or_claims_too_much_is_refused(hostile):
    path, words = hostile
    with pytest.raises(BadInput, match=rf"run\.h5: .*/strokes/\S+ {words}"):
        read_recording(path)


@pytest.mark.slow
def test_no_command_hands_out_what_the_file_leads_to(hostile, monkeypatch, capsys, tmp_path):
    path, words = hostile
    out = tmp_path / "csv"
    for line in (
        ["export", "csv", path, "--out", out],
        ["report", path, "--out", tmp_path / "report"],
    ):
        said = typed(monkeypatch, capsys, *line)
        assert said.exit_code == 2
        assert words in " ".join(said.err.split())
        assert "Traceback" not in said.err
    assert not any(SECRET[:8] in file.read_bytes() for file in out.rglob("*") if file.is_file())


def test_columns_of_a_strangers_file_are_refused_in_the_same_way(hostile):
    path, words = hostile
    with pytest.raises(BadInput, match=words):
        list_columns(path)
