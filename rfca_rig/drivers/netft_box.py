"""What a Net F/T says of its own configuration, over HTTP or its command interface, and whether the settings agree with it."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from http.client import HTTPException
from typing import Protocol
from urllib.request import ProxyHandler, build_opener

from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.codecs.netft_commands import (
    CALIBRATION_BYTES,
    PORT,
    READING_BYTES,
    CalibrationInfo,
    NetFtReading,
    ReadCalibrationInfo,
    ReadForce,
    decode_calibration,
    decode_reading,
    encode_command,
)
from rfca_rig.codecs.netft_configuration import LARGEST_BYTES, PATH, NetFtConfiguration, decode_configuration
from rfca_rig.errors import BadInput, DeviceError

TIMEOUT_S = 2.0
SAME = 1e-6


class Box(Protocol):
    """Asked before a stream starts; may wait for the network."""

    def says(self) -> NetFtConfiguration | CalibrationInfo:
        """Raises DeviceError where the box does not answer, or answers what cannot be read."""
        ...


class Expected(Protocol):
    """What the settings of a driver say of the box."""

    @property
    def counts_per_N(self) -> float: ...

    @property
    def counts_per_Nm(self) -> float: ...

    @property
    def internal_rate_Hz(self) -> float: ...

    @property
    def decimation(self) -> int: ...


class HttpBox:
    """The box's configuration page. Proxies of the surroundings are passed by: the box stands on the laboratory's own network."""

    def __init__(self, host: str, port: int = 80, timeout_s: float = TIMEOUT_S) -> None:
        self._url = f"http://{host}:{port}{PATH}"
        self._timeout_s = timeout_s

    def says(self) -> NetFtConfiguration:
        try:
            with build_opener(ProxyHandler({})).open(self._url, timeout=self._timeout_s) as answer:
                page = answer.read(LARGEST_BYTES + 1)
            return decode_configuration(page)
        except (OSError, HTTPException) as error:
            raise DeviceError(
                f"{self._url} gives no configuration: {error}; check the address, or set configuration = 'unchecked'"
            ) from error
        except MalformedFrame as error:
            raise DeviceError(f"{self._url}: {error}; is this a Net F/T?") from error


class CommandBox:
    """The box's command interface on TCP. It knows units and counts, but no rate."""

    def __init__(self, host: str, port: int = PORT, timeout_s: float = TIMEOUT_S) -> None:
        self._host, self._port = host, port
        self._timeout_s = timeout_s

    def says(self) -> CalibrationInfo:
        reply = self._asked(encode_command(ReadCalibrationInfo()), CALIBRATION_BYTES)
        with self._named():
            return decode_calibration(reply)

    def reading(self, command: ReadForce) -> NetFtReading:
        """One reading, for a look at the sensor without a stream. Raises DeviceError like `says`."""
        reply = self._asked(encode_command(command), READING_BYTES)
        with self._named():
            return decode_reading(reply)

    @contextmanager
    def _named(self) -> Iterator[None]:
        """Says whose reply cannot be read."""
        try:
            yield
        except MalformedFrame as error:
            raise DeviceError(f"command interface at {self._host}:{self._port}: {error}; is this a Net F/T?") from error

    def _asked(self, command: bytes, length: int) -> bytes:
        try:
            with socket.create_connection((self._host, self._port), self._timeout_s) as connection:
                connection.settimeout(self._timeout_s)
                connection.sendall(command)
                return _received(connection, length)
        except OSError as error:
            raise DeviceError(f"command interface at {self._host}:{self._port} does not answer: {error}; check the address") from error


def _received(connection: socket.socket, length: int) -> bytes:
    """`length` bytes, or fewer where the peer ends before."""
    data = b""
    while len(data) < length and (more := connection.recv(length - len(data))):
        data += more
    return data


def refuse_difference(says: NetFtConfiguration | CalibrationInfo, expected: Expected, where: str) -> None:
    """Raises BadInput for counts or a rate other than expected, DeviceError for a box that will not stream."""
    _refuse_counts("counts_per_N", says.counts_per_N, expected.counts_per_N, f"{says.counts_per_force:g} per {says.force_unit}", where)
    _refuse_counts("counts_per_Nm", says.counts_per_Nm, expected.counts_per_Nm, f"{says.counts_per_torque:g} per {says.torque_unit}", where)
    if isinstance(says, NetFtConfiguration):
        _refuse_rate(says, expected, where)


def _refuse_counts(name: str, said: float, expected: float, how: str, where: str) -> None:
    if abs(said / expected - 1.0) > SAME:
        raise BadInput(f"force sensor: {name} is {expected:.10g}, {where} is set to {said:.10g} ({how}); correct the one that is wrong")


def _refuse_rate(says: NetFtConfiguration, expected: Expected, where: str) -> None:
    if says.rdt_enabled is False:
        raise DeviceError(f"RDT is disabled on {where}; enable it (comrdte) on its communications page")
    internal_Hz = says.internal_rate_Hz or expected.internal_rate_Hz
    decimation = says.decimation(internal_Hz)
    said_Hz = None if decimation is None else internal_Hz / decimation
    expected_Hz = expected.internal_rate_Hz / expected.decimation
    if said_Hz is not None and abs(said_Hz / expected_Hz - 1.0) > SAME:
        raise BadInput(
            f"force sensor: rate_Hz is {expected_Hz:.6g}, {where} is set to {said_Hz:.6g} records/s (comrdtrate {says.rdt_rate_Hz:g}); "
            "correct the one that is wrong"
        )
