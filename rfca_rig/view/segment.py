"""One stage of a recording, prepared for playback."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rfca_rig.recording.model import Stream
from rfca_rig.view.decimation import Extrema, Floats, decimate
from rfca_rig.view.messages import CHANNELS, hanging_deg
from rfca_rig.view.scenes import Scene

_PLACES = {channel.name: place for place, channel in enumerate(CHANNELS)}
_SHOWN_AS = {"shaft_angle_rad": "shaft_angle_deg"}
FORCE, MOMENT = ("fx_N", "fy_N", "fz_N"), ("tx_Nm", "ty_Nm", "tz_Nm")


def channel_of(column: str) -> str | None:
    """Channel of the page that shows a recorded column; None for a column that is not shown."""
    name = _SHOWN_AS.get(column, column)
    return name if name in _PLACES else None


@dataclass(frozen=True)
class Track:
    """Samples of one device: `t_s` (m,) from the stage's first sample, ascending; `values` (m, channels) of the channels at `places`."""

    t_s: Floats
    values: Floats
    places: Sequence[int]


@dataclass(frozen=True)
class StageSamples:
    """Samples of a whole stage; times in s from its first sample.

    `shaft_rad` (m, 2) holds times and shaft angles as recorded; `sizes` (m, 3) times, force [N] and moment [N m] as vector lengths.
    Either may be empty.
    """

    tracks: Sequence[Track]
    shaft_rad: Floats
    sizes: Floats

    @property
    def nbytes(self) -> int:
        """Memory of all arrays, for the limit of a cache."""
        return sum(track.values.nbytes + track.t_s.nbytes for track in self.tracks) + self.shaft_rad.nbytes + self.sizes.nbytes

    def extrema(self, begin_s: float, dt_s: float, first: int, count: int) -> Extrema:
        """Extrema (count, channels) in buckets of a time line on which the stage begins at `begin_s`."""
        found = Extrema.none(count, len(CHANNELS))
        for track in self.tracks:
            part = decimate(track.t_s + begin_s, track.values, dt_s, first, count)
            found.low[:, track.places], found.high[:, track.places] = part.low, part.high
        return found

    def shaft_at(self, t_s: float) -> float | None:
        """Shaft angle at a time from the stage's first sample, linearly interpolated; None where none was recorded."""
        return float(np.interp(t_s, self.shaft_rad[:, 0], self.shaft_rad[:, 1])) if len(self.shaft_rad) else None

    def value_at(self, channel: str, t_s: float) -> float | None:
        """Last value up to a time; None where the channel was not recorded, or began later."""
        place = _PLACES[channel]
        for track in self.tracks:
            if place in track.places and (row := int(np.searchsorted(track.t_s, t_s, side="right"))):
                return float(track.values[row - 1, list(track.places).index(place)])
        return None


@dataclass(frozen=True)
class Clip:
    """One stage: its place on the time line, what it was, and `load` to read its samples.

    `rest_s` is the time recorded before the commanded start. `planned_rad` gives the commanded shaft angle at a time from the commanded
    start; None where it is unknown. `hinge_deg` (6,) are hinge angles from a photo.
    """

    label: str
    kind: str
    begin_s: float
    duration_s: float
    rest_s: float
    scene: Scene
    load: Callable[[], StageSamples] = field(repr=False)
    planned_rad: Callable[[float], float] | None = field(default=None, repr=False)
    hinge_deg: Floats | None = None

    @property
    def end_s(self) -> float:
        return self.begin_s + self.duration_s


def samples_of(streams: Mapping[str, Stream]) -> StageSamples:
    """Samples of the streams of a recorded stage, with times from the earliest sample of all streams."""
    used = [stream for stream in streams.values() if len(stream.t_s)]
    zero_s = min((float(stream.t_s.min()) for stream in used), default=0.0)
    tracks = [track for stream in used if (track := _track(stream, zero_s)) is not None]
    return StageSamples(tracks, _shaft(used, zero_s), _sizes(used, zero_s))


def _track(stream: Stream, zero_s: float) -> Track | None:
    names = [(column, shown) for column in stream.columns if (shown := channel_of(column)) is not None]
    if not names:
        return None
    # Streams are nearly always sorted; a stable sort keeps records of equal time in order of arrival.
    values = np.column_stack([_in_page_units(stream, column) for column, _ in names])
    order = _order(stream)
    return Track(stream.t_s[order] - zero_s, values[order], [_PLACES[shown] for _, shown in names])


def _in_page_units(stream: Stream, column: str) -> Floats:
    values = stream.columns[column].values
    return hanging_deg(values) if column == "shaft_angle_rad" else values


def _order(stream: Stream) -> np.ndarray:
    return np.argsort(stream.t_s, kind="stable")


def _shaft(streams: Iterable[Stream], zero_s: float) -> Floats:
    for stream in streams:
        if "shaft_angle_rad" in stream.columns:
            order = _order(stream)
            both: Floats = np.column_stack([stream.t_s - zero_s, stream.columns["shaft_angle_rad"].values])[order]
            return both
    return np.zeros((0, 2))


def _sizes(streams: Iterable[Stream], zero_s: float) -> Floats:
    for stream in streams:
        if "fz_N" in stream.columns:
            columns = [stream.t_s - zero_s, _norm(stream, FORCE), _norm(stream, MOMENT)]
            sizes: Floats = np.column_stack(columns)[_order(stream)]
            return sizes
    return np.zeros((0, 3))


def _norm(stream: Stream, names: Sequence[str]) -> Floats:
    squares = [stream.columns[name].values ** 2 for name in names if name in stream.columns]
    return np.sqrt(np.sum(squares, axis=0)) if squares else np.zeros(len(stream.t_s))
