"""Playback of a time line of clips: samples at one time, and in a window before it."""

from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Mapping, Sequence

import numpy as np

from rfca_rig.view.decimation import Extrema, Floats
from rfca_rig.view.leg_pose import LegMoment, Legs
from rfca_rig.view.messages import CHANNELS, Message
from rfca_rig.view.segment import Clip, StageSamples

# Limit of the cache of loaded stages.
CACHE_BYTES = 200 << 20
# The interval of one picture of the limits, which are updated five times a second.
RECENT_S = 0.2


class Player:
    """Loads the samples of stages on demand, and caches those used last."""

    def __init__(self, clips: Sequence[Clip], legs: Legs) -> None:
        self.clips = clips
        self.duration_s = clips[-1].end_s if clips else 0.0
        self._legs = legs
        self._begins_s = [clip.begin_s for clip in clips]
        self._loaded: OrderedDict[int, StageSamples] = OrderedDict()

    def _samples(self, place: int) -> StageSamples:
        if place in self._loaded:
            self._loaded.move_to_end(place)
            return self._loaded[place]
        samples = self._loaded[place] = self.clips[place].load()
        # The oldest come first in the dictionary. The stage just loaded is never dropped, however large it is.
        while len(self._loaded) > 1 and sum(stage.nbytes for stage in self._loaded.values()) > CACHE_BYTES:
            self._loaded.popitem(last=False)
        return samples

    def place_at(self, at_s: float) -> int:
        """Index of the clip that is played at a time, or was played last."""
        return max(bisect_right(self._begins_s, at_s) - 1, 0)

    def extrema(self, dt_s: float, first: int, count: int) -> Extrema:
        """Extrema (count, channels) in buckets of `dt_s` s, the first of which begins at first * dt_s."""
        found = Extrema.none(count, len(CHANNELS))
        begin_s, end_s = first * dt_s, (first + count) * dt_s
        for place in range(self.place_at(begin_s), self.place_at(end_s) + 1):
            clip = self.clips[place]
            if clip.begin_s < end_s and clip.end_s >= begin_s:
                part = self._samples(place).extrema(clip.begin_s, dt_s, first, count)
                found = Extrema(np.fmin(found.low, part.low), np.fmax(found.high, part.high))
        return found

    def leg(self, at_s: float) -> Message | None:
        """Pose of the leg at a time; None where no angle of the shaft was recorded."""
        clip, samples, t_s = self._at(at_s)
        shaft_rad = samples.shaft_at(t_s)
        if shaft_rad is None:
            return None
        planned_rad = None if clip.planned_rad is None else clip.planned_rad(t_s - clip.rest_s)
        fy_N, fz_N = samples.value_at("fy_N", t_s), samples.value_at("fz_N", t_s)
        force_N = None if fy_N is None or fz_N is None else (fy_N, fz_N)
        return self._legs.message(LegMoment(clip.scene, shaft_rad, planned_rad, clip.hinge_deg, force_N))

    def _at(self, at_s: float) -> tuple[Clip, StageSamples, float]:
        """The clip at a time, its samples, and the time in s since its first sample, within the clip."""
        place = self.place_at(at_s)
        clip = self.clips[place]
        return clip, self._samples(place), min(at_s - clip.begin_s, clip.duration_s)

    def loads(self, at_s: float) -> tuple[Floats, Floats]:
        """Largest force [N] and moment [N m], each pair (2,): over the last RECENT_S, and since the stage began."""
        _, samples, t_s = self._at(at_s)
        before = samples.sizes[: int(np.searchsorted(samples.sizes[:, 0], t_s, side="right"))]
        # At least the last sample: a slow stream may have none within the interval.
        lately = before[min(int(np.searchsorted(before[:, 0], t_s - RECENT_S)), max(len(before) - 1, 0)) :]
        return lately[:, 1:].max(axis=0, initial=0.0), before[:, 1:].max(axis=0, initial=0.0)

    def channels(self) -> Mapping[str, bool]:
        """Which channels were recorded, judged by the first clip of each kind: loading all stages would take long."""
        places = {self.clips[place].kind: place for place in reversed(range(len(self.clips)))}.values()
        recorded = {place for clip in places for track in self._samples(clip).tracks for place in track.places}
        return {channel.name: place in recorded for place, channel in enumerate(CHANNELS)}
