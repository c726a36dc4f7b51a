"""--view on a run, and the view of a recording, as typed."""

import json
import re
import signal
import socket
import subprocess
import sys

import pytest

from rfca_rig.cli import attach_view
from rfca_rig.cli.attach_view import parse_viewing
from rfca_rig.view import run_queue
from tests.cli.typed import typed
from tests.view.pages import opened, stream_of
from tests.view.test_replay import SMALL

RUN = ("dynamic", "run", "--height", "215", "--speed", "3.249", "--repeats", "1", "--pace", "0")
URL = re.compile(r"http://127\.0\.0\.1:(\d+)/#token=\S{32}")


@pytest.fixture
def views(monkeypatch):
    """Those that were started, gone afterwards however long they would have stayed."""
    started = []

    class Noted(run_queue.LiveView):
        def __init__(self, *words):
            super().__init__(*words)
            started.append(self)

    monkeypatch.setattr(attach_view, "LiveView", Noted)
    yield started
    for view in started:
        view._process.kill()
        view._process.wait()


def test_a_run_with_a_view_prints_its_address_once_and_leaves_the_page_behind(
    monkeypatch, capsys, tmp_path, views
):
    said = typed(monkeypatch, capsys, *RUN, "--view", "--json", "--runs", tmp_path)
    assert said.exit_code == 0, said.err
    assert json.loads(said.out)["strokes"][0]["valley_fz_N"] < -40.0
    assert len(URL.findall(said.err)) == 1
    with opened(URL.search(said.err)[0]) as page:
        state = [message for message in page.all_after_end() if message["kind"] == "state"][-1]
    assert state["ended"] == "done" and "valley" in state["said"][-1]
    assert views[0].is_alive


def test_without_the_option_nothing_is_started(monkeypatch, capsys, tmp_path, views):
    assert parse_viewing(False, None, 1.0) is None
    said = typed(monkeypatch, capsys, *RUN, "--dry-run", "--runs", tmp_path)
    assert said.exit_code == 0 and not views


def test_who_names_a_port_wants_the_view():
    assert parse_viewing(False, 8650, 1.0).port == 8650
    assert parse_viewing(True, None, 2.0).port == 0


def test_a_port_that_is_taken_is_said_before_anything_is_recorded(
    monkeypatch, capsys, tmp_path, views
):
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        said = typed(
            monkeypatch, capsys, *RUN, "--view-port", taken.getsockname()[1], "--runs", tmp_path
        )
    assert said.exit_code == 2 and "is taken" in said.err.splitlines()[-1]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("words", [(*RUN, "--view"), ("view", str(SMALL))])
def test_without_the_extra_one_line_says_what_to_install(monkeypatch, capsys, tmp_path, words):
    monkeypatch.setattr(run_queue, "find_spec", lambda _: None)
    monkeypatch.chdir(tmp_path)
    said = typed(monkeypatch, capsys, *words)
    assert said.exit_code == 2 and said.err.splitlines() == [
        'rfca-rig: the view is an extra that is not installed; type pip install "rfca-rig[view]"'
    ]
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_no_run_is_one_line(monkeypatch, capsys, tmp_path):
    said = typed(monkeypatch, capsys, "view", tmp_path)
    assert said.exit_code == 2 and len(said.err.splitlines()) == 1 and str(tmp_path) in said.err
    said = typed(monkeypatch, capsys, "view", tmp_path / "nothing")
    assert said.exit_code == 2 and "is not there" in said.err


@pytest.mark.slow
def test_a_recording_is_served_until_the_key_is_pressed():
    words = [sys.executable, "-c", "from rfca_rig.cli.main import run; run()", "view", str(SMALL)]
    with subprocess.Popen(words, stderr=subprocess.PIPE, text=True) as serving:
        try:
            url = URL.search(serving.stderr.readline())[0]
            with stream_of(url) as socket:
                hello = json.loads(socket.recv())
                assert hello["mode"] == "replay" and hello["mark"] == "IMPORT"
            serving.send_signal(signal.SIGINT)
            assert serving.wait(20.0) == 0
            assert serving.stderr.read() == ""
        finally:
            serving.kill()
