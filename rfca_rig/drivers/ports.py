"""Non-blocking ports: datagrams by UDP, and serial lines by pyserial."""

import socket
from typing import Protocol

from rfca_rig.errors import DeviceError

# The usual default holds only 17 ms of single records at 15 kHz.
RECEIVE_BUFFER_BYTES = 4 << 20
MAX_DATAGRAM_BYTES = 2048


class Datagrams(Protocol):
    """Datagrams to and from one peer. `send` and `receive_all` raise DeviceError if the
    connection fails.
    """

    def send(self, datagram: bytes) -> None: ...

    def receive_all(self) -> list[bytes]:
        """What has arrived since the last call, in that order; never waits."""
        ...

    def close(self) -> None:
        """May be called any number of times."""
        ...


def open_udp() -> tuple[socket.socket, int]:
    """A non-blocking UDP socket of no address yet, and the bytes of receive buffer that the
    system granted it.
    """
    opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    opened.setblocking(False)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
    return opened, opened.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF)


class UdpDatagrams:
    """UDP to one host and port; datagrams from other senders are dropped.

    `receive_buffer_bytes` is what the kernel granted of the requested 4 MiB (Linux includes its own
    bookkeeping, twice the payload, and caps it at net.core.rmem_max). Raises DeviceError if the
    host cannot be addressed.
    """

    def __init__(self, host: str, port: int) -> None:
        self._peer = f"{host}:{port}"
        self._socket, self.receive_buffer_bytes = open_udp()
        try:
            # A connected UDP socket receives from this peer only, and reports its ICMP errors.
            self._socket.connect((host, port))
        except OSError as error:
            self._socket.close()
            raise DeviceError(
                f"no way to {self._peer}: {error}; check the sensor's address and the network cable"
            ) from error

    def send(self, datagram: bytes) -> None:
        try:
            self._socket.send(datagram)
        except OSError as error:
            raise DeviceError(
                f"datagram to {self._peer} not sent: {error}; check the network cable and "
                "the sensor's power"
            ) from error

    def receive_all(self) -> list[bytes]:
        datagrams: list[bytes] = []
        try:
            while True:
                datagrams.append(self._socket.recv(MAX_DATAGRAM_BYTES))
        except BlockingIOError:
            return datagrams
        except OSError as error:
            raise DeviceError(
                f"nothing to be received from {self._peer}: {error}; is the sensor on, "
                "and RDT enabled?"
            ) from error

    def fileno(self) -> int:
        """File descriptor, to wait for arriving datagrams."""
        return self._socket.fileno()

    def close(self) -> None:
        self._socket.close()


def advise_receive_buffer(granted_bytes: int) -> str:
    """Advice in one line if the kernel granted a smaller receive buffer than requested, else
    empty.
    """
    if granted_bytes >= RECEIVE_BUFFER_BYTES:
        return ""
    return (
        f"the system gives {granted_bytes >> 10} KiB of receive buffer where "
        f"{RECEIVE_BUFFER_BYTES >> 10} were asked for, so records go "
        "missing while this computer is busy; allow more: sudo sysctl -w "
        f"net.core.rmem_max={RECEIVE_BUFFER_BYTES}"
    )


class SerialPort(Protocol):
    """The members of `serial.Serial` that drivers use. All raise OSError if the line is broken,
    as pyserial does.
    """

    @property
    def in_waiting(self) -> int:
        """Bytes that have arrived."""
        ...

    def read(self, size: int = 1) -> bytes:
        """At most `size` of the bytes that have arrived; never waits."""
        ...

    def write(self, data: bytes) -> int | None: ...

    def close(self) -> None: ...


def open_port(path: str, bits_per_s: int) -> SerialPort:
    """Opens the port with 8 data bits, no parity, one stop bit. Raises DeviceError if it cannot
    be opened.
    """
    import serial  # noqa: PLC0415 (no other device needs it)

    try:
        port: SerialPort = serial.Serial(path, bits_per_s, timeout=0, write_timeout=1.0)
    except (serial.SerialException, ValueError) as error:
        raise DeviceError(
            f"serial port {path} cannot be opened: {error}; check [force_sensor] in the "
            "rig file, and who may open it"
        ) from error
    return port
