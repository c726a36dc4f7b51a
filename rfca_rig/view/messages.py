"""Messages from the server to the page, the same for live view and replay, and the interface to
their sources.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from math import isnan
from typing import Any, Protocol

import numpy as np

from rfca_rig.view.pyramid import Extrema, Floats
from rfca_rig.view.run_facts import ListedStage

Message = Mapping[str, Any]
SPAN_S = 8.0
DOCS = "/trips/{code}"

# Traces and the leg are sent at the first rate, which looks continuous; limits and health, which
# people read, at the second.
BEATS_HZ = 25.0
STATES_HZ = 5.0
SHORTEST_SPAN_S = 0.05


@dataclass(frozen=True)
class Channel:
    """One trace of the page, in the unit that it is drawn in. It is sent with `decimals`, finer
    than the noise of any sensor.
    """

    name: str
    label: str
    unit: str
    plot: str
    decimals: int = 4


WRENCH = (
    *(Channel(f"f{axis}_N", f"f{axis}", "N", "force") for axis in "xyz"),
    *(Channel(f"t{axis}_Nm", f"t{axis}", "N m", "moment", 5) for axis in "xyz"),
)
SHAFT = (
    Channel("shaft_angle_deg", "shaft", "deg", "angle", 3),
    Channel("shaft_speed_rad_s", "speed", "rad/s", "speed"),
)
CHANNELS = (*WRENCH, *SHAFT)


def hello(
    title: str,
    mark: str,
    stages: Iterable[ListedStage],
    limits: Sequence[Mapping[str, object]],
    leg: Mapping[str, object] | None,
    duration_s: float | None = None,
    channels: Sequence[Channel] = CHANNELS,
) -> Message:
    """The first message to a page. A recording has a duration, a run in progress has none."""
    is_live = duration_s is None
    return {
        "kind": "hello",
        "title": title,
        "mark": mark,
        "mode": "live" if is_live else "replay",
        "can_stop": is_live,
        "span_s": SPAN_S,
        "channels": [
            {
                "name": channel.name,
                "label": channel.label,
                "unit": channel.unit,
                "plot": channel.plot,
            }
            for channel in channels
        ],
        "stages": [asdict(stage) for stage in stages],
        "limits": list(limits),
        "leg": leg,
        "duration_s": duration_s,
        "docs": DOCS,
    }


def trace(
    dt_s: float,
    first: int,
    extrema: Extrema,
    is_reset: bool,
    channels: Sequence[Channel] = CHANNELS,
) -> Message:
    """Extrema (n, channels) of consecutive buckets of `dt_s` s; the first begins at first *
    dt_s. `is_reset` clears the page's traces.
    """
    message: dict[str, Any] = {"kind": "trace", "dt_s": dt_s, "from_s": first * dt_s}
    if is_reset:
        message["reset"] = True
    message["low"] = _by_channel(extrema.low, channels)
    message["high"] = _by_channel(extrema.high, channels)
    return message


def _by_channel(values: Floats, channels: Sequence[Channel]) -> dict[str, list[float | None]]:
    """Values (n, channels) as numbers of JSON, by the name of their channel."""
    numbers = {}
    for column, channel in enumerate(channels):
        numbers[channel.name] = _as_json_numbers(values[:, column], channel.decimals)
    return numbers


def _as_json_numbers(values: Floats, decimals: int) -> list[float | None]:
    rounded = np.round(values, decimals)
    # JSON has no NaN. The test for any at all comes first because most traces have none, and the
    # loop is slow.
    if np.isnan(values).any():
        return [None if isnan(value) else value for value in rounded.tolist()]
    numbers: list[float | None] = rounded.tolist()
    return numbers


@dataclass(frozen=True)
class Health:
    """One line of the health panel."""

    name: str
    value: str
    is_good: bool


class Feed(Protocol):
    """Messages for one page; polled at every beat."""

    def new_messages(self) -> Sequence[Message]:
        """Messages that the page has not had yet."""
        ...

    def handle_message(self, message: Mapping[str, Any]) -> None:
        """Takes in a message from the page; one that makes no sense is ignored."""
        ...


class FeedSource(Protocol):
    """Source of feeds for any number of pages."""

    def hello(self) -> Message: ...

    def feed(self) -> Feed:
        """A feed for one more page."""
        ...

    def stop(self, how: str) -> bool:
        """Requests a stop; False where there is nothing to stop. Raises LookupError for an
        unknown kind of stop.
        """
        ...

    def pause(self, is_wanted: bool) -> bool:
        """Requests a pause, or that the run goes on; False where that would change nothing."""
        ...


def number_in(message: Mapping[str, Any], name: str) -> float | None:
    """A number from a page's message, None where it is missing or not a number."""
    value = message.get(name)
    # bool is a subclass of int in Python. The bound keeps infinity and NaN out, which Python's JSON
    # parser accepts.
    if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9:
        return float(value)
    return None
