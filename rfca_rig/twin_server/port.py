"""What the server does with each of its openings to the outside."""

from typing import Protocol


class Port(Protocol):
    """Never waits; the server calls it before and after each step of the twins."""

    def address(self) -> str:
        """How to reach it, as a client is told."""
        ...

    def poll(self, now_s: float) -> None:
        """Takes in what has arrived, gives out what is waiting. `now_s` is the server's clock."""
        ...

    def close(self) -> None:
        """May be called any number of times."""
        ...
