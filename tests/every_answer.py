"""Looks at every final answer of a diagnosis that is made in this process, for any caller.

The entry point `diagnose` limits linear algebra to one thread by the decorator
`single_threaded_blas`. So every final answer passes the decorator, also where a command imports the
entry point when it runs. It is replaced before the package is imported. Answers that are made in
other processes are not seen.
"""

from collections.abc import Callable
from functools import wraps
from types import TracebackType
from typing import Any

from rfca_rig.executors import cores

# Title of each answer since the last test ended, and the contradictions in them.
SEEN: list[str] = []
_CONTRADICTIONS: list[str] = []

_limit_threads = cores.single_threaded_blas


class WatchedLimit:
    """`single_threaded_blas`, which looks at the answer of a function that it decorates."""

    def __init__(self) -> None:
        self._limit = _limit_threads()

    def __enter__(self) -> None:
        self._limit.__enter__()

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> bool | None:
        return self._limit.__exit__(kind, error, traceback)

    def __call__(self, function: Callable[..., Any]) -> Callable[..., Any]:
        limited = self._limit(function)

        @wraps(function)
        def watched(*positional: Any, **named: Any) -> Any:
            answer = limited(*positional, **named)
            look_at(answer)
            return answer

        watched.is_watched = True
        return watched


def watch_entry_points() -> None:
    """Call it before any module of the diagnosis is imported."""
    cores.single_threaded_blas = WatchedLimit


def look_at(answer: Any) -> None:
    """Keeps the contradictions of a Diagnosis, also of the one in an Answer."""
    # The first test of a diagnosis has imported them; other tests need not wait for them.
    from rfca_rig.diagnosis.result import Diagnosis
    from tests.diagnosis.invariants import list_contradictions

    diagnosis = getattr(answer, "diagnosis", answer)
    if not isinstance(diagnosis, Diagnosis):
        return
    SEEN.append(diagnosis.title)
    for contradiction in list_contradictions(diagnosis):
        _CONTRADICTIONS.append(f"the answer about {diagnosis.title!r}: {contradiction}")


def take_contradictions() -> list[str]:
    """The contradictions of all answers since the last call."""
    contradictions = list(_CONTRADICTIONS)
    _CONTRADICTIONS.clear()
    return contradictions
