"""Feed of a run in progress for one page: traces at the resolution that the page shows, without duplicates or gaps."""

from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any

from rfca_rig.view.live_source import LiveSource
from rfca_rig.view.messages import SPAN_S, Message, trace
from rfca_rig.view.page_feed import BEATS_HZ, SHORTEST_SPAN_S, STATES_HZ, Feed, number_in
from rfca_rig.view.pyramid import level_for, width_s

LONGEST_SPAN_S = 7 * 86400.0
STATE_EVERY = round(BEATS_HZ / STATES_HZ)


class LiveRun:
    """Implements `page_feed.FeedSource`. `beat` reads the queue once for all pages."""

    def __init__(self, source: LiveSource) -> None:
        self.source = source
        self._beats = 0
        self.state = source.state()
        self.leg = source.leg()

    def beat(self) -> None:
        self.source.look()
        self._refresh()

    def on_run_exit(self) -> None:
        """The run's process has ended."""
        self.source.on_run_exit()
        # Zero makes the next refresh build a state at once, so that every page shows the end.
        self._beats = 0
        self._refresh()

    def _refresh(self) -> None:
        if self._beats % STATE_EVERY == 0:
            self.state = self.source.state()
        self._beats += 1
        self.leg = self.source.leg()

    def hello(self) -> Message:
        return self.source.hello()

    def feed(self) -> Feed:
        return LiveFeed(self)

    def stop(self, how: str) -> bool:
        return self.source.stop(how)


class LiveFeed:
    """Implements `page_feed.Feed`."""

    def __init__(self, run: LiveRun) -> None:
        self._run = run
        self._shown: tuple[Message | None, Message | None] = (None, None)
        self._span_s = SPAN_S
        self._begin()

    def _begin(self) -> None:
        # Another span needs another level of the pyramid; the page gets the whole window again.
        self._level = level_for(self._span_s)
        self._sent: int | None = None

    def hear(self, message: Mapping[str, Any]) -> None:
        span_s = number_in(message, "span_s") if message.get("kind") == "span" else None
        if span_s is not None:
            self._span_s = min(max(span_s, SHORTEST_SPAN_S), LONGEST_SPAN_S)
            self._begin()

    def new_messages(self) -> Sequence[Message]:
        shown, self._shown = self._shown, (self._run.state, self._run.leg)
        # States and legs are shared by all pages: identity tells whether this page has had the current one.
        changed = [now for before, now in zip(shown, self._shown, strict=True) if now is not None and now is not before]
        traced = self._trace()
        return [*changed] if traced is None else [traced, *changed]

    def _trace(self) -> Message | None:
        pyramid = self._run.source.pyramid
        end = pyramid.closed(self._level)
        # A page that fell behind the oldest bucket kept cannot be continued without a gap: its window starts again.
        is_reset = self._sent is None or self._sent < pyramid.oldest(self._level)
        begin = max(end - ceil(self._span_s / width_s(self._level)), 0) if is_reset else self._sent
        if begin is None or begin >= end:
            return None
        self._sent = end
        return trace(width_s(self._level), begin, pyramid.between(self._level, begin, end), is_reset)
