"""Configuration of a Net F/T box, read over HTTP or its command interface, and its comparison with the settings."""

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
from rfca_rig.codecs.netft_configuration import MAX_PAGE_BYTES, PATH, NetFtConfiguration, decode_configuration
from rfca_rig.errors import BadInput, DeviceError

TIMEOUT_S = 2.0
# Relative tolerance: counts per unit are converted between units, which leaves rounding errors.
RELATIVE_TOLERANCE = 1e-6


class NetFtBox(Protocol):
    """Source of the box's configuration. It is read before a stream starts and may wait for the network."""

    def says(self) -> NetFtConfiguration | CalibrationInfo:
        """Reads the configuration. Raises DeviceError if the box does not answer, or its answer cannot be decoded."""
        ...


class NetFtExpectation(Protocol):
    """The settings of a driver that must agree with the box."""

    @property
    def counts_per_N(self) -> float: ...

    @property
    def counts_per_Nm(self) -> float: ...

    @property
    def internal_rate_Hz(self) -> float: ...

    @property
    def decimation(self) -> int: ...


class HttpBox:
    """The box's configuration page. Proxy settings of the environment are ignored: the box is on the laboratory's own network."""

    def __init__(self, host: str, port: int = 80, timeout_s: float = TIMEOUT_S) -> None:
        self._url = f"http://{host}:{port}{PATH}"
        self._timeout_s = timeout_s

    def says(self) -> NetFtConfiguration:
        try:
            with build_opener(ProxyHandler({})).open(self._url, timeout=self._timeout_s) as answer:
                # One byte more than allowed is read, so that the decoder can refuse a page that is too long.
                page = answer.read(MAX_PAGE_BYTES + 1)
            return decode_configuration(page)
        except (OSError, HTTPException) as error:
            raise DeviceError(
                f"{self._url} gives no configuration: {error}; check the address, or set configuration = 'unchecked'"
            ) from error
        except MalformedFrame as error:
            raise DeviceError(f"{self._url}: {error}; is this a Net F/T?") from error


class CommandBox:
    """The box's command interface on TCP. It reports units and counts, but no rate."""

    def __init__(self, host: str, port: int = PORT, timeout_s: float = TIMEOUT_S) -> None:
        self._host, self._port = host, port
        self._timeout_s = timeout_s

    def says(self) -> CalibrationInfo:
        reply = self._request(encode_command(ReadCalibrationInfo()), CALIBRATION_BYTES)
        with self._name_sender():
            return decode_calibration(reply)

    def reading(self, command: ReadForce) -> NetFtReading:
        """One force reading without a stream. Raises DeviceError like `says`."""
        reply = self._request(encode_command(command), READING_BYTES)
        with self._name_sender():
            return decode_reading(reply)

    @contextmanager
    def _name_sender(self) -> Iterator[None]:
        """Adds the address to the error of a reply that cannot be decoded."""
        try:
            yield
        except MalformedFrame as error:
            raise DeviceError(f"command interface at {self._host}:{self._port}: {error}; is this a Net F/T?") from error

    def _request(self, command: bytes, length: int) -> bytes:
        try:
            with socket.create_connection((self._host, self._port), self._timeout_s) as connection:
                connection.settimeout(self._timeout_s)
                connection.sendall(command)
                return _receive(connection, length)
        except OSError as error:
            raise DeviceError(f"command interface at {self._host}:{self._port} does not answer: {error}; check the address") from error


def _receive(connection: socket.socket, length: int) -> bytes:
    """`length` bytes, or fewer if the peer closes the connection before."""
    data = b""
    while len(data) < length and (more := connection.recv(length - len(data))):
        data += more
    return data


def refuse_difference(says: NetFtConfiguration | CalibrationInfo, expected: NetFtExpectation, where: str) -> None:
    """Compares the box's configuration with the settings.

    Raises BadInput if counts or rate differ, DeviceError if the box will not stream. `where` names the box in the message.
    """
    _refuse_counts("counts_per_N", says.counts_per_N, expected.counts_per_N, f"{says.counts_per_force:g} per {says.force_unit}", where)
    _refuse_counts("counts_per_Nm", says.counts_per_Nm, expected.counts_per_Nm, f"{says.counts_per_torque:g} per {says.torque_unit}", where)
    if isinstance(says, NetFtConfiguration):
        # The command interface reports no rate.
        _refuse_rate(says, expected, where)


def _refuse_counts(name: str, configured: float, expected: float, how: str, where: str) -> None:
    if abs(configured / expected - 1.0) > RELATIVE_TOLERANCE:
        raise BadInput(
            f"force sensor: {name} is {expected:.10g}, {where} is set to {configured:.10g} ({how}); correct the one that is wrong"
        )


def _refuse_rate(says: NetFtConfiguration, expected: NetFtExpectation, where: str) -> None:
    if says.rdt_enabled is False:
        raise DeviceError(f"RDT is disabled on {where}; enable it (comrdte) on its communications page")
    internal_Hz = says.internal_rate_Hz or expected.internal_rate_Hz
    # The box rounds comrdtrate to an integer fraction of its internal rate, so the effective rates are compared.
    decimation = says.decimation(internal_Hz)
    box_Hz = None if decimation is None else internal_Hz / decimation
    expected_Hz = expected.internal_rate_Hz / expected.decimation
    if box_Hz is not None and abs(box_Hz / expected_Hz - 1.0) > RELATIVE_TOLERANCE:
        raise BadInput(
            f"force sensor: rate_Hz is {expected_Hz:.6g}, {where} is set to {box_Hz:.6g} records/s (comrdtrate {says.rdt_rate_Hz:g}); "
            "correct the one that is wrong"
        )
