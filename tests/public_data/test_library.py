"""Sets of public recordings are got from a folder, or from a server, or refused in one line."""

import functools
import http.server
import json
import threading

import pytest

import rfca_rig as rr
from rfca_rig.errors import BadInput
from rfca_rig.public_data import sources
from rfca_rig.public_data.registry import read_registry
from rfca_rig.public_data.sources import RECORDINGS_VARIABLE, SOURCES_VARIABLE
from tests.cli.typed import typed
from tests.public_data.excerpts import rebuild
from tests.public_data.made_up import CONTENT, put_source, use_made_up_set

# Nothing listens at this port, so no connection is ever made.
NO_SERVER = "http://127.0.0.1:9/"


@pytest.fixture
def alone(monkeypatch, tmp_path):
    """A computer without a network, with empty folders for sources and recordings."""
    monkeypatch.setenv(SOURCES_VARIABLE, str(tmp_path / "sources"))
    monkeypatch.setenv(RECORDINGS_VARIABLE, str(tmp_path / "recordings"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(sources, "SERVER", NO_SERVER)
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_source_that_was_put_by_hand_becomes_a_folder_of_recordings(alone, monkeypatch):
    put_source(alone / "sources", use_made_up_set(monkeypatch))
    lines = []
    folder = rr.datasets.get("simple", progress=lines.append)
    assert lines == ["owner/name: results/swing.csv"]
    rows = (folder / "runs/ddp.csv").read_text(encoding="utf-8").splitlines()
    assert rows[:3] == ["time,position,velocity,torque", "0,0,1,1", "0.01,0.099833,0.995,1"]
    readme = (folder / "README.txt").read_text(encoding="utf-8")
    assert "https://github.com/owner/name" in readme
    assert "Copyright (c) 2020 Somebody. Please cite: A paper" in readme
    assert {path.name for path in folder.iterdir()} == {
        "README.txt",
        "experiment.toml",
        "model.xml",
        "runs",
    }
    # It was converted once: the source is not needed again.
    (alone / "sources").rename(alone / "gone")
    assert rr.datasets.get("simple", progress=lines.append) == folder
    assert len(lines) == 1


def test_without_a_network_the_place_for_the_file_is_named(alone, monkeypatch):
    source = use_made_up_set(monkeypatch)
    with pytest.raises(BadInput) as error:
        rr.datasets.get("simple")
    line = str(error.value)
    assert "no connection to the server" in line and "\n" not in line
    assert str(alone / "sources" / source.name_of("")) in line


def test_a_file_with_another_sha256_is_not_taken(alone, monkeypatch):
    source = use_made_up_set(monkeypatch)
    put_source(alone / "sources", source, CONTENT.replace("1.0\n", "1.1\n"))
    with pytest.raises(BadInput, match="no connection"):
        rr.datasets.get("simple")


@pytest.fixture
def server(tmp_path):
    """A server of the files below tmp_path/served, and its address."""
    handler = functools.partial(
        http.server.SimpleHTTPRequestHandler, directory=str(tmp_path / "served")
    )
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as served:
        threading.Thread(target=served.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{served.server_address[1]}/"
        served.shutdown()


def test_a_source_is_fetched_from_the_server(alone, monkeypatch, server):
    source = use_made_up_set(monkeypatch)
    put_source(alone / "served", source)
    monkeypatch.setattr(sources, "SERVER", server)
    assert (rr.datasets.get("simple") / "runs/ddp.csv").is_file()
    assert (alone / "sources" / source.name_of("results/swing.csv")).is_file()


@pytest.mark.parametrize(
    ("content", "reason"),
    [(None, "the server answers 404"), ("other", "its SHA-256 is not the registered one")],
)
def test_a_server_without_the_file_is_refused(alone, monkeypatch, server, content, reason):
    source = use_made_up_set(monkeypatch)
    if content is not None:
        put_source(alone / "served", source, content)
    monkeypatch.setattr(sources, "SERVER", server)
    with pytest.raises(BadInput, match=reason):
        rr.datasets.get("simple")


def test_a_source_with_other_values_than_expected_is_not_converted(alone, monkeypatch):
    content = CONTENT.replace("1.0\n", "1.1\n")
    put_source(alone / "sources", use_made_up_set(monkeypatch, content), content)
    with pytest.raises(BadInput, match=r"rms 0\.2843, 0\.7197, 0\.6943, 1\.1 became of it"):
        rr.datasets.get("simple")
    assert not list((alone / "recordings").rglob("*.csv"))


def test_a_folder_with_content_is_not_written_over(alone, monkeypatch):
    put_source(alone / "sources", use_made_up_set(monkeypatch))
    (alone / "mine").mkdir()
    (alone / "mine" / "notes.txt").touch()
    with pytest.raises(BadInput, match="mine: is there already"):
        rr.datasets.get("simple", out="mine")


def test_a_name_that_is_none_is_answered_with_the_nearest():
    with pytest.raises(BadInput, match="simpel: no such set of recordings; did you mean simple"):
        rr.datasets.get("simpel")


def test_true_sources_pass_the_sha256_and_become_a_set(alone, monkeypatch):
    """With the excerpts of `free-swing`, which are complete."""
    public_set = read_registry().find("free-swing")
    for file in public_set.recordings:
        for path in file.sources:
            rebuild(path, alone / "sources" / public_set.group.source.name_of(path))
    folder = rr.datasets.get("free-swing")
    assert len(list((folder / "runs").glob("*.csv"))) == 3


def test_the_command_lists_every_set(monkeypatch, capsys):
    listed = typed(monkeypatch, capsys, "datasets", "list", "--json")
    rows = json.loads(listed.out)
    assert [row["name"] for row in rows] == rr.datasets.names()
    plain = typed(monkeypatch, capsys, "datasets", "list").out
    for row in rows:
        assert f"{row['name']}: omits {row['concealed']}" in plain
        assert row["repository"] in plain


def test_the_command_makes_a_folder_that_is_checked(alone, monkeypatch, capsys):
    put_source(alone / "sources", use_made_up_set(monkeypatch))
    done = typed(monkeypatch, capsys, "datasets", "get", "simple")
    assert (done.exit_code, done.out.split(":")[0]) == (0, "simple")
    assert done.err.splitlines()[0] == "FETCH   owner/name: results/swing.csv"
    assert (alone / "simple" / "experiment.toml").is_file()


def test_the_command_ends_with_2_where_nothing_can_be_fetched(alone, monkeypatch, capsys):
    done = typed(monkeypatch, capsys, "datasets", "get", "golf")
    assert done.exit_code == 2
    assert done.err.splitlines()[-1].startswith("rfca-rig: data/Ball_drops_data.xls of github.com/")
    assert not (alone / "golf").exists()
