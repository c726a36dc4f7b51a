"""Driver for an ATI Net F/T force sensor (NetBox), RDT over UDP."""

import socket
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from http.client import HTTPException
from urllib.request import ProxyHandler, build_opener

import numpy as np
from numpy.typing import NDArray

from rfca_rig.acquisition.acquired import AcquiredDatagrams, RecordSource
from rfca_rig.clock import Clock, WallClock
from rfca_rig.codecs.force_sensors import mark_axia_status, status_text
from rfca_rig.devices.netft.codec import (
    CALIBRATION_BYTES,
    COMMAND_PORT,
    MAX_PAGE_BYTES,
    MAX_RECORDS,
    PATH,
    READING_BYTES,
    RECORD_BYTES,
    CalibrationInfo,
    NetFtConfiguration,
    NetFtReading,
    RdtCommand,
    ReadCalibrationInfo,
    ReadForce,
    Records,
    decode_calibration,
    decode_configuration,
    decode_reading,
    decode_records,
    describe_low_pass,
    encode_command,
    encode_request,
    lag_of_low_pass_s,
    start_command,
)
from rfca_rig.devices.netft.section import NetFtBox, NetFtConnection, NetFtSection, NetFtSettings
from rfca_rig.drivers.device_time import wrap_to_signed
from rfca_rig.drivers.ports import Datagrams, UdpDatagrams, advise_receive_buffer
from rfca_rig.drivers.record_stream import RecordSequence, StatusCounter
from rfca_rig.drivers.roles import ForceSamples, SensorScale, StreamHealth, concatenate_blocks
from rfca_rig.errors import BadInput, DeviceError, MalformedFrame
from rfca_rig.subprocesses import can_be_started

TIMEOUT_S = 2.0
# Relative tolerance: counts per unit are converted between units, which leaves rounding errors.
RELATIVE_TOLERANCE = 1e-6

# Time in s in which records of an earlier stream may still arrive after a stop.
QUIET_S = 0.02


class HttpBox:
    """The box's configuration page. Proxy settings of the environment are ignored: the box is on
    the laboratory's own network.
    """

    def __init__(self, host: str, port: int = 80, timeout_s: float = TIMEOUT_S) -> None:
        self._url = f"http://{host}:{port}{PATH}"
        self._timeout_s = timeout_s

    def read_configuration(self) -> NetFtConfiguration:
        try:
            with build_opener(ProxyHandler({})).open(self._url, timeout=self._timeout_s) as answer:
                # One byte more than allowed is read, so that the decoder can refuse a page that is
                # too long.
                page = answer.read(MAX_PAGE_BYTES + 1)
            return decode_configuration(page)
        except (OSError, HTTPException) as error:
            raise DeviceError(
                f"{self._url} gives no configuration: {error}; check the address, or set "
                "configuration = 'unchecked'"
            ) from error
        except MalformedFrame as error:
            raise DeviceError(f"{self._url}: {error}; is this a Net F/T?") from error


class CommandBox:
    """The box's command interface on TCP. It reports units and counts, but no rate."""

    def __init__(self, host: str, port: int = COMMAND_PORT, timeout_s: float = TIMEOUT_S) -> None:
        self._host = host
        self._port = port
        self._timeout_s = timeout_s

    def read_configuration(self) -> CalibrationInfo:
        reply = self._request(encode_command(ReadCalibrationInfo()), CALIBRATION_BYTES)
        with self._name_sender():
            return decode_calibration(reply)

    def reading(self, command: ReadForce) -> NetFtReading:
        """One force reading without a stream. Raises DeviceError like `read_configuration`."""
        reply = self._request(encode_command(command), READING_BYTES)
        with self._name_sender():
            return decode_reading(reply)

    @contextmanager
    def _name_sender(self) -> Iterator[None]:
        """Adds the address to the error of a reply that cannot be decoded."""
        try:
            yield
        except MalformedFrame as error:
            raise DeviceError(
                f"command interface at {self._host}:{self._port}: {error}; is this a Net F/T?"
            ) from error

    def _request(self, command: bytes, length: int) -> bytes:
        try:
            with socket.create_connection((self._host, self._port), self._timeout_s) as connection:
                connection.settimeout(self._timeout_s)
                connection.sendall(command)
                return _receive(connection, length)
        except OSError as error:
            raise DeviceError(
                f"command interface at {self._host}:{self._port} does not answer: "
                f"{error}; check the address"
            ) from error


