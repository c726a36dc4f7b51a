"""The page in a real browser, against a server that says what the test wants: what is shown."""

import re
from itertools import pairwise

import numpy as np
import pytest

pytest.importorskip(
    "playwright", reason='the page is tested in a browser: pip install "rfca-rig[dev]"'
)

from playwright.sync_api import Page, expect

from tests.view import messages
from tests.view.shown import DESKTOP, heard, painted

DT_S = 0.008


def flat(value: float, count: int = 1000) -> list[float | None]:
    return [value] * count


def inked_rows(
    page: Page, plot: str, t_s: float, colour: tuple[int, int, int], opacity: int = 120
) -> list[float]:
    """The values, on the panel's scale, of all pixels of about that colour in the column of the
    canvas at `t_s`.
    """
    return page.evaluate(  # type: ignore[no-any-return]
        """([name, t, colour, opacity]) => {
          const plot = rfcaView.traces.panels.find(panel => panel.kind.plot === name).plot;
          const canvas = plot.ctx.canvas, ratio = canvas.width / canvas.clientWidth;
          const x = Math.round(plot.valToPos(t, "x", true));
          const column = plot.ctx.getImageData(x - 1, 0, 3, canvas.height).data;
          const isOpaque = at => column[at + 3] > opacity;
          const isLike = (at, c) => Math.abs(column[at + c] - colour[c]) < 40;
          const near = at => [0, 1, 2].every(c => isLike(at, c)) && isOpaque(at);
          const rows = new Set();
          for (let at = 0; at < column.length; at += 4) if (near(at)) rows.add(Math.floor(at / 12));
          return [...rows].map(row => plot.posToVal((row - plot.bbox.top) / ratio, "y"));
        }""",
        [plot, t_s, list(colour), opacity],
    )


BLUE = (0x17, 0x3F, 0x6B)


class TestTraces:
    def test_a_record_that_alone_in_eight_seconds_is_high_is_drawn_at_its_height(self, show):
        shown = show()
        peaked = flat(3.0)
        peaked[640] = (3.0, 187.0)
        shown.server.say(messages.trace(0.0, DT_S, reset=True, fz_N=peaked))
        painted(shown)
        rows = inked_rows(shown.page, "force", 640.5 * DT_S, BLUE)
        assert max(rows) == pytest.approx(187.0, abs=4.0)
        assert min(rows) == pytest.approx(3.0, abs=4.0)
        assert max(inked_rows(shown.page, "force", 600.5 * DT_S, BLUE)) < 8.0

    def test_the_room_between_least_and_most_is_filled(self, show):
        shown = show()
        shown.server.say(messages.trace(0.0, DT_S, reset=True, fz_N=[(-60.0, -20.0)] * 1000))
        painted(shown)
        pale = tuple(round(255 + (part - 255) * 0x59 / 255) for part in BLUE)
        inside = [
            row for row in inked_rows(shown.page, "force", 4.004, pale) if -58.0 < row < -22.0
        ]
        assert len(inside) > 40  # pixels; a fill to zero would reach above as well
        assert not [
            row for row in inked_rows(shown.page, "force", 4.004, pale) if -16.0 < row < -4.0
        ]

    def test_frames_follow_on_one_another_and_the_window_moves_on(self, show):
        shown = show()
        for frame in range(30):
            shown.server.say(
                messages.trace(frame * 0.4, DT_S, reset=not frame, fz_N=flat(float(frame), 50))
            )
        painted(shown)
        from_s, to_s, kept = shown.page.evaluate(
            "[rfcaView.traces.fromS, rfcaView.traces.toS, rfcaView.shown.buckets.t]"
        )
        assert (from_s, to_s) == pytest.approx((4.0, 12.0))
        assert max(b - a for a, b in pairwise(kept)) == pytest.approx(DT_S)
        assert kept[0] < 4.0 and len(kept) < 1400
        assert inked_rows(shown.page, "force", 11.9, BLUE)[0] == pytest.approx(29.0, abs=0.6)

    def test_what_is_sent_again_after_a_seek_takes_the_place_of_what_was_there(self, show):
        shown = show()
        shown.server.say(
            messages.trace(0.0, DT_S, reset=True, fz_N=flat(5.0)),
            messages.trace(40.0, DT_S, reset=True, fz_N=flat(-30.0)),
        )
        painted(shown)
        assert shown.page.evaluate("rfcaView.shown.buckets.t.length") == 1000
        assert shown.page.evaluate("rfcaView.traces.toS") == pytest.approx(48.0)

    @pytest.mark.parametrize(("buckets_without", "is_a_gap"), [(6, False), (30, True)])
    def test_a_slow_device_is_one_line_a_silent_one_has_a_gap(
        self, show, buckets_without, is_a_gap
    ):
        shown = show()
        values = flat(10.0)
        values[500 : 500 + buckets_without] = [None] * buckets_without
        shown.server.say(messages.trace(0.0, DT_S, reset=True, fz_N=values))
        painted(shown)
        middle_s = (500 + buckets_without / 2) * DT_S
        assert (inked_rows(shown.page, "force", middle_s, BLUE) == []) == is_a_gap

    def test_the_legend_says_value_unit_and_extremes_and_hides_a_channel(self, show):
        shown = show()
        shown.server.say(
            messages.trace(0.0, DT_S, reset=True, fz_N=[(-54.97, -54.0), *flat(3.11, 999)])
        )
        painted(shown)
        panel = shown.page.locator(".panel[data-plot=force]")
        expect(panel.locator("h2")).to_have_text("Force (N)")
        reading = panel.get_by_role("button", name="fz")
        expect(reading).to_contain_text("3.11")
        expect(reading).to_contain_text("\N{MINUS SIGN}55.0 … 3.11")
        reading.click()
        painted(shown)
        assert inked_rows(shown.page, "force", 4.0, BLUE) == []
        expect(reading).to_have_attribute("aria-pressed", "false")
        reading.click()

    def test_another_span_is_asked_of_the_server(self, show):
        shown = show()
        shown.page.get_by_role("button", name="30 s", exact=True).click()
        assert heard(shown, "span") == [{"kind": "span", "span_s": 30}]
        assert shown.page.evaluate("rfcaView.traces.spanS") == 30


