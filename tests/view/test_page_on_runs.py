"""The page in a real browser on the real server: a run on the twin, and a recording."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np
import pytest

pytest.importorskip(
    "playwright", reason='the page is tested in a browser: pip install "rfca-rig[dev]"'
)

from playwright.sync_api import ViewportSize, expect

from rfca_rig.campaign.stored import open_stored
from rfca_rig.clock import WallClock
from rfca_rig.engine.interfaces import Tick
from rfca_rig.engine.run import run_plan
from rfca_rig.errors import Stopped
from rfca_rig.protocol.plan import Flap, MoveShaft, Stage
from rfca_rig.recording.model import Stroke
from rfca_rig.view.leg_pose import Legs
from rfca_rig.view.replay import Replay
from rfca_rig.view.run_queue import url_of
from rfca_rig.view.server import listen_on, port_of, serve
from tests.engine.rigs import one_condition, recorder_on
from tests.view.browser import WatchedPage, browser
from tests.view.test_live_view import RIG, viewed

SMALL = Path(__file__).parents[1] / "data" / "small-campaign"


@pytest.fixture(scope="module")
def one_page() -> Iterator[WatchedPage]:
    with browser() as started:
        yield WatchedPage(started.new_page(viewport=ViewportSize(width=1280, height=800)))


@pytest.fixture
def watched(one_page: WatchedPage) -> Iterator[WatchedPage]:
    one_page.complaints.clear()
    yield one_page
    assert one_page.complaints == []


@contextmanager
def visited(watched: WatchedPage, url: str) -> Iterator[WatchedPage]:
    """The page there, which is left before its server goes."""
    watched.page.goto(url)
    try:
        yield watched
    finally:
        watched.page.goto("about:blank")


def wait_for_extremes(watched: WatchedPage, channel: str, low: float, high: float) -> None:
    """Of all buckets that the page has drawn; those before what is looked at come after it."""
    watched.page.wait_for_function(
        """([name, lowest, highest]) => { const { low, high } = rfcaView.shown.buckets;
          return Math.min(...low[name].filter(v => v !== null)) <= lowest + 1e-4
            && Math.max(...high[name].filter(v => v !== null)) >= highest - 1e-4; }""",
        arg=[channel, low, high],
    )


def lowest_drawn(watched: WatchedPage, channel: str) -> float:
    script = "name => Math.min(...rfcaView.shown.buckets.low[name].filter(v => v !== null))"
    return watched.page.evaluate(script, channel)  # type: ignore[no-any-return]


def extremes(stroke: Stroke, channel: str) -> tuple[float, float]:
    _, values = stroke.channel(channel)
    return float(values.min()), float(values.max())


@pytest.mark.long
def test_a_run_is_seen_with_the_peaks_of_its_recording_and_its_end(tmp_path, watched):
    plan = one_condition(RIG)
    with (
        recorder_on(RIG, tmp_path / "run") as (bench, recorder, kept),
        viewed(bench, plan) as (view, supervision, _),
        visited(watched, view.url),
    ):
        expect(watched.page.locator("#mark b")).to_have_text("SIM")
        run_plan(plan, bench, recorder, lambda stage: view.run_queue.line(stage.label), supervision)
        view.run_queue.end("done", "")
        expect(watched.page.locator("#ended")).to_contain_text("The run has ended: done")
        stroke = kept.finish().strokes[0]
        for channel in (
            "fy_N",
            "fz_N",
            "tx_Nm",
        ):  # the run was longer than the stroke, so there may be more
            wait_for_extremes(watched, channel, *extremes(stroke, channel))
        assert lowest_drawn(watched, "fz_N") == pytest.approx(extremes(stroke, "fz_N")[0], abs=1e-3)
        expect(watched.page.locator("#stage-list .past")).to_have_count(len(plan.stages))
        assert len(watched.page.locator("#leg-picture .leg").get_attribute("points").split()) == 8


@pytest.mark.slow
def test_the_button_stops_the_run(tmp_path, watched):
    plan = one_condition(RIG)
    with (
        recorder_on(RIG, tmp_path / "run") as (bench, recorder, kept),
        viewed(bench, plan) as (view, supervision, told),
        visited(watched, view.url),
    ):
        watched.page.get_by_role("button", name="Torque off now").click()
        expect(watched.page.locator("#stop-answer")).to_have_text("Asked: torque off now.")
        with pytest.raises(Stopped, match="in the view"):
            run_plan(
                plan, bench, recorder, lambda stage: view.run_queue.line(stage.label), supervision
            )
        assert len(told) == 1
        kept.finish()


# Of a shaft at 186 deg/s, so long as a bucket of 8 ms, and a loop's tick.
ANGLE_APART_DEG = 2.0


def shaft_in_file(run_h5: Path, stroke: int) -> tuple[np.ndarray, np.ndarray]:
    """Host times in s and angles in deg of a stroke as another program reads them from the
    file.
    """
    with h5py.File(run_h5) as file:
        shaft = file[f"strokes/{stroke:03}/shaft"]
        return shaft["host_s"][()], np.degrees(shaft["shaft_angle_rad"][()])


def angle_under_mouse(watched: WatchedPage, at_s: float) -> float:
    """The shaft's angle that the page says in words for a time of its traces."""
    x, y = watched.page.evaluate(
        """at_s => {
          const plot = rfcaView.traces.panels.find(panel => panel.kind.plot === "angle").plot;
          const box = plot.over.getBoundingClientRect();
          return [box.left + plot.valToPos(at_s, "x"), box.top + 0.5 * box.height];
        }""",
        at_s,
    )
    watched.page.mouse.move(x, y)
    watched.page.evaluate("() => rfcaView.traces.draw()")
    text = watched.page.locator(".panel[data-plot=angle] .reading b").inner_text()
    watched.page.mouse.move(1.0, 1.0)
    return float(text.replace("\N{MINUS SIGN}", "-"))


