"""[force_sensor] in a rig file: one section per kind of sensor, told apart by `device`."""

from typing import Annotated, Literal

from pydantic import ConfigDict, Field, model_validator

from rfca_rig.clock import Clock
from rfca_rig.codecs.ati_serial import RecordForm
from rfca_rig.description.sections import Positive, Section
from rfca_rig.drivers.ati_serial import AtiSerialSettings
from rfca_rig.drivers.roles import ForceSensor as ForceSensorRole
from rfca_rig.drivers.serial_port import SerialPort, open_port
from rfca_rig.errors import BadInput

Port = Annotated[int, Field(gt=0, le=65535)]


class NetFtSection(Section):
    """An ATI Net F/T; the counts per unit stand on its configuration page and in its calibration certificate.

    `configuration` says where the box is asked, before each stream, whether it is set as this file says: on its configuration page
    ("http": counts, units and rate), at its command interface ("commands": counts and units), or nowhere ("unchecked").
    `buffered` takes many records a datagram, as many as the box's RDT buffer size.
    """

    device: Literal["ati-net-ft"]
    counts_per_N: Positive
    counts_per_Nm: Positive
    rate_Hz: Annotated[float, Field(gt=0, le=7912)]
    host: str = "192.168.1.1"
    port: Port = 49152
    configuration: Literal["http", "commands", "unchecked"] = "http"
    http_port: Port = 80
    command_port: Port = 49151
    buffered: bool = True


class AtiSerialSection(Section):
    """An ATI F/T Controller (CTL, CON) on a serial port; the counts per unit stand in its calibration certificate.

    `rate_Hz` is what the controller sends, which its averaging and the line decide; a run measures it and refuses another one.
    """

    device: Literal["ati-serial"]
    counts_per_N: Positive
    counts_per_Nm: Positive
    rate_Hz: Positive
    port: str = "/dev/ttyUSB0"
    bits_per_s: Annotated[int, Field(gt=0)] = 38_400
    record: Literal["ascii", "binary", "binary-checksum"] = "ascii"

    def settings(self) -> AtiSerialSettings:
        """The same for the driver."""
        form = RecordForm(self.record)
        return AtiSerialSettings(self.counts_per_N, self.counts_per_Nm, self.rate_Hz, form, self.bits_per_s, address=self.port)

    @model_validator(mode="after")
    def _line_carries_it(self) -> "AtiSerialSection":
        try:
            self.settings()
        except BadInput as error:
            raise ValueError(str(error)) from None
        return self


class AtiDaqSection(Section):
    """An ATI DAQ F/T: gage voltages through a sampling card. `calibration_file` is the .cal file that came with the transducer.

    Its path counts from the folder of the rig file. `unloaded_V` are the voltages with nothing on the sensor, in the order of the
    channels; `channels` are six differential inputs as the card's maker names them, and a seventh for the thermistor where the
    calibration compensates by one.
    """

    device: Literal["ati-daq"]
    calibration_file: Annotated[str, Field(min_length=1)]
    rate_Hz: Annotated[float, Field(gt=0, le=40_000)]
    unloaded_V: Annotated[tuple[float, ...], Field(strict=False, min_length=6, max_length=7)] = (0.0,) * 6
    channels: str = "Dev1/ai0:5"


class OwnForceSensorSection(Section):
    """A sensor of a lab's own, read by what `file` defines as FORCE_SENSOR; `twin_file` defines its TWIN. Both count from the rig file's
    folder.

    Here the other keys are only carried along: what they must be, FORCE_SENSOR says when the rig file is read (`own_devices`).
    """

    model_config = ConfigDict(extra="allow")

    device: Literal["own"]
    file: Annotated[str, Field(min_length=1)]
    twin_file: Annotated[str, Field(min_length=1)] | None = None
    rate_Hz: Positive


class ForceSensorKeys(OwnForceSensorSection):
    """What a lab's file inherits for its FORCE_SENSOR: the keys of [force_sensor], and the driver they make."""

    model_config = ConfigDict(extra="forbid")

    counts_per_N: Positive
    counts_per_Nm: Positive
    port: str = "/dev/ttyUSB0"
    bits_per_s: Annotated[int, Field(gt=0)] = 115_200

    def open(self) -> SerialPort:
        """The way to the sensor, to be closed by the caller; override it for one that is on no serial port. Raises DeviceError."""
        return open_port(self.port, self.bits_per_s)

    def driver(self, port: SerialPort, clock: Clock) -> ForceSensorRole:
        """The driver on that port."""
        raise NotImplementedError("FORCE_SENSOR defines no driver(port, clock)")


ForceSensor = Annotated[NetFtSection | AtiSerialSection | AtiDaqSection | OwnForceSensorSection, Field(discriminator="device")]