ORANGE = (0xF2, 0xA9, 0x3B)


class TestExpectedForce:
    """A stroke of 3 s from 1 s on: expected are -20 N, with a band from -50 to +10 N."""

    LINES = ([-20.0] * 31, [-50.0] * 31, [10.0] * 31)

    def brought(self, show, until_s=8.0):
        shown = show(anew=True)
        measured = flat(60.0, round(until_s / DT_S))
        shown.server.say(
            messages.trace(0.0, DT_S, reset=True, fz_N=measured),
            messages.strokes((1.0, 4.0)),
            messages.expected(*self.LINES),
        )
        painted(shown)
        return shown

    def test_line_and_band_are_where_they_are_expected(self, show):
        shown = self.brought(show)
        line = inked_rows(shown.page, "force", 2.5, ORANGE)
        assert np.mean(line) == pytest.approx(-20.0, abs=1.5)
        band = inked_rows(shown.page, "force", 2.5, ORANGE, opacity=60)
        assert (min(band), max(band)) == pytest.approx((-50.0, 10.0), abs=1.5)
        assert len(band) > 60
        assert inked_rows(shown.page, "force", 2.5, BLUE)[0] == pytest.approx(60.0, abs=3.0)
        for outside_s in (0.9, 4.1):
            assert inked_rows(shown.page, "force", outside_s, ORANGE) == []

    def test_nothing_is_drawn_beyond_what_was_measured(self, show):
        shown = self.brought(show, until_s=2.0)
        assert inked_rows(shown.page, "force", 1.9, ORANGE)
        assert inked_rows(shown.page, "force", 2.1, ORANGE) == []

    def test_it_is_told_at_the_end_of_what_is_shown_and_can_be_hidden(self, show):
        shown = self.brought(show, until_s=3.0)
        button = shown.page.get_by_role("button", name="expected")
        expect(button).to_contain_text(
            "fz \N{MINUS SIGN}20.0 (\N{MINUS SIGN}50.0 \N{HORIZONTAL ELLIPSIS} 10.0)"
        )
        button.click()
        painted(shown)
        assert inked_rows(shown.page, "force", 2.5, ORANGE) == []
        expect(button).to_have_attribute("aria-pressed", "false")
        button.click()
        painted(shown)
        assert inked_rows(shown.page, "force", 2.5, ORANGE)

    def test_with_its_channel_it_is_hidden_too(self, show):
        shown = self.brought(show)
        reading = shown.page.locator(".panel[data-plot=force]").get_by_role("button", name="fz")
        reading.click()
        painted(shown)
        assert inked_rows(shown.page, "force", 2.5, ORANGE) == []
        reading.click()

    def test_where_nothing_is_predicted_nothing_is_said(self, show):
        shown = show(anew=True)
        shown.server.say(messages.trace(0.0, DT_S, reset=True, fz_N=flat(5.0)))
        shown.server.say(messages.strokes((1.0, 4.0)))
        painted(shown)
        expect(shown.page.locator(".expected")).to_be_hidden()

    def test_a_peak_of_one_sample_is_drawn_in_a_long_window(self, show):
        shown = show(anew=True)
        shown.page.get_by_role("button", name="120 s", exact=True).click()
        peaked = [0.0] * 31
        peaked[17] = 90.0
        places = [(3.0 * number, 3.0 * number + 3.0) for number in range(40)]
        shown.server.say(
            messages.trace(0.0, 0.12, reset=True, fz_N=flat(-5.0)),
            messages.strokes(*places),
            messages.expected(peaked),
        )
        painted(shown)
        for from_s, _ in (places[2], places[30]):
            assert max(inked_rows(shown.page, "force", from_s + 1.7, ORANGE)) > 80.0
        shown.page.get_by_role("button", name="8 s", exact=True).click()


