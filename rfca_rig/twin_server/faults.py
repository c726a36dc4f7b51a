"""Catalogue of injected faults, their schedule, and the panel that switches them while the server runs.

Schedule of faults from the command line: NAME@SECONDS or NAME@FROM-TO.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite

from rfca_rig.errors import BadInput


@dataclass(frozen=True)
class Fault:
    """A `once` fault happens when it is switched on; the others last until they are switched off."""

    name: str
    meaning: str
    once: bool = False


# Names are used on the command line and in docs/fault-table.md.
FORCE_FAULTS = (
    Fault("force-lost", "every tenth datagram is lost"),
    Fault("force-twice", "every tenth datagram comes twice"),
    Fault("force-swapped", "every tenth datagram is overtaken by the next"),
    Fault("force-short", "every tenth datagram lacks its last 9 bytes"),
    Fault("force-long", "every tenth datagram has one byte too many"),
    Fault("force-silent", "no datagram leaves the box"),
    Fault("force-stuck", "every record has the values of the first, though all counters run on, as with a transducer that was unplugged"),
    Fault("force-frozen", "records keep coming, but the sensor's own sample counter and values stand still"),
    Fault("force-saturated", "every record carries status 0x80020000"),
    Fault("force-scale", "twice the counts per newton and newton metre, as after a change on the box's web page, which says so"),
    Fault("bias-stops-stream", "a bias request ends the stream"),
    Fault("box-restart", "the stream ends and the sensor's sample counter begins at 0", once=True),
    Fault("stream-stolen", "another client took the stream, until it is started again", once=True),
)
BOX_FAULTS = (Fault("http-busy", "the box's web server turns every request away"),)
CAN_FAULTS = (
    Fault("can-silent", "the drive hears but says nothing"),
    Fault("bus-off", "the drive neither hears nor says anything"),
    Fault("can-short", "every frame of the drive lacks its last byte"),
    Fault("own-frame-echo", "what is sent to the drive comes back to the sender"),
    Fault("can-twice", "every frame of the drive comes twice"),
)
DRIVE_FAULTS = (
    Fault("drive-restart", "the drive starts again: without torque, and its position counts from elsewhere", once=True),
    Fault("drive-hot", "the motor warms by 5 K every second, and the drive has no limit of its own", once=True),
    Fault("temperature-stuck", "the temperature that the drive tells never changes again", once=True),
    Fault("encoder-frozen", "every report of the position is the next one over again", once=True),
)
ODRIVE_FAULTS = (
    Fault("heartbeat-silent", "encoder reports go on without heartbeats"),
    Fault("encoder-jump", "the encoder reads one motor turn more"),
    Fault("watchdog-trip", "the drive says its watchdog expired, and goes idle", once=True),
    Fault("over-temperature", "the drive says its motor is too hot, and goes idle", once=True),
    Fault("idle-unasked", "the drive goes idle without any error", once=True),
    *DRIVE_FAULTS,
)


class FaultPanel:
    """State of all faults."""

    def __init__(self, catalogue: Iterable[Fault]) -> None:
        self._known = {fault.name: fault for fault in catalogue}
        self._on: set[str] = set()

    def switch_on(self, name: str) -> None:
        """Raises BadInput for a name that is not in the catalogue."""
        self._on.add(self._check_name(name))

    def switch_off(self, name: str) -> None:
        """Raises BadInput for a name that is not in the catalogue."""
        self._on.discard(self._check_name(name))

    def switch_all_off(self) -> None:
        self._on.clear()

    def is_on(self, name: str) -> bool:
        return name in self._on

    def any_on(self) -> bool:
        return bool(self._on)

    def take(self, name: str) -> bool:
        """Whether a one-time fault is pending; clears it."""
        is_pending = name in self._on
        self._on.discard(name)
        return is_pending

    def run_pending(self, events: Mapping[str, Callable[[], None]]) -> None:
        """Runs each pending event once."""
        for name, happen in events.items():
            if self.take(name):
                happen()

    def lines(self) -> list[str]:
        """One line per fault with its state and meaning."""
        return [
            f"{fault.name:<18} {'once' if fault.once else 'on  ' if self.is_on(fault.name) else 'off '} {fault.meaning}"
            for fault in self._known.values()
        ]

    def _check_name(self, name: str) -> str:
        if name not in self._known:
            raise BadInput(f"no fault is called {name!r}; there are {', '.join(self._known)}")
        return name


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
