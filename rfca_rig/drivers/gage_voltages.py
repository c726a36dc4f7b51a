"""What samples the gage voltages of a DAQ F/T transducer, whatever card it is."""

from typing import Protocol

from rfca_rig.codecs.gage_block import GageBlock


class GageVoltages(Protocol):
    """Six differential inputs, and a seventh for the thermistor where the calibration asks for one, on a clock of the card's own."""

    def start(self) -> float:
        """Begins to sample anew; returns the samples per second that the card's clock really gives.

        Raises DeviceError where the card is not there or refuses.
        """
        ...

    def read(self) -> list[GageBlock]:
        """Everything sampled since the last call; never waits. Raises DeviceError where the card gave up."""
        ...

    def stop(self) -> None:
        """May be called at any time, any number of times."""
        ...

    def identity(self) -> dict[str, str]: ...