class TestLeg:
    def test_leg_ghost_floor_and_force_stand_where_they_are(self, show):
        shown = show()
        shown.server.say(messages.leg())
        painted(shown)
        points = shown.page.locator("#leg-picture .leg").get_attribute("points").split()
        assert [tuple(map(float, point.split(","))) for point in points] == [
            pytest.approx((1e3 * y, 1e3 * z), abs=0.01) for y, z in messages.leg()["leg"]
        ]
        assert shown.page.locator("#leg-picture .ghost").get_attribute("points") != ""
        assert " 215H" in shown.page.locator("#leg-picture .floor").get_attribute("d")
        expect(shown.page.locator("#leg-key")).to_contain_text(
            "the model at the measured shaft angle, not seen"
        )

    def test_the_ground_pushes_the_leg_up_and_against_the_sensors_y(self, show):
        shown = show()
        touching = messages.leg(leg=[[0.0, 0.0], [0.0, 0.215]] * 4, force=[-30.0, -40.0])
        shown.server.say(touching)
        painted(shown)
        start, tip = re.match(
            r"M(\S+ \S+)L(\S+ \S+)M", shown.page.locator("#leg-picture .force").get_attribute("d")
        ).groups()
        (y0, z0), (y1, z1) = (tuple(map(float, text.split())) for text in (start, tip))
        assert (y0, z0) == (0.0, 215.0)
        assert (y1 - y0) / (z1 - z0) == pytest.approx(30.0 / -40.0)
        assert z1 < z0
        expect(shown.page.locator("#leg-picture .newtons")).to_have_text("50.0 N")

    def test_what_is_guessed_looks_guessed(self, show):
        shown = show()
        shown.server.say(messages.leg(source="shaft only", ghost=None, force=None))
        painted(shown)
        expect(shown.page.locator("#leg-picture .leg")).to_have_class("leg guessed")
        expect(shown.page.locator("#leg-key")).to_contain_text("only the shaft is known")
        expect(shown.page.locator("#leg-picture .force")).to_have_attribute("d", "")

    def test_without_a_believed_leg_none_is_drawn(self, show):
        expect(show(messages.hello(leg=None)).page.locator("#leg-key")).to_have_text(
            "No leg is described, so none is drawn."
        )