def angles_drawn(watched: WatchedPage) -> tuple[np.ndarray, np.ndarray]:
    """Times in s, and angles in deg of the page's buckets that have one."""
    times_s, angles_deg = watched.page.evaluate(
        """() => { const { t, low, high } = rfcaView.shown.buckets;
          const has = t.map((_, i) => i).filter(i => low.shaft_angle_deg[i] !== null);
          return [has.map(i => t[i]),
            has.map(i => (low.shaft_angle_deg[i] + high.shaft_angle_deg[i]) / 2)]; }"""
    )
    return np.array(times_s), np.array(angles_deg)


def wait_until_first_link_is_at(watched: WatchedPage, angle_deg: float) -> None:
    """In deg from the horizontal, positive downwards, as the leg is drawn."""
    watched.page.wait_for_function(
        """([angle, apart]) => {
          const points = document.querySelector("#leg-picture .leg").getAttribute("points");
          const [shaft, hinge] = (points ?? "").split(" ").map(text => text.split(",").map(Number));
          if (!hinge) return false;
          const drawn = Math.atan2(hinge[1] - shaft[1], hinge[0] - shaft[0]) * 180 / Math.PI;
          return Math.abs(drawn - angle) < apart; }""",
        arg=[angle_deg, ANGLE_APART_DEG],
    )


def wait_until_drawn(watched: WatchedPage, at_s: float) -> None:
    watched.page.wait_for_function("at_s => rfcaView.shown.buckets?.endS >= at_s", arg=at_s)


@pytest.mark.slow
def test_the_shaft_s_angle_is_that_of_the_list_and_of_the_recording(tmp_path, watched):
    """Live and replayed. Each stroke is a turn: the third begins at 734 deg of the drive."""
    plan = one_condition(RIG, 3)
    drawn_in_stroke = []
    with (
        recorder_on(RIG, tmp_path / "run") as (bench, recorder, kept),
        viewed(bench, plan) as (view, supervision, _),
        visited(watched, view.url),
    ):
        first_tick_s = []
        take_tick = view.run_queue.tick

        def note_tick(tick: Tick) -> None:
            first_tick_s.append(tick.now_s)
            del first_tick_s[1:]
            take_tick(tick)

        view.run_queue.tick = note_tick

        def compare(stage: Stage) -> None:
            if isinstance(stage, MoveShaft | Flap):
                now_s = bench.clock.now_s() - first_tick_s[0]
                wait_until_drawn(watched, now_s - 0.01)
            if isinstance(stage, MoveShaft):
                stated_deg = float(stage.label.removeprefix("shaft to ").removesuffix(" deg"))
                assert angle_under_mouse(watched, now_s - 0.02) == pytest.approx(
                    stated_deg, abs=ANGLE_APART_DEG
                )
                wait_until_first_link_is_at(watched, stated_deg)
            if isinstance(stage, Flap):
                drawn_in_stroke.append(angles_drawn(watched))
                in_stroke_s = now_s - 0.6
                said.append((in_stroke_s, angle_under_mouse(watched, in_stroke_s)))

        said: list[tuple[float, float]] = []
        run_plan(plan, bench, recorder, compare, supervision)
        kept.finish()
    for number in (1, 2, 3):
        host_s, angle_deg = shaft_in_file(tmp_path / "run" / "run.h5", number)
        times_s, shown_deg = drawn_in_stroke[number - 1]
        run_s = host_s - first_tick_s[0]
        in_stroke = (times_s > run_s[0]) & (times_s < run_s[-1])
        assert in_stroke.sum() > 100 and angle_deg.min() < 15.0 and angle_deg.max() > 200.0
        np.testing.assert_allclose(
            shown_deg[in_stroke],
            np.interp(times_s[in_stroke], run_s, angle_deg),
            rtol=0.0,
            atol=ANGLE_APART_DEG,
        )
        # Neither at 180 deg, nor at the top, nor where a stage begins.
        assert np.abs(np.diff(shown_deg)).max() < 2 * ANGLE_APART_DEG
        at_s, said_deg = said[number - 1]
        assert said_deg == pytest.approx(np.interp(at_s, run_s, angle_deg), abs=ANGLE_APART_DEG)
    with replayed(tmp_path / "run") as url, visited(watched, url):
        watched.page.wait_for_function("() => rfcaView.shown.state")
        watched.page.keyboard.press("Space")
        watched.page.keyboard.press("End")
        host_s, angle_deg = shaft_in_file(tmp_path / "run" / "run.h5", 3)
        wait_until_drawn(watched, watched.page.evaluate("() => rfcaView.replay.durationS"))
        end_s = watched.page.evaluate("() => rfcaView.replay.durationS")
        assert angle_under_mouse(watched, end_s - 0.5) == pytest.approx(
            np.interp(host_s[-1] - 0.5, host_s, angle_deg), abs=ANGLE_APART_DEG
        )


