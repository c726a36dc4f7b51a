"""The page in a real browser, against a server that says what the test wants: what a person does
with it, and what befalls it.
"""

from collections.abc import Callable

import pytest

pytest.importorskip(
    "playwright", reason='the page is tested in a browser: pip install "rfca-rig[dev]"'
)

from playwright.sync_api import expect

from tests.view import messages
from tests.view.shown import Shown, heard


class TestStopping:
    @pytest.mark.parametrize(
        ("button", "how", "said"),
        [
            ("Stop at the next safe point", "safe point", "stops at the next safe point"),
            ("Torque off now", "now", "torque off now"),
        ],
    )
    def test_a_stop_is_sent_once_and_shown(self, show, button, how, said):
        shown = show(anew=True)
        shown.page.get_by_role("button", name=button).dblclick()
        expect(shown.page.locator("#stop-answer")).to_contain_text(said)
        expect(shown.page.get_by_role("button", name=button)).to_be_disabled()
        assert shown.server.stops == [{"how": how}]

    def test_torque_off_stays_possible_after_a_safe_stop_was_asked_for_elsewhere(self, show):
        shown = show(anew=True)
        shown.server.say(messages.state(stop_asked="safe point"))
        expect(
            shown.page.get_by_role("button", name="Stop at the next safe point")
        ).to_be_disabled()
        shown.page.get_by_role("button", name="Torque off now").click()
        expect(shown.page.locator("#stop-answer")).to_have_text("Asked: torque off now.")
        assert shown.server.stops == [{"how": "now"}]

    def test_a_stop_that_was_refused_says_so_and_may_be_tried_again(self, show):
        shown = show(anew=True)
        shown.server.stop_status = 500
        shown.page.get_by_role("button", name="Torque off now").click()
        expect(shown.page.locator("#stop-answer")).to_have_text(
            "Refused (500). NOT SENT. Use the emergency stop."
        )
        expect(shown.page.get_by_role("button", name="Torque off now")).to_be_enabled()
        shown.watched.complaints.clear()  # the browser notes the 500 in its console

    def test_buttons_stay_where_they_are_whatever_is_said(self, show):
        shown = show(anew=True)
        before = shown.page.locator("#stop-now").bounding_box()
        shown.page.locator("#stop-safe").click()
        shown.server.say(messages.state(9.0, trip={"code": "L-01", "text": "force " * 40}))
        expect(shown.page.locator("#trip")).to_be_visible()
        assert shown.page.locator("#stop-now").bounding_box() == before


class TestPausing:
    def test_a_pause_is_sent_and_shown_and_its_end_asked_twice(self, show):
        shown = show(anew=True)
        button = shown.page.locator("#pause")
        expect(button).to_have_text("Pause")
        button.click()
        shown.server.say(messages.state(pause="asked"))
        expect(button).to_have_text("Do not pause")
        shown.server.say(messages.state(pause="paused"))
        expect(button).to_have_text("Continue")
        expect(shown.page.locator("#pause-says")).to_contain_text("keep away")
        expect(shown.page.locator("#eta")).to_contain_text("paused at 21 %")
        button.click()
        expect(button).to_have_text("Yes, continue")
        assert shown.server.pauses == [{"how": "pause"}]
        button.click()
        shown.server.say(messages.state())
        expect(button).to_have_text("Pause")
        assert shown.server.pauses[1:] == [
            {"how": "continue", "confirmed": "nobody is near the leg"}
        ]

    def test_a_run_that_is_to_stop_cannot_be_paused(self, show):
        shown = show(anew=True)
        shown.server.say(messages.state(stop_asked="safe point"))
        expect(shown.page.locator("#pause")).to_be_disabled()

    def test_a_pause_does_not_move_the_buttons_that_stop(self, show):
        shown = show(anew=True)
        before = shown.page.locator("#stop-now").bounding_box()
        shown.server.say(messages.state(pause="paused"))
        expect(shown.page.locator("#pause")).to_have_text("Continue")
        assert shown.page.locator("#stop-now").bounding_box() == before


