"""Progress callbacks of long-running work."""

from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

T = TypeVar("T")

# Called with the number of items done, and their total.
ProgressCount = Callable[[int, int], None]
# Called with the name of the work, the number of items done, and their total.
ProgressReport = Callable[[str, int, int], None]
"""Called with what is being done, how many of it are done, and of how many."""


def ignore_named_progress(what: str, done: int, of: int) -> None:
    """Callback that ignores progress, with the name of the work."""


def ignore_share(step: str, share: float) -> None:
    """Callback that ignores the current step and the share of the work that is done."""


def ignore_progress(_done: int, _of: int) -> None:
    """Callback that ignores progress."""


def iterate_with_progress(items: Sequence[T], report_progress: ProgressCount) -> Iterator[T]:
    """Yields the items. Before each, and after the last, `report_progress` is called with the
    number done and the total.
    """
    for number, item in enumerate(items):
        report_progress(number, len(items))
        yield item
    if items:
        report_progress(len(items), len(items))
