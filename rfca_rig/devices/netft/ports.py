"""Ports of the twin of the box: commands over TCP, its web page, and its records over UDP.

Between the twin and the network is a datagram link with injected faults.
"""

import socket
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.force_sensors import SATURATED, newton_metres_per, newtons_per
from rfca_rig.codecs.sensor_axes import SensorAxes
from rfca_rig.devices.netft.codec import (
    COMMAND_BYTES,
    LOW_PASS_HZ,
    RECORD_BYTES,
    NetFtConfiguration,
    RdtCommand,
    Records,
    ToolTransformation,
    decode_records,
    decode_request,
    encode_records,
    encode_request,
)
from rfca_rig.devices.netft.section import BOX_RATE_HZ, NetFtConnection, NetFtSection
from rfca_rig.devices.netft.twin import (
    AXIA_OUT_OF_RANGE,
    LARGEST_COUNT,
    PRODUCTS,
    LowPass,
    NetFtBoxTwin,
    NetFtTwin,
    Page,
)
from rfca_rig.errors import MalformedFrame
from rfca_rig.twin_server.faults import Fault, FaultPanel
from rfca_rig.twin_server.open_ports import OpenPorts, SensorWire, TwinMaker
from rfca_rig.twin_server.tcp import TcpClient, accept_all, bound_udp, listening_tcp
from rfca_rig.twins.wires import DatagramLink, datagram_link
from rfca_rig.twins.world import SensorTwin

LONGEST_REQUEST = 8192
# Of one connection: a page takes milliseconds.
LONGEST_S = 10.0
REASONS = {
    200: "OK",
    400: "Bad Request",
    404: "Not Found",
    405: "Method Not Allowed",
    503: "Service Unavailable",
}
STARTS = frozenset({RdtCommand.START_SINGLE, RdtCommand.START_BUFFERED})
LONGEST_DATAGRAM = 2048
# Taken in one step of the server's millisecond; a client sends a handful. A sender that floods must
# not keep the loop here.
MOST_REQUESTS = 100
# After a delay the twin sends many datagrams at once.
SEND_BUFFER_BYTES = 1 << 20

# Faults of single datagrams hit every tenth one.
FAULT_INTERVAL = 10

# Names are used on the command line and in docs/fault-table.md.
FORCE_FAULTS = (
    Fault("force-lost", "every tenth datagram is lost"),
    Fault("force-twice", "every tenth datagram comes twice"),
    Fault("force-swapped", "every tenth datagram is overtaken by the next"),
    Fault("force-short", "every tenth datagram lacks its last 9 bytes"),
    Fault("force-long", "every tenth datagram has one byte too many"),
    Fault("force-silent", "no datagram leaves the box"),
    Fault(
        "force-stuck",
        (
            "every record has the values of the first, though all counters run on, as with a "
            "transducer that was unplugged"
        ),
    ),
    Fault(
        "force-frozen",
        "records keep coming, but the sensor's own sample counter and values stand still",
    ),
    Fault("force-saturated", "every record carries status 0x80020000"),
    Fault(
        "force-scale",
        (
            "twice the counts per newton and newton metre, as after a change on the box's "
            "web page, which says so"
        ),
    ),
    Fault(
        "box-turned",
        "the box turns all forces by 90 degrees about z; its web page says so",
    ),
    Fault("box-filter", "the box filters with 5 Hz; its web page says so, by a code"),
    Fault("box-pounds", "the box counts in lbf and lbf-in; its web page says so"),
    Fault(
        "box-axia",
        "the box is an Ethernet Axia that is out of range: status 0xc0000000, and its own web page",
    ),
    Fault("bias-stops-stream", "a bias request ends the stream"),
    Fault("box-restart", "the stream ends and the sensor's sample counter begins at 0", once=True),
    Fault("stream-stolen", "another client took the stream, until it is started again", once=True),
)
BOX_FAULTS = (Fault("http-busy", "the box's web server turns every request away"),)


FILTER_CODE = "8"
TURNED_IN_THE_BOX = ToolTransformation(turn_deg=(0.0, 0.0, 90.0))
TURNED_90 = SensorAxes(("-y", "x", "z"))
POUNDS_PER_UNIT = 1.0 / np.repeat([newtons_per("lbf"), newton_metres_per("lbf-in")], 3)


