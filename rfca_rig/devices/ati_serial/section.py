"""Keys of [force_sensor] for an ATI F/T Controller."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from rfca_rig.devices.ati_serial.codec import RecordForm
from rfca_rig.devices.sections import SerialSensorKeys
from rfca_rig.toml import Positive


class AtiSerialSection(SerialSensorKeys):
    """An ATI F/T Controller (CTL, CON) on a serial port. The counts per unit are in its calibration
    certificate.

    `rate_Hz` is the rate at which the controller sends. It follows from its averaging and the
    serial line. A run measures it and is refused if it differs.
    """

    device: Literal["ati-serial"]
    counts_per_N: Positive = Field(description="in the calibration certificate")
    counts_per_Nm: Positive = Field(description="in the calibration certificate")
    rate_Hz: Positive = Field(description="rate at which the controller sends; a run measures it")
    port: str = Field(default="/dev/ttyUSB0", description="serial port")
    bits_per_s: Annotated[int, Field(gt=0)] = Field(
        default=38_400, description="of the serial line"
    )
    record: Literal["ascii", "binary", "binary-checksum"] = Field(
        default="ascii", description="form of a record"
    )

    @model_validator(mode="after")
    def _line_carries_it(self) -> "AtiSerialSection":
        # Ten bits per byte: start bit, eight data bits, stop bit.
        most_Hz = self.bits_per_s / (10.0 * self.form.record_bytes)
        if self.rate_Hz > most_Hz * (1.0 + 1e-9):
            raise ValueError(
                f"force sensor: rate_Hz is {self.rate_Hz:g}, at {self.bits_per_s} bit/s "
                f"the line carries {most_Hz:.1f} records/s "
                f"in the form {self.form.value!r}; lower rate_Hz or take the form 'binary-checksum'"
            )
        return self

    @property
    def form(self) -> RecordForm:
        """The form of a record, for the codec."""
        return RecordForm(self.record)
