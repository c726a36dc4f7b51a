"""The settings that a moteus keeps, read and written by text commands on its diagnostic stream."""

from collections.abc import Sequence
from math import nan

import can

from rfca_rig.clock import Clock
from rfca_rig.devices.checks import Listener
from rfca_rig.devices.drive_setup import DriveNeeds, DriveSetup, Setting
from rfca_rig.devices.moteus import codec, console
from rfca_rig.devices.moteus.checks import MoteusSeen, judge_moteus, look_for_moteus
from rfca_rig.devices.moteus.codec import (
    MAX_STREAM_BYTES,
    ClientStreamData,
    Mode,
    Route,
    ServerStreamData,
    StreamPoll,
    StreamSubframe,
    mode_text,
)
from rfca_rig.devices.moteus.driver import OWN_ID
from rfca_rig.devices.moteus.section import MoteusSection
from rfca_rig.drivers.can_frames import BusHealth, receive_frames, send
from rfca_rig.errors import BadInput, DeviceError, MalformedFrame

REMEDY = "check the adapter, its cable and the drive's power"
# Interval between two polls, and time for the answer to a poll, in s.
POLL_S = 2e-3
ANSWER_S = 0.1
# Time for the answer to a command, in s: to save, the drive erases its flash.
COMMAND_S = 3.0
# A stream without bytes for this time holds no more of what was asked before, in s; and the time in
# which it must come to that.
QUIET_S = 0.05
FLUSH_S = 1.0
# Modes in which the motor is off.
OFF = frozenset({Mode.STOPPED, Mode.FAULT})
# What a drive may do where its watchdog expires: turn freely, damp the motion, or short the
# windings. The other one holds the shaft with all torque that it has.
SAFE_TIMEOUT_MODES = (0, 12, 15)
DAMP = 12
# From the factory, with no prefix.
NEW_DRIVE_ID = 1
# Both take effect at once, so that the drive is reached by other frames from then on.
ADDRESS = (console.CAN_PREFIX, console.ID)

# Name, purpose and unit of the settings that are read, in the order of the list.
NAMES = (
    (console.ID, "number on the bus", ""),
    (console.CAN_PREFIX, "upper bits of the CAN id", ""),
    (console.POSITION_MIN, "lowest position: none, for a leg that turns", "rev"),
    (console.POSITION_MAX, "highest position: none, for a leg that turns", "rev"),
    (console.DEFAULT_TIMEOUT, "watchdog of commands that bring none", "s"),
    (console.TIMEOUT_MODE, "when it expires: 0 free, 10 hold, 12 damp, 15 brake", ""),
    (console.TIMEOUT_TORQUE, "largest torque of damping", "N m"),
    (console.MAX_CURRENT, "largest phase current", "A"),
    (console.MAX_VELOCITY, "speed above which torque is reduced", "rev/s"),
    (console.VELOCITY_LIMIT, "of the drive's own trajectories; commands switch it off", "rev/s"),
    (console.ACCELERATION_LIMIT, "likewise", "rev/s^2"),
    (console.OUTPUT_RATIO, "output turns per motor turn; gear_ratio is beyond it", ""),
    (console.POLES, "of the motor, two for each pair; 0 is not calibrated", ""),
)


