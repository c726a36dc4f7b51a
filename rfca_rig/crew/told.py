"""How far a piece of work is."""

from collections.abc import Callable

Told = Callable[[str, int, int], None]
"""Is told what is being done, how many of it are done, and of how many."""


def silent(what: str, done: int, of: int) -> None:
    """Tells nobody."""
