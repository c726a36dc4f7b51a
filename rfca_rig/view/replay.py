"""Playback of a recording on the same page as a live run: forwards at any speed, from any time."""

import asyncio
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from math import floor
from pathlib import Path
from typing import Any

from rfca_rig.campaign.stored import StoredRecording, open_stored
from rfca_rig.clock import Clock, WallClock
from rfca_rig.errors import BadInput, Trip
from rfca_rig.protocol.plan import Limits
from rfca_rig.recording.loop_gaps import LONGEST_KEY, recorded_gaps
from rfca_rig.view.expected_force import ExpectedFeed, ExpectedForces, PlacedStroke
from rfca_rig.view.gauges import Gauge
from rfca_rig.view.leg_pose import Legs
from rfca_rig.view.messages import (
    BEATS_HZ,
    CHANNELS,
    SHORTEST_SPAN_S,
    SPAN_S,
    STATES_HZ,
    Feed,
    Health,
    Message,
    hello,
    number_in,
    trace,
)
from rfca_rig.view.pyramid import MAX_BUCKETS
from rfca_rig.view.run_facts import ListedStage, new_token
from rfca_rig.view.run_queue import url_of
from rfca_rig.view.server import listen_on, port_of, serve
from rfca_rig.view.time_line import Player, plan_in, time_line

LONGEST_SPAN_S = 60.0
FASTEST = 100.0
STATE_EVERY = round(BEATS_HZ / STATES_HZ)
HEALTH_NAMES = {
    "sensor_records": "sensor records",
    LONGEST_KEY: "worst loop gap, ms",
    "tare_drift": "tare drift",
}


class Replay:
    """Implements `messages.FeedSource` for a recording. Each page has its own playback position."""

    def __init__(self, stored: StoredRecording, legs: Legs, clock: Clock) -> None:
        self._stored = stored
        self._legs = legs
        self._clock = clock
        plan = plan_in(stored)
        self._limits = plan.limits if plan else None
        self.player = Player(time_line(stored, legs.start_rad, legs.ramp_s), legs)
        self.forces = ExpectedForces(stored.nominal, stored.known_to)
        self.strokes: tuple[PlacedStroke, ...] = self.player.strokes()

    def prepare(self) -> None:
        """Computes the shapes of the leg and the forces of all strokes, which takes seconds."""
        self._legs.prepare([clip.scene for clip in self.player.clips])
        self.forces.prepare([clip.stroke for clip in self.player.clips])

    def hello(self) -> Message:
        recorded = self.player.channels()
        channels = [channel for channel in CHANNELS if recorded[channel.name]]
        stages = [
            ListedStage(clip.label, clip.kind, round(clip.duration_s, 4))
            for clip in self.player.clips
        ]
        limits: list[dict[str, object]] = []
        if self._limits:
            limits = [_describe_gauge(gauge) for gauge in gauges(self._limits)]
        return hello(
            self._stored.title,
            self._stored.source,
            stages,
            limits,
            self._legs.description,
            self.player.duration_s,
            channels,
        )

    def feed(self) -> Feed:
        return ReplayFeed(self, self._limits, self._health(), self._ending(), self._clock)

    def stop(self, how: str) -> bool:
        """A recording cannot be stopped."""
        del how
        return False

    def pause(self, is_wanted: bool) -> bool:
        """A recording cannot be paused by the run's request."""
        del is_wanted
        return False

    def _health(self) -> list[Health]:
        """Health of the run from the recording's provenance."""
        known = self._stored.provenance
        why = self._end_reason()
        gaps = recorded_gaps(known)
        lines = [
            _health_line(shown, known[name])
            for name, shown in HEALTH_NAMES.items()
            if name in known and not (name == LONGEST_KEY and gaps is not None)
        ]
        if gaps is not None:
            lines.append(Health("loop gaps", gaps.text(), is_good=True))
        if why is not None:
            lines.append(Health("ended", why, why == "done"))
        return lines

    def _end_reason(self) -> str | None:
        # A run that crashed has no end of its own; what put its recording together wrote
        # "interrupted".
        known = self._stored.provenance
        return known.get("ended", known.get("interrupted"))

    def _ending(self) -> Mapping[str, Any]:
        why = self._end_reason()
        reason = self._stored.provenance.get("reason", "")
        trip = None
        if reason in set(Trip):
            trip = {"code": reason, "text": why}
        return {"ended": why or "the recording ends here", "trip": trip}


def _describe_gauge(gauge: Gauge) -> dict[str, object]:
    return {
        "name": gauge.name,
        "unit": gauge.unit,
        "limit": round(gauge.limit, 4),
        "code": str(gauge.code),
    }


def _health_line(name: str, text: str) -> Health:
    """A line of health. Counts of zero are left out; counts of faults of the sensor make it a
    bad line.
    """
    parts = [part for part in text.split(", ") if not part.startswith("0 ")]
    return Health(name, ", ".join(parts), name != HEALTH_NAMES["sensor_records"] or len(parts) == 1)


def gauges(limits: Limits) -> tuple[Gauge, Gauge]:
    """Gauges of the limits that a recording allows to evaluate: force and moment."""
    return Gauge("force", "N", Trip.FORCE, limits.force_N), Gauge(
        "moment", "N m", Trip.MOMENT, limits.torque_Nm
    )


