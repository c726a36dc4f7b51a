"""Keys of [force_sensor] for an ATI DAQ F/T."""

from pathlib import Path
from typing import Annotated, ClassVar, Literal

from pydantic import Field

from rfca_rig.devices.ati_daq.codec import TransducerCalibration, parse_calibration
from rfca_rig.devices.sections import ForceSensorSection
from rfca_rig.errors import BadInput


class AtiDaqSection(ForceSensorSection):
    """An ATI DAQ F/T: gage voltages through a sampling card. `calibration_file` is the .cal file
    that came with the transducer.

    Its path is relative to the folder of the rig file. `unloaded_V` are the voltages of the
    unloaded sensor, in the order of the channels. `channels` are six differential inputs in the
    notation of the card's maker, and a seventh for the thermistor where the calibration compensates
    temperature.
    """

    file_keys: ClassVar = ("calibration_file",)

    device: Literal["ati-daq"]
    calibration_file: Annotated[str, Field(min_length=1)] = Field(
        description="the .cal file of the transducer, from the folder of this file"
    )
    rate_Hz: Annotated[float, Field(gt=0, le=40_000)] = Field(
        description="samples/s of each channel"
    )
    unloaded_V: Annotated[tuple[float, ...], Field(strict=False, min_length=6, max_length=7)] = (
        Field(
            default=(0.0,) * 6,
            description="voltages of the unloaded sensor, in the order of the channels",
        )
    )
    channels: str = Field(
        default="Dev1/ai0:5", description="six differential inputs, and a seventh for a thermistor"
    )

    def calibration(self) -> TransducerCalibration:
        """The calibration in the file. Raises BadInput where it cannot be read, or is no
        calibration file.
        """
        try:
            content = Path(self.calibration_file).read_bytes()
        except OSError as error:
            raise BadInput(
                f"{self.calibration_file}: cannot be read: {error.strerror}; see "
                "calibration_file in the rig file"
            ) from None
        return parse_calibration(content, self.calibration_file)
