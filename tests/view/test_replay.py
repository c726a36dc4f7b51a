"""A recording on the page: what is in it, when, from anywhere, at any speed."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from rfca_rig.campaign.stored import open_stored, store_in_memory
from rfca_rig.clock import TwinClock
from rfca_rig.errors import BadInput
from rfca_rig.model.stroke import simulate_stroke_at_speed
from rfca_rig.recording.model import Column, Recording, Stream, Stroke
from rfca_rig.recording.store import write_recording
from rfca_rig.view.leg_pose import Legs
from rfca_rig.view.replay import Replay
from rfca_rig.view.time_line import PAUSE_S
from tests.engine.rigs import one_condition, recorder_on, twin_rig
from tests.recording.growing import grown
from tests.view.test_live_source import drawn, traces

SMALL = Path(__file__).parents[1] / "data" / "small-campaign"


class Shown:
    """A page on a recording, and the time that passes for it."""

    def __init__(self, stored, has_shapes=False):
        self.clock = TwinClock()
        legs = Legs(stored.nominal)
        self.replay = Replay(stored, legs, self.clock)
        if has_shapes:
            legs.prepare(
                [clip.scene for clip in self.replay.player.clips if clip.kind == "hold"][:1]
            )
        self.feed = self.replay.feed()

    def after(self, seconds, beats=1):
        """All that came meanwhile."""
        got = []
        for _ in range(beats):
            self.clock.wait_until(self.clock.now_s() + seconds / beats)
            got += self.feed.new_messages()
        return got

    def seek(self, at_s):
        self.feed.handle_message({"kind": "play", "speed": 0.0})
        self.feed.handle_message({"kind": "seek", "at_s": at_s})


@pytest.fixture(scope="module")
def small():
    return open_stored(SMALL)


def last(messages, kind):
    return [message for message in messages if message["kind"] == kind][-1]


def test_played_from_the_beginning_every_peak_is_drawn(small):
    shown = Shown(small)
    got = shown.feed.new_messages() + shown.after(shown.replay.player.duration_s, beats=300)
    values = np.concatenate(
        [stroke.samples.whole()["table"].columns["fz_N"].values for stroke in small.strokes]
    )
    static = [stage.fz_N for stage in small.static]
    assert drawn(got) == pytest.approx(
        (min(values.min(), *static), max(values.max(), *static)), abs=1e-4
    )
    end = last(got, "state")
    assert (
        end["done"] == 1.0
        and end["ended"]
        and end["stage"] == len(shown.replay.hello()["stages"]) - 1
    )


def test_after_a_seek_the_whole_window_comes_anew_as_numpy_finds_it(small):
    shown = Shown(small)
    clip = shown.replay.player.clips[2]
    stroke = small.strokes[2].samples.whole()["table"]
    shown.seek(clip.end_s)
    got = shown.after(0.04)
    window = traces(got)[0]
    assert window["reset"] and window["dt_s"] == 0.008 and len(window["low"]["fz_N"]) <= 1000
    begin_s = clip.begin_s - stroke.t_s.min()
    buckets = np.floor((stroke.t_s + begin_s) / 0.008).astype(int) - round(window["from_s"] / 0.008)
    for bucket in np.unique(buckets)[:-1]:
        inside = stroke.columns["fz_N"].values[buckets == bucket]
        assert window["low"]["fz_N"][bucket] == pytest.approx(inside.min(), abs=1e-4)
        assert window["high"]["fz_N"][bucket] == pytest.approx(inside.max(), abs=1e-4)
    pause = slice(int(clip.end_s / 0.008) + 1, int((clip.end_s + PAUSE_S) / 0.008) - 1)
    assert set(window["low"]["fz_N"][pause]) <= {None}


def test_time_goes_as_fast_as_the_page_wants_and_stands_where_it_says(small):
    shown = Shown(small)
    shown.feed.new_messages()
    shown.feed.handle_message({"kind": "play", "speed": 4.0})
    assert last(shown.after(1.0, beats=25), "state")["now_s"] == pytest.approx(4.0, abs=0.9)
    shown.feed.handle_message({"kind": "play", "speed": 0.0})
    before = last(shown.after(0.2), "state")["now_s"]
    state = last(shown.after(5.0, beats=5), "state")
    assert (state["now_s"], state["speed"], state["eta_s"]) == (before, 0.0, None)


def test_the_very_last_sample_is_drawn():
    t_s = np.array([-0.1, 0.0, 0.0999])
    fz_N = np.array([1.0, 2.0, -77.0])
    stroke = Stroke(0.215, 2.4, 1, {"table": Stream(t_s, {"fz_N": Column(fz_N, "N")})})
    shown = Shown(store_in_memory(SMALL, Recording("short", "IMPORT", {}, {}, (stroke,), ())))
    assert drawn(shown.feed.new_messages() + shown.after(1.0, beats=10))[0] == -77.0


@pytest.mark.parametrize("at_s", [-5.0, 1e8])
def test_a_seek_beyond_either_end_stops_there(small, at_s):
    shown = Shown(small)
    shown.seek(at_s)
    now_s = last(shown.after(0.04), "state")["now_s"]
    assert now_s == pytest.approx(0.0 if at_s < 0 else shown.replay.player.duration_s, abs=1e-3)


def test_static_stages_are_drawn_from_their_photos_beside_the_model(small):
    shown = Shown(small, has_shapes=True)
    place = next(
        place for place, clip in enumerate(shown.replay.player.clips) if clip.hinge_deg is not None
    )
    clip = shown.replay.player.clips[place]
    shown.seek(clip.begin_s + 0.5 * clip.duration_s)
    leg = last(shown.after(0.04), "leg")
    assert leg["source"] == "photo" and leg["ghost"]
    angles = np.arctan2(*np.diff(np.array(leg["leg"]), axis=0).T[::-1])
    np.testing.assert_allclose(np.degrees(np.diff(angles)), clip.hinge_deg, atol=0.01)


def test_nothing_recorded_can_be_stopped(small):
    shown = Shown(small)
    assert not shown.replay.hello()["can_stop"] and not shown.replay.stop("now")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A run of one stroke on the twin: its folder while nothing is put together yet, its
    recording, and its file.
    """
    folder = tmp_path_factory.mktemp("replay") / "run"
    rig = twin_rig()
    from rfca_rig.engine.run import run_plan

    with recorder_on(rig, folder) as (bench, recorder, kept):
        run_plan(one_condition(rig), bench, recorder, lambda _: None)
        unfinished = open_stored(folder)
        recording = kept.finish()
    return unfinished, recording, folder


