"""Faults that come and go by the clock, as ordered on the command line: NAME@SECONDS or NAME@FROM-TO."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import isfinite

from rfca_rig.errors import BadInput
from rfca_rig.twin_server.faults import FaultPanel


@dataclass(frozen=True, order=True)
class Switching:
    """One fault goes on or off `at_s` after the server began."""

    at_s: float
    name: str
    on: bool


def switchings(orders: Sequence[str]) -> tuple[Switching, ...]:
    """All of them in order of time. Raises BadInput for an order that cannot be read."""
    return tuple(sorted(switching for order in orders for switching in _of(order)))


def _of(order: str) -> list[Switching]:
    name, at, when = order.partition("@")
    begin, dash, end = when.partition("-")
    try:
        moments_s = [float(moment) for moment in ((begin, end) if dash else (begin,))]
    except ValueError:
        moments_s = []
    if not at or not name or not moments_s or moments_s != sorted(moments_s) or not all(isfinite(s) and s >= 0 for s in moments_s):
        raise BadInput(f"--fault {order}: write NAME@SECONDS or NAME@FROM-TO, as in force-lost@2-4")
    return [Switching(at_s, name, on) for at_s, on in zip(moments_s, (True, False), strict=False)]


class Agenda:
    """Hands each switching to the panel once its moment has come. Raises BadInput at once for a fault that is not there."""

    def __init__(self, orders: Sequence[Switching], panel: FaultPanel) -> None:
        for order in orders:
            panel.switch_off(order.name)
        self._left = list(orders)
        self._panel = panel

    def pass_to(self, now_s: float) -> list[Switching]:
        """What was switched on or off by now, since the last call."""
        done = []
        while self._left and self._left[0].at_s <= now_s:
            switching = self._left.pop(0)
            (self._panel.switch_on if switching.on else self._panel.switch_off)(switching.name)
            done.append(switching)
        return done
