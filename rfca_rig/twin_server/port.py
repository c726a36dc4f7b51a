"""Protocol of the server's ports."""

from typing import Protocol


class Port(Protocol):
    """A port to the outside. It never waits; the server polls it before and after each step of the twins."""

    def address(self) -> str:
        """Address of the port, as shown to the user."""
        ...

    def poll(self, now_s: float) -> None:
        """Receives what has arrived, sends what is queued. `now_s` is the server's clock."""
        ...

    def close(self) -> None:
        """Closes the port. May be called any number of times."""
        ...