def _receive(connection: socket.socket, length: int) -> bytes:
    """`length` bytes, or fewer if the peer closes the connection before."""
    data = b""
    while len(data) < length and (more := connection.recv(length - len(data))):
        data += more
    return data


def refuse_difference(
    configuration: NetFtConfiguration | CalibrationInfo, expected: NetFtSettings, where: str
) -> None:
    """Compares the box's configuration with the settings.

    Raises BadInput if counts, rate, model, tool transformation or filter differ, DeviceError if the
    box will not stream. `where` names the box in the message.
    """
    _refuse_counts(
        "counts_per_N",
        configuration.counts_per_N,
        expected.counts_per_N,
        f"{configuration.counts_per_force:g} per {configuration.force_unit}",
        where,
    )
    _refuse_counts(
        "counts_per_Nm",
        configuration.counts_per_Nm,
        expected.counts_per_Nm,
        f"{configuration.counts_per_torque:g} per {configuration.torque_unit}",
        where,
    )
    if isinstance(configuration, NetFtConfiguration):
        # The command interface reports none of these.
        _refuse_model(configuration, expected, where)
        _refuse_rate(configuration, expected, where)
        _refuse_transformation(configuration, expected, where)
        _refuse_filter(configuration, expected, where)


def _refuse_counts(name: str, configured: float, expected: float, how: str, where: str) -> None:
    if abs(configured / expected - 1.0) > RELATIVE_TOLERANCE:
        raise BadInput(
            f"force sensor: {name} is {expected:.10g}, {where} is set to "
            f"{configured:.10g} ({how}); correct the one that is wrong"
        )


def _refuse_rate(configuration: NetFtConfiguration, expected: NetFtSettings, where: str) -> None:
    if configuration.rdt_enabled is False:
        raise DeviceError(
            f"RDT is disabled on {where}; enable it (comrdte) on its communications page"
        )
    internal_Hz = configuration.internal_rate_Hz or expected.internal_rate_Hz
    # The box rounds comrdtrate to an integer fraction of its internal rate, so the effective rates
    # are compared.
    decimation = configuration.decimation(internal_Hz)
    if decimation is None:
        return
    box_Hz = internal_Hz / decimation
    expected_Hz = expected.internal_rate_Hz / expected.decimation
    if abs(box_Hz / expected_Hz - 1.0) > RELATIVE_TOLERANCE:
        raise BadInput(
            f"force sensor: rate_Hz is {expected_Hz:.6g}, {where} is set to {box_Hz:.6g} "
            f"records/s (comrdtrate {configuration.rdt_rate_Hz:g}); "
            "correct the one that is wrong"
        )


def _refuse_model(configuration: NetFtConfiguration, expected: NetFtSettings, where: str) -> None:
    if configuration.is_axia == expected.is_axia:
        return
    names = {True: ("an Ethernet Axia", "axia"), False: ("a NetBox", "net-box")}
    name, word = names[configuration.is_axia]
    raise BadInput(
        f"force sensor: {where} is {name}, whose status bits are others than those of "
        f'{names[expected.is_axia][0]}; set model = "{word}" under [force_sensor]'
    )


