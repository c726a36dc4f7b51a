"""The sensor's side of the datagram link: an ATI Net F/T NetBox with its transducer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.codecs.netbox_status import SATURATED
from rfca_rig.codecs.rdt import MOST_RECORDS, RdtCommand, Records, Request, decode_request, encode_records
from rfca_rig.twins.datagram_link import LinkEnd
from rfca_rig.twins.ticks import Ticks

Floats = NDArray[np.float64]

LARGEST_COUNT = 2**31 - 1


@dataclass(frozen=True)
class NetFtTwinSettings:
    """How the box is configured, and the transducer: standard deviation of its noise and range per axis, in N and N m.

    One record per `decimation` internal samples, `buffer_records` of them per datagram in buffered mode. Public drivers
    disagree on whether setting the bias ends a running stream; `bias_stops_stream` chooses.
    """

    counts_per_N: float = 1e6
    counts_per_Nm: float = 1e6
    decimation: int = 1
    internal_rate_Hz: float = 7000.0
    buffer_records: int = MOST_RECORDS
    noise_std: tuple[float, ...] = (0.0,) * 6
    full_scale: tuple[float, ...] = (330.0, 330.0, 990.0, 30.0, 30.0, 30.0)
    bias_stops_stream: bool = False


@dataclass
class _Stream:
    """What a start request asked for. `left` None is without end."""

    records_per_datagram: int
    left: int | None
    sequence: int = 1


class NetFtTwin:
    """Takes requests, samples on its own grid n / rate since power-up, sends records. Brought forward step by step by a world:

    `take_requests`, `due`, then, after the plant moved, `measured`.
    """

    def __init__(self, link: LinkEnd, settings: NetFtTwinSettings, random: np.random.Generator) -> None:
        self._link = link
        self._settings = settings
        self._random = random
        self._ticks = Ticks(settings.decimation / settings.internal_rate_Hz)
        self._stream: _Stream | None = None
        self._due: list[Floats] = []
        self._held = 0
        self._first_held = 0
        self._bias = np.zeros(6)
        self._bias_wanted = False
        self._counts_per_unit = np.repeat([settings.counts_per_N, settings.counts_per_Nm], 3)
        self._noise_std, self._full_scale = np.array(settings.noise_std), np.array(settings.full_scale)

    def take_requests(self) -> None:
        """Obeys what has come in, the last one winning; what is not an RDT request is ignored, as the box does."""
        for datagram in self._link.receive_all():
            try:
                self._obey(decode_request(datagram))
            except MalformedFrame:
                continue

    def _obey(self, request: Request) -> None:
        if request.command in {RdtCommand.START_SINGLE, RdtCommand.START_BUFFERED}:
            size = 1 if request.command == RdtCommand.START_SINGLE else self._settings.buffer_records
            self._begin(_Stream(size, request.sample_count or None))
        elif request.command == RdtCommand.STOP:
            self._begin(None)
        elif request.command == RdtCommand.SET_BIAS:
            self._bias_wanted = True
            self._begin(None if self._settings.bias_stops_stream else self._stream)

    def _begin(self, stream: _Stream | None) -> None:
        if stream is not self._stream:
            self._stream = stream
            self._due, self._held = [], 0

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in the step that ends at `to_s`; none while nobody listens and no bias is wanted."""
        times_s = self._ticks.until(to_s)
        return times_s if self._stream is not None or self._bias_wanted else times_s[:0]

    def measured(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6) at the times that were due, and sends the datagrams that are full."""
        if self._bias_wanted and len(wrench):
            self._bias, self._bias_wanted = wrench[-1].copy(), False
        if self._stream is None or not len(wrench):
            return
        if self._held == 0:
            self._first_held = self._ticks.taken - len(wrench) + 1
        self._due.append(wrench)
        self._held += len(wrench)
        if self._held >= self._stream.records_per_datagram or (self._stream.left is not None and self._held >= self._stream.left):
            self._send_full(self._stream)

    def _send_full(self, stream: _Stream) -> None:
        wrench = self._due[0] if len(self._due) == 1 else np.concatenate(self._due)
        sent = 0
        while sent < len(wrench) and (size := self._next_size(stream, len(wrench) - sent)):
            self._send(stream, wrench[sent : sent + size], self._first_held + sent)
            sent += size
        self._due, self._held, self._first_held = [wrench[sent:]], len(wrench) - sent, self._first_held + sent
        if stream.left == 0:
            self._begin(None)

    def _next_size(self, stream: _Stream, held: int) -> int:
        """Records of the next datagram: a full one, or the last of a counted stream; 0 while there are not enough."""
        size = stream.records_per_datagram if stream.left is None else min(stream.records_per_datagram, stream.left)
        return size if size <= held else 0

    def _send(self, stream: _Stream, wrench: Floats, first: int) -> None:
        order = np.arange(len(wrench))
        counts, status = self._digitised(wrench)
        records = Records(
            rdt_sequence=((stream.sequence + order) & 0xFFFFFFFF).astype(np.uint32),
            ft_sequence=((first + order) * self._settings.decimation & 0xFFFFFFFF).astype(np.uint32),
            status=status,
            counts=counts,
        )
        self._link.send(encode_records(records))
        stream.sequence += len(wrench)
        if stream.left is not None:
            stream.left -= len(wrench)

    def _digitised(self, wrench: Floats) -> tuple[NDArray[np.int32], NDArray[np.uint32]]:
        """Counts (m, 6) and status (m,). The converter saturates on what the transducer feels, bias or not."""
        felt = wrench + self._random.standard_normal(wrench.shape) * self._noise_std
        within = np.minimum(np.maximum(felt, -self._full_scale), self._full_scale)
        status = np.where((within != felt).any(axis=1), np.uint32(SATURATED), np.uint32(0))
        counts = np.rint((within - self._bias) * self._counts_per_unit)
        return np.clip(counts, -LARGEST_COUNT, LARGEST_COUNT).astype(np.int32), status
