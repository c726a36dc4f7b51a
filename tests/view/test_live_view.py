"""The view in its own process beside runs on the twin: what it is told, what it may ask for, and
what its death costs.
"""

import os
import signal
import socket
import threading
from contextlib import contextmanager
from pathlib import Path

import pytest
from websockets.exceptions import InvalidStatus

from rfca_rig.engine.interfaces import StopRequest
from rfca_rig.engine.run import Supervision, run_plan
from rfca_rig.errors import BadInput, Stopped
from rfca_rig.protocol.plan import Flap, MoveShaft, Rest
from rfca_rig.recording.run_text import events_of
from rfca_rig.view.run_facts import run_facts
from rfca_rig.view.run_queue import LiveView
from tests.engine.rigs import one_condition, recorder_on, twin_rig
from tests.view.pages import asked_to_stop, got, opened, posted, stream_of
from tests.view.test_live_source import drawn
from tests.waiting import wait_for

RIG = twin_rig()


@contextmanager
def viewed(bench, plan, port=0):
    """A view, which is gone afterwards however long it would have stayed."""
    stop_request = StopRequest()
    told = []
    facts = run_facts(
        plan, "SIM", bench.sensor.scale(), RIG.nominal(), RIG.known_to.model_dump(exclude_none=True)
    )
    view = LiveView(
        facts, plan, stop_request, lambda: (bench.sensor.health(), 0), told.append, port
    )
    try:
        yield view, Supervision(stop_request=stop_request, observer=view.run_queue), told
    finally:
        view.close()
        view._process.kill()
        view._process.wait()


@pytest.fixture(scope="module")
def unwatched(tmp_path_factory):
    """The bytes of a run that nobody looks at."""
    folder = tmp_path_factory.mktemp("unwatched") / "run"
    with recorder_on(RIG, folder) as (bench, recorder, kept):
        run_plan(one_condition(RIG), bench, recorder, lambda _: None)
        kept.finish()
    return (folder / "run.h5").read_bytes()


@pytest.mark.slow
def test_a_page_sees_all_of_a_run_and_the_recording_is_the_same_to_the_last_byte(
    tmp_path, unwatched
):
    plan = one_condition(RIG)
    with (
        recorder_on(RIG, tmp_path / "run") as (bench, recorder, kept),
        viewed(bench, plan) as (view, supervision, _),
        opened(view.url) as page,
    ):
        run_plan(plan, bench, recorder, lambda stage: view.run_queue.line(stage.label), supervision)
        view.run_queue.end("done", "")
        got = page.all_after_end()
        stroke = kept.finish().strokes[0]
        assert asked_to_stop(view.url, b'{"how": "now"}') == 409
    assert (tmp_path / "run" / "run.h5").read_bytes() == unwatched
    hello = got[0]
    state = [message for message in got if message["kind"] == "state"][-1]
    assert (hello["kind"], hello["mark"], hello["mode"]) == ("hello", "SIM", "live")
    assert [stage["label"] for stage in hello["stages"]] == [stage.label for stage in plan.stages]
    assert (state["ended"], state["trip"], state["done"]) == ("done", None, 1.0)
    assert state["said"] == [stage.label for stage in plan.stages][-12:]
    assert view.run_queue.lost == 0
    low, high = drawn(got)
    assert (
        low <= stroke.channel("fz_N")[1].min() + 1e-4
        and high >= stroke.channel("fz_N")[1].max() - 1e-4
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "after", "last"),
    [("safe point", Rest, MoveShaft), ("now", Rest, Rest)],
)
def test_a_stop_from_the_page_ends_the_run_as_the_key_does(tmp_path, how, after, last):
    """Asked for while the leg rests before the first of three strokes: a safe point is reached
    before it.
    """
    plan = one_condition(RIG, 3)
    done = []
    with (
        recorder_on(RIG, tmp_path / "run") as (bench, recorder, kept),
        viewed(bench, plan) as (view, supervision, told),
    ):

        def progress(stage):
            done.append(stage)
            if isinstance(stage, after) and sum(isinstance(one, after) for one in done) == 1:
                assert asked_to_stop(view.url, f'{{"how": "{how}"}}'.encode()) == 202

        with pytest.raises(Stopped, match="in the view"):
            run_plan(plan, bench, recorder, progress, supervision)
        assert len(told) == 1
        strokes = kept.so_far().strokes
    assert isinstance(done[-1], last)
    assert sum(isinstance(stage, Flap) for stage in done) == len(strokes) <= 1


