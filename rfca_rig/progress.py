"""How far long work has come, told to whoever wants to know."""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

T = TypeVar("T")

Watcher = Callable[[int, int], None]
Told = Callable[[str, int, int], None]
"""Is told what is being done, how many of it are done, and of how many."""


def silent(what: str, done: int, of: int) -> None:
    """Tells nobody."""


def unwatched(_done: int, _of: int) -> None:
    """For work that nobody watches."""


def counted(items: Sequence[T], told: Watcher) -> Iterator[T]:
    """The items; before each, and behind the last, `told` hears how many are done, of how many."""
    for number, item in enumerate(items):
        told(number, len(items))
        yield item
    if items:
        told(len(items), len(items))