def state_faults(as_set: NetFtConfiguration, panel: FaultPanel) -> NetFtConfiguration:
    """The configuration on the page of a box with the faults that are on."""
    configuration = as_set
    if panel.is_on("force-scale"):
        configuration = replace(
            configuration,
            counts_per_force=2.0 * as_set.counts_per_force,
            counts_per_torque=2.0 * as_set.counts_per_torque,
        )
    if panel.is_on("box-pounds"):
        configuration = replace(configuration, force_unit="lbf", torque_unit="lbf-in")
    if panel.is_on("box-filter"):
        configuration = replace(configuration, low_pass=FILTER_CODE)
    if panel.is_on("box-turned"):
        configuration = replace(configuration, tool_transformation=TURNED_IN_THE_BOX)
    if panel.is_on("box-axia"):
        configuration = replace(configuration, product=PRODUCTS[True], is_axia=True)
    return configuration


class TamperedBox:
    """Implements `NetFtBox` for a driver in the same process, with the faults of a panel."""

    def __init__(self, box: NetFtBoxTwin, panel: FaultPanel) -> None:
        self._box = box
        self._panel = panel

    def read_configuration(self) -> NetFtConfiguration:
        return state_faults(self._box.read_configuration(), self._panel)


@dataclass
class _Connection:
    client: TcpClient
    rest: bytes = b""


class CommandPort:
    """Serves any number of clients at once. Write commands are not answered."""

    def __init__(self, box: NetFtBoxTwin, host: str, port: int) -> None:
        self._box = box
        self._listening = listening_tcp(host, port)
        self._host, self.port = self._listening.getsockname()
        self._connections: list[_Connection] = []

    def address(self) -> str:
        return f"Net F/T commands on TCP {self._host}:{self.port}"

    def poll(self, now_s: float) -> None:
        self._connections += [
            _Connection(client) for client in accept_all(self._listening, len(self._connections))
        ]
        for connection in self._connections:
            connection.rest += connection.client.receive()
            # TCP has no message borders: commands are cut from the byte stream by their length.
            while len(connection.rest) >= COMMAND_BYTES:
                connection.client.send(self._box.answer(connection.rest[:COMMAND_BYTES]))
                connection.rest = connection.rest[COMMAND_BYTES:]
            connection.client.flush(now_s)
        for connection in [
            connection for connection in self._connections if connection.client.done
        ]:
            self._connections.remove(connection)
            connection.client.close()

    def close(self) -> None:
        for connection in self._connections:
            connection.client.close()
        self._connections.clear()
        self._listening.close()


@dataclass
class _HttpConnection:
    client: TcpClient
    request: bytes = b""
    answered: bool = False
    since_s: float = 0.0


class HttpPort:
    """Serves GET only. The fault `http-busy` acts here, and every fault that the page states."""

    def __init__(self, box: NetFtBoxTwin, panel: FaultPanel, host: str, port: int) -> None:
        self._box = box
        self._panel = panel
        self._as_set = box.configuration
        self._listening = listening_tcp(host, port)
        self._host, self.port = self._listening.getsockname()
        self._connections: list[_HttpConnection] = []

    def address(self) -> str:
        return f"Net F/T pages on HTTP {self._host}:{self.port}"

    def poll(self, now_s: float) -> None:
        self._connections += [
            _HttpConnection(client, since_s=now_s)
            for client in accept_all(self._listening, len(self._connections))
        ]
        for connection in self._connections:
            self._listen(connection)
            connection.client.flush(now_s)
            if now_s - connection.since_s > LONGEST_S:
                connection.client.open = False
        for connection in [
            connection for connection in self._connections if connection.client.done
        ]:
            self._connections.remove(connection)
            connection.client.close()

    def _listen(self, connection: _HttpConnection) -> None:
        connection.request += connection.client.receive()
        # The request is complete at the empty line; one that is too long is answered as far as it
        # came.
        if connection.answered or (
            b"\r\n\r\n" not in connection.request and len(connection.request) <= LONGEST_REQUEST
        ):
            return
        connection.answered = True
        connection.client.send(
            _bytes(
                self._answer(
                    connection.request.split(b"\r\n")[0].decode("ascii", "replace").split()
                )
            )
        )
        # HTTP with "Connection: close": the client sees the end of the page by the end of the
        # connection.
        connection.client.finish()

    def _answer(self, words: list[str]) -> Page:
        if len(words) != 3 or not words[2].startswith("HTTP/1."):
            return Page(400, "text/plain", b"not a request")
        if words[0] != "GET":
            return Page(405, "text/plain", b"GET only")
        self._box.busy = self._panel.is_on("http-busy")
        # Set again for each request, as a fault may have been switched since the last one.
        self._box.configuration = state_faults(self._as_set, self._panel)
        return self._box.page(words[1])

    def close(self) -> None:
        for connection in self._connections:
            connection.client.close()
        self._connections.clear()
        self._listening.close()


