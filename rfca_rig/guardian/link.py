"""The connection between the guardian and its parent process: small binary records, and one end of
the wire.

Neither side can block the other.
"""

import select
import socket
import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag

import can

from rfca_rig.drivers.guard import TorqueOffResult

# Fields: kind, flags, dlc, payload length, number, arbitration id, time.
HEAD = struct.Struct("<BBBxHxxIId")
# Fields: silence, duration, reports, torque; see `TorqueOffResult`.
_SILENCED = struct.Struct("<ddqd")

# Limit of the send queue, about 8000 frames.
MAX_QUEUED_BYTES = 1 << 18
READ_BYTES = 1 << 16


class RecordKind(IntEnum):
    """FRAME goes both ways; FRAME_TO_CONFIRM, ARM and CLOSE go to the guardian; the rest come
    from it.
    """

    FRAME = 1
    FRAME_TO_CONFIRM = 2
    ARM = 3
    CLOSE = 4
    CONFIRMED = 5
    ALIVE = 6
    BUS_ERROR = 7
    LET_GO = 8
    SILENCED = 9


class FrameFlag(IntFlag):
    """Flags of a CAN frame."""

    EXTENDED = 1
    REMOTE = 2
    ERROR = 4
    FD = 8
    BITRATE_SWITCH = 16
    ERROR_STATE = 32


@dataclass(frozen=True, slots=True)
class GuardianRecord:
    """One message. `t_s` is the time of the clock that both processes share; for a frame from the
    bus, the frame's own time stamp.

    `number` identifies the arming, or the frame to be confirmed. `flags`, `dlc` and
    `arbitration_id` belong to frames.
    """

    kind: RecordKind
    t_s: float
    number: int = 0
    payload: bytes = b""
    flags: int = 0
    dlc: int = 0
    arbitration_id: int = 0

    @property
    def text(self) -> str:
        return self.payload.decode()


def encode(record: GuardianRecord) -> bytes:
    head = HEAD.pack(
        record.kind,
        record.flags,
        record.dlc,
        len(record.payload),
        record.number,
        record.arbitration_id,
        record.t_s,
    )
    return head + record.payload


def split_records(received: bytes | bytearray) -> tuple[list[GuardianRecord], int]:
    """Decodes all complete records; returns them and the number of bytes that they took."""
    records = []
    at = 0
    while at + HEAD.size <= len(received):
        kind, flags, dlc, size, number, arbitration_id, t_s = HEAD.unpack_from(received, at)
        end = at + HEAD.size + size
        # The rest of this record has not arrived yet.
        if end > len(received):
            break
        records.append(
            GuardianRecord(
                RecordKind(kind),
                t_s,
                number,
                bytes(received[at + HEAD.size : end]),
                flags,
                dlc,
                arbitration_id,
            )
        )
        at = end
    return records, at


def from_frame(
    message: can.Message, t_s: float, kind: RecordKind = RecordKind.FRAME, number: int = 0
) -> GuardianRecord:
    flags = (
        FrameFlag.EXTENDED * message.is_extended_id
        | FrameFlag.REMOTE * message.is_remote_frame
        | FrameFlag.ERROR * message.is_error_frame
        | FrameFlag.FD * message.is_fd
        | FrameFlag.BITRATE_SWITCH * message.bitrate_switch
        | FrameFlag.ERROR_STATE * message.error_state_indicator
    )
    return GuardianRecord(
        kind, t_s, number, bytes(message.data), flags, message.dlc, message.arbitration_id
    )


def to_frame(record: GuardianRecord) -> can.Message:
    """The CAN frame of a record, with `t_s` as its time stamp."""
    flags = record.flags
    return can.Message(
        timestamp=record.t_s,
        arbitration_id=record.arbitration_id,
        is_extended_id=bool(flags & FrameFlag.EXTENDED),
        is_remote_frame=bool(flags & FrameFlag.REMOTE),
        is_error_frame=bool(flags & FrameFlag.ERROR),
        is_fd=bool(flags & FrameFlag.FD),
        bitrate_switch=bool(flags & FrameFlag.BITRATE_SWITCH),
        error_state_indicator=bool(flags & FrameFlag.ERROR_STATE),
        dlc=record.dlc,
        data=record.payload,
    )


def from_text(kind: RecordKind, t_s: float, text: str, number: int = 0) -> GuardianRecord:
    # The length field has 16 bits; error texts of adapters may be long.
    return GuardianRecord(kind, t_s, number, text.encode()[:2000])


def from_result(result: TorqueOffResult, t_s: float, number: int) -> GuardianRecord:
    return GuardianRecord(
        RecordKind.SILENCED,
        t_s,
        number,
        _SILENCED.pack(result.silent_s, result.took_s, result.reports, result.torque_Nm),
    )


def decode_result(record: GuardianRecord) -> TorqueOffResult:
    return TorqueOffResult(*_SILENCED.unpack(record.payload))


class GuardianLink:
    """Non-blocking record stream. `flush` sends what the socket accepts and keeps the rest;
    `take` returns what has arrived.
    """

    def __init__(self, end: socket.socket) -> None:
        end.setblocking(False)
        self._end = end
        self._waiting = bytearray()
        self._received = bytearray()
        self.is_cut = False

    def fileno(self) -> int:
        return self._end.fileno()

    def put(self, record: GuardianRecord, may_be_dropped: bool = False) -> bool:
        """Queues a record for the next `flush`. Returns False if it was dropped, because the
        queue is full.
        """
        if may_be_dropped and len(self._waiting) > MAX_QUEUED_BYTES:
            self.flush()
            if len(self._waiting) > MAX_QUEUED_BYTES:
                return False
        self._waiting += encode(record)
        return True

    def flush(self) -> None:
        try:
            while self._waiting:
                del self._waiting[: self._end.send(self._waiting)]
        except BlockingIOError:
            return
        except OSError:
            # What the other side sent before can still be received.
            self.is_cut = True
            self._waiting.clear()

    def take(self) -> list[GuardianRecord]:
        """All records that have arrived, in order. Sets `is_cut` if no more can arrive."""
        try:
            while received := self._end.recv(READ_BYTES):
                self._received += received
            self.is_cut = True
        except BlockingIOError:
            pass
        except OSError:
            self.is_cut = True
        records, size = split_records(self._received)
        del self._received[:size]
        return records

    def wait(self, timeout_s: float) -> None:
        """Waits until data has arrived or can be sent, for `timeout_s` at most."""
        writable = []
        if self._waiting:
            writable = [self._end]
        select.select([self._end], writable, [], max(timeout_s, 0.0))

    def close(self) -> None:
        self._end.close()
