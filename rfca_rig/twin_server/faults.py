"""Catalogue of injected faults, their schedule, and the panel that switches them while the server
runs.

Also how the faults of a drive and its bus act. Those of one make are in its folder (`devices`).

The schedule comes from the command line, NAME@SECONDS or NAME@FROM-TO, or from text commands to the
TCP port of the running server, which is always on the loopback address only.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import isfinite, radians
from typing import Any

import can

from rfca_rig.codecs.fdcanusb import FD_LENGTHS
from rfca_rig.errors import BadInput, RigError
from rfca_rig.twin_server.tcp import LOOPBACK, TcpClient, accept_all, is_http, listening_tcp
from rfca_rig.twins.drive_parts import DriveTwin

LONGEST_LINE = 1024
# Of a hand, in N, and of its lever, in mm.
LARGEST_PUSH = 1000.0
# Heating rate of the fault `drive-hot` in K/s.
HEATING_K_s = 5.0
VERBS = (
    "on NAME, off NAME, off all, faults, status, height MM, hold DEG, let go, "
    "push FX FY FZ [LEVER_MM], tool LINE"
)


@dataclass(frozen=True)
class Fault:
    """A `once` fault happens when it is switched on; the others last until they are switched
    off.
    """

    name: str
    meaning: str
    once: bool = False


# Names are used on the command line and in docs/fault-table.md.
CAN_FAULTS = (
    Fault("can-silent", "the drive hears but says nothing"),
    Fault("bus-off", "the drive neither hears nor says anything"),
    Fault("can-short", "every frame of the drive lacks its last byte"),
    Fault("own-frame-echo", "what is sent to the drive comes back to the sender"),
    Fault("can-twice", "every frame of the drive comes twice"),
)
DRIVE_FAULTS = (
    Fault(
        "drive-restart",
        "the drive starts again: without torque, and its position counts from elsewhere",
        once=True,
    ),
    Fault(
        "drive-hot",
        "the motor warms by 5 K every second, and the drive has no limit of its own",
        once=True,
    ),
    Fault(
        "temperature-stuck", "the temperature that the drive tells never changes again", once=True
    ),
    Fault("encoder-frozen", "every report of the position is the next one over again", once=True),
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
        lines = []
        for fault in self._known.values():
            if fault.once:
                state = "once"
            elif self.is_on(fault.name):
                state = "on"
            else:
                state = "off"
            lines.append(f"{fault.name:<18} {state:<4} {fault.meaning}")
        return lines

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

    @property
    def words(self) -> str:
        """As in "force-lost on"."""
        if self.on:
            return f"{self.name} on"
        return f"{self.name} off"


def parse_fault_events(orders: Sequence[str]) -> tuple[FaultEvent, ...]:
    """Parses all options into events in order of time. Raises BadInput for an invalid one."""
    return tuple(sorted(switching for order in orders for switching in _parse(order)))


def _parse(order: str) -> list[FaultEvent]:
    name, at, when = order.partition("@")
    begin, dash, end = when.partition("-")
    times = [begin]
    if dash:
        times.append(end)
    try:
        times_s = [float(time) for time in times]
    except ValueError:
        times_s = []
    if (
        not at
        or not name
        or not times_s
        or times_s != sorted(times_s)
        or not all(isfinite(s) and s >= 0 for s in times_s)
    ):
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
            if switching.on:
                self._panel.switch_on(switching.name)
            else:
                self._panel.switch_off(switching.name)
            switched.append(switching)
        return switched


@dataclass
class _Connection:
    client: TcpClient
    rest: bytes = b""


def refuse_line(line: str) -> str:  # noqa: ARG001 (whatever it says)
    """For a drive whose twin has no tool of its maker."""
    raise BadInput("the twin of this drive has no tool of its maker")


class ControlPort:
    """Answers each line with one or more lines, the last of which begins with `ok` or `error`.

    `set_height` takes metres; `status` returns the server's state in one line. `push` takes the
    force in N of a hand along the rig's axes, and in metres how far from the shaft along y it acts.
    `type_line` takes a line of the drive's own tool, and returns what it prints. `hold` takes the
    angle in rad at which a hand holds the shaft, None to let it go.
    """

    def __init__(
        self,
        panel: FaultPanel,
        port: int,
        set_height: Callable[[float], None],
        status: Callable[[], str],
        push: Callable[[tuple[float, float, float], float], None] | None = None,
        type_line: Callable[[str], str] = refuse_line,
        hold: Callable[[float | None], None] = lambda _: None,
    ) -> None:
        self._panel = panel
        self._push = push
        self._type_line = type_line
        self._hold = hold
        self._set_height = set_height
        self._status = status
        # Faults and heights are for the local user, even if the device ports are open to the
        # network.
        self._listening = listening_tcp(LOOPBACK, port)
        self.port = int(self._listening.getsockname()[1])
        self._connections: list[_Connection] = []

    def address(self) -> str:
        return f"control lines on TCP {LOOPBACK}:{self.port} ({VERBS})"

    def poll(self, now_s: float) -> None:
        self._connections += [
            _Connection(client) for client in accept_all(self._listening, len(self._connections))
        ]
        for connection in self._connections:
            self._listen(connection)
            connection.client.flush(now_s)
        for connection in [
            connection for connection in self._connections if not connection.client.open
        ]:
            self._connections.remove(connection)
            connection.client.close()

    def _listen(self, connection: _Connection) -> None:
        received = connection.rest + connection.client.receive()
        # The body of a browser's request may hold valid commands; none of it is obeyed.
        if is_http(received):
            connection.client.open = False
            return
        *lines, connection.rest = received.split(b"\n")
        for line in lines:
            answer = self._answer(line.decode("ascii", "replace").split())
            connection.client.send(
                "".join(f"{reply}\n" for reply in answer).encode("ascii", "replace")
            )
        # A client that never ends its line must not fill the memory.
        if len(connection.rest) > LONGEST_LINE:
            connection.client.open = False

    def _answer(self, words: list[str]) -> list[str]:
        try:
            if words:
                return [*self._execute(words), "ok"]
            return []
        # Also of the simulation: where the leg has no rest pose at a height, the server goes on at
        # the height before.
        except RigError as error:
            return [f"error {error}"]

    def _execute(self, words: list[str]) -> list[str]:
        match words:
            case ["on", name]:
                self._panel.switch_on(name)
            case ["off", "all"]:
                self._panel.switch_all_off()
            case ["off", name]:
                self._panel.switch_off(name)
            case ["faults"]:
                return self._panel.lines()
            case ["status"]:
                return [self._status()]
            case ["tool", *line]:
                return [self._type_line(" ".join(line))]
            case _:
                self._move(words)
        return []

    def _move(self, words: list[str]) -> None:
        """What is done to the rig by hand."""
        match words:
            case ["height", height_mm]:
                self._set_height(_height_m(height_mm))
            case ["push", *numbers] if self._push is not None and len(numbers) in {3, 4}:
                fx, fy, fz, *lever_mm = _read_push(numbers)
                self._push((fx, fy, fz), sum(lever_mm) / 1e3)
            case ["hold", angle_deg]:
                self._hold(radians(_angle_deg(angle_deg)))
            case ["let", "go"]:
                self._hold(None)
            case _:
                raise BadInput(f"cannot read {' '.join(words)[:60]!r}; the commands are {VERBS}")

    def close(self) -> None:
        for connection in self._connections:
            connection.client.close()
        self._connections.clear()
        self._listening.close()


def _read_push(texts: Sequence[str]) -> list[float]:
    try:
        numbers = [float(text) for text in texts]
    except ValueError:
        numbers = []
    if not numbers or not all(abs(number) <= LARGEST_PUSH for number in numbers):
        raise BadInput(
            f"push {' '.join(texts)[:60]} is no force along x, y, z and lever, of at most "
            f"{LARGEST_PUSH:g} N and mm"
        )
    return numbers


def _height_m(height_mm: str) -> float:
    try:
        height = float(height_mm)
    except ValueError:
        height = float("nan")
    if not 0.0 < height < 1000.0:
        raise BadInput(f"height {height_mm[:20]} is not one in millimetres, above 0 and below 1000")
    return 1e-3 * height


def _angle_deg(text: str) -> float:
    try:
        angle_deg = float(text)
    except ValueError:
        angle_deg = float("nan")
    if not abs(angle_deg) <= 180.0:
        raise BadInput(f"{text[:20]} is no angle in degrees, from -180 to 180")
    return angle_deg


def drive_events(motor: DriveTwin) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""
    return {
        "drive-restart": motor.restart,
        "drive-hot": partial(setattr, motor.warmth, "fever_K_s", HEATING_K_s),
        "temperature-stuck": motor.warmth.stick,
        "encoder-frozen": motor.encoder.freeze,
    }


class DriveDialect:
    """Knowledge of the drive's frames that bus faults need; this one is for drives without
    faults that depend on it.
    """

    def is_heartbeat(self, message: can.Message) -> bool:  # noqa: ARG002 (none is)
        return False

    def shift_encoder(self, message: can.Message) -> can.Message:
        """The frame with a displaced encoder position; other frames unchanged."""
        return message


@dataclass(frozen=True)
class DriveFaults:
    """The faults of one kind of drive: their list, one-time events inside its twin by name, and
    what bus faults need of its frames.
    """

    faults: tuple[Fault, ...] = ()
    events: Callable[[Any], Mapping[str, Callable[[], None]]] = lambda _: {}
    dialect: DriveDialect = field(default_factory=DriveDialect)


class TamperedBus(can.BusABC):
    """The twin's bus; the faults of the panel act on the frames that pass."""

    def __init__(self, end: can.BusABC, panel: FaultPanel, dialect: DriveDialect) -> None:
        super().__init__(channel=end.channel_info)
        self.channel_info = end.channel_info
        self._end = end
        self._panel = panel
        self._dialect = dialect

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Sends a frame with the active faults. Raises can.CanOperationError once the end is
        shut down.
        """
        # Without faults, the usual case, a frame costs no further lookups.
        if self._panel.any_on():
            if self._panel.is_on("can-silent") or self._panel.is_on("bus-off"):
                return
            if self._panel.is_on("heartbeat-silent") and self._dialect.is_heartbeat(msg):
                return
            if self._panel.is_on("encoder-jump"):
                msg = self._dialect.shift_encoder(msg)
            if self._panel.is_on("can-short"):
                msg = _shorten(msg)
            # The frame is sent here a first time.
            if self._panel.is_on("can-twice"):
                self._end.send(msg, timeout)
        self._end.send(msg, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message = self._end.recv(timeout)
        # A drive without a bus receives nothing: what arrives meanwhile is lost.
        while message is not None and self._panel.is_on("bus-off"):
            message = self._end.recv(timeout)
        if message is not None and self._panel.is_on("own-frame-echo"):
            self._end.send(message)
        return message, False

    def shutdown(self) -> None:
        super().shutdown()
        self._end.shutdown()


def replace_data(message: can.Message, data: bytes) -> can.Message:
    """The same frame with other data, and the matching length."""
    return can.Message(
        arbitration_id=message.arbitration_id,
        data=data,
        is_extended_id=message.is_extended_id,
        is_fd=message.is_fd,
        bitrate_switch=message.bitrate_switch,
    )


def _shorten(message: can.Message) -> can.Message:
    """Removes the last byte; on CAN-FD as many as lead to the next valid length."""
    length = len(message.data) - 1
    if message.is_fd:
        length = max((size for size in FD_LENGTHS if size <= length), default=0)
    return replace_data(message, bytes(message.data[: max(length, 0)]))