def _bytes(page: Page) -> bytes:
    head = (
        f"HTTP/1.1 {page.status} {REASONS.get(page.status, 'Unknown')}",
        f"Content-Type: {page.content_type}",
        f"Content-Length: {len(page.body)}",
        "Connection: close",
    )
    return "\r\n".join(head).encode("ascii") + b"\r\n\r\n" + page.body


class UdpLink:
    """Sends records to the source of the last start request: a second client takes the stream from
    the first, as on the box.

    A datagram that the network refuses is lost, like one lost on the way.
    """

    def __init__(self, host: str, port: int) -> None:
        self._socket = bound_udp(host, port)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER_BYTES)
        self._host, self.port = self._socket.getsockname()
        self._listener: tuple[str, int] | None = None

    def address(self) -> str:
        return f"Net F/T RDT on UDP {self._host}:{self.port}"

    def send(self, datagram: bytes) -> None:
        if self._listener is not None:
            with suppress(OSError):
                self._socket.sendto(datagram, self._listener)

    def receive_all(self) -> list[bytes]:
        """Requests since the last call, oldest first; never waits."""
        requests: list[bytes] = []
        for _ in range(MOST_REQUESTS):
            try:
                request, sender = self._socket.recvfrom(LONGEST_DATAGRAM)
            except BlockingIOError:
                break
            # ICMP "port unreachable" for an earlier datagram: its receiver is gone.
            except ConnectionError:
                continue
            self._note(request, sender)
            requests.append(request)
        return requests

    def _note(self, request: bytes, sender: tuple[str, int]) -> None:
        try:
            starts = decode_request(request).command in STARTS
        except MalformedFrame:
            return
        if starts:
            self._listener = sender

    def close(self) -> None:
        self._socket.close()


