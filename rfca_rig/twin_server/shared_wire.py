"""In-process CAN bus that clients join and leave."""

import can

from rfca_rig.codecs.classic_can import ClassicFrame
from rfca_rig.twins.wires import CanEnd


class SharedWire:
    """Every end receives what the others send, as on a real bus."""

    def __init__(self, name: str) -> None:
        self._name = name
        self._ends: list[CanEnd] = []

    def join(self) -> CanEnd:
        end = CanEnd(self._name, self._ends)
        self._ends.append(end)
        return end

    def leave(self, end: CanEnd) -> None:
        """Removes an end. May be called more than once."""
        if end in self._ends:
            self._ends.remove(end)
            end.shutdown()


def message_of(frame: ClassicFrame) -> can.Message:
    """Converts a classic frame to a python-can message."""
    return can.Message(
        arbitration_id=frame.can_id,
        data=frame.data,
        dlc=frame.length,
        is_extended_id=frame.extended,
        is_remote_frame=frame.remote,
    )


def is_classic(message: can.Message) -> bool:
    """Whether `frame_of` can convert the message: neither CAN FD nor an error frame."""
    return not message.is_fd and not message.is_error_frame


def frame_of(message: can.Message) -> ClassicFrame:
    """Converts a python-can message, which must be classic, to a frame."""
    remote = message.is_remote_frame
    return ClassicFrame(message.arbitration_id, b"" if remote else bytes(message.data), message.is_extended_id, remote, message.dlc)
