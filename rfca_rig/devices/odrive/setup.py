"""Sets up an ODrive over CAN: what its firmware and an endpoint file allow. The motor stays off.

Firmware 0.6 takes a node id without further help, and any setting through the endpoints of its
`flat_endpoints.json`. Firmware 0.5 saves nothing over CAN: its lines are for odrivetool.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import can

from rfca_rig.clock import Clock
from rfca_rig.devices.checks import LISTEN_S, Listener, ReceivedFrame, join_ids, mean_period_s
from rfca_rig.devices.drive_setup import DriveNeeds, DriveSetup, Setting
from rfca_rig.devices.odrive import codec, settings
from rfca_rig.devices.odrive.checks import IDENTIFYING_COMMANDS, WARNING_PERIOD_RATIO
from rfca_rig.devices.odrive.endpoints import RELEASES, EndpointFile, read_endpoint_file
from rfca_rig.devices.odrive.messages import (
    BROADCAST_NODE,
    Address,
    AxisState,
    BusPower,
    Heartbeat,
    Message,
    OdriveCommand,
    OdriveFirmware,
    RebootAction,
    TxSdo,
    Version,
    error_text,
    state_text,
)
from rfca_rig.devices.odrive.section import OdriveSection
from rfca_rig.errors import DeviceError, MalformedFrame

# An answer takes less than a millisecond on a free bus; a lost question is asked again.
ANSWER_S = 0.05
TRIES = 3
STEP_S = 1e-3
# Adapters hold frames from before the bus was opened: they come at once, and are left out.
STALE_S = 0.05
# Firmware 0.6.11 and later answer a write as well: that answer passes before the value is read.
WRITTEN_S = 0.01
# A drive that saves writes its flash and starts again. How long a real one takes was not measured.
RESTART_S = 2.0
LONGEST_RESTART_S = 8.0
HEARD_S = 0.1

Reply = TypeVar("Reply", bound=Message)


@dataclass(frozen=True)
class FoundDrive:
    """The drive that is set up, by what it told. `node_id` is its present one."""

    node_id: int
    beat: Heartbeat
    version: Version | None
    serial_number: int | None
    voltage_V: float | None


class OdriveSetup(DriveSetup):
    """The settings of the ODrive that a rig file names, or of the only other one on the bus."""

    def __init__(
        self, keys: OdriveSection, bus: can.BusABC, clock: Clock, needs: DriveNeeds
    ) -> None:
        """Raises BadInput for an endpoint file that cannot be used."""
        self._keys = keys
        self._needs = needs
        self._clock = clock
        self._listener = Listener(bus, clock)
        self._dialect = OdriveFirmware(keys.dialect)
        self._names = settings.NAMES[self._dialect]
        self._file: EndpointFile | None = None
        if needs.maker_file is not None:
            self._file = read_endpoint_file(needs.maker_file)
        self._drive: FoundDrive | None = None
        self._others: tuple[int, ...] = ()

    def list_wanted(self) -> tuple[Setting, ...]:
        return settings.list_wanted(self._keys, self._needs)

    def read(self) -> tuple[Setting, ...]:
        """Listens for a second, then asks the drive. Raises DeviceError, and BadInput where the
        endpoint file is for another firmware.
        """
        self._listener.listen(STALE_S)
        heard = self._listener.listen(LISTEN_S)
        self._check_bus()
        node = self._choose_node(heard)
        beat = self._await_beat(node, heard)
        # Nothing more is asked of a drive that runs: any frame feeds its watchdog.
        if beat.state != AxisState.IDLE:
            raise DeviceError(
                f"node {node} is in {state_text(beat.state)}, not idle: its settings are left "
                "alone; end the program that runs it, or type in odrivetool "
                "odrv0.axis0.requested_state = AxisState.IDLE"
            )
        self._drive = self._identify(node, beat)
        measured = self._measure(node, heard)
        stored: dict[str, float] = {}
        if self._file is not None and self._drive.version is not None:
            self._file.check_version(self._drive.version)
            stored = self._read_endpoints(self._file, node)
        settings_read = []
        for setting in self.list_wanted():
            if setting.name in stored:
                found = replace(setting, actual=stored[setting.name])
            else:
                found = _compare_measured(setting, measured.get(setting.name))
            can_write = setting.can_write and self._can_write(setting.name)
            settings_read.append(replace(found, can_write=can_write))
        return tuple(settings_read)

    def _check_bus(self) -> None:
        if self._listener.failed is not None:
            raise DeviceError(f"the CAN bus failed: {self._listener.failed}")

    def _choose_node(self, heard: Sequence[ReceivedFrame]) -> int:
        """The node id of the drive to set up: that of the rig file, or the only other one."""
        nodes = _list_nodes(heard)
        if not nodes and self._dialect == OdriveFirmware.V0_6:
            # A drive may send nothing by itself. All drives answer the question for addresses.
            self._listener.ask(_question(codec.request(BROADCAST_NODE, OdriveCommand.ADDRESS)))
            nodes = _list_nodes(self._listener.listen(ANSWER_S))
            self._check_bus()
        wanted = self._keys.node_id
        self._others = tuple(sorted(nodes - {wanted}))
        if wanted in nodes:
            return wanted
        if len(nodes) == 1:
            self._others = ()
            return nodes.pop()
        if nodes:
            raise DeviceError(
                f"nodes {join_ids(self._others)} answer, and the rig file has {wanted}; put the "
                "right one under [motor], or unplug the other drives while this one is set up"
            )
        raise DeviceError(
            f"no ODrive answers at {self._keys.bitrate} bit/s; check power, wiring and the 120 ohm "
            "at both ends; a new drive has 250000 bit/s: type the lines of --print in odrivetool "
            "over USB"
        )

    def _await_beat(self, node: int, heard: Sequence[ReceivedFrame]) -> Heartbeat:
        beats = [
            message
            for message in map(self._decode, _from_node(heard, node))
            if isinstance(message, Heartbeat)
        ]
        if beats:
            return beats[-1]
        beat = self._ask(codec.request(node, OdriveCommand.HEARTBEAT), Heartbeat)
        if beat is None:
            raise DeviceError(
                f"node {node} sends no heartbeat, so that nobody knows whether its motor is on; "
                f"in odrivetool: odrv0.{self._names.heartbeat} = 100"
            )
        return beat

    def _identify(self, node: int, beat: Heartbeat) -> FoundDrive:
        version = self._ask(codec.request(node, OdriveCommand.VERSION), Version)
        is_newer = self._dialect == OdriveFirmware.V0_6
        if is_newer and version is None:
            raise DeviceError(
                f'node {node} does not tell its firmware, as 0.5 does not: put dialect = "0.5" '
                "under [motor], with torque_constant_Nm_per_A"
            )
        if not is_newer and version is not None:
            raise DeviceError(
                f"node {node} has firmware {'.'.join(map(str, version.firmware))}: put "
                'dialect = "0.6" under [motor]'
            )
        address = None
        if is_newer:
            address = self._ask(codec.request(node, OdriveCommand.ADDRESS), Address)
        power = self._ask(codec.request(node, OdriveCommand.BUS_VOLTAGE_CURRENT), BusPower)
        serial_number = None
        if address is not None:
            serial_number = address.serial_number
        voltage_V = None
        if power is not None:
            voltage_V = power.voltage_V
        return FoundDrive(node, beat, version, serial_number, voltage_V)

    def _measure(self, node: int, heard: Sequence[ReceivedFrame]) -> dict[str, float]:
        """What CAN shows without an endpoint file: the bit rate at which the drive answers, its
        number, and the periods of its messages, 0 for one that does not come.
        """
        frames = _from_node(heard, node)
        messages = {
            self._names.heartbeat: OdriveCommand.HEARTBEAT,
            self._names.encoder: OdriveCommand.ENCODER_ESTIMATES,
            self._names.iq: OdriveCommand.IQ,
        }
        if self._dialect == OdriveFirmware.V0_6:
            messages |= {
                self._names.torques: OdriveCommand.TORQUES,
                self._names.temperature: OdriveCommand.TEMPERATURES,
            }
        actual = {
            settings.BAUD_RATE: float(self._keys.bitrate),
            settings.NODE_ID: float(node),
        }
        for name, command in messages.items():
            period_s = mean_period_s(
                [frame for frame in frames if frame.message.arbitration_id & 0x1F == command]
            )
            actual[name] = round(1e3 * (period_s or 0.0), 1)
        return actual

    def _read_endpoints(self, file: EndpointFile, node: int) -> dict[str, float]:
        actual = {}
        for setting in self.list_wanted():
            # The bit rate is what both speak; the value in the drive may be meant for later.
            if setting.name != settings.BAUD_RATE and setting.name in file.endpoints:
                value = self._read_endpoint(file, node, setting.name)
                if value is not None:
                    actual[setting.name] = value
        return actual

    def _read_endpoint(self, file: EndpointFile, node: int, name: str) -> float | None:
        endpoint = file.endpoints[name]
        answer = self._ask(
            codec.read_endpoint(node, endpoint.endpoint_id),
            TxSdo,
            lambda reply: reply.endpoint_id == endpoint.endpoint_id,
            is_question=False,
        )
        if answer is None:
            return None
        return endpoint.decode(answer.value)

    def _can_write(self, name: str) -> bool:
        if name == settings.NODE_ID:
            return self._drive is not None and self._drive.serial_number is not None
        return self._file is not None and name in self._file.endpoints

    def describe(self) -> tuple[str, ...]:
        drive = self._drive
        if drive is None:
            return ()
        words = [f"ODrive, node {drive.node_id}"]
        if drive.serial_number is not None:
            words.append(f"serial number {drive.serial_number:012X}")
        if drive.version is None:
            words.append("firmware 0.5")
        else:
            words.append(f"firmware {'.'.join(map(str, drive.version.firmware))}")
            words.append(f"board {'.'.join(map(str, drive.version.hardware))}")
        words.append(state_text(drive.beat.state))
        if drive.beat.error:
            words.append(error_text(drive.beat.error, self._dialect))
        if drive.voltage_V is not None:
            words.append(f"{drive.voltage_V:.1f} V")
        lines = [", ".join(words)]
        if drive.node_id != self._keys.node_id:
            lines.append(f"node {drive.node_id} answers, the rig file has {self._keys.node_id}")
        if self._others:
            lines.append(f"also on the bus: node {join_ids(self._others)}")
        if self._dialect == OdriveFirmware.V0_5:
            lines.append(
                "firmware 0.5 shows and saves no settings over CAN: use the lines of --print"
            )
        elif self._file is None:
            lines.append(
                "the rest needs --endpoints with the flat_endpoints.json of this firmware, from "
                f"{RELEASES}"
            )
        return tuple(lines)

    def write(self, settings_to_write: Sequence[Setting]) -> None:
        """The node id comes last: from then on the drive has another address. Raises DeviceError
        where the drive keeps another value.
        """
        drive = self._found()
        new_node = None
        for setting in settings_to_write:
            if setting.wanted is None:
                continue
            if setting.name == settings.NODE_ID:
                new_node = round(setting.wanted)
            else:
                self._write_endpoint(drive.node_id, setting.name, setting.wanted)
        if new_node is not None:
            self._write_node(drive, new_node)

    def _write_endpoint(self, node: int, name: str, wanted: float) -> None:
        if self._file is None:
            raise DeviceError(f"{name} cannot be written without an endpoint file")
        endpoint = self._file.endpoints[name]
        value = endpoint.encode(wanted)
        self._listener.ask(_command(codec.write_endpoint(node, endpoint.endpoint_id, value)))
        self._listener.listen(WRITTEN_S)
        self._check_bus()
        kept = self._read_endpoint(self._file, node, name)
        if kept != endpoint.decode(value):
            raise DeviceError(
                f"node {node} does not take {name} = {wanted:g}: it keeps {kept}; nothing was saved"
            )

    def _write_node(self, drive: FoundDrive, node: int) -> None:
        if drive.serial_number is None:
            raise DeviceError(f"node {drive.node_id} does not tell its serial number")
        self._listener.ask(
            _command(codec.address(BROADCAST_NODE, Address(node, drive.serial_number)))
        )
        self._check_bus()
        answer = self._ask(codec.request(node, OdriveCommand.ADDRESS), Address)
        if answer is None or answer.serial_number != drive.serial_number:
            raise DeviceError(f"the drive does not answer as node {node} after it was told to")
        self._drive = replace(drive, node_id=node)

    def save(self) -> None:
        """The drive saves and starts again. Raises DeviceError where it does not come back."""
        node = self._found().node_id
        self._listener.ask(_command(codec.reboot(node, RebootAction.SAVE_CONFIGURATION)))
        self._listener.listen(RESTART_S)
        deadline_s = self._clock.now_s() + LONGEST_RESTART_S
        # It is not asked meanwhile: frames that no device acknowledges fill the adapter's queue.
        while self._clock.now_s() < deadline_s:
            self._check_bus()
            if _from_node(self._listener.listen(HEARD_S), node):
                return
        if self._ask(codec.request(node, OdriveCommand.HEARTBEAT), Heartbeat) is not None:
            return
        raise DeviceError(
            f"node {node} did not come back within {LONGEST_RESTART_S:g} s after it was to save; "
            "switch its power off and on, and run the command again"
        )

    def list_lines(self, settings_to_write: Sequence[Setting]) -> tuple[str, ...]:
        """For odrivetool, connected by USB."""
        lines = []
        for setting in settings_to_write:
            if setting.wanted is None:
                # Typed alone, a name prints its value.
                lines.append(f"odrv0.{setting.name}")
            else:
                lines.append(f"odrv0.{setting.name} = {_in_python(setting.name, setting.wanted)}")
        return (*lines, "odrv0.save_configuration()")

    def _found(self) -> FoundDrive:
        if self._drive is None:
            raise DeviceError("read the drive before anything is written to it")
        return self._drive

    def _decode(self, frame: ReceivedFrame) -> Message | None:
        try:
            return codec.decode(frame.message.arbitration_id, frame.message.data, self._dialect)
        except MalformedFrame as error:
            raise DeviceError(f"the drive cannot be understood: {error}") from error

    def _ask(
        self,
        frame: codec.Frame,
        kind: type[Reply],
        is_answer: Callable[[Reply], bool] = lambda _: True,
        is_question: bool = True,
    ) -> Reply | None:
        """The answer of the node that the frame is for; None where it does not come."""
        node = codec.node_of(frame[0])
        for attempt in range(TRIES):
            # The firmware takes an empty data frame for a question too, which adapters without
            # remote frames need; on a busy bus it may collide with the answer.
            if is_question and attempt < TRIES - 1:
                self._listener.ask(_question(frame))
            else:
                self._listener.ask(_command(frame))
            until_s = self._clock.now_s() + ANSWER_S
            while self._clock.now_s() < until_s:
                for heard in _from_node(self._listener.listen(STEP_S), node):
                    message = self._decode(heard)
                    if isinstance(message, kind) and is_answer(message):
                        return message
            self._check_bus()
        return None


def _compare_measured(setting: Setting, measured: float | None) -> Setting:
    """A period that was measured by this computer's clock is right to the share that the doctor
    takes for right.
    """
    if measured is None or setting.unit != "ms" or setting.wanted is None:
        return replace(setting, actual=measured)
    least = setting.wanted if setting.least is None else setting.least
    most = setting.wanted if setting.most is None else setting.most
    return replace(
        setting,
        actual=measured,
        least=least / WARNING_PERIOD_RATIO,
        most=most * WARNING_PERIOD_RATIO,
    )


def _list_nodes(heard: Sequence[ReceivedFrame]) -> set[int]:
    """Nodes that behave as ODrives: only a drive sends these messages."""
    nodes = set()
    for frame in heard:
        message = frame.message
        command = message.arbitration_id & 0x1F
        is_address = command == OdriveCommand.ADDRESS and message.dlc in (7, 8)
        is_report = command in IDENTIFYING_COMMANDS and message.dlc == 8
        if not message.is_extended_id and (is_report or is_address):
            nodes.add(codec.node_of(message.arbitration_id))
    return nodes


def _from_node(heard: Sequence[ReceivedFrame], node: int) -> list[ReceivedFrame]:
    return [
        frame
        for frame in heard
        if not frame.message.is_extended_id
        and codec.node_of(frame.message.arbitration_id) == node
        and frame.message.dlc
    ]


def _question(frame: codec.Frame) -> can.Message:
    return can.Message(arbitration_id=frame[0], is_extended_id=False, is_remote_frame=True)


def _command(frame: codec.Frame) -> can.Message:
    return can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False)


def _in_python(name: str, value: float) -> str:
    """The value as it is typed in odrivetool."""
    if name in settings.SWITCHES:
        return str(bool(value))
    if value == round(value):
        return str(round(value))
    return f"{value:g}"


def make_setup(
    keys: OdriveSection, bus: can.BusABC, clock: Clock, needs: DriveNeeds
) -> OdriveSetup:
    """The settings of the drive that [motor] names."""
    return OdriveSetup(keys, bus, clock, needs)
