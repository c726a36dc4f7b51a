"""Interface between the server and its sources of messages: a run in progress or a recording."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from rfca_rig.view.messages import Message

# Traces and the leg are sent at the first rate, which looks continuous; limits and health, which people read, at the second.
BEATS_HZ = 25.0
STATES_HZ = 5.0
SHORTEST_SPAN_S = 0.05


class Feed(Protocol):
    """Messages for one page; polled at every beat."""

    def new_messages(self) -> Sequence[Message]:
        """Messages that the page has not had yet."""
        ...

    def hear(self, message: Mapping[str, Any]) -> None:
        """Takes in a message from the page; one that makes no sense is ignored."""
        ...


class FeedSource(Protocol):
    """Source of feeds for any number of pages."""

    def hello(self) -> Message: ...

    def feed(self) -> Feed:
        """A feed for one more page."""
        ...

    def stop(self, how: str) -> bool:
        """Requests a stop; False where there is nothing to stop. Raises LookupError for an unknown kind of stop."""
        ...


def number_in(message: Mapping[str, Any], name: str) -> float | None:
    """A number from a page's message, None where it is missing or not a number."""
    value = message.get(name)
    # bool is a subclass of int in Python. The bound keeps infinity and NaN out, which Python's JSON parser accepts.
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9 else None
