"""The process that owns the sensor's socket, and does nothing but carry its records into the ring."""

import signal
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait

import numpy as np

from rfca_rig.acquisition.ring import Ring
from rfca_rig.clock import WallClock
from rfca_rig.drivers.datagrams import UdpDatagrams
from rfca_rig.errors import DeviceError

PAUSE_S = 1e-3  # between two looks at the socket while records come: 15 datagrams at 15 kHz, against hundreds that it holds
IDLE_S = 0.2


@dataclass(frozen=True)
class RecordSource:
    """Where the records come from; each datagram holds 1..`most_records` of `record_bytes` bytes."""

    host: str
    port: int
    record_bytes: int
    most_records: int


@dataclass(frozen=True)
class AcquisitionAssignment:
    """What to carry where. `clock` is the parent's: both stamp alike, as the clock behind it is the machine's."""

    source: RecordSource
    ring_name: str
    clock: WallClock


def acquire(parent: Connection) -> None:
    """Takes its assignment from the parent, and runs until that says None, or is gone.

    First tells the parent the receive buffer that was granted, in bytes, or in words why there is no way to the sensor. Then
    sends what it is given as bytes, and tells in words what went wrong, once until the next order. An interrupt from the
    keyboard is left to the parent.
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
        Carrier(assignment.source, datagrams, ring, assignment.clock, parent).run()
    finally:
        datagrams.close()
        ring.close()


class Carrier:
    """From the socket to the ring, and orders of the parent to the socket."""

    def __init__(self, source: RecordSource, datagrams: UdpDatagrams, ring: Ring, clock: WallClock, parent: Connection) -> None:
        self._source = source
        self._datagrams = datagrams
        self._ring = ring
        self._clock = clock
        self._parent = parent
        self._complained = False

    def run(self) -> None:
        while self._obey():
            if self._carry():
                self._clock.wait_until(self._clock.now_s() + PAUSE_S)
            else:
                wait([self._datagrams.fileno(), self._parent], IDLE_S)

    def _obey(self) -> bool:
        """False when there is nobody left to work for."""
        try:
            while self._parent.poll():
                order = self._parent.recv()
                if order is None:
                    return False
                self._complained = False
                self._send(order)
        except (EOFError, ConnectionError):
            return False
        return True

    def _send(self, order: bytes) -> None:
        try:
            self._datagrams.send(order)
        except DeviceError as error:
            self._complain(error)

    def _complain(self, error: DeviceError) -> None:
        if not self._complained:
            self._complained = True
            self._parent.send(str(error))

    def _carry(self) -> bool:
        """Whether anything had arrived."""
        try:
            arrived = self._datagrams.receive_all()
        except DeviceError as error:
            self._complain(error)
            return False
        whole = [datagram for datagram in arrived if self._is_whole(datagram)]
        if whole:
            records = np.frombuffer(b"".join(whole), np.uint8).reshape(-1, self._source.record_bytes)
            self._ring.write(self._clock.now_s(), records)
        return bool(arrived)

    def _is_whole(self, datagram: bytes) -> bool:
        count, rest = divmod(len(datagram), self._source.record_bytes)
        if rest == 0 and 1 <= count <= self._source.most_records:
            return True
        self._ring.refuse(len(datagram))
        return False