def _refuse_transformation(
    configuration: NetFtConfiguration, expected: NetFtSettings, where: str
) -> None:
    """A transformation that is not known looks like crosstalk of the sensor."""
    there = configuration.tool_transformation
    stated = expected.tool_transformation
    if there is None and not stated.is_identity:
        raise BadInput(
            f"force sensor: the rig file states a tool transformation ({stated}), the page of "
            f"{where} states none; leave out tool_transformation_mm and tool_transformation_deg"
        )
    if there is None or there.is_close(stated):
        return
    raise BadInput(
        f"force sensor: the tool transformation of {where} is {there}, the rig file states "
        f"{stated}; set it to 0 on its Configurations page, or give it as "
        "tool_transformation_mm and tool_transformation_deg under [force_sensor]"
    )


def _refuse_filter(configuration: NetFtConfiguration, expected: NetFtSettings, where: str) -> None:
    there = configuration.low_pass
    if there is None or expected.low_pass is None or there == str(expected.low_pass):
        return
    raise BadInput(
        f"force sensor: low_pass is {expected.low_pass}, {where} has its filter "
        f"{describe_low_pass(there, configuration.is_axia)}; correct the one that is wrong"
    )


def list_warnings(
    configuration: NetFtConfiguration | CalibrationInfo, expected: NetFtSettings
) -> list[str]:
    """Settings of the box that are not refused, and yet change the forces."""
    if not isinstance(configuration, NetFtConfiguration):
        return []
    code = configuration.low_pass
    if code is None or code == "0" or expected.low_pass is not None:
        return []
    lag_s = lag_of_low_pass_s(code, configuration.is_axia)
    lag = "forces come late"
    effect = 'an effect "sensor_lag"'
    if lag_s is not None:
        lag = f"forces come about {1e3 * lag_s:.2g} ms late"
        effect = f'[[effects]] id = "sensor_lag", parameters = {{ time_constant_s = {lag_s:.2g} }}'
    return [
        f"the box's low-pass filter is {describe_low_pass(code, configuration.is_axia)}: {lag}, "
        "which looks like a lag of the rig; switch it off on its Settings page, or state "
        f"low_pass = {code} under [force_sensor] and give the model {effect}"
    ]


