"""Keys of [force_sensor] for an ATI Net F/T; the settings of its driver, and what driver or twin
are connected to.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

from pydantic import Field

from rfca_rig.devices.netft.codec import CalibrationInfo, NetFtConfiguration
from rfca_rig.devices.sections import ForceSensorSection
from rfca_rig.drivers.ports import Datagrams
from rfca_rig.errors import BadInput
from rfca_rig.toml import Positive

Port = Annotated[int, Field(gt=0, le=65535)]


class NetFtBox(Protocol):
    """Source of the box's configuration. It is read before a stream starts and may wait for the
    network.
    """

    def read_configuration(self) -> NetFtConfiguration | CalibrationInfo:
        """Reads the configuration. Raises DeviceError if the box does not answer, or its answer
        cannot be decoded.
        """
        ...


@dataclass(frozen=True)
class NetFtConnection:
    """What the driver talks to: the stream of records, and where the settings of the box are read.

    `advice` is a note on the connection, see `advise_receive_buffer`.
    """

    datagrams: Datagrams
    box: NetFtBox | None
    advice: str = ""

    def close(self) -> None:
        self.datagrams.close()


@dataclass(frozen=True)
class NetFtSettings:
    """Scale and rate as configured in the box (cfgcpf, cfgcpt, comrdtrate); `address` and
    `serial_number` are for the recording.

    With `buffered` the box puts as many records into a datagram as its RDT buffer size says: fewer
    datagrams, each late by up to one buffer. Raises BadInput for a rate that is not
    `internal_rate_Hz` divided by an integer: the box rounds to such a rate.
    """

    counts_per_N: float = 1e6
    counts_per_Nm: float = 1e6
    rate_Hz: float = 7000.0
    internal_rate_Hz: float = 7000.0
    address: str = ""
    serial_number: str = ""
    buffered: bool = True

    def __post_init__(self) -> None:
        for name in ("counts_per_N", "counts_per_Nm", "rate_Hz", "internal_rate_Hz"):
            if not 0.0 < getattr(self, name) < float("inf"):
                raise BadInput(f"force sensor: {name} is {getattr(self, name)}, must be above 0")
        # The tolerance allows for a rate that is written with a few digits, such as 2333.3.
        if abs(self.rate_Hz * self.decimation / self.internal_rate_Hz - 1.0) > 1e-3:
            nearest_Hz = self.internal_rate_Hz / self.decimation
            raise BadInput(
                f"force sensor: rate_Hz is {self.rate_Hz:g}, must be "
                f"{self.internal_rate_Hz:g}/n; nearest {nearest_Hz:.2f}"
            )

    @property
    def decimation(self) -> int:
        """Internal samples per record."""
        return max(1, round(self.internal_rate_Hz / self.rate_Hz))

    @property
    def record_period_s(self) -> float:
        return self.decimation / self.internal_rate_Hz


class NetFtSection(ForceSensorSection):
    """An ATI Net F/T. The counts per unit are on its configuration page and in its calibration
    certificate.

    `configuration` states where the box's settings are checked before each stream: on its
    configuration page ("http": counts, units and rate), at its command interface ("commands":
    counts and units), or not at all ("unchecked"). `buffered` takes many records per datagram, as
    many as the box's RDT buffer size.
    """

    device: Literal["ati-net-ft"]
    counts_per_N: Positive = Field(description="on the configuration page of the box")
    counts_per_Nm: Positive = Field(description="on the configuration page of the box")
    rate_Hz: Annotated[float, Field(gt=0, le=7912)] = Field(
        description="RDT output rate of the box"
    )
    host: str = Field(default="192.168.1.1", description="address of the box")
    port: Port = Field(default=49152, description="port of its RDT stream")
    configuration: Literal["http", "commands", "unchecked"] = Field(
        default="http", description="where the settings of the box are checked before each stream"
    )
    http_port: Port = Field(default=80, description="port of its configuration page")
    command_port: Port = Field(default=49151, description="port of its command interface")
    buffered: bool = Field(
        default=True,
        description="many records per datagram, as many as the RDT buffer size of the box",
    )

    def settings(self) -> NetFtSettings:
        """The settings for the driver. Raises BadInput for a rate that the box cannot have."""
        return self.to_dataclass(NetFtSettings, address=f"{self.host}:{self.port}")