class DiagnosticStream:
    """Text commands to one drive, each with its answer."""

    def __init__(
        self, bus: can.BusABC, clock: Clock, drive_id: int, prefix: int, bitrate_switch: bool
    ) -> None:
        self.drive_id = drive_id
        self.prefix = prefix
        self._bus = bus
        self._clock = clock
        self._health = BusHealth()
        self._bitrate_switch = bitrate_switch

    def begin(self) -> None:
        """Ends what a program before may have left: half a command, and reports that the drive
        sends by itself. Raises DeviceError.
        """
        # The first one may only complete such a half, which the drive then refuses.
        for _ in range(2):
            self._send_line("tel stop")
            self._flush()

    def _flush(self) -> None:
        """Takes what the drive sends, until it is quiet."""
        until_s = self._clock.now_s() + FLUSH_S
        quiet_since_s = self._clock.now_s()
        while self._clock.now_s() - quiet_since_s < QUIET_S:
            if self._poll():
                quiet_since_s = self._clock.now_s()
            if self._clock.now_s() > until_s:
                raise DeviceError(
                    f"drive {self.drive_id} keeps sending on its diagnostic stream; end the other "
                    "program that uses it, such as tview"
                )

    def get(self, name: str) -> float:
        """The setting that is in force. Raises DeviceError."""
        command = f"conf get {name}"
        self._send_line(command)
        answer = self._await_line(command)
        try:
            if not answer.startswith("ERR"):
                return console.parse_setting(answer)
        except MalformedFrame:
            answer = f"answered {answer[:40]!r}"
        raise DeviceError(
            f"drive {self.drive_id} does not tell {name} ({answer}); update its firmware: "
            f"python -m moteus.moteus_tool --target {self.drive_id} --flash FILE"
        )

    def execute(self, command: str) -> None:
        """Has a command executed. Raises DeviceError where the drive refuses it."""
        self._send_line(command)
        self._await_ok(command)

    def _await_ok(self, command: str) -> None:
        answer = self._await_line(command)
        if not answer.startswith("OK"):
            raise DeviceError(
                f"drive {self.drive_id} refused {command!r}: {answer}; compare with the reference "
                "of its firmware"
            )

    def set(self, name: str, value: float) -> None:
        """Changes a setting; it is in force at once, and not saved. Raises DeviceError."""
        command = f"conf set {name} {console.format_setting(value)}"
        self._send_line(command)
        # The answer to this one comes from the new address already.
        if name == console.ID:
            self.drive_id = int(value)
        if name == console.CAN_PREFIX:
            self.prefix = int(value)
        self._await_ok(command)

    def _send_line(self, line: str) -> None:
        data = line.encode("ascii", "replace") + console.LINE_END
        for first in range(0, len(data), MAX_STREAM_BYTES):
            piece = data[first : first + MAX_STREAM_BYTES]
            self._send(ClientStreamData(console.CHANNEL, piece), wants_reply=False)

    def _await_line(self, command: str) -> str:
        until_s = self._clock.now_s() + COMMAND_S
        received = b""
        while self._clock.now_s() < until_s:
            received += self._poll()
            lines, _ = console.split_lines(received)
            if lines:
                return lines[0]
        raise DeviceError(
            f"drive {self.drive_id} did not answer {command!r} within {COMMAND_S:g} s; {REMEDY}"
        )

    def _poll(self) -> bytes:
        """The bytes that the drive has now; none where it does not answer in time."""
        self._send(StreamPoll(console.CHANNEL, MAX_STREAM_BYTES), wants_reply=True)
        until_s = self._clock.now_s() + ANSWER_S
        while self._clock.now_s() < until_s:
            self._clock.wait_until(self._clock.now_s() + POLL_S)
            for message in receive_frames(self._bus, self._health, REMEDY):
                answer = self._answer_in(message)
                if answer is not None:
                    return answer.data
        return b""

    def _answer_in(self, message: can.Message) -> ServerStreamData | None:
        route = codec.route_of(message.arbitration_id)
        if route != Route(self.drive_id, OWN_ID, prefix=self.prefix):
            return None
        try:
            subframes = codec.decode(message.data)
        # A damaged answer is lost; the command then has none.
        except MalformedFrame:
            return None
        for item in subframes:
            if isinstance(item, ServerStreamData) and item.channel == console.CHANNEL:
                return item
        return None

    def _send(self, subframe: StreamSubframe, wants_reply: bool) -> None:
        identifier = codec.arbitration_id(Route(OWN_ID, self.drive_id, wants_reply, self.prefix))
        message = can.Message(
            arbitration_id=identifier,
            is_extended_id=True,
            is_fd=True,
            bitrate_switch=self._bitrate_switch,
            data=codec.encode([subframe]),
        )
        send(self._bus, message, REMEDY)