@pytest.mark.slow
def test_a_view_that_is_killed_costs_the_run_nothing(tmp_path, unwatched):
    plan = one_condition(RIG)
    with (
        recorder_on(RIG, tmp_path / "run") as (bench, recorder, kept),
        viewed(bench, plan) as (view, supervision, _),
    ):

        def progress(stage):
            if isinstance(stage, MoveShaft):
                os.kill(view.process_id, signal.SIGKILL)

        run_plan(plan, bench, recorder, progress, supervision)
        view.run_queue.end("done", "")
        kept.finish()
        assert not view.is_alive
    assert (tmp_path / "run" / "run.h5").read_bytes() == unwatched


def test_a_page_opened_late_sees_how_the_run_ended_and_only_with_the_token(tmp_path):
    plan = one_condition(RIG)
    with recorder_on(RIG, tmp_path / "run") as (bench, _, _), viewed(bench, plan) as (view, _, _):
        view.run_queue.end("TRIP L-01: force 310.0 N", "L-01")
        view.close()
        with opened(view.url) as page:
            state = [message for message in page.all_after_end() if message["kind"] == "state"][-1]
            assert state["trip"]["code"] == "L-01"
            assert (
                got(view.url, "/trips/L-01")[1].startswith("# L-01")
                and got(view.url, "/trips/L-99")[0] == 404
            )
            assert got(view.url, "/static/view.js")[2] == "text/javascript; charset=utf-8"
        guessed = view.url[:-1] + ("a" if view.url[-1] != "a" else "b")
        for wrong, more in (
            (guessed, {}),
            (view.url, {"origin": "http://example.com"}),
            (view.url, {"additional_headers": {"Host": "x"}}),
        ):
            with pytest.raises(InvalidStatus), stream_of(wrong, **more):
                pass
        assert asked_to_stop(guessed, b'{"how": "now"}') == 403
        assert asked_to_stop(view.url, b'{"how": "now"}', Origin="http://example.com") == 403
        assert asked_to_stop(view.url, b"now") == 400
        assert asked_to_stop(view.url, b'{"how": ' + b"[" * 900) == 400
        assert asked_to_stop(view.url, b'{"how": "gently"}') == 400


@pytest.mark.skipif(not Path("/proc/self/fd").is_dir(), reason="only Linux tells who holds what")
def test_nobody_who_reads_what_a_run_says_waits_for_its_view(tmp_path):
    """As `| tail` does, until everybody who could write into the pipe has closed it."""
    plan = one_condition(RIG)
    with recorder_on(RIG, tmp_path / "run") as (bench, _, _), viewed(bench, plan) as (view, _, _):
        own = view.process_id
        children = Path(f"/proc/{own}/task/{own}/children").read_text().split()
        for process in (own, *children):
            assert {str(Path(f"/proc/{process}/fd/{number}").readlink()) for number in (1, 2)} == {
                "/dev/null"
            }


def test_a_port_that_is_taken_is_one_clear_line(tmp_path):
    plan = one_condition(RIG)
    with socket.socket() as taken, recorder_on(RIG, tmp_path / "run") as (bench, _, _):
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(BadInput, match=f"port {port} is taken"), viewed(bench, plan, port):
            pass


@pytest.mark.slow
def test_a_pause_from_the_page_makes_the_run_wait_until_it_may_go_on(tmp_path):
    plan = one_condition(RIG, 2)
    done = []
    with (
        recorder_on(RIG, tmp_path / "run") as (bench, recorder, kept),
        viewed(bench, plan) as (view, supervision, told),
    ):

        def progress(stage):
            done.append(stage)
            if isinstance(stage, Flap) and sum(isinstance(one, Flap) for one in done) == 1:
                assert posted(view.url, "pause", b'{"how": "pause"}') == 202

        def go_on_when_paused():
            wait_for(lambda: any(line.startswith("paused") for line in told))
            confirmed = b'{"how": "continue", "confirmed": "nobody is near the leg"}'
            assert posted(view.url, "pause", confirmed) == 202

        operator = threading.Thread(target=go_on_when_paused)
        operator.start()
        run_plan(plan, bench, recorder, progress, supervision)
        operator.join()
        strokes = kept.finish().strokes
    events = [event["event"] for event in events_of(tmp_path / "run")]
    assert len(strokes) == 2 and done[-1] is plan.stages[-1]
    assert events.index("paused") < events.index("pause ends")
    assert told[-1] == "the pause is over"
