"""Datagrams of a sensor, received by a separate process; a replacement for `UdpDatagrams`.

`run_acquisition` is the main function of that process: it only copies records from the sensor's
socket into the ring.
"""

import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait

import numpy as np

from rfca_rig import subprocesses
from rfca_rig.acquisition.ring import Ring, RingReader
from rfca_rig.clock import WallClock
from rfca_rig.drivers.ports import UdpDatagrams
from rfca_rig.errors import DeviceError

# Pause between two reads of the socket: 15 datagrams at 15 kHz, while the socket holds hundreds.
PAUSE_S = 1e-3
# Longest wait without records, in s.
IDLE_S = 0.2

MODULE = "rfca_rig.acquisition.acquired"

# 17 s of records at 15 kHz, 12 MB.
RING_RECORDS = 1 << 18
# A new interpreter has to import numpy, which takes long on a loaded machine.
STARTED_WITHIN_S = 30.0
ENDED_WITHIN_S = 2.0
# Cap per call, so that a flood of invalid datagrams cannot fill the memory.
MAX_REFUSED_PER_READ = 100


@dataclass(frozen=True)
class RecordSource:
    """Address of the sensor; each datagram holds 1..`most_records` records of `record_bytes`
    bytes.
    """

    host: str
    port: int
    record_bytes: int
    most_records: int


@dataclass(frozen=True)
class AcquisitionAssignment:
    """Source and destination of the records. `clock` is the parent's; its time is the same in
    both processes.
    """

    source: RecordSource
    ring_name: str
    clock: WallClock


def run_acquisition(parent: Connection) -> None:
    """Receives its assignment from the parent, and runs until the parent sends None, or has ended.

    Its first message is the granted receive buffer in bytes, or a text on why the sensor cannot be
    reached. Afterwards it forwards the bytes that it is given, and reports an error as text, once
    until the next command. ^C is left to the parent.
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

    def __init__(
        self,
        source: RecordSource,
        datagrams: UdpDatagrams,
        ring: Ring,
        clock: WallClock,
        parent: Connection,
    ) -> None:
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
            records = np.frombuffer(b"".join(whole), np.uint8).reshape(
                -1, self._source.record_bytes
            )
            self._ring.write(self._clock.now_s(), records)
        return bool(arrived)

    def _is_whole(self, datagram: bytes) -> bool:
        count, remainder = divmod(len(datagram), self._source.record_bytes)
        if remainder == 0 and 1 <= count <= self._source.most_records:
            return True
        self._ring.refuse(len(datagram))
        return False


def start_acquisition(
    assignment: AcquisitionAssignment,
) -> tuple[subprocess.Popen[bytes], Connection]:
    """Starts the acquisition process; returns it and a connection to it."""
    return subprocesses.spawn(MODULE, assignment)


class AcquiredDatagrams:
    """Implements `drivers.datagrams.Datagrams` for one sensor. No record is lost, whatever this
    process does meanwhile.

    `receive_all` returns the records in order, but not in their original datagrams: each returned
    one holds as many records as fit. A datagram that was not whole records is replaced by zero
    bytes of the length of the latest such datagram. Views and recorders in other processes attach
    to the ring by `ring_name`. The process ends with `close`, and by itself when this one dies.

    Raises DeviceError if the host cannot be addressed.
    """

    def __init__(
        self, source: RecordSource, clock: WallClock, ring_records: int = RING_RECORDS
    ) -> None:
        self._source = source
        self._peer = f"{source.host}:{source.port}"
        self._ring = Ring.create(ring_records, source.record_bytes)
        self._reader = RingReader(self._ring)
        self._refused = 0
        self.ring_name = self._ring.name
        try:
            self._process, self._child = start_acquisition(
                AcquisitionAssignment(source, self.ring_name, clock)
            )
        except OSError as error:
            self._ring.remove()
            raise DeviceError(
                f"acquisition of {self._peer}: no process can be started: {error}"
            ) from error
        self.receive_buffer_bytes = self._await_started()

    def _await_started(self) -> int:
        """Receive buffer in bytes that the process was granted: its first message."""
        try:
            if self._child.poll(STARTED_WITHIN_S):
                message = self._child.recv()
            else:
                message = f"it did not start within {STARTED_WITHIN_S:g} s"
        except EOFError:
            message = "it ended before it began"
        if isinstance(message, int):
            return message
        self.close()
        raise DeviceError(f"acquisition of {self._peer}: {message}")

    @property
    def process_id(self) -> int:
        """Process id of the reading process, to measure its CPU time."""
        return self._process.pid

    @property
    def overrun(self) -> int:
        """Number of records overwritten before this side read them; they also appear as gaps in
        the record numbers.
        """
        return self._reader.overrun

    def send(self, datagram: bytes) -> None:
        try:
            self._child.send(datagram)
        except OSError as error:
            raise DeviceError(
                f"acquisition of {self._peer} has ended: {error}; start the run again"
            ) from error

    def receive_all(self) -> list[bytes]:
        self._check()
        records = self._reader.read().records
        most = self._source.most_records
        in_one = [records[at : at + most].tobytes() for at in range(0, len(records), most)]
        refused, size = self._ring.refused
        new = refused - self._refused
        self._refused = refused
        # The driver's decoder refuses the zeros, and so counts the datagram as malformed.
        return in_one + [bytes(size)] * min(new, MAX_REFUSED_PER_READ)

    def _check(self) -> None:
        """Raises DeviceError for an error that the process reported, or if it has ended."""
        try:
            if self._child.poll():
                raise DeviceError(self._child.recv())
        except (EOFError, OSError) as error:
            raise DeviceError(
                f"acquisition of {self._peer} has ended by itself; start the run again"
            ) from error

    def close(self) -> None:
        """Ends the process, which takes a few milliseconds, and removes the ring."""
        if self._child.closed:
            return
        # The process may have just ended.
        with suppress(OSError):
            self._child.send(None)
        try:
            self._process.wait(ENDED_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._child.close()
        self._ring.remove()


if __name__ == "__main__":
    with Connection(int(sys.argv[1])) as parent:
        run_acquisition(parent)
