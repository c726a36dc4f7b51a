"""Schedule of faults from the command line: NAME@SECONDS or NAME@FROM-TO."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from rfca_rig.errors import BadInput
from rfca_rig.twin_server.faults import FaultPanel


@dataclass(frozen=True, order=True)
class FaultEvent:
    """One fault switched on or off `at_s` after the start of the server."""

    at_s: float
    name: str
    on: bool


def parse_fault_events(orders: Sequence[str]) -> tuple[FaultEvent, ...]:
    """Parses all options into events in order of time. Raises BadInput for an invalid one."""
    return tuple(sorted(switching for order in orders for switching in _parse(order)))


def _parse(order: str) -> list[FaultEvent]:
    name, at, when = order.partition("@")
    begin, dash, end = when.partition("-")
    try:
        times_s = [float(time) for time in ((begin, end) if dash else (begin,))]
    except ValueError:
        times_s = []
    if not at or not name or not times_s or times_s != sorted(times_s) or not all(isfinite(s) and s >= 0 for s in times_s):
        raise BadInput(f"--fault {order}: write NAME@SECONDS or NAME@FROM-TO, as in force-lost@2-4")
    # With one time only, the fault stays on.
    return [FaultEvent(at_s, name, on) for at_s, on in zip(times_s, (True, False), strict=False)]


class FaultSchedule:
    """Switches each fault at its time. Raises BadInput at once for an unknown fault."""

    def __init__(self, orders: Sequence[FaultEvent], panel: FaultPanel) -> None:
        for order in orders:
            # Switching off is harmless, and raises for an unknown name before the server starts.
            panel.switch_off(order.name)
        self._left = list(orders)
        self._panel = panel

    def pass_to(self, now_s: float) -> list[FaultEvent]:
        """Switches the faults that are due by `now_s`; returns the events since the last call."""
        switched = []
        while self._left and self._left[0].at_s <= now_s:
            switching = self._left.pop(0)
            (self._panel.switch_on if switching.on else self._panel.switch_off)(switching.name)
            switched.append(switching)
        return switched