class MoteusSetup(DriveSetup):
    """The settings of one moteus. A drive with another id than the rig file's is found where it is
    the only one on the bus, and gets that id when it is written.
    """

    def __init__(
        self, keys: MoteusSection, bus: can.BusABC, clock: Clock, needs: DriveNeeds
    ) -> None:
        if needs.maker_file is not None:
            raise BadInput(f"{needs.maker_file}: a moteus has no endpoints; leave --endpoints out")
        self._keys = keys
        self._bus = bus
        self._clock = clock
        self._open_stream: DiagnosticStream | None = None

    def list_wanted(self) -> tuple[Setting, ...]:
        wanted = self._wanted(DAMP)
        return tuple(
            Setting(name, purpose, wanted.get(name), None, unit) for name, purpose, unit in NAMES
        )

    def read(self) -> tuple[Setting, ...]:
        stream = self._stream()
        actual = {name: stream.get(name) for name, _, _ in NAMES}
        timeout_mode = actual[console.TIMEOUT_MODE]
        if timeout_mode not in SAFE_TIMEOUT_MODES:
            timeout_mode = DAMP
        wanted = self._wanted(timeout_mode)
        return tuple(
            Setting(name, purpose, wanted.get(name), actual[name], unit)
            for name, purpose, unit in NAMES
        )

    def describe(self) -> tuple[str, ...]:
        """The drive that the last `read` found."""
        stream = self._open_stream
        if stream is None:
            return ()
        line = f"moteus {stream.drive_id}, stopped"
        if stream.drive_id != self._keys.drive_id:
            line += f"; the rig file has {self._keys.drive_id}"
        return (line,)

    def _wanted(self, timeout_mode: float) -> dict[str, float]:
        keys = self._keys
        return {
            console.ID: keys.drive_id,
            console.CAN_PREFIX: keys.can_prefix,
            console.POSITION_MIN: nan,
            console.POSITION_MAX: nan,
            console.DEFAULT_TIMEOUT: keys.watchdog_ms / 1e3,
            console.TIMEOUT_MODE: timeout_mode,
        }

    def write(self, settings: Sequence[Setting]) -> None:
        stream = self._stream()
        # The address last: where an earlier setting is refused, the drive is still where it was.
        for setting in sorted(settings, key=lambda setting: setting.name in ADDRESS):
            if setting.wanted is not None:
                stream.set(setting.name, setting.wanted)

    def save(self) -> None:
        self._stream().execute("conf write")

    def list_lines(self, settings: Sequence[Setting]) -> tuple[str, ...]:
        settings = [setting for setting in settings if setting.wanted is not None]
        address = [setting for setting in settings if setting.name in ADDRESS]
        others = [setting for setting in settings if setting.name not in ADDRESS]
        # A drive that was not looked for is taken for a new one.
        lines = [_tool_line(NEW_DRIVE_ID, 0)]
        if self._open_stream is not None:
            lines = [_tool_line(self._open_stream.drive_id, self._open_stream.prefix)]
        lines += [_set_line(setting) for setting in (*others, *address)]
        if address:
            # The drive changes its address at once, and saves what it is told there.
            lines.append(_tool_line(self._keys.drive_id, self._keys.can_prefix))
        return (*lines, "conf write")

    def _stream(self) -> DiagnosticStream:
        """The stream to the drive, which is looked for at the first call."""
        if self._open_stream is None:
            drive_id, prefix = self._find_drive()
            stream = DiagnosticStream(
                self._bus, self._clock, drive_id, prefix, self._keys.bitrate_switch
            )
            stream.begin()
            self._open_stream = stream
        return self._open_stream

    def _find_drive(self) -> tuple[int, int]:
        """Id and prefix of the drive. Raises DeviceError where there is none, or several, or one
        that runs.
        """
        keys = self._keys
        seen = self._look(keys.drive_id, keys.can_prefix)
        drive_id = keys.drive_id
        prefix = keys.can_prefix
        if seen.answer is None and not seen.others and prefix:
            # From the factory a drive has none.
            prefix = 0
            seen = self._look(drive_id, prefix)
        if seen.answer is None and len(seen.others) == 1:
            drive_id = seen.others[0]
            seen = self._look(drive_id, prefix)
        if seen.answer is None and seen.others:
            raise DeviceError(
                f"drives {', '.join(map(str, seen.others))} answer, none with the id "
                f"{keys.drive_id} of the rig file; correct drive_id under [motor], or connect the "
                "drive alone"
            )
        if seen.answer is None:
            finding = judge_moteus(seen, drive_id)[0]
            raise DeviceError(f"{finding.seen}; {finding.fix}")
        if seen.answer.mode not in OFF:
            raise DeviceError(
                f"drive {drive_id} is not stopped: {mode_text(seen.answer.mode)}; end the program "
                f"that runs it, or: python -m moteus.moteus_tool --target {drive_id} --stop"
            )
        return drive_id, prefix

    def _look(self, drive_id: int, prefix: int) -> MoteusSeen:
        listener = Listener(self._bus, self._clock)
        seen = look_for_moteus(listener, drive_id, prefix, self._keys.bitrate_switch)
        if listener.failed is not None:
            raise DeviceError(f"CAN bus failed while looking for the drive: {listener.failed}")
        return seen


def _set_line(setting: Setting) -> str:
    return f"conf set {setting.name} {console.format_setting(setting.wanted or 0.0)}"


def _tool_line(drive_id: int, prefix: int) -> str:
    """The line that starts the maker's window, where commands to a drive are typed."""
    line = f"python -m moteus_gui.tview --target {drive_id}"
    if prefix:
        line += f" --can-prefix {prefix}"
    return line