class NetFtSensor:
    """A `ForceSensor` over datagrams, with an endless stream. Sends a bias only in `bias`: taring
    belongs to the experiment.

    The box does not answer requests, so a missing sensor shows only as silence, see `silent_s`.
    With `box` its configuration is checked before each start. `advice` is a note on the connection
    for the health report, see `advise_receive_buffer`.
    """

    def __init__(
        self,
        datagrams: Datagrams,
        clock: Clock,
        settings: NetFtSettings,
        box: NetFtBox | None = None,
        advice: str = "",
    ) -> None:
        self._datagrams = datagrams
        self._clock = clock
        self._settings = settings
        self._box = box
        self._advice = advice
        self._running = False
        self._serial_number = settings.serial_number
        self._set_in_the_box: dict[str, str] = {}
        self._reset()

    def _reset(self) -> None:
        self._sequence = RecordSequence()
        self._status = StatusCounter()
        self._last_ft: int | None = None
        self._malformed = self._stalled = 0
        self._last_malformed = ""
        self._heard_s = self._read_s = self._clock.now_s()

    def start(self) -> None:
        """Starts the stream, after discarding for 20 ms what an earlier one still delivers.

        Raises BadInput if the box is configured differently from the settings, DeviceError if it
        does not answer.
        """
        self.check_configuration()
        self._send(RdtCommand.STOP)
        self._clock.wait_until(self._clock.now_s() + QUIET_S)
        self._datagrams.receive_all()
        self._reset()
        self._send(start_command(self._settings.buffered))
        self._running = True

    def check_configuration(self) -> list[str]:
        """Warnings of the box's settings; none where they are not read. Raises as `start`."""
        if self._box is None:
            return []
        configuration = self._box.read_configuration()
        refuse_difference(
            configuration,
            self._settings,
            f"the box at {self._settings.address or 'the other end'}",
        )
        if isinstance(configuration, NetFtConfiguration):
            self._serial_number = configuration.serial_number or self._serial_number
            self._set_in_the_box = describe_settings(configuration)
        return list_warnings(configuration, self._settings)

    def stop(self) -> None:
        """Ends the stream. Raises DeviceError if the request cannot be sent."""
        self._running = False
        self._send(RdtCommand.STOP)

    def bias(self) -> None:
        """Makes the box take its present load as zero; call it with the sensor unloaded.

        Whether a bias ends a running stream differs between boxes, so a running stream is
        restarted.
        """
        self._send(RdtCommand.SET_BIAS)
        if self._running:
            self.start()

    def _send(self, command: RdtCommand) -> None:
        self._datagrams.send(encode_request(command))

    def read(self) -> ForceSamples:
        """Records (m, 6) since the last call, ascending, each once. Raises DeviceError if their
        rate differs from the settings.
        """
        self._read_s = self._clock.now_s()
        blocks = [
            block
            for datagram in self._datagrams.receive_all()
            if (block := self._decode(datagram)) is not None
        ]
        if not blocks or not self._running:
            return NO_SAMPLES
        records = concatenate_blocks(blocks)
        picked, numbers = self._sequence.take(records.rdt_sequence)
        # One block without loss is the usual case and needs no copy.
        if len(picked) < len(records.status) or len(blocks) > 1:
            records = _select(records, picked)
        self._inspect(records, numbers)
        return _samples(records, numbers, self._read_s, self._settings.record_period_s)

    def _decode(self, datagram: bytes) -> Records | None:
        try:
            records = decode_records(datagram)
        except MalformedFrame as error:
            self._malformed += 1
            self._last_malformed = str(error)
            return None
        if self._settings.is_axia:
            return replace(records, status=mark_axia_status(records.status))
        return records

    def _inspect(self, records: Records, numbers: NDArray[np.int64]) -> None:
        """Checks the status words, and the progress of the sensor's own sample counter."""
        if len(numbers) == 0:
            return
        self._heard_s = self._read_s
        self._status.take(records.status)
        # A signed 32 bit difference is right across the wrap of the counter, and negative after a
        # restart of the box.
        steps = (records.ft_sequence[1:] - records.ft_sequence[:-1]).view(np.int32)
        if self._last_ft is None:
            since = 1
        else:
            since = wrap_to_signed(int(records.ft_sequence[0]) - self._last_ft)
        # Every step as set is the usual case, and a comparison is much cheaper than a median.
        if np.count_nonzero(steps != self._settings.decimation):
            # Only neighbouring records: a lost record would look like a larger step.
            self._check_rate(steps[numbers[1:] - numbers[:-1] == 1])
            self._stalled += int((steps <= 0).sum())
        self._stalled += since <= 0
        self._last_ft = int(records.ft_sequence[-1])

    def _check_rate(self, steps: NDArray[np.int32]) -> None:
        """Raises DeviceError for a wrong rate, which would stretch the time base of the whole
        recording.
        """
        if (steps == self._settings.decimation).all():
            return
        # The median is not affected by single stalled records.
        step = int(np.median(steps))
        if step > 0 and step != self._settings.decimation:
            raise DeviceError(
                f"force sensor sends {self._settings.internal_rate_Hz / step:.0f} "
                f"records/s, the settings say {self._settings.rate_Hz:g}; "
                "set the box's RDT output rate (comrdtrate) or rate_Hz"
            )

    def silent_s(self) -> float:
        """Time in s from the last `read` with a new record, or from the start, to the last
        `read`.
        """
        return self._read_s - self._heard_s

    def scale(self) -> SensorScale:
        return SensorScale(
            self._settings.counts_per_N,
            self._settings.counts_per_Nm,
            1.0 / self._settings.record_period_s,
        )

    def health(self) -> StreamHealth:
        """Counters since `start`. `received` + `lost` is the number of records sent until the
        newest one.
        """
        return self._sequence.health(self._status, self._stalled, self._malformed, self._notes())

    def _notes(self) -> list[str]:
        notes = []
        if self._running and self.silent_s() > 0.1:
            notes.append(
                f"no record for {self.silent_s():.2f} s: check power and cable, or who "
                "else started its stream"
            )
        if self._stalled:
            notes.append(
                "the sensor's own sample counter stood still or ran back in "
                f"{self._stalled} records: these values are not new"
            )
        if self._status.faulty:
            notes.append(
                f"faulty status in {self._status.faulty} records: {status_text(self._status.seen)}"
            )
        if self._malformed:
            notes.append(
                f"{self._malformed} datagrams thrown away, the last one: {self._last_malformed}"
            )
        if self._advice and self._sequence.lost:
            notes.append(self._advice)
        return notes

    def identity(self) -> dict[str, str]:
        make = "ATI Net F/T, RDT"
        if self._settings.is_axia:
            make = "ATI Ethernet Axia, RDT"
        return {
            "make": make,
            "address": self._settings.address,
            "serial_number": self._serial_number,
            "counts_per_N": repr(self._settings.counts_per_N),
            "counts_per_Nm": repr(self._settings.counts_per_Nm),
            "rate_Hz": f"{1.0 / self._settings.record_period_s:.6g}",
            **self._set_in_the_box,
        }