class TestState:
    def test_the_current_stage_is_marked_and_in_sight(self, show):
        shown = show()
        shown.server.say(
            messages.state(
                stage=30, stage_done=0.25, stage_label="flap 215 mm, 2.433 rad/s, repeat 10"
            )
        )
        now = shown.page.locator("#stage-list [aria-current=step]")
        expect(now).to_contain_text("repeat 10")
        expect(now).to_be_in_viewport()
        assert now.locator("progress").evaluate("bar => bar.value") == 0.25
        expect(shown.page.locator("#stage-list .past")).to_have_count(30)
        expect(shown.page.locator("#going-on")).to_have_text("flap 215 mm, 2.433 rad/s, repeat 10")

    def test_after_a_stop_what_was_left_out_is_not_ticked_off(self, show):
        shown = show()
        shown.server.say(messages.state(stage=6), messages.state(stage=6, stop_asked="safe point"))
        shown.server.say(
            messages.state(stage=36, stop_asked="safe point"),
            messages.state(stage=-1, ended="stopped by the operator"),
        )
        expect(shown.page.locator("#stage-list .left")).to_have_count(29)
        expect(shown.page.locator("#stage-list .past")).to_have_count(8)

    def test_a_page_that_is_opened_after_a_stop_ticks_off_what_was_done(self, show):
        page = show(state=messages.state(stage=-1, reached=6, ended="stopped by the operator")).page
        expect(page.locator("#stage-list .past")).to_have_count(7)

    def test_a_short_stage_that_came_and_went_between_two_states_is_done(self, show):
        shown = show()
        shown.server.say(messages.state(stage=3), messages.state(stage=6))
        expect(shown.page.locator("#stage-list .past")).to_have_count(6)
        expect(shown.page.locator("#stage-list .left")).to_have_count(0)

    def test_a_plan_of_ten_thousand_stages_shows_those_around_now(self, show):
        stages = [
            {"label": f"cycles {number}", "kind": "cycles", "duration_s": 60.0}
            for number in range(10_000)
        ]
        shown = show(messages.hello(stages=stages))
        shown.server.say(messages.state(stage=7000))
        expect(shown.page.locator("#stage-list [aria-current=step]")).to_have_text(
            re.compile("cycles 7000")
        )
        assert shown.page.locator("#stage-list li").count() < 300

    def test_a_limit_tells_how_far_it_is_and_how_near_it_came(self, show):
        limits = messages.state()["limits"]
        limits["force"] = {"value": 240.0, "share": 0.8, "peak_share": 0.93, "limit": 300.0}
        limits["following error"] = {"value": 6.0, "share": 0.2, "peak_share": 0.3, "limit": 30.0}
        page = show(state=messages.state(limits=limits)).page
        force = page.get_by_role("meter", name=re.compile("force, trip L-01"))
        expect(force).to_have_attribute("aria-valuetext", "240 of 300 N, 20 % left")
        assert force.locator(".fill").evaluate("fill => fill.style.width") == "80%"
        assert force.locator(".peak").evaluate("peak => peak.style.left") == "93%"
        expect(page.locator("#limit-list li.close")).to_have_count(1)
        expect(page.get_by_role("meter", name=re.compile("following"))).to_have_attribute(
            "aria-valuetext", "6.00 of 30.0 deg, 80 % left"
        )

    def test_what_is_bad_stands_out_in_words_too(self, show):
        health = [
            {"name": "lost", "value": "212", "is_good": False},
            {"name": "drive temperature", "value": "41 degC", "is_good": True},
        ]
        page = show(state=messages.state(health=health)).page
        expect(page.locator("#health-list .bad")).to_have_text("lost212 \N{EN DASH} bad")
        expect(page.locator("#health-head")).to_have_text("Health: 1 bad")

    def test_a_trip_is_large_with_code_and_paragraph(self, show):
        tripped = messages.state(
            ended="TRIP L-01",
            eta_s=None,
            trip={"code": "L-01", "text": "TRIP L-01: force 312 N, limit 300 N"},
        )
        page = show(state=tripped).page
        expect(page.locator("#trip-code")).to_have_text("TRIP L-01")
        expect(page.locator("#trip-text")).to_have_text("force 312 N, limit 300 N")
        expect(page.locator("#eta")).to_have_text("cut short at 21 % after 0 s")
        assert page.locator("#trip-code").bounding_box()["height"] > 30
        expect(page.locator("#trip-link")).to_have_attribute("href", "/trips#l-01")
        page.wait_for_function("() => document.title === 'TRIP L-01'")
        expect(page.get_by_role("button", name="Torque off now")).to_be_disabled()

    def test_sim_and_real_differ_without_colour(self, show):
        look = """mark => { const style = getComputedStyle(mark);
          return [style.backgroundColor, style.borderTopStyle, mark.querySelector('b').textContent]; }"""
        sim, real = (
            show(messages.hello(mark=mark)).page.locator("#mark").evaluate(look)
            for mark in ("SIM", "REAL")
        )
        assert sim == ["rgba(0, 0, 0, 0)", "dashed", "SIM"]
        assert real == ["rgb(27, 27, 27)", "solid", "REAL"]


def test_the_player_of_a_recording_fits_a_phone(show):
    shown = show(
        messages.hello(mode="replay", can_stop=False, duration_s=6000.0),
        messages.state(5999.5, speed=1.0),
        anew=True,
    )
    page = shown.page
    page.set_viewport_size({"width": 390, "height": 844})
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    shown.server.say(messages.strokes((5990.0, 5999.0)), messages.expected([1.0] * 91))
    painted(shown)
    for part in ("#play", "#speed", "#slider", "#clock", ".expected", "[data-span='120']"):
        box = page.locator(part).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= 390, part
    # Every value stands beside the name of its panel.
    assert page.evaluate(
        "[...document.querySelectorAll('.panel .head')].every(each => each.scrollWidth "
        "<= each.clientWidth)"
    )
    page.set_viewport_size(DESKTOP)


@pytest.mark.slow
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (1920, 1080), (820, 1180), (1180, 820)])
def test_nothing_runs_out_of_the_page_at_any_size(show, width, height):
    shown = show()
    page = shown.page
    page.set_viewport_size({"width": width, "height": height})
    painted(shown)
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    for part in (
        "#mark",
        "#stop-safe",
        "#stop-now",
        "#traces",
        "#leg",
        "#limits",
        "#stages",
        "#health",
    ):
        box = page.locator(part).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= width and box["height"] > 20, part
    assert page.locator("#stop-now").bounding_box()["y"] < 200
    page.set_viewport_size(DESKTOP)
