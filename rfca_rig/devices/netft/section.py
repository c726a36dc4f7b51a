"""Keys of [force_sensor] for an ATI Net F/T; the settings of its driver, and what driver or twin
are connected to.
"""

from dataclasses import dataclass
from typing import Annotated, Literal, Protocol

from pydantic import Field, model_validator

from rfca_rig.devices.netft.codec import (
    NO_TRANSFORMATION,
    CalibrationInfo,
    NetFtConfiguration,
    ToolTransformation,
)
from rfca_rig.devices.sections import ForceSensorSection
from rfca_rig.drivers.ports import Datagrams
from rfca_rig.errors import BadInput
from rfca_rig.toml import Positive

Port = Annotated[int, Field(gt=0, le=65535)]
Three = Annotated[tuple[float, float, float], Field(strict=False)]

BOX_RATE_HZ = 7000.0
# The highest rate of its converter (setadcrate) in a public driver; the manual says 7912.
AXIA_RATE_HZ = 7812.0


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

    `tool_transformation` and `low_pass`, the code of the filter, are those that the rig file
    states; None where it states no filter.

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
    is_axia: bool = False
    tool_transformation: ToolTransformation = NO_TRANSFORMATION
    low_pass: int | None = None

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
    """An ATI Net F/T, with its NetBox or as an Ethernet Axia. The counts per unit are on its
    configuration page and in its calibration certificate.

    `configuration` states where the box's settings are checked before each stream: on its
    configuration page ("http": counts, units and rate), at its command interface ("commands":
    counts and units), or not at all ("unchecked"). `buffered` takes many records per datagram, as
    many as the box's RDT buffer size. A tool transformation that is set in the box turns and shifts
    all forces, so it is refused unless it is stated here.
    """

    device: Literal["ati-net-ft"]
    model: Literal["net-box", "axia"] = Field(
        default="net-box",
        description="NetBox or Ethernet Axia, which has other status bits",
    )
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

    adc_rate_Hz: Annotated[float, Field(gt=0, le=8000)] | None = Field(
        default=None, description="sampling rate of an Ethernet Axia; 7812 if not given"
    )
    tool_transformation_mm: Three | None = Field(
        default=None, description="shift that is set in the box as its tool transformation"
    )
    tool_transformation_deg: Three | None = Field(
        default=None, description="turns about x, y, z that are set in the box with it"
    )
    low_pass: Annotated[int, Field(ge=0, le=12)] | None = Field(
        default=None, description="code of the box's low-pass filter, 0 for none"
    )

    @model_validator(mode="after")
    def _rate_belongs_to_an_axia(self) -> "NetFtSection":
        if self.adc_rate_Hz is not None and self.model != "axia":
            raise ValueError(
                f'adc_rate_Hz is for model = "axia"; a NetBox samples at {BOX_RATE_HZ:g} Hz'
            )
        return self

    @property
    def internal_rate_Hz(self) -> float:
        """Rate of the sensor's own samples."""
        if self.model == "axia":
            return self.adc_rate_Hz or AXIA_RATE_HZ
        return BOX_RATE_HZ

    def transformation(self) -> ToolTransformation:
        """The tool transformation that the file states; none without its keys."""
        nothing = (0.0, 0.0, 0.0)
        return ToolTransformation(
            self.tool_transformation_mm or nothing, self.tool_transformation_deg or nothing
        )

    def settings(self) -> NetFtSettings:
        """The settings for the driver. Raises BadInput for a rate that the box cannot have."""
        return self.to_dataclass(
            NetFtSettings,
            address=f"{self.host}:{self.port}",
            internal_rate_Hz=self.internal_rate_Hz,
            is_axia=self.model == "axia",
            tool_transformation=self.transformation(),
        )