@contextmanager
def replayed(path: Path) -> Iterator[str]:
    """The address of a recording that is served from a thread."""
    stored = open_stored(path)
    listening = listen_on(0)
    begun = threading.Event()
    over: list[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = []

    async def served() -> None:
        over.append((asyncio.get_running_loop(), asyncio.Event()))
        begun.set()
        await serve(
            Replay(stored, Legs(stored.nominal), WallClock()),
            "t" * 32,
            listening,
            over[0][1],
            lambda _pages: True,
        )

    thread = threading.Thread(target=asyncio.run, args=(served(),), daemon=True)
    thread.start()
    begun.wait(10.0)
    try:
        yield url_of(port_of(listening), "t" * 32)
    finally:
        over[0][0].call_soon_threadsafe(over[0][1].set)
        thread.join(10.0)


def test_a_recording_is_played_and_sought_with_the_peaks_that_it_has(watched):
    stroke = open_stored(SMALL).strokes[2].samples.whole()["table"]
    with replayed(SMALL) as url, visited(watched, url):
        expect(watched.page.locator("#mark")).to_contain_text("replay")
        expect(watched.page.locator("#stop-now")).to_be_disabled()
        watched.page.wait_for_function("() => rfcaView.shown.state?.now_s > 0.1")  # it plays
        watched.page.keyboard.press("Space")
        watched.page.wait_for_function("() => rfcaView.shown.state.speed === 0")
        watched.page.keyboard.press("End")
        watched.page.wait_for_function(
            "() => Math.abs(rfcaView.shown.state.now_s - rfcaView.replay.durationS) < 0.01"
        )
        watched.page.get_by_role("button", name="30 s", exact=True).click()
        watched.page.wait_for_function(
            "() => rfcaView.shown.buckets.endS - rfcaView.shown.buckets.t[0] > 10"
        )
        values = stroke.columns["fz_N"].values
        wait_for_extremes(watched, "fz_N", float(np.min(values)), float(np.max(values)))
        expect(watched.page.locator("#clock")).to_contain_text("of")


def test_the_token_is_in_no_request_s_address_and_leaves_the_address_bar(watched):
    addresses = []
    watched.page.on("request", lambda request: addresses.append(request.url))
    watched.page.on("websocket", lambda socket: addresses.append(socket.url))
    with replayed(SMALL) as url, visited(watched, url):
        assert watched.page.url == url.partition("#")[0]
        watched.page.reload()
        watched.page.wait_for_function("() => window.rfcaView?.shown.state")
        assert watched.page.context.cookies() == []
    assert len(addresses) > 10 and not [address for address in addresses if "t" * 32 in address]


@pytest.mark.slow
def test_without_the_right_token_the_page_stays_empty_and_says_so(watched):
    with replayed(SMALL) as url:
        for address in (url[:-1], url + "%00(", url.partition("#")[0]):
            watched.page.goto("about:blank")
            watched.page.evaluate("() => 0")
            watched.page.goto(address)
            watched.page.evaluate("() => sessionStorage.clear()")
            expect(watched.page.get_by_role("alertdialog")).to_contain_text("Not allowed")
            expect(watched.page.locator("#title")).to_have_text("Waiting for the run")
    watched.complaints[:] = [line for line in watched.complaints if "403" not in line]
