"""Datagram link with injected faults, between the sensor twin and the network."""

from dataclasses import replace

import numpy as np

from rfca_rig.codecs.rdt import RECORD_BYTES, SATURATED, RdtCommand, Records, decode_records, decode_request, encode_records, encode_request
from rfca_rig.errors import MalformedFrame
from rfca_rig.twin_server.faults import FaultPanel
from rfca_rig.twin_server.netft_ports import STARTS
from rfca_rig.twins.wires import DatagramLink

# Faults of single datagrams hit every tenth one.
FAULT_INTERVAL = 10


class TamperedLink:
    """The twin's link; the faults of the panel act on its datagrams."""

    def __init__(self, link: DatagramLink, panel: FaultPanel) -> None:
        self._link = link
        self._panel = panel
        self._sent = 0
        self._overtaken: bytes | None = None
        self._stolen = False
        self._samples_before_restart = 0
        self._last_sample = 0
        self._frozen: Records | None = None
        self._stuck: Records | None = None

    def receive_all(self) -> list[bytes]:
        """Received requests, with those that a fault adds."""
        requests: list[bytes] = []
        if self._panel.take("box-restart"):
            self._samples_before_restart = self._last_sample
            requests.append(encode_request(RdtCommand.STOP))
        self._stolen = self._stolen or self._panel.take("stream-stolen")
        for request in self._link.receive_all():
            command = _command(request)
            # A new start request takes the stream back.
            self._stolen = self._stolen and command not in STARTS
            requests.append(request)
            if command == RdtCommand.SET_BIAS and self._panel.is_on("bias-stops-stream"):
                requests.append(encode_request(RdtCommand.STOP))
        return requests

    def send(self, datagram: bytes) -> None:
        self._sent += 1
        # The internal sample counter is the second word of a record; the last record of the datagram counts.
        self._last_sample = int.from_bytes(datagram[-RECORD_BYTES:][4:8], "big")
        if self._stolen or self._panel.is_on("force-silent"):
            return
        # An earlier fault may have an after-effect: a shifted sample counter, or a datagram that is held back.
        if not self._panel.any_on() and self._samples_before_restart == 0 and self._overtaken is None:
            self._link.send(datagram)
            return
        for altered in self._apply_network_faults(encode_records(self._apply_box_faults(decode_records(datagram)))):
            self._link.send(altered)

    def _apply_box_faults(self, records: Records) -> Records:
        """Applies the faults inside the box."""
        records = replace(records, ft_sequence=records.ft_sequence - np.uint32(self._samples_before_restart))
        if self._panel.is_on("force-scale"):
            records = replace(records, counts=np.clip(2 * records.counts.astype(np.int64), -(2**31) + 1, 2**31 - 1).astype(np.int32))
        if self._panel.is_on("force-saturated"):
            records = replace(records, status=np.full_like(records.status, SATURATED))
        self._stuck = (self._stuck or records) if self._panel.is_on("force-stuck") else None
        if self._stuck is not None:
            records = replace(records, counts=np.broadcast_to(self._stuck.counts[0], records.counts.shape).copy())
        self._frozen = (self._frozen or records) if self._panel.is_on("force-frozen") else None
        return records if self._frozen is None else _repeat_sample(records, self._frozen)

    def _apply_network_faults(self, datagram: bytes) -> list[bytes]:
        """Applies the network faults, to every tenth datagram."""
        waiting, self._overtaken = self._overtaken, None
        if self._sent % FAULT_INTERVAL == 0:
            if self._panel.is_on("force-lost"):
                datagrams = []
            elif self._panel.is_on("force-twice"):
                datagrams = [datagram, datagram]
            elif self._panel.is_on("force-short"):
                datagrams = [datagram[: -RECORD_BYTES // 4]]
            elif self._panel.is_on("force-long"):
                datagrams = [datagram + b"\0"]
            elif self._panel.is_on("force-swapped"):
                self._overtaken, datagrams = datagram, []
            else:
                datagrams = [datagram]
        else:
            datagrams = [datagram]
        return datagrams if waiting is None else [*datagrams, waiting]

    def close(self) -> None:
        self._link.close()


def _command(request: bytes) -> int | None:
    try:
        return decode_request(request).command
    except MalformedFrame:
        return None


def _repeat_sample(records: Records, frozen: Records) -> Records:
    """Records that repeat the sample of `frozen`; their record numbers run on."""
    return replace(
        records,
        ft_sequence=np.full_like(records.ft_sequence, frozen.ft_sequence[0]),
        counts=np.broadcast_to(frozen.counts[0], records.counts.shape).copy(),
    )
