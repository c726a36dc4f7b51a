"""rfca-rig export as it is typed."""

import importlib.util
import json

import pytest
from mcap.reader import make_reader

from rfca_rig.recording.store import write_recording
from tests.cli.typed import typed
from tests.export.recordings import lay_photos, recording


@pytest.fixture
def run(tmp_path):
    lay_photos(tmp_path / "run")
    write_recording(recording(140), tmp_path / "run" / "run.h5")
    return tmp_path / "run"


def test_mcap(run, tmp_path, monkeypatch, capsys):
    out = tmp_path / "small.mcap"
    said = typed(monkeypatch, capsys, "export", "mcap", run, "--out", out)
    assert (said.exit_code, said.out) == (0, "")
    assert (
        "overlays/001.jpg: is not there" in said.err and f"1 of them pictures, in {out}" in said.err
    )
    with out.open("rb") as file:
        assert make_reader(file).get_summary().statistics.message_count > 300


def test_mcap_as_json(run, tmp_path, monkeypatch, capsys):
    said = typed(
        monkeypatch,
        capsys,
        "export",
        "mcap",
        run / "run.h5",
        "--out",
        tmp_path / "a" / "b.mcap",
        "--json",
    )
    told = json.loads(said.out)
    assert (told["out"], told["pictures"], told["missing"], said.err) == (
        str(tmp_path / "a" / "b.mcap"),
        1,
        ["overlays/001.jpg"],
        "",
    )


def test_without_the_extra_one_line_says_what_to_install(run, tmp_path, monkeypatch, capsys):
    found = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if name == "mcap" else found(name)
    )
    said = typed(monkeypatch, capsys, "export", "mcap", run, "--out", tmp_path / "small.mcap")
    assert (said.exit_code, said.err) == (
        2,
        'rfca-rig: MCAP is an extra that is not installed; type pip install "rfca-rig[mcap]"\n',
    )


def test_csv(run, tmp_path, monkeypatch, capsys):
    said = typed(monkeypatch, capsys, "export", "csv", run, "--out", tmp_path / "csv")
    assert said.exit_code == 0
    assert f"in 8 files; {tmp_path / 'csv' / 'stages.csv'} lists them" in said.err
    again = typed(monkeypatch, capsys, "export", "csv", run, "--out", tmp_path / "csv", "--json")
    assert (again.exit_code, again.out) == (2, "")


@pytest.mark.parametrize("kind", ["mcap", "csv"])
def test_what_is_no_recording_is_bad_input(tmp_path, monkeypatch, capsys, kind):
    said = typed(monkeypatch, capsys, "export", kind, tmp_path / "none", "--out", tmp_path / "out")
    assert said.exit_code == 2
    assert said.err.startswith(f"rfca-rig: {tmp_path / 'none'}: is not there")
