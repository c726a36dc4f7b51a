"""Waits for what another thread or process does, with patience for a machine that is busy with
something else.
"""

import time
from collections.abc import Callable

PATIENCE_S = 60.0


def wait_for(condition: Callable[[], bool]) -> None:
    """Returns once the condition holds; fails where it does not within `PATIENCE_S`."""
    until_s = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < until_s, f"nothing came of it within {PATIENCE_S:g} s"
        time.sleep(0.002)
