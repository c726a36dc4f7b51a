"""[force_sensor] in a rig file: one section per kind of sensor, selected by `device`."""

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from rfca_rig.clock import Clock
from rfca_rig.codecs.ati_serial import RecordForm
from rfca_rig.drivers.force_sensors.ati_serial import AtiSerialSettings
from rfca_rig.drivers.ports import SerialPort, open_port
from rfca_rig.drivers.roles import ForceSensor as ForceSensorRole
from rfca_rig.errors import BadInput
from rfca_rig.toml import Positive, Section

Port = Annotated[int, Field(gt=0, le=65535)]


class NetFtSection(Section):
    """An ATI Net F/T. The counts per unit are on its configuration page and in its calibration certificate.

    `configuration` states where the box's settings are checked before each stream: on its configuration page ("http": counts, units and
    rate), at its command interface ("commands": counts and units), or not at all ("unchecked"). `buffered` takes many records per datagram,
    as many as the box's RDT buffer size.
    """

    device: Literal["ati-net-ft"]
    counts_per_N: Positive = Field(description="on the configuration page of the box")
    counts_per_Nm: Positive = Field(description="on the configuration page of the box")
    rate_Hz: Annotated[float, Field(gt=0, le=7912)] = Field(description="RDT output rate of the box")
    host: str = Field(default="192.168.1.1", description="address of the box")
    port: Port = Field(default=49152, description="port of its RDT stream")
    configuration: Literal["http", "commands", "unchecked"] = Field(
        default="http", description="where the settings of the box are checked before each stream"
    )
    http_port: Port = Field(default=80, description="port of its configuration page")
    command_port: Port = Field(default=49151, description="port of its command interface")
    buffered: bool = Field(default=True, description="many records per datagram, as many as the RDT buffer size of the box")


class AtiSerialSection(Section):
    """An ATI F/T Controller (CTL, CON) on a serial port. The counts per unit are in its calibration certificate.

    `rate_Hz` is the rate at which the controller sends. It follows from its averaging and the serial line. A run measures it and is refused
    if it differs.
    """

    device: Literal["ati-serial"]
    counts_per_N: Positive = Field(description="in the calibration certificate")
    counts_per_Nm: Positive = Field(description="in the calibration certificate")
    rate_Hz: Positive = Field(description="rate at which the controller sends; a run measures it")
    port: str = Field(default="/dev/ttyUSB0", description="serial port")
    bits_per_s: Annotated[int, Field(gt=0)] = Field(default=38_400, description="of the serial line")
    record: Literal["ascii", "binary", "binary-checksum"] = Field(default="ascii", description="form of a record")

    def settings(self) -> AtiSerialSettings:
        """The settings for the driver."""
        form = RecordForm(self.record)
        return AtiSerialSettings(self.counts_per_N, self.counts_per_Nm, self.rate_Hz, form, self.bits_per_s, address=self.port)

    @model_validator(mode="after")
    def _line_carries_it(self) -> "AtiSerialSection":
        # The driver knows which rates a line can carry; its refusal becomes a message with the line of the file.
        try:
            self.settings()
        except BadInput as error:
            raise ValueError(str(error)) from None
        return self


class AtiDaqSection(Section):
    """An ATI DAQ F/T: gage voltages through a sampling card. `calibration_file` is the .cal file that came with the transducer.

    Its path is relative to the folder of the rig file. `unloaded_V` are the voltages of the unloaded sensor, in the order of the channels.
    `channels` are six differential inputs in the notation of the card's maker, and a seventh for the thermistor where the calibration
    compensates temperature.
    """

    device: Literal["ati-daq"]
    calibration_file: Annotated[str, Field(min_length=1)] = Field(
        description="the .cal file of the transducer, from the folder of this file"
    )
    rate_Hz: Annotated[float, Field(gt=0, le=40_000)] = Field(description="samples/s of each channel")
    unloaded_V: Annotated[tuple[float, ...], Field(strict=False, min_length=6, max_length=7)] = Field(
        default=(0.0,) * 6, description="voltages of the unloaded sensor, in the order of the channels"
    )
    channels: str = Field(default="Dev1/ai0:5", description="six differential inputs, and a seventh for a thermistor")


class OwnForceSensorSection(Section):
    """A lab's own sensor, read by the class FORCE_SENSOR in `file`; `twin_file` defines its TWIN. Both are relative to the rig file's
    folder.  Other keys are only passed on here. FORCE_SENSOR validates them when the rig file is read.
    """

    # A lab's class defines keys that are unknown here.
    model_config = ConfigDict(extra="allow")

    device: Literal["own"]
    file: Annotated[str, Field(min_length=1)]
    twin_file: Annotated[str, Field(min_length=1)] | None = None
    rate_Hz: Positive


class ForceSensorKeys(OwnForceSensorSection):
    """Base class of a lab's FORCE_SENSOR: the keys of [force_sensor], and the driver that is made from them."""

    # A wrong key is refused again, now that the lab's class states all of them.
    model_config = ConfigDict(extra="forbid")

    counts_per_N: Positive
    counts_per_Nm: Positive
    port: str = "/dev/ttyUSB0"
    bits_per_s: Annotated[int, Field(gt=0)] = 115_200

    def open(self) -> SerialPort:
        """Open the connection to the sensor, to be closed by the caller. Override it for a sensor that is not on a serial port.

        Raises DeviceError.
        """
        return open_port(self.port, self.bits_per_s)

    def driver(self, port: SerialPort, clock: Clock) -> ForceSensorRole:
        """The driver on that port."""
        raise NotImplementedError("FORCE_SENSOR defines no driver(port, clock)")


ForceSensor = Annotated[NetFtSection | AtiSerialSection | AtiDaqSection | OwnForceSensorSection, Field(discriminator="device")]
