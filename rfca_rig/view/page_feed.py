"""What a page is sent, whether it shows a run or a recording."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from rfca_rig.view.messages import Message

BEATS_HZ = 25.0
STATES_HZ = 5.0
SHORTEST_SPAN_S = 0.05


class Feed(Protocol):
    """One page's; asked at every beat."""

    def news(self) -> Sequence[Message]:
        """What the page does not know yet."""
        ...

    def hear(self, said: Mapping[str, Any]) -> None:
        """What the page says; what makes no sense is passed over."""
        ...


class FeedSource(Protocol):
    """Where the feeds of any number of pages come from."""

    def hello(self) -> Message: ...

    def feed(self) -> Feed:
        """For one more page."""
        ...

    def stop(self, how: str) -> bool:
        """False where there is nothing to stop. Raises LookupError for an unknown way to."""
        ...


def number_in(said: Mapping[str, Any], name: str) -> float | None:
    """A number that a page sent, None where it is none."""
    value = said.get(name)
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e9 else None