def test_a_run_is_the_same_from_its_stages_from_its_file_and_from_memory(run):
    unfinished, recording, folder = run
    pictures = []
    for stored in (
        unfinished,
        store_in_memory(SMALL, recording),
        open_stored(folder),
        open_stored(folder / "run.h5"),
    ):
        shown = Shown(stored)
        shown.seek(1.0)
        got = shown.after(0.04)
        pictures.append((traces(got), last(got, "leg")))
    assert all(picture == pictures[0] for picture in pictures[1:])


def test_the_ghost_of_a_stroke_is_where_the_commanded_motion_would_be(run):
    shown = Shown(run[2] and open_stored(run[2]))
    (clip,) = shown.replay.player.clips
    start_rad = twin_rig().model().leg.start_angle_rad
    speed_rad_s = clip.scene.stroke.speed_rad_s
    assert clip.planned_rad(-0.1) == start_rad
    t_s = np.linspace(0.0, 1.0, 100_001)
    ramp_s = twin_rig().model().drive.ramp_s
    speeds = speed_rad_s * np.minimum(t_s / ramp_s, 1.0)
    by_hand = start_rad + np.sum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(t_s))
    assert clip.planned_rad(1.0) == pytest.approx(by_hand, abs=1e-6)


def test_the_expected_force_of_a_stroke_begins_where_its_recording_has_time_0(run):
    shown = Shown(run[0])
    shown.replay.forces.prepare([clip.stroke for clip in shown.replay.player.clips])
    shown.seek(1.0)
    got = shown.after(0.04)
    (placed,) = last(got, "strokes")["strokes"]
    (clip,) = shown.replay.player.clips
    streams = run[1].strokes[0].streams
    earliest_s = min(float(stream.t_s[0]) for stream in streams.values())
    latest_s = max(float(stream.t_s[-1]) for stream in streams.values())
    assert placed["from_s"] == pytest.approx(clip.begin_s - earliest_s, abs=1e-6)
    assert placed["to_s"] == pytest.approx(placed["from_s"] + latest_s, abs=1e-6)
    expected = last(got, "expected")
    assert expected["condition"] == placed["condition"]
    of_model = simulate_stroke_at_speed(
        twin_rig().model(), 0.215, 3.249, np.arange(0.0, latest_s, 1e-3)
    )
    assert expected["channels"]["fz_N"]["value"] == np.round(of_model.fz_N, 4).tolist()
    later = shown.after(0.2, beats=5)
    assert {message["kind"] for message in later}.isdisjoint({"expected", "strokes"})


def test_the_band_comes_from_the_uncertainty_that_the_recording_states(tmp_path, run):
    recording = replace(run[1], known_to={"friction_coefficient": 0.05})
    path = write_recording(recording, tmp_path / "known.h5")
    for stored in (open_stored(path), store_in_memory(tmp_path, recording)):
        shown = Shown(stored)
        shown.replay.forces.prepare([clip.stroke for clip in shown.replay.player.clips])
        lines = last(shown.feed.new_messages(), "expected")["channels"]["fz_N"]
        assert max(np.subtract(lines["high"], lines["value"])) > 2.0


def test_nothing_is_expected_of_static_stages(small):
    shown = Shown(small)
    player = shown.replay.player
    placed = last(shown.feed.new_messages(), "strokes")["strokes"]
    strokes = [clip for clip in player.clips if clip.kind == "flap"]
    assert len(placed) == len(strokes) < len(player.clips)
    for clip, stroke in zip(strokes, placed, strict=True):
        assert clip.begin_s <= stroke["from_s"] < stroke["to_s"] == pytest.approx(clip.end_s)


def test_static_stages_of_a_run_have_the_samples_behind_their_means(tmp_path):
    grown(tmp_path / "run", 4).finish("done")
    stored = open_stored(tmp_path / "run")
    clips = Shown(stored).replay.player.clips
    assert sorted(clip.kind for clip in clips) == ["flap", "flap", "hold", "hold"]
    assert all(clip.load().tracks for clip in clips)


def test_a_folder_that_is_no_run_is_said_to_be_none(tmp_path):
    with pytest.raises(BadInput, match="neither"):
        open_stored(tmp_path)


def test_a_recording_without_anything_in_it_plays_nothing(tmp_path, run):
    empty = replace(run[1], strokes=(), static=(), raw=())
    shown = Shown(open_stored(write_recording(empty, tmp_path / "empty.h5")))
    state = last(shown.after(0.04), "state")
    assert (state["stage"], state["done"]) == (-1, 1.0)
    assert shown.replay.hello()["stages"] == []