class TamperedLink:
    """The twin's link; the faults of the panel act on its datagrams."""

    def __init__(self, link: DatagramLink, panel: FaultPanel) -> None:
        self._link = link
        self._panel = panel
        self._sent = 0
        self._overtaken: bytes | None = None
        self._stolen = False
        self._samples_before_restart = 0
        self._last_sample = 0
        self._frozen: Records | None = None
        self._stuck: Records | None = None
        self._low_pass: LowPass | None = None

    def receive_all(self) -> list[bytes]:
        """Received requests, with those that a fault adds."""
        requests: list[bytes] = []
        if self._panel.take("box-restart"):
            self._samples_before_restart = self._last_sample
            requests.append(encode_request(RdtCommand.STOP))
        self._stolen = self._stolen or self._panel.take("stream-stolen")
        for request in self._link.receive_all():
            command = _command(request)
            # A new start request takes the stream back.
            self._stolen = self._stolen and command not in STARTS
            requests.append(request)
            if command == RdtCommand.SET_BIAS and self._panel.is_on("bias-stops-stream"):
                requests.append(encode_request(RdtCommand.STOP))
        return requests

    def send(self, datagram: bytes) -> None:
        self._sent += 1
        # The internal sample counter is the second word of a record; the last record of the
        # datagram counts.
        self._last_sample = int.from_bytes(datagram[-RECORD_BYTES:][4:8], "big")
        if self._stolen or self._panel.is_on("force-silent"):
            return
        # An earlier fault may have an after-effect: a shifted sample counter, or a datagram that is
        # held back.
        if (
            not self._panel.any_on()
            and self._samples_before_restart == 0
            and self._overtaken is None
        ):
            self._link.send(datagram)
            return
        for altered in self._apply_network_faults(
            encode_records(self._apply_box_faults(decode_records(datagram)))
        ):
            self._link.send(altered)

    def _apply_box_faults(self, records: Records) -> Records:
        """Applies the faults inside the box."""
        records = replace(
            records, ft_sequence=records.ft_sequence - np.uint32(self._samples_before_restart)
        )
        records = replace(records, counts=self._apply_settings(records))
        if self._panel.is_on("box-axia"):
            records = replace(records, status=np.full_like(records.status, AXIA_OUT_OF_RANGE))
        if self._panel.is_on("force-saturated"):
            records = replace(records, status=np.full_like(records.status, SATURATED))
        if self._panel.is_on("force-stuck"):
            self._stuck = self._stuck or records
        else:
            self._stuck = None
        if self._stuck is not None:
            records = replace(
                records, counts=np.broadcast_to(self._stuck.counts[0], records.counts.shape).copy()
            )
        if self._panel.is_on("force-frozen"):
            self._frozen = self._frozen or records
        else:
            self._frozen = None
        if self._frozen is None:
            return records
        return _repeat_sample(records, self._frozen)

    def _apply_settings(self, records: Records) -> NDArray[np.int32]:
        """Counts of a box that is set otherwise than the rig file says."""
        counts = records.counts.astype(np.float64)
        if self._panel.is_on("force-scale"):
            counts *= 2.0
        if self._panel.is_on("box-pounds"):
            counts *= POUNDS_PER_UNIT
        if self._panel.is_on("box-turned"):
            # A frame that is turned by 90 degrees about z.
            counts = TURNED_90.to_device(counts)
        if self._panel.is_on("box-filter"):
            self._low_pass = self._low_pass or LowPass(LOW_PASS_HZ[FILTER_CODE])
            # Neighbouring records; a single one is as long as all of the box's own samples.
            steps = np.diff(records.ft_sequence).view(np.int32)
            step = max(1, int(steps.max(initial=1)))
            counts = self._low_pass.apply(counts, step / BOX_RATE_HZ)
        else:
            self._low_pass = None
        return np.rint(np.clip(counts, -LARGEST_COUNT, LARGEST_COUNT)).astype(np.int32)

    def _apply_network_faults(self, datagram: bytes) -> list[bytes]:
        """Applies the network faults, to every tenth datagram."""
        waiting = self._overtaken
        self._overtaken = None
        if self._sent % FAULT_INTERVAL == 0:
            if self._panel.is_on("force-lost"):
                datagrams = []
            elif self._panel.is_on("force-twice"):
                datagrams = [datagram, datagram]
            elif self._panel.is_on("force-short"):
                datagrams = [datagram[: -RECORD_BYTES // 4]]
            elif self._panel.is_on("force-long"):
                datagrams = [datagram + b"\0"]
            elif self._panel.is_on("force-swapped"):
                self._overtaken = datagram
                datagrams = []
            else:
                datagrams = [datagram]
        else:
            datagrams = [datagram]
        if waiting is None:
            return datagrams
        return [*datagrams, waiting]

    def close(self) -> None:
        self._link.close()


def _command(request: bytes) -> int | None:
    try:
        return decode_request(request).command
    except MalformedFrame:
        return None


def _repeat_sample(records: Records, frozen: Records) -> Records:
    """Records that repeat the sample of `frozen`; their record numbers run on."""
    return replace(
        records,
        ft_sequence=np.full_like(records.ft_sequence, frozen.ft_sequence[0]),
        counts=np.broadcast_to(frozen.counts[0], records.counts.shape).copy(),
    )


class NetFtWire(SensorWire):
    """Datagrams: records by UDP, and the box's own answers beside them."""

    faults = FORCE_FAULTS
    port_faults = BOX_FAULTS

    def connect(
        self, keys: NetFtSection, make_twin: TwinMaker, panel: FaultPanel | None
    ) -> tuple[SensorTwin, NetFtConnection]:
        """The twin at one end of a link, and what the driver talks to at the other."""
        drivers_end, twins_end = datagram_link()
        twin = make_twin(twins_end if panel is None else TamperedLink(twins_end, panel))
        if keys.configuration == "unchecked":
            return twin, NetFtConnection(drivers_end, None)
        box = NetFtBoxTwin(twin)
        if panel is not None:
            return twin, NetFtConnection(drivers_end, TamperedBox(box, panel))
        return twin, NetFtConnection(drivers_end, box)

    def open(
        self,
        keys: NetFtSection,  # noqa: ARG002 (the port that it names is that of the real box)
        panel: FaultPanel,
        ports: OpenPorts,
    ) -> Callable[[TwinMaker], SensorTwin]:
        """Opens the port of the records; those of the box open with its twin."""
        openings = ports.openings
        link = UdpLink(openings.host, openings.rdt_port)
        ports.note(link.address(), link.close, host=openings.host, rdt_port=link.port)

        def put_on_ports(make_twin: TwinMaker) -> SensorTwin:
            twin: NetFtTwin = make_twin(TamperedLink(link, panel))
            box = NetFtBoxTwin(twin)
            pages = HttpPort(box, panel, openings.host, openings.http_port)
            ports.add(pages, http_port=pages.port)
            commands = CommandPort(box, openings.host, openings.command_port)
            ports.add(commands, command_port=commands.port)
            return twin

        return put_on_ports


WIRE = NetFtWire()