class ReplayFeed:
    """Implements `messages.Feed`; starts to play at once."""

    def __init__(
        self,
        replay: Replay,
        limits: Limits | None,
        health: Sequence[Health],
        ending: Mapping[str, Any],
        clock: Clock,
    ) -> None:
        self._player = replay.player
        self._strokes = replay.strokes
        self._expected = ExpectedFeed(replay.forces)
        self._limits = limits
        self._health = [asdict(line) for line in health]
        self._ending = ending
        self._clock = clock
        self._played_s = clock.now_s()
        self._speed = 1.0
        self._at_s = 0.0
        self._beats = 0
        self._show(SPAN_S)

    def _show(self, span_s: float) -> None:
        self._span_s = min(max(span_s, SHORTEST_SPAN_S), LONGEST_SPAN_S)
        # Buckets of any width: samples are at hand, so the fixed levels of the live pyramid are not
        # needed.
        self._dt_s = self._span_s / MAX_BUCKETS
        self._sent: int | None = None
        self._beats = 0

    def handle_message(self, message: Mapping[str, Any]) -> None:
        # The time until now was played at the old speed.
        self._play()
        match message.get("kind"):
            case "seek" if (at_s := number_in(message, "at_s")) is not None:
                self._at_s = min(max(at_s, 0.0), self._player.duration_s)
                self._show(self._span_s)
            case "play" if (speed := number_in(message, "speed")) is not None:
                self._speed = min(max(speed, 0.0), FASTEST)
                self._beats = 0
            case "span" if (span_s := number_in(message, "span_s")) is not None:
                self._show(span_s)

    def _play(self) -> None:
        now_s = self._clock.now_s()
        self._at_s = min(
            self._at_s + self._speed * (now_s - self._played_s), self._player.duration_s
        )
        self._played_s = now_s

    def new_messages(self) -> Sequence[Message]:
        self._play()
        if not self._player.clips:
            if self._is_due():
                return [self._state()]
            return []
        messages: list[Message] = []
        if trace := self._trace():
            messages.append(trace)
        messages += self._expected.new_messages(self._strokes)
        if leg := self._player.leg(self._at_s):
            messages.append(leg)
        if self._is_due():
            messages.append(self._state())
        return messages

    def _is_due(self) -> bool:
        # Remainder 1: after a reset to 0 the first beat sends a state at once.
        self._beats += 1
        return self._beats % STATE_EVERY == 1

    def _trace(self) -> Message | None:
        # Number of buckets that are complete; at the end of the recording also the last one.
        is_at_end = self._at_s >= self._player.duration_s
        if is_at_end:
            end = floor(self._at_s / self._dt_s) + 1
        else:
            end = floor(self._at_s / self._dt_s)
        # At high speed a beat may skip more than a window: then nothing of what was sent is visible
        # any more.
        is_reset = self._sent is None or end - self._sent > MAX_BUCKETS
        if self._sent is None or is_reset:
            begin = max(end - MAX_BUCKETS, 0)
        else:
            begin = self._sent
        if begin == end and not is_reset:
            return None
        self._sent = end
        return trace(
            self._dt_s, begin, self._player.extrema(self._dt_s, begin, end - begin), is_reset
        )

    def _state(self) -> Message:
        player = self._player
        done = 1.0
        if player.duration_s:
            done = self._at_s / player.duration_s
        left_s = None
        if self._speed:
            left_s = round((player.duration_s - self._at_s) / self._speed, 1)
        ending: Mapping[str, Any] = {"ended": None, "trip": None}
        if self._at_s >= player.duration_s:
            ending = self._ending
        return {
            "kind": "state",
            "now_s": round(self._at_s, 4),
            **self._stage(),
            "done": round(done, 4),
            "eta_s": left_s,
            "limits": self._limit_state(),
            "health": self._health,
            "said": [],
            "speed": self._speed,
            "stop_asked": None,
            **ending,
        }

    def _stage(self) -> dict[str, Any]:
        if not self._player.clips:
            return {"stage": -1, "stage_label": "nothing was recorded", "stage_done": 0.0}
        index = self._player.place_at(self._at_s)
        clip = self._player.clips[index]
        if clip.duration_s:
            done = min((self._at_s - clip.begin_s) / clip.duration_s, 1.0)
        else:
            done = 1.0
        return {"stage": index, "stage_label": clip.label, "stage_done": round(done, 4)}

    def _limit_state(self) -> dict[str, Any]:
        if self._limits is None or not self._player.clips:
            return {}
        states = {}
        for gauge, value, peak in zip(
            gauges(self._limits), *self._player.loads(self._at_s), strict=True
        ):
            # The peak since the stage began first, marked as reported, so that the gauge shows the
            # current value and this peak.
            gauge.show(float(peak))
            gauge.is_reported = True
            gauge.show(float(value))
            states[gauge.name] = gauge.read_values()
        return states


def replay(path: Path, port: int, ready: Callable[[str], None]) -> None:
    """Serves a recording until the process is interrupted.

    Parameters
    ----------
    path
        A run's folder, a recording file or a campaign.
    port
        TCP port; 0 for any free one.
    ready
        Called with the address to open, as soon as it can be opened.

    Raises
    ------
    BadInput
        Where there is no recording, none with anything to play, or for a port that is in use.
    """
    stored = open_stored(path)
    source = Replay(stored, Legs(stored.nominal), WallClock())
    if not source.player.clips:
        raise BadInput(
            f"{path}: holds neither strokes nor static stages, so there is nothing to view"
        )
    listening = listen_on(port)
    token = new_token()
    ready(url_of(port_of(listening), token))
    # Until the shapes are there the page shows a straight leg, and no expected force.
    threading.Thread(target=source.prepare, daemon=True).start()
    asyncio.run(serve(source, token, listening, asyncio.Event(), lambda _pages: True))
