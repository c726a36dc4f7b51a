"""CAN frames as a stream of a recording: every frame that passed on the bus, of any node."""

from collections.abc import Iterator

import can
import numpy as np

from rfca_rig.recording.columns import DEVICE_TIME, HOST_TIME, ColumnForm, Rows, StreamForm

CAN = "can"
# Bits of the column `flags`.
EXTENDED = 1
REMOTE = 2
ERROR = 4
FD = 8
BIT_RATE_SWITCH = 16
ERROR_STATE = 32
SENT = 64
WORD_BYTES = 4
CLASSIC_BYTES = 8
FD_BYTES = 64


def can_form(is_fd: bool) -> StreamForm:
    """Layout of the stream: identifier, flags and length; the data, least byte first, in words of
    four bytes. `device_s` is the host's time too: frames carry no time of their sender.
    """
    data_bytes = FD_BYTES if is_fd else CLASSIC_BYTES
    words = (ColumnForm(f"data{word}", "<u4", "") for word in range(data_bytes // WORD_BYTES))
    return StreamForm(
        CAN,
        (
            ColumnForm("identifier", "<u4", ""),
            ColumnForm("flags", "<u1", ""),
            ColumnForm("length", "<u1", ""),
            *words,
            ColumnForm(HOST_TIME, "<f8", "s"),
            ColumnForm(DEVICE_TIME, "<f8", "s"),
        ),
    )


def frame_row(form: StreamForm, message: can.Message, host_s: float, is_sent: bool) -> bytes:
    """The record of one frame, as laid out by `can_form`."""
    flags = (
        EXTENDED * message.is_extended_id
        | REMOTE * message.is_remote_frame
        | ERROR * message.is_error_frame
        | FD * message.is_fd
        | BIT_RATE_SWITCH * message.bitrate_switch
        | ERROR_STATE * message.error_state_indicator
        | SENT * is_sent
    )
    dtype = form.dtype
    data_bytes = dtype.itemsize - 4 - 1 - 1 - 8 - 8
    head = np.array([message.arbitration_id], "<u4").tobytes() + bytes([flags, message.dlc])
    data = bytes(message.data)[:data_bytes].ljust(data_bytes, b"\0")
    return head + data + np.array([host_s, host_s], "<f8").tobytes()


def messages_in(rows: Rows, times_s: np.ndarray) -> Iterator[can.Message]:
    """The frames of records (m,) of the stream, stamped with `times_s` (m,)."""
    names = [name for name in rows.dtype.names or () if name.startswith("data")]
    data = np.stack([rows[name] for name in names], axis=1).astype("<u4")
    for row, words, time_s in zip(rows, data, times_s, strict=True):
        flags = int(row["flags"])
        length = int(row["length"])
        is_remote = bool(flags & REMOTE)
        content = words.tobytes()[:length]
        # A remote frame has a length and no data.
        if is_remote:
            content = b""
        yield can.Message(
            timestamp=float(time_s),
            arbitration_id=int(row["identifier"]),
            is_extended_id=bool(flags & EXTENDED),
            is_remote_frame=is_remote,
            is_error_frame=bool(flags & ERROR),
            is_fd=bool(flags & FD),
            bitrate_switch=bool(flags & BIT_RATE_SWITCH),
            error_state_indicator=bool(flags & ERROR_STATE),
            is_rx=not flags & SENT,
            dlc=length,
            data=content,
        )
