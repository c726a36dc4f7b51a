"""From ticks to messages, with nothing in between but the queue: what a page is told of a run."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rfca_rig.drivers.roles import SensorScale
from rfca_rig.engine.limit_monitor import LoadMonitor
from rfca_rig.errors import SimulationFailed, Tripped
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Cycles, Flap, whole_turns
from rfca_rig.view import expected_force
from rfca_rig.view.gauges import Gauges
from rfca_rig.view.messages import CHANNELS
from rfca_rig.view.process import MOST_STROKES
from rfca_rig.view.run_facts import ExpectedStroke, ListedStage, Progress
from rfca_rig.view.run_queue import Stamp, tick_block, ticks_of
from tests.engine.rigs import one_condition, twin_rig
from tests.view.seen import SCALE, counts_of, tick, watched

LIMITS = twin_rig().facts().limits
FZ = [channel.name for channel in CHANNELS].index("fz_N")


def traces(messages):
    return [message for message in messages if message["kind"] == "trace"]


def drawn(messages, channel="fz_N"):
    """Least and greatest of all traces, each of which follows on the one before."""
    end_s = None
    low = []
    high = []
    for message in traces(messages):
        assert message.get("reset") or message["from_s"] == pytest.approx(end_s, abs=1e-9)
        end_s = message["from_s"] + message["dt_s"] * len(message["low"][channel])
        low += [value for value in message["low"][channel] if value is not None]
        high += [value for value in message["high"][channel] if value is not None]
    return min(low), max(high)


@settings(max_examples=8)
@given(st.integers(0, 2**32 - 1))
def test_all_peaks_of_a_run_are_in_what_a_page_was_sent(seed):
    random = np.random.default_rng(seed)
    with watched() as both:
        feed = both.run.feed()
        got = []
        forces = []
        for number in range(1, 250):
            force_N = random.normal(0.0, 50.0) + 300.0 * (random.uniform() < 0.02)
            counts = np.concatenate(
                [counts_of(0.0, rows=int(random.integers(0, 30))), counts_of(force_N)]
            )
            forces.append(force_N)
            both.run_queue.tick(tick(0.002 * number, counts))
            if random.uniform() < 0.1:
                both.run.beat()
                got += feed.new_messages()
        both.run_queue.end("done", "")
        both.run.beat()
        got += feed.new_messages()
        assert drawn(got) == pytest.approx((min(*forces, 0.0), max(*forces, 0.0)), abs=1e-4)


def test_a_span_that_changes_gives_the_whole_window_anew_and_every_page_its_own():
    with watched() as both:
        slow = both.run.feed()
        quick = both.run.feed()
        got = []
        quick.handle_message({"kind": "span", "span_s": 0.5})
        for number in range(1, 1500):
            both.run_queue.tick(tick(0.002 * number, counts_of(float(number))))
            if number % 20 == 0:
                both.run.beat()
                got += quick.new_messages()
        assert drawn(got) == pytest.approx((1.0, 1480.0), abs=1.0)
        assert drawn(traces(slow.new_messages()))[0] == 1.0
        quick.handle_message({"kind": "span", "span_s": 2.0})
        (window,) = traces(quick.new_messages())
        assert window["reset"] and window["dt_s"] == 0.002 and len(window["low"]["fz_N"]) == 1000
        assert window["from_s"] == pytest.approx(0.002 * 1480 - 2.0, abs=0.01)


@pytest.mark.parametrize(
    "nonsense",
    [
        {},
        {"kind": "span"},
        {"kind": "span", "span_s": "8"},
        {"kind": "span", "span_s": float("nan")},
        {"kind": 3},
    ],
)
def test_nonsense_from_a_page_changes_nothing(nonsense):
    with watched() as both:
        both.run_queue.tick(tick(0.1, counts_of(1.0)))
        feed = both.run.feed()
        both.run.beat()
        feed.new_messages()
        feed.handle_message(nonsense)
        assert not traces(feed.new_messages())


def test_what_a_loop_saw_last_is_drawn_though_no_tick_follows():
    """As after a trip, while the shaft is watched until it stands."""
    with watched() as both:
        feed = both.run.feed()
        for number in range(1, 50):
            both.run_queue.tick(tick(0.002 * number, counts_of(100.0 if number == 49 else 1.0)))
        both.run.beat()
        assert drawn(feed.new_messages())[1] == 1.0
        both.clock.wait_until(0.3)
        both.run.beat()
        assert (
            drawn(
                [
                    {**message, "reset": True}
                    for message in feed.new_messages()
                    if message["kind"] == "trace"
                ]
            )[1]
            == 100.0
        )


def test_everything_that_is_sent_is_plain_json():
    with watched() as both:
        feed = both.run.feed()
        for number in range(1, 100):
            both.run_queue.tick(tick(0.01 * number, counts_of(1.0)))
        both.run.beat()
        for message in (both.run.hello(), *feed.new_messages()):
            json.dumps(message, allow_nan=False)


def test_a_run_whose_process_dies_is_over_and_cannot_be_stopped():
    with watched() as both:
        both.run_queue.tick(tick(0.002, counts_of(1.0)))
        both.run.on_run_exit()
        assert "without a word" in both.run.state["ended"] and not both.run.stop("now")


def test_a_trip_is_told_with_its_code():
    with watched() as both:
        both.run_queue.end("TRIP L-01: force 310.0 N, limit 300 N", "L-01")
        both.run.on_run_exit()
        assert both.run.state["trip"] == {
            "code": "L-01",
            "text": "TRIP L-01: force 310.0 N, limit 300 N",
        }


def angles_sent(messages):
    """Every shaft angle of the window as a page has it after these messages, with its buckets'
    times.
    """
    angle_deg = {}
    for message in traces(messages):
        if message.get("reset"):
            angle_deg.clear()
        for number, low_deg in enumerate(message["low"]["shaft_angle_deg"]):
            if low_deg is not None:
                angle_deg[round(message["from_s"] + number * message["dt_s"], 6)] = low_deg
    return angle_deg


def test_the_shaft_s_angle_goes_on_over_whole_turns_and_counts_as_the_stage_does():
    """Two strokes, each a turn of the shaft, by a drive that reports three turns more."""
    with watched(given=one_condition(twin_rig(), 2)) as both:
        feed = both.run.feed()
        sent = []
        shaft_deg = 3 * 360.0 - 20.0
        now_s = 0.0

        def turn_to(end_deg):
            nonlocal now_s, shaft_deg
            while shaft_deg < end_deg:
                now_s += 0.002
                shaft_deg += 0.5
                both.run_queue.tick(
                    tick(now_s, counts_of(0.0), np.radians(shaft_deg), rate_Hz=500.0)
                )
                both.run.beat()
                sent.extend(feed.new_messages())

        def stage(kind):
            begun = next(one for one in both.plan.stages if type(one).__name__ == kind)
            turns_rad = whole_turns(begun, np.radians(shaft_deg))
            both.run_queue.stage(begun, None, turns_rad)

        turn_to(3 * 360.0 - 10.0)
        assert list(angles_sent(sent).values())[-1] == pytest.approx(-10.0, abs=15.0)
        for turns in (3, 4):
            stage("MoveShaft")
            turn_to(turns * 360.0 + 14.0)
            stage("Rest")
            turn_to(turns * 360.0 + 14.5)
            stage("Flap")
            turn_to(turns * 360.0 + 250.0)
            both.clock.wait_until(both.clock.now_s() + 1.0)
            both.run.beat()
            sent.extend(feed.new_messages())
            shown_deg = angles_sent(sent)
            values_deg = list(shown_deg.values())
            assert values_deg[-1] == pytest.approx(250.0, abs=2.0)
            # 250 deg per second, and buckets of 8 ms.
            assert np.abs(np.diff(values_deg)).max() < 3.0
            assert values_deg[0] == pytest.approx(-20.0 - 360.0 * (turns - 3), abs=2.0)


def test_in_cycles_the_shaft_s_angle_counts_anew_with_each_turn():
    once = one_condition(twin_rig())
    cycles = Cycles(0.215, 6.0, 1, 4)
    with watched(given=replace(once, stages=(*once.stages, cycles))) as both:
        feed = both.run.feed()
        sent = []
        both.run_queue.stage(cycles, None, whole_turns(cycles, np.radians(7214.0)))
        for number, shaft_deg in enumerate(np.arange(7214.0, 8600.0, 0.7), start=1):
            both.run_queue.tick(
                tick(0.002 * number, counts_of(0.0), np.radians(shaft_deg), rate_Hz=500.0)
            )
            both.run.beat()
            sent.extend(feed.new_messages())
            if number % 50 == 0:
                values_deg = list(angles_sent(sent).values())
                assert values_deg[-1] == pytest.approx(shaft_deg % 360.0, abs=60.0)
                assert np.abs(np.diff(values_deg)).max() < 4.0


def test_the_leg_is_drawn_at_once_and_bent_when_the_shapes_are_there():
    with watched() as both:
        for stage in both.plan.stages[:4]:
            both.run_queue.stage(stage, None, None)
        both.run_queue.tick(tick(0.002, counts_of(-5.0), angle_rad=1.2, target_rad=1.25))
        both.run.beat()
        straight = both.run.leg
        assert (
            straight["source"] == "shaft only"
            and straight["ghost"] is None
            and straight["height_m"] == 0.215
        )
        both.run.source._legs.prepare(both.run.source._facts.scenes)
        both.run.beat()
        bent = both.run.leg
        assert (
            bent["source"] == "model at measured shaft angle"
            and len(bent["leg"]) == len(bent["ghost"]) == 8
        )
        assert max(z for _, z in bent["leg"]) < 0.222 < max(z for _, z in straight["leg"])
        assert bent["force"] == [0.0, -5.0]


def of_kind(messages, kind):
    return [message for message in messages if message["kind"] == kind]


def begin_stroke(both, stage, start_s):
    """The stage, a tick at rest, its commanded start, and a tick after it."""
    both.run_queue.stage(stage, None, None)
    both.run_queue.tick(tick(start_s, counts_of(0.0)))
    both.run_queue.start(start_s)
    both.run_queue.tick(tick(start_s + 0.002, counts_of(0.0)))
    both.run.beat()


def test_the_expected_force_begins_at_the_commanded_start_and_is_sent_once(monkeypatch):
    made = []
    predict = expected_force.predict_force

    def counted(*words):
        made.append(words)
        return predict(*words)

    monkeypatch.setattr(expected_force, "predict_force", counted)
    rig = twin_rig()
    with watched(given=one_condition(rig, 2)) as both:
        feed = both.run.feed()
        both.run_queue.tick(tick(5.0, counts_of(0.0)))
        first, second = [stage for stage in both.plan.stages if isinstance(stage, Flap)]
        begin_stroke(both, first, 7.5)
        # The stroke began before its prediction was there.
        (strokes,) = of_kind(feed.new_messages(), "strokes")
        both.run.source.forces.prepare(both.run.source._facts.strokes)
        (expected,) = of_kind(feed.new_messages(), "expected")
        begin_stroke(both, second, 11.25)
        later = feed.new_messages()
        assert not of_kind(later, "expected") and not of_kind(feed.new_messages(), "strokes")
        (strokes,) = of_kind(later, "strokes")
        of_late_page = both.run.feed().new_messages()
        both.run_queue.stage(both.plan.stages[1], None, None)
        both.run_queue.start(12.0)
        both.run.beat()
        assert not of_kind(feed.new_messages(), "strokes")
    places = [(one["from_s"], one["to_s"]) for one in strokes["strokes"]]
    assert places == [
        pytest.approx((from_s, from_s + first.stroke_s), abs=1e-5) for from_s in (2.5, 6.25)
    ]
    assert {one["condition"] for one in strokes["strokes"]} == {expected["condition"]}
    assert len(made) == 1
    assert of_kind(of_late_page, "expected") == [expected]
    assert of_kind(of_late_page, "strokes") == [strokes]
    of_model = simulate_stroke_at_speed(
        rig.model(), first.height_m, first.speed_rad_s, np.arange(0.0, first.stroke_s, 1e-3)
    )
    for name, decimals in (("fy_N", 4), ("fz_N", 4), ("tx_Nm", 5)):
        lines = expected["channels"][name]
        assert lines["value"] == np.round(getattr(of_model, name), decimals).tolist()
        assert all(
            low <= value <= high
            for low, value, high in zip(lines["low"], lines["value"], lines["high"], strict=True)
        )
    assert expected["dt_s"] == 1e-3


def test_a_model_that_cannot_be_read_or_computed_expects_nothing(monkeypatch):
    stroke = ExpectedStroke(0.215, 3.249, 0.5)
    nominal = twin_rig().nominal()
    for unreadable in ({}, {"leg": {}}):
        forces = expected_force.ExpectedForces(unreadable, {})
        forces.prepare([stroke, None])
        assert forces.message(stroke.condition) is None

    def fail(*_words):
        raise SimulationFailed("no step is short enough")

    monkeypatch.setattr(expected_force, "predict_force", fail)
    forces = expected_force.ExpectedForces(nominal, {})
    forces.prepare([stroke])
    assert forces.message(stroke.condition) is None


@pytest.mark.parametrize(
    "known_to",
    [{}, {"k0_relative": 1e9}, {"command_delay_ms": 3.0}],
    ids=["none is stated", "out of reach", "of no value of the model"],
)
def test_without_a_band_the_line_is_sent_alone(known_to):
    stroke = ExpectedStroke(0.215, 3.249, 0.5)
    forces = expected_force.ExpectedForces(twin_rig().nominal(), known_to)
    with np.errstate(over="ignore"):
        forces.prepare([stroke])
    assert set(forces.message(stroke.condition)["channels"]["fz_N"]) == {"value"}


def test_only_the_newest_strokes_are_kept():
    with watched() as both:
        (flap,) = [stage for stage in both.plan.stages if isinstance(stage, Flap)]
        begin_stroke(both, flap, 1.0)
        for number in range(MOST_STROKES):
            both.run_queue.start(2.0 + number)
        both.run.beat()
        strokes = both.run.source.strokes
        assert len(strokes) == MOST_STROKES
        assert strokes[-1].from_s == pytest.approx(MOST_STROKES)
        assert strokes[0].from_s == pytest.approx(1.0)


def seen(now_s, force_N, moment_Nm=0.0, rows=1):
    return ticks_of([tick_block(tick(now_s, counts_of(force_N, moment_Nm, rows)), Stamp(0.0, 0))])


@settings(max_examples=20)
@given(
    st.lists(st.tuples(st.floats(0.0, 320.0), st.integers(1, 15)), min_size=1, max_size=8),
    st.one_of(st.none(), st.floats(1.0, 100.0)),
)
def test_a_share_passes_one_exactly_where_the_run_trips(pieces, expected_N):
    """Held against the very watch that stops a run."""
    expected = None if expected_N is None else Load(expected_N, 1.0)
    watch = LoadMonitor(LIMITS, SCALE)
    gauges = Gauges(LIMITS, SCALE)
    watch.expect(expected)
    gauges.stage(expected)
    forces = [force_N for force_N, ticks in pieces for _ in range(ticks)]
    for number, force_N in enumerate(forces, start=1):
        one = tick(0.01 * number, counts_of(force_N, rows=3))
        gauges.take(ticks_of([tick_block(one, Stamp(0.0, 0))]))
        share = max(
            gauges.read_values()[name]["peak_share"] for name in ("force", "force above expected")
        )
        try:
            watch.check(one.force)
            assert share < 1.001
        except Tripped:
            assert share > 0.999
            return


def test_a_peak_between_two_tellings_is_told_and_the_peak_of_a_stage_stays_until_the_next():
    gauges = Gauges(LIMITS, SensorScale(1e6, 1e6, 7000.0))
    for now_s, force_N in ((0.002, 10.0), (0.004, 150.0), (0.006, 10.0)):
        gauges.take(seen(now_s, force_N))
    assert gauges.read_values()["force"] == {
        "value": 150.0,
        "share": 0.5,
        "peak_share": 0.5,
        "limit": 300.0,
    }
    gauges.take(seen(0.008, 30.0))
    assert gauges.read_values()["force"] == {
        "value": 30.0,
        "share": 0.1,
        "peak_share": 0.5,
        "limit": 300.0,
    }
    gauges.stage(None)
    gauges.take(seen(0.010, 30.0))
    assert gauges.read_values()["force"]["peak_share"] == 0.1


STAGES = [
    ListedStage("move", "move", 2.0),
    ListedStage("rest", "rest", 10.0),
    ListedStage("flap", "flap", 4.0),
] * 2


def test_progress_learns_how_much_of_the_planned_time_a_stage_needs():
    progress = Progress(STAGES)
    assert progress.at(0.0).eta_s is None
    progress.begin(0, 100.0)
    assert progress.at(100.0).eta_s == 32.0
    for number, wall_s in ((1, 102.0), (2, 103.0), (3, 107.0)):
        progress.begin(number, wall_s)
    at = progress.at(108.0)
    assert (at.stage, at.stage_done, at.eta_s) == (3, 0.5, 1.0 + 1.0 + 4.0)
    assert at.done == pytest.approx(17.0 / 32.0, abs=1e-4)
    progress.end(108.0, is_whole=False)
    assert (progress.at(120.0).done, progress.at(120.0).stage) == (at.done, -1)
    progress.end(120.0, is_whole=True)
    assert progress.at(120.0).done == 1.0


def test_a_pause_counts_to_no_stage():
    """Neither to the time that is left, nor to the experience with stages of that kind."""
    plain = Progress(STAGES)
    paused = Progress(STAGES)
    for progress in (plain, paused):
        progress.begin(0, 100.0)
    paused.pause(True, 101.0)
    assert paused.at(101.0) == paused.at(900.0) == plain.at(101.0)
    paused.pause(False, 901.0)
    assert paused.at(901.5) == plain.at(101.5)
    plain.begin(1, 102.0)
    paused.begin(1, 902.0)
    assert paused.at(902.5) == plain.at(102.5)
