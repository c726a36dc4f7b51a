"""Twin of an ATI Net F/T NetBox with its transducer, on a datagram link."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.force_sensors import SATURATED
from rfca_rig.devices.netft.codec import (
    LOW_PASS_HZ,
    MAX_RECORDS,
    NO_TRANSFORMATION,
    PATH,
    RECORD_BYTES,
    CalibrationInfo,
    NetFtConfiguration,
    NetFtReading,
    RdtCommand,
    ReadCalibrationInfo,
    Records,
    Request,
    ToolTransformation,
    decode_command,
    decode_request,
    encode_calibration,
    encode_configuration,
    encode_reading,
    encode_records,
)
from rfca_rig.devices.netft.section import NetFtSection
from rfca_rig.errors import MalformedFrame
from rfca_rig.twins.wires import DatagramLink, SampleGrid

Floats = NDArray[np.float64]

LARGEST_COUNT = 2**31 - 1
# What an Ethernet Axia sends instead of `SATURATED`: an error, force or torque out of range.
AXIA_OUT_OF_RANGE = 1 << 31 | 1 << 30

# By whether it is an Ethernet Axia.
PRODUCTS = {False: "Net F/T twin", True: "Ethernet Axia twin"}

OK = 200
NOT_FOUND = 404
UNAVAILABLE = 503
LARGEST_READING = 2**15 - 1


@dataclass(frozen=True)
class NetFtTwinSettings:
    """Configuration of the box, and noise standard deviation and range of the transducer per axis,
    in N and N m.

    It sends one record per `decimation` internal samples, and `buffer_records` of them per datagram
    in buffered mode. Public drivers disagree on whether setting the bias ends a running stream;
    `bias_stops_stream` selects it. `low_pass` is the code of its filter, here a first-order one of
    the cut-off that is listed for the code; None or 0 is none. `tool_transformation` is only stated
    on its page: the twin's transducer is mounted so that the wrench comes as the rig file says.
    """

    counts_per_N: float = 1e6
    counts_per_Nm: float = 1e6
    decimation: int = 1
    internal_rate_Hz: float = 7000.0
    buffer_records: int = MAX_RECORDS
    noise_std: tuple[float, ...] = (0.0,) * 6
    full_scale: tuple[float, ...] = (330.0, 330.0, 990.0, 30.0, 30.0, 30.0)
    bias_stops_stream: bool = False
    is_axia: bool = False
    low_pass: int | None = None
    tool_transformation: ToolTransformation = NO_TRANSFORMATION


class LowPass:
    """First-order low-pass of sampled values. Which filter a box has is not known; this one has its
    cut-off.
    """

    def __init__(self, cut_off_Hz: float) -> None:
        self._rate_per_s = 2.0 * np.pi * cut_off_Hz
        self._last: Floats | None = None

    def apply(self, values: Floats, period_s: float) -> Floats:
        """Filtered values (m, n) of equally spaced ones, which continue those of the last call."""
        if not len(values):
            return values
        share = 1.0 - np.exp(-self._rate_per_s * period_s)
        filtered = np.empty_like(values)
        last = self._last
        if last is None:
            last = values[0]
        for row, value in enumerate(values):
            last = last + share * (value - last)
            filtered[row] = last
        self._last = last
        return filtered


@dataclass
class _Stream:
    """A running stream. `left` is the number of records still to send, None for an endless one."""

    records_per_datagram: int
    left: int | None
    sequence: int = 1


class NetFtTwin:
    """Executes requests, samples on its own grid n / rate since power-up, and sends records.

    A world advances it in steps: `take_requests`, `due`, then, after the plant has moved,
    `take_wrench`. With `samples_without_stream` it also samples once per step without a stream, so
    that `latest` is up to date.
    """

    def __init__(
        self, link: DatagramLink, settings: NetFtTwinSettings, random: np.random.Generator
    ) -> None:
        self._link = link
        self.settings = settings
        self._random = random
        self._ticks = SampleGrid(settings.decimation / settings.internal_rate_Hz)
        self._stream: _Stream | None = None
        self._due: list[Floats] = []
        self._held = 0
        self._first_held = 0
        self._bias = np.zeros(6)
        self._bias_wanted = False
        self.samples_without_stream = False
        self._latest = np.zeros((1, 6))
        self._counts_per_unit = np.repeat([settings.counts_per_N, settings.counts_per_Nm], 3)
        self._noise_std = np.array(settings.noise_std)
        self._full_scale = np.array(settings.full_scale)
        self._out_of_range = SATURATED
        if settings.is_axia:
            self._out_of_range = AXIA_OUT_OF_RANGE
        self._low_pass: LowPass | None = None
        if settings.low_pass:
            self._low_pass = LowPass(LOW_PASS_HZ[str(settings.low_pass)])

    def take_requests(self) -> None:
        """Executes received requests; the last one takes precedence. Other datagrams are
        ignored, as the box does.
        """
        for datagram in self._link.receive_all():
            try:
                self._obey(decode_request(datagram))
            except MalformedFrame:
                continue

    def _obey(self, request: Request) -> None:
        if request.command in {RdtCommand.START_SINGLE, RdtCommand.START_BUFFERED}:
            if request.command == RdtCommand.START_SINGLE:
                size = 1
            else:
                size = self.settings.buffer_records
            self._begin(_Stream(size, request.sample_count or None))
        elif request.command == RdtCommand.STOP:
            self._begin(None)
        elif request.command == RdtCommand.SET_BIAS:
            self.bias()
            self._begin(None if self.settings.bias_stops_stream else self._stream)

    def bias(self) -> None:
        """Takes the load at the next sample as zero."""
        self._bias_wanted = True

    def latest(self) -> tuple[NDArray[np.int32], int]:
        """Counts (6,) and status of the newest sample."""
        counts, status = self._digitise(self._latest)
        return counts[0], int(status[0])

    def _begin(self, stream: _Stream | None) -> None:
        # Any new request takes precedence; records still held for the old stream are dropped.
        if stream is not self._stream:
            self._stream = stream
            self._due = []
            self._held = 0

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in s in the step that ends at `to_s`; none without a stream and
        without a pending bias.
        """
        times_s = self._ticks.until(to_s)
        if self._stream is not None or self._bias_wanted:
            return times_s
        # The grid runs on since power-up, even if no sample is needed.
        if self.samples_without_stream:
            return times_s[-1:]
        return times_s[:0]

    def take_wrench(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6), in N and N m, at the times that were due, and sends the
        datagrams that are full.
        """
        if self._low_pass is not None:
            settings = self.settings
            wrench = self._low_pass.apply(wrench, settings.decimation / settings.internal_rate_Hz)
        if self._bias_wanted and len(wrench):
            self._bias = wrench[-1].copy()
            self._bias_wanted = False
        if len(wrench):
            self._latest = wrench[-1:].copy()
        if self._stream is None or not len(wrench):
            return
        if self._held == 0:
            # Internal sample number of the first held record, from which its counters follow.
            self._first_held = self._ticks.taken - len(wrench) + 1
        self._due.append(wrench)
        self._held += len(wrench)
        if self._held >= self._stream.records_per_datagram or (
            self._stream.left is not None and self._held >= self._stream.left
        ):
            self._send_full(self._stream)

    def _send_full(self, stream: _Stream) -> None:
        if len(self._due) == 1:
            wrench = self._due[0]
        else:
            wrench = np.concatenate(self._due)
        ready = self._count_ready(stream, len(wrench))
        size = stream.records_per_datagram
        # Records are encoded in blocks of whole datagrams, as numpy calls cost more than the
        # records themselves.
        at_once = MAX_RECORDS // size * size
        for begin in range(0, ready, at_once):
            block = self._encode(
                stream, wrench[begin : min(begin + at_once, ready)], self._first_held + begin
            )
            for at in range(0, len(block), size * RECORD_BYTES):
                self._link.send(block[at : at + size * RECORD_BYTES])
        self._due = [wrench[ready:]]
        self._held = len(wrench) - ready
        self._first_held = self._first_held + ready
        if stream.left == 0:
            self._begin(None)

    def _count_ready(self, stream: _Stream, held: int) -> int:
        """Number of held records to send now: whole datagrams, or all remaining ones at the end
        of a counted stream.
        """
        if stream.left is not None and held >= stream.left:
            return stream.left
        return held - held % stream.records_per_datagram

    def _encode(self, stream: _Stream, wrench: Floats, first: int) -> bytes:
        """Encodes consecutive records (m, 6), as many as fit in a datagram: one call is cheaper
        than one per record.
        """
        order = np.arange(len(wrench))
        counts, status = self._digitise(wrench)
        records = Records(
            # The conversion wraps, as the counters of the box do.
            rdt_sequence=(stream.sequence + order).astype(np.uint32),
            # The internal sample counter runs on from power-up, by `decimation` per record.
            ft_sequence=((first + order) * self.settings.decimation).astype(np.uint32),
            status=status,
            counts=counts,
        )
        stream.sequence += len(wrench)
        if stream.left is not None:
            stream.left -= len(wrench)
        return encode_records(records)

    def _digitise(self, wrench: Floats) -> tuple[NDArray[np.int32], NDArray[np.uint32]]:
        """Counts (m, 6) and status (m,) of a wrench (m, 6). The converter saturates on the true
        load, independent of the bias.
        """
        # In place where possible: for so few records new memory takes longer than the sums.
        noisy = self._random.standard_normal(wrench.shape)
        noisy *= self._noise_std
        noisy += wrench
        status = np.zeros(len(wrench), np.uint32)
        within = np.abs(noisy) <= self._full_scale
        # Compared so that a value that is no number counts as beyond the range.
        if not np.logical_and.reduce(within, axis=None):
            status[~within.all(axis=1)] = self._out_of_range
            noisy = np.minimum(np.maximum(noisy, -self._full_scale), self._full_scale)
        noisy -= self._bias
        noisy *= self._counts_per_unit
        counts = np.rint(noisy, out=noisy)
        np.maximum(counts, -LARGEST_COUNT, out=counts)
        return np.minimum(counts, LARGEST_COUNT, out=counts).astype(np.int32), status


@dataclass(frozen=True)
class Page:
    """Response of the web server."""

    status: int
    content_type: str
    body: bytes


class NetFtBoxTwin:
    """Answers at once, from the settings and the latest measurement of the streaming twin.

    With `busy` every page is refused with 503, as the box does when it is queried too often.
    `configuration` may be changed at run time.
    """

    def __init__(self, streaming: NetFtTwin) -> None:
        settings = streaming.settings
        self._streaming = streaming
        self.busy = False
        self.configuration = NetFtConfiguration(
            product=PRODUCTS[settings.is_axia],
            serial_number="TWIN",
            force_unit="N",
            torque_unit="Nm",
            counts_per_force=settings.counts_per_N,
            counts_per_torque=settings.counts_per_Nm,
            rdt_enabled=True,
            rdt_rate_Hz=round(settings.internal_rate_Hz / settings.decimation, 6),
            internal_rate_Hz=settings.internal_rate_Hz,
            records_per_datagram=settings.buffer_records,
            low_pass=str(settings.low_pass or 0),
            tool_transformation=settings.tool_transformation,
            is_axia=settings.is_axia,
        )
        self._full_scale = settings.full_scale

    def read_configuration(self) -> NetFtConfiguration:
        """The configuration as on the page; a driver in the same process reads it here."""
        return replace(self.configuration)

    def page(self, target: str) -> Page:
        """Response to `GET target`. A query string is ignored, as there is only one
        configuration.
        """
        if self.busy:
            return Page(UNAVAILABLE, "text/plain", b"busy")
        if target.partition("?")[0] != PATH:
            return Page(NOT_FOUND, "text/plain", b"no such page")
        others = {
            "runstat": "0x00000000",
            "cfgmr": ";".join(f"{limit:g}" for limit in self._full_scale),
        }
        return Page(OK, "text/xml", encode_configuration(self.configuration, others))

    def answer(self, command: bytes) -> bytes:
        """Reply of the command interface to 20 bytes; empty if they are not a read command."""
        try:
            order = decode_command(command)
        except MalformedFrame:
            return b""
        if isinstance(order, ReadCalibrationInfo):
            configuration = self.configuration
            per_unit = round(configuration.counts_per_force), round(configuration.counts_per_torque)
            return encode_calibration(
                CalibrationInfo(
                    configuration.force_unit,
                    configuration.torque_unit,
                    *per_unit,
                    self._scale_factors(),
                )
            )
        # From now on the twin samples without a stream too, so that later readings are current.
        self._streaming.samples_without_stream = True
        if order.bias:
            self._streaming.bias()
        counts, status = self._streaming.latest()
        scaled = np.rint(counts / np.array(self._scale_factors()))
        small = np.clip(scaled, -LARGEST_READING - 1, LARGEST_READING).astype(int)
        return encode_reading(NetFtReading(status >> 16, tuple(small.tolist())))

    def _scale_factors(self) -> tuple[int, ...]:
        """Smallest integer scale factors with which the full scale fits 16 bits."""
        per_unit = (self.configuration.counts_per_N,) * 3 + (self.configuration.counts_per_Nm,) * 3
        largest = [
            limit * counts / LARGEST_READING
            for limit, counts in zip(self._full_scale, per_unit, strict=True)
        ]
        return tuple(max(1, int(np.ceil(factor))) for factor in largest)


def make_twin(
    link: DatagramLink,
    keys: NetFtSection,
    noise_std: tuple[float, ...],
    random: np.random.Generator,
) -> NetFtTwin:
    """The twin of the box that [force_sensor] names, on its end of the link."""
    stated = keys.settings()
    settings = keys.to_dataclass(
        NetFtTwinSettings,
        decimation=stated.decimation,
        internal_rate_Hz=stated.internal_rate_Hz,
        noise_std=noise_std,
        is_axia=stated.is_axia,
        tool_transformation=stated.tool_transformation,
    )
    return NetFtTwin(link, settings, random)
