"""A sensor's datagrams, read by a process of their own: stands where `UdpDatagrams` would."""

import subprocess
from contextlib import suppress

from rfca_rig.acquisition.process import AcquisitionAssignment, RecordSource
from rfca_rig.acquisition.ring import Ring, RingReader
from rfca_rig.acquisition.starting import started
from rfca_rig.clock import WallClock
from rfca_rig.codecs.rdt import MOST_RECORDS, PORT, RECORD_BYTES
from rfca_rig.errors import DeviceError

RING_RECORDS = 1 << 18  # 17 s at 15 kHz, 12 MB
STARTED_WITHIN_S = 30.0
ENDED_WITHIN_S = 2.0
MOST_REFUSED = 100


class AcquiredDatagrams:
    """Implements `drivers.datagrams.Datagrams` for one sensor. Whatever this process does meanwhile, no record is missed.

    What `receive_all` gives are the records in their order, but not the datagrams' own limits: as many records as fit stand in
    one. A datagram that was no whole records is stood for by as many zero bytes as the latest of them had. Views and recorders
    in other processes attach to the ring by `ring_name`. The process ends with `close`, and by itself when this one dies.

    Raises DeviceError where the host cannot be addressed.
    """

    def __init__(self, host: str, clock: WallClock, port: int = PORT, ring_records: int = RING_RECORDS) -> None:
        self._peer = f"{host}:{port}"
        self._ring = Ring.create(ring_records, RECORD_BYTES)
        self._reader = RingReader(self._ring)
        self._refused = 0
        self.ring_name = self._ring.name
        source = RecordSource(host, port, RECORD_BYTES, MOST_RECORDS)
        try:
            self._process, self._child = started(AcquisitionAssignment(source, self.ring_name, clock))
        except OSError as error:
            self._ring.remove()
            raise DeviceError(f"acquisition of {self._peer}: no process can be started: {error}") from error
        self.receive_buffer_bytes = self._granted()

    def _granted(self) -> int:
        """What the process says first."""
        try:
            said = self._child.recv() if self._child.poll(STARTED_WITHIN_S) else f"it did not start within {STARTED_WITHIN_S:g} s"
        except EOFError:
            said = "it ended before it began"
        if isinstance(said, int):
            return said
        self.close()
        raise DeviceError(f"acquisition of {self._peer}: {said}")

    @property
    def process_id(self) -> int:
        """Of the reading process, for watching its cost."""
        return self._process.pid

    @property
    def overrun(self) -> int:
        """Records that this side read too late; they are also missing from the numbers of what it got."""
        return self._reader.overrun

    def send(self, datagram: bytes) -> None:
        try:
            self._child.send(datagram)
        except OSError as error:
            raise DeviceError(f"acquisition of {self._peer} has ended: {error}; start the run anew") from error

    def receive_all(self) -> list[bytes]:
        self._check()
        records = self._reader.read().records
        in_one = [records[at : at + MOST_RECORDS].tobytes() for at in range(0, len(records), MOST_RECORDS)]
        return in_one + self._newly_refused()

    def _newly_refused(self) -> list[bytes]:
        refused, size = self._ring.refused
        new, self._refused = refused - self._refused, refused
        return [bytes(size)] * min(new, MOST_REFUSED)

    def _check(self) -> None:
        """Raises DeviceError for what the process complained of, or where it ended."""
        try:
            if self._child.poll():
                raise DeviceError(self._child.recv())
        except (EOFError, OSError) as error:
            raise DeviceError(f"acquisition of {self._peer} has ended by itself; start the run anew") from error

    def close(self) -> None:
        """Ends the process, which takes a few milliseconds, and takes the ring away."""
        if self._child.closed:
            return
        with suppress(OSError):  # it may have just ended
            self._child.send(None)
        try:
            self._process.wait(ENDED_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._child.close()
        self._ring.remove()
