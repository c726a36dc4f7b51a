"""Runs as a catalogue of Tiled, read by Tiled's own client within the process."""

from contextlib import contextmanager
from shutil import copytree

import pytest

import rfca_rig as rr
from rfca_rig.errors import BadInput
from tests.logbook.made import DONE, TRIPPED, plan, run

pytest.importorskip("tiled.server")

import xarray
from tiled.client import Context, from_context
from tiled.client.utils import ClientError
from tiled.queries import Contains, FullText, Key
from tiled.server.app import build_app

from rfca_rig.notebook import tiled

# Tiled's client within the process is the test client of Starlette, which wants another httpx.
pytestmark = pytest.mark.filterwarnings("ignore:Using `httpx` with")


@contextmanager
def serve(folder):
    with Context.from_app(build_app(tiled.catalogue(folder))) as context:
        yield from_context(context)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recorded") / "runs"
    rr.run(height_mm=215, speed_rad_s=2.433, repeats=2, seed=3, runs=folder)
    return folder


@pytest.fixture
def folder(tmp_path):
    for number, ending in enumerate([DONE, TRIPPED, DONE]):
        path = tmp_path / "runs" / "autumn" / f"SIM-{number}"
        run(path, plan("flapping"), ending=ending, sample=f"leg {number}")
    return tmp_path / "runs"


@pytest.fixture
def opened(monkeypatch):
    """The paths that are opened from now on."""
    paths = []

    def open_path(path):
        paths.append(path)
        return rr.open(path)

    monkeypatch.setattr(tiled, "open_path", open_path)
    tiled._open.cache_clear()
    return paths


def test_a_stroke_has_the_values_units_and_attributes_of_the_recording(recorded):
    with serve(recorded) as client:
        (served,) = client.values()
        assert list(served) == ["001", "002"]
        for number, stroke in enumerate(served.values()):
            dataset = stroke.read()
            expected = rr.open(served.metadata["run"]).to_xarray(number)
            xarray.testing.assert_identical(dataset, expected)
            for name, column in expected.variables.items():
                assert dataset[name].dtype == column.dtype
                assert dataset[name].values.tobytes() == column.values.tobytes(), name
            assert dataset["fz_N"].attrs == {"units": "N"}


def test_metadata_are_the_columns_of_the_table(recorded):
    (row,) = rr.runs(recorded).to_dict("records")
    with serve(recorded) as client:
        (served,) = client.values()
        assert served.metadata["heights_mm"] == [215.0]
        assert served.metadata["began"] == row["began"].isoformat()
        for name in ("seed", "sensor_counts_per_N", "rfca_rig_version", "ended", "strokes", "run"):
            assert served.metadata[name] == row[name], name
        missing = set(row) - set(served.metadata)
        assert missing == {name for name, value in row.items() if value is None}
        assert "probability" in missing


def test_runs_are_found_by_their_metadata(folder):
    (height_mm, *_) = rr.runs(folder)["heights_mm"][0]
    with serve(folder) as client:
        assert sorted(client) == ["autumn:SIM-0", "autumn:SIM-1", "autumn:SIM-2"]
        searches = {
            "ended": client.search(Key("ended") == "tripped"),
            "code": client.search(Key("code") == "F-02").search(Key("source") == "SIM"),
            "word": client.search(FullText("tripped")),
            "sample": client.search(Key("sample") == "leg 1"),
        }
        for name, runs in searches.items():
            assert list(runs) == ["autumn:SIM-1"], name
        assert len(client.search(Contains("heights_mm", height_mm))) == 3
        assert len(client.search(Contains("heights_mm", height_mm + 1.0))) == 0
        assert len(client.search(Key("began") > "2001-01-01")) == 3
        # A run without a diagnosis has no probability: it is left out, and nothing fails.
        assert len(client.search(Key("probability") > 0.5)) == 0


def test_a_recording_is_opened_when_a_stroke_is_asked_for_and_once(recorded, opened):
    with serve(recorded) as client:
        assert len(client.search(Key("ended") == "done")) == 1
        (served,) = client.values()
        assert len(served) == 2 and list(served) == ["001", "002"]
        assert opened == []
        served["001"].read()
        served["002"]["fz_N"].read()
        assert len(opened) == 1


def test_runs_that_begin_or_end_meanwhile_are_served(folder):
    with serve(folder) as client:
        run(folder / "SIM-new", plan("flapping"), ending=None)
        assert list(client.search(Key("ended") == "unfinished")) == ["SIM-new"]
        assert client["SIM-new"].metadata["ended"] == "unfinished"
        (folder / "SIM-new/end.json").write_text('{"provenance": {"reason": "done"}}')
        assert client["SIM-new"].metadata["ended"] == "done"
        run(folder / "SIM-newest", plan("flapping"), ending=DONE)
        assert client["SIM-newest"].metadata["ended"] == "done"


def test_every_run_has_a_key_that_a_url_can_hold(recorded, tmp_path):
    (path,) = (path for path in recorded.iterdir() if path.is_dir())
    for name in ("leg #1", "leg ?1", "50 %", "a/b", "a:b"):
        copytree(path, tmp_path / "runs" / name)
    with serve(tmp_path / "runs") as client:
        assert len(list(client)) == 5
        served = {client[key].metadata["run"] for key in client}
        assert len(served) == 5
    with serve(path) as client:
        assert list(client) == [path.name]


def test_a_recording_that_cannot_be_read_is_one_line_for_the_client(recorded, tmp_path):
    (path,) = (path for path in recorded.iterdir() if path.is_dir())
    copytree(path, tmp_path / "runs" / "SIM-0")
    (tmp_path / "runs" / "SIM-0" / "run.h5").write_bytes(b"no HDF5")
    with serve(tmp_path / "runs") as client:
        assert client["SIM-0"].metadata["ended"] == "done"
        with pytest.raises(ClientError, match=r"422: .*run\.h5: is not a whole recording"):
            client["SIM-0"]["001"]


def test_what_is_not_there_is_refused(folder, tmp_path):
    with serve(folder) as client:
        with pytest.raises(KeyError):
            client["SIM-9"]
        with pytest.raises(KeyError):
            client["autumn:SIM-0"]["999"]
    with pytest.raises(BadInput, match="is no folder"):
        tiled.catalogue(tmp_path / "nowhere")
