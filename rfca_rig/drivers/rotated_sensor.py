"""A force sensor that is mounted in other axes than the rig's."""

from dataclasses import replace

from rfca_rig.codecs.sensor_axes import SensorAxes
from rfca_rig.drivers.roles import (
    ConfiguredSensor,
    ForceSamples,
    ForceSensor,
    SensorScale,
    StreamHealth,
)


class RotatedSensor:
    """Implements `ForceSensor`: the counts of `sensor` in the rig's axes.

    Everything behind it, limits, recording, view and reports, has the rig's axes only. The counts
    themselves are the device's, in another order and with other signs; `identity` has the axes,
    with which a reader of the recording gets the device's own columns back.
    """

    def __init__(self, sensor: ForceSensor, axes: SensorAxes) -> None:
        self._sensor = sensor
        self._axes = axes

    def start(self) -> None:
        self._sensor.start()

    def read(self) -> ForceSamples:
        samples = self._sensor.read()
        return replace(samples, counts=self._axes.to_rig(samples.counts))

    def stop(self) -> None:
        self._sensor.stop()

    def scale(self) -> SensorScale:
        return self._sensor.scale()

    def health(self) -> StreamHealth:
        return self._sensor.health()

    def identity(self) -> dict[str, str]:
        return {**self._sensor.identity(), "axes": " ".join(self._axes.names)}

    def check_configuration(self) -> list[str]:
        """As `ConfiguredSensor`; empty for a sensor that states no settings."""
        if isinstance(self._sensor, ConfiguredSensor):
            return self._sensor.check_configuration()
        return []


def with_axes(sensor: ForceSensor, axes: SensorAxes) -> ForceSensor:
    """The sensor in the rig's axes; the same object where the device has them already."""
    if axes.is_identity:
        return sensor
    return RotatedSensor(sensor, axes)