class TestConnection:
    def test_silence_covers_the_picture_until_it_is_heard_again(self, show):
        shown = show(messages.hello(mark="REAL"), anew=True)
        shown.server.is_silent = True
        lost = shown.page.get_by_role("alertdialog")
        expect(lost).to_be_visible()
        expect(lost).to_contain_text("Connection lost")
        expect(lost).to_contain_text("s old")
        assert (
            float(shown.page.locator("main").evaluate("main => getComputedStyle(main).opacity"))
            < 0.5
        )
        assert shown.page.title() == "CONNECTION LOST"
        expect(shown.page.locator("#stop-now")).to_be_enabled()
        shown.server.is_silent = False
        expect(lost).to_be_hidden()

    def test_a_closed_connection_is_lost_and_found_again_with_new_traces(self, show):
        shown = show(anew=True)
        shown.server.say(messages.trace(0.0, 0.008, reset=True, fz_N=[5.0] * 1000))
        shown.server.hello["title"] = "the next one"
        shown.server.hang_up()
        expect(shown.page.get_by_role("alertdialog")).to_be_visible()
        expect(shown.page.locator("#title")).to_have_text("the next one")
        expect(shown.page.get_by_role("alertdialog")).to_be_hidden()
        assert shown.page.evaluate("rfcaView.shown.buckets.t.length") == 0

    def test_the_end_of_a_run_is_no_alarm(self, show):
        shown = show(state=messages.state(ended="done"), anew=True)
        shown.server.hang_up()
        shown.page.wait_for_function("() => document.title.startsWith('ended')")
        assert not shown.page.get_by_role("alertdialog").is_visible()
        expect(shown.page.locator("#ended")).to_have_text(
            "The run has ended: done. This picture does not change any more."
        )

    def test_a_run_that_tells_nothing_new_is_said_to(self, show):
        expect(show(anew=True).page.locator("#stale")).to_be_visible()

    def test_a_token_of_an_earlier_run_is_told_from_a_loss(self, show):
        shown = show(anew=True)
        shown.page.evaluate("rfcaView.connection.token = 'stale'")
        shown.server.hang_up()
        expect(shown.page.get_by_role("alertdialog")).to_contain_text("Not allowed")
        shown.watched.complaints.clear()  # the 403


def replayed(show: Callable[..., Shown], anew: bool = True) -> Shown:
    return show(
        messages.hello(mode="replay", can_stop=False, duration_s=60.0),
        messages.state(12.0, speed=1.0),
        anew=anew,
    )


class TestReplay:
    def test_it_plays_by_itself_and_cannot_be_stopped_only_paused(self, show):
        shown = replayed(show)
        assert heard(shown, "play") == [{"kind": "play", "speed": 1}]
        expect(shown.page.locator("#stop-now")).to_be_disabled()
        expect(shown.page.locator("#stop-answer")).to_have_text(
            "A recording: there is nothing to stop."
        )
        shown.server.heard.clear()
        shown.page.keyboard.press("Space")
        assert heard(shown, "play") == [{"kind": "play", "speed": 0}]

    def test_it_stands_still_for_those_who_want_less_motion(self, show, one_page):
        one_page.page.emulate_media(reduced_motion="reduce")
        assert heard(replayed(show), "play") == [{"kind": "play", "speed": 0}]
        one_page.page.emulate_media(reduced_motion="null")

    def test_the_slider_seeks(self, show):
        shown = replayed(show)
        slider = shown.page.get_by_label("Time in the recording")
        expect(slider).to_have_js_property("value", "12")
        # a page that is slow to tell its value would show the next state, in which the time is 12 s
        shown.server.is_silent = True
        box = slider.bounding_box()
        shown.page.mouse.click(box["x"] + 0.75 * box["width"], box["y"] + 0.5 * box["height"])
        assert heard(shown, "seek")[-1]["at_s"] == pytest.approx(45.0, abs=1.0)
        assert float(slider.evaluate("slider => slider.value")) == pytest.approx(45.0, abs=1.0)
        expect(shown.page.locator("#clock")).to_contain_text("of 60.0 s")

    def test_the_slider_stays_where_it_was_put_until_states_from_before_have_come(self, show):
        shown = replayed(show)
        times_s = shown.page.evaluate("""() => {
            const { replay } = rfcaView, put = performance.now();
            const showAfter = (ms) => {
                performance.now = () => put + ms;
                replay.update({ now_s: 12.0, speed: 1.0 });
                return Number(replay.slider.value);
            };
            performance.now = () => put;
            replay.seek(45.0);
            const times = [showAfter(0), showAfter(290), showAfter(310)];
            delete performance.now;
            return times;
        }""")
        assert times_s == [45.0, 45.0, 12.0]

    @pytest.mark.parametrize(
        ("key", "at_s"),
        [
            ("ArrowRight", 13.0),
            ("ArrowLeft", 11.0),
            ("Shift+ArrowLeft", 11.9),
            ("Home", 0.0),
            ("End", 60.0),
        ],
    )
    def test_keys(self, show, key, at_s):
        shown = replayed(show, anew=False)
        shown.page.wait_for_function("() => document.getElementById('slider').value === '12'")
        shown.server.heard.clear()
        shown.page.locator("#slider").focus()  # which has a mind of its own about keys
        shown.page.keyboard.press(key)
        assert heard(shown, "seek") == [{"kind": "seek", "at_s": pytest.approx(at_s)}]
        assert shown.page.evaluate("rfcaView.replay.wantedS") == pytest.approx(at_s)

    @pytest.mark.slow
    def test_speed_is_asked_for(self, show):
        shown = replayed(show)
        heard(shown, "play")
        shown.server.heard.clear()
        shown.page.locator("#speed").select_option("0.25")
        assert heard(shown, "play") == [{"kind": "play", "speed": 0.25}]