def describe_settings(configuration: NetFtConfiguration) -> dict[str, str]:
    """Settings of the box that change the forces, for the recording; without those that its page
    does not state.
    """
    settings = {}
    if configuration.low_pass is not None:
        settings["low_pass"] = describe_low_pass(configuration.low_pass, configuration.is_axia)
    if configuration.tool_transformation is not None:
        settings["tool_transformation"] = str(configuration.tool_transformation)
    return settings


NO_SAMPLES = ForceSamples(
    np.empty(0),
    np.empty(0),
    np.empty(0, np.int64),
    np.empty(0, np.uint32),
    np.empty((0, 6), np.int32),
)


def _select(records: Records, rows: NDArray[np.int64]) -> Records:
    return Records(
        records.rdt_sequence[rows],
        records.ft_sequence[rows],
        records.status[rows],
        records.counts[rows],
    )


def _samples(
    records: Records, numbers: NDArray[np.int64], host_s: float, period_s: float
) -> ForceSamples:
    device_s = numbers.astype(np.float64)
    device_s -= 1.0
    device_s *= period_s
    return ForceSamples(
        np.full(len(numbers), host_s), device_s, numbers, records.status, records.counts
    )


def record_source(host: str, port: int) -> RecordSource:
    """The stream of a box, for the process that receives it."""
    return RecordSource(host, port, RECORD_BYTES, MAX_RECORDS)


def open_connection(keys: NetFtSection, clock: WallClock) -> NetFtConnection:
    """The connection to the box that [force_sensor] names. Raises DeviceError if the host cannot
    be addressed.
    """
    # A process of its own empties the socket, so that a busy loop loses no records.
    source = record_source(keys.host, keys.port)
    datagrams: Datagrams
    if can_be_started():
        datagrams = AcquiredDatagrams(source, clock)
    else:
        datagrams = UdpDatagrams(keys.host, keys.port)
    return NetFtConnection(
        datagrams, make_box(keys), advise_receive_buffer(datagrams.receive_buffer_bytes)
    )


def make_box(keys: NetFtSection) -> NetFtBox | None:
    """Where the settings of the box are read."""
    if keys.configuration == "http":
        return HttpBox(keys.host, keys.http_port)
    if keys.configuration == "commands":
        return CommandBox(keys.host, keys.command_port)
    return None


def make_driver(keys: NetFtSection, connection: NetFtConnection, clock: Clock) -> NetFtSensor:
    """The driver of the box that [force_sensor] names."""
    return NetFtSensor(
        connection.datagrams, clock, keys.settings(), connection.box, connection.advice
    )
