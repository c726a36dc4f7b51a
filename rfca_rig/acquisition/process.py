"""Main function of the acquisition process: it only copies records from the sensor's socket into the ring."""

import signal
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait

import numpy as np

from rfca_rig.acquisition.ring import Ring
from rfca_rig.clock import WallClock
from rfca_rig.drivers.ports import UdpDatagrams
from rfca_rig.errors import DeviceError

# Pause between two reads of the socket: 15 datagrams at 15 kHz, while the socket holds hundreds.
PAUSE_S = 1e-3
# Longest wait without records, in s.
IDLE_S = 0.2


@dataclass(frozen=True)
class RecordSource:
    """Address of the sensor; each datagram holds 1..`most_records` records of `record_bytes` bytes."""

    host: str
    port: int
    record_bytes: int
    most_records: int


@dataclass(frozen=True)
class AcquisitionAssignment:
    """Source and destination of the records. `clock` is the parent's; its time is the same in both processes."""

    source: RecordSource
    ring_name: str
    clock: WallClock


def run_acquisition(parent: Connection) -> None:
    """Receives its assignment from the parent, and runs until the parent sends None, or has ended.

    Its first message is the granted receive buffer in bytes, or a text on why the sensor cannot be reached. Afterwards it forwards
    the bytes that it is given, and reports an error as text, once until the next command. ^C is left to the parent.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    assignment: AcquisitionAssignment = parent.recv()
    try:
        ring = Ring.attach(assignment.ring_name)
        datagrams = UdpDatagrams(assignment.source.host, assignment.source.port)
    except DeviceError as error:
        parent.send(str(error))
        return
    try:
        parent.send(datagrams.receive_buffer_bytes)
        RecordCopier(assignment.source, datagrams, ring, assignment.clock, parent).run()
    finally:
        datagrams.close()
        ring.close()


class RecordCopier:
    """Copies records from the socket to the ring, and commands of the parent to the socket."""

    def __init__(self, source: RecordSource, datagrams: UdpDatagrams, ring: Ring, clock: WallClock, parent: Connection) -> None:
        self._source = source
        self._datagrams = datagrams
        self._ring = ring
        self._clock = clock
        self._parent = parent
        self._has_reported = False

    def run(self) -> None:
        while self._obey():
            if self._copy_records():
                self._clock.wait_until(self._clock.now_s() + PAUSE_S)
            else:
                # Nothing is coming: sleep until a datagram or a command arrives.
                wait([self._datagrams.fileno(), self._parent], IDLE_S)

    def _obey(self) -> bool:
        """Forwards the parent's commands. False if the parent is done or gone."""
        try:
            while self._parent.poll():
                command = self._parent.recv()
                if command is None:
                    return False
                self._has_reported = False
                self._send(command)
        except (EOFError, ConnectionError):
            return False
        return True

    def _send(self, order: bytes) -> None:
        try:
            self._datagrams.send(order)
        except DeviceError as error:
            self._report_error(error)

    def _report_error(self, error: DeviceError) -> None:
        # An unreachable sensor fails at every read; one message until the next command is enough.
        if not self._has_reported:
            self._has_reported = True
            self._parent.send(str(error))

    def _copy_records(self) -> bool:
        """Copies what has arrived to the ring. True if anything had."""
        try:
            arrived = self._datagrams.receive_all()
        except DeviceError as error:
            self._report_error(error)
            return False
        whole = [datagram for datagram in arrived if self._is_whole(datagram)]
        if whole:
            records = np.frombuffer(b"".join(whole), np.uint8).reshape(-1, self._source.record_bytes)
            self._ring.write(self._clock.now_s(), records)
        return bool(arrived)

    def _is_whole(self, datagram: bytes) -> bool:
        count, remainder = divmod(len(datagram), self._source.record_bytes)
        if remainder == 0 and 1 <= count <= self._source.most_records:
            return True
        self._ring.refuse(len(datagram))
        return False
