"""Twin of a Net F/T box without its stream: configuration page and command interface."""

from dataclasses import dataclass, replace

import numpy as np

from rfca_rig.codecs.malformed import MalformedFrame
from rfca_rig.codecs.netft_commands import (
    CalibrationInfo,
    NetFtReading,
    ReadCalibrationInfo,
    decode_command,
    encode_calibration,
    encode_reading,
)
from rfca_rig.codecs.netft_configuration import PATH, NetFtConfiguration, encode_configuration
from rfca_rig.twins.netft import NetFtTwin, NetFtTwinSettings

OK, NOT_FOUND, UNAVAILABLE = 200, 404, 503
LARGEST_READING = 2**15 - 1


@dataclass(frozen=True)
class Page:
    """Response of the web server."""

    status: int
    content_type: str
    body: bytes


class NetFtBoxTwin:
    """Answers at once, from the settings and the latest measurement of the streaming twin.

    With `busy` every page is refused with 503, as the box does when it is queried too often. `configuration` may be changed at run time.
    """

    def __init__(self, streaming: NetFtTwin, settings: NetFtTwinSettings) -> None:
        self._streaming = streaming
        self.busy = False
        self.configuration = NetFtConfiguration(
            product="Net F/T twin",
            serial_number="TWIN",
            force_unit="N",
            torque_unit="Nm",
            counts_per_force=settings.counts_per_N,
            counts_per_torque=settings.counts_per_Nm,
            rdt_enabled=True,
            rdt_rate_Hz=round(settings.internal_rate_Hz / settings.decimation, 6),
            internal_rate_Hz=settings.internal_rate_Hz,
            records_per_datagram=settings.buffer_records,
            low_pass="0",
        )
        self._full_scale = settings.full_scale

    def says(self) -> NetFtConfiguration:
        """The configuration as on the page; a driver in the same process reads it here."""
        return replace(self.configuration)

    def page(self, target: str) -> Page:
        """Response to `GET target`. A query string is ignored, as there is only one configuration."""
        if self.busy:
            return Page(UNAVAILABLE, "text/plain", b"busy")
        if target.partition("?")[0] != PATH:
            return Page(NOT_FOUND, "text/plain", b"no such page")
        others = {"runstat": "0x00000000", "cfgmr": ";".join(f"{limit:g}" for limit in self._full_scale)}
        return Page(OK, "text/xml", encode_configuration(self.configuration, others))

    def answer(self, command: bytes) -> bytes:
        """Reply of the command interface to 20 bytes; empty if they are not a read command."""
        try:
            order = decode_command(command)
        except MalformedFrame:
            return b""
        if isinstance(order, ReadCalibrationInfo):
            return encode_calibration(self._calibration_info())
        # From now on the twin samples without a stream too, so that later readings are current.
        self._streaming.samples_without_stream = True
        if order.bias:
            self._streaming.bias()
        counts, status = self._streaming.latest()
        scaled = np.rint(counts / np.array(self._scale_factors()))
        small = np.clip(scaled, -LARGEST_READING - 1, LARGEST_READING).astype(int)
        return encode_reading(NetFtReading(status >> 16, tuple(small.tolist())))

    def _calibration_info(self) -> CalibrationInfo:
        says = self.configuration
        counts = round(says.counts_per_force), round(says.counts_per_torque)
        return CalibrationInfo(says.force_unit, says.torque_unit, *counts, self._scale_factors())

    def _scale_factors(self) -> tuple[int, ...]:
        """Smallest integer scale factors with which the full scale fits 16 bits."""
        per_unit = (self.configuration.counts_per_N,) * 3 + (self.configuration.counts_per_Nm,) * 3
        largest = [limit * counts / LARGEST_READING for limit, counts in zip(self._full_scale, per_unit, strict=True)]
        return tuple(max(1, int(np.ceil(factor))) for factor in largest)
