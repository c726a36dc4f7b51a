"""How the twin of a force sensor is mounted: its axes, a hand that pushes on the leg, and the
faults of a mounting, which no box and no protocol states.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.sensor_axes import SensorAxes
from rfca_rig.twin_server.faults import Fault, FaultPanel
from rfca_rig.twins.world import SensorTwin

Floats = NDArray[np.float64]

# The thickness of an adapter plate that was forgotten, and a calibration of another range.
LOWER_M = 0.025
GAIN = 1.2

LOWER = Fault("sensor-lower", "the sensor sits 25 mm lower than below_shaft_mm says")
MOUNT_FAULTS = (
    Fault("sensor-turned-90", "the sensor is mounted turned by 90 degrees about its z axis"),
    Fault("sensor-turned-180", "the sensor is mounted turned by 180 degrees about its z axis"),
    Fault("sensor-upside-down", "the sensor is mounted upside down, turned about its y axis"),
    Fault("sensor-mirrored", "the sensor's axes are left-handed: x counts to the other side"),
    Fault("channels-swapped", "fx and fy are swapped, as by a cable or a matrix"),
    Fault("channel-inverted", "fz has the wrong sign"),
    Fault("sensor-gain", "forces have 20 % more counts than the calibration says"),
    LOWER,
)


def _both(forces: list[list[float]], moments: list[list[float]]) -> Floats:
    """(6, 6) of the 3 x 3 matrices of forces and moments."""
    matrix = np.zeros((6, 6))
    matrix[:3, :3] = forces
    matrix[3:, 3:] = moments
    return matrix


def _turned(matrix: list[list[float]]) -> Floats:
    """(6, 6) of a sensor that is turned: moments as forces."""
    return _both(matrix, matrix)


_UNCHANGED = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
# What the sensor reads is the matrix times what it would read without the fault.
_IN_THE_SENSOR = {
    "sensor-turned-90": _turned([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]),
    "sensor-turned-180": _turned([[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]]),
    "sensor-upside-down": _turned([[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]),
    # Moments of a mirrored frame turn the other way.
    "sensor-mirrored": _both(
        [[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]],
        [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
    ),
    "channels-swapped": _both([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], _UNCHANGED),
    "channel-inverted": _both([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]], _UNCHANGED),
    "sensor-gain": _both((GAIN * np.eye(3)).tolist(), _UNCHANGED),
}


def load_at_point(force_N: Floats, at_m: Floats) -> Floats:
    """Wrench (6,) on the sensor of a force (3,) that acts at a point (3,) from the sensor's origin,
    in the rig's axes.
    """
    return np.concatenate([force_N, np.cross(at_m, force_N)])


@dataclass
class SimulatedLoad:
    """What a hand or a hung mass adds to the load on the sensor, in the rig's axes; nothing until
    it is set.
    """

    wrench: Floats = field(default_factory=lambda: np.zeros(6))

    def push(self, force_N: Sequence[float], below_shaft_m: float, lever_m: float = 0.0) -> None:
        """A force (3,) at the height of the shaft's axis, `lever_m` along y from it; 0 N ends."""
        at_m = np.array([0.0, lever_m, -below_shaft_m])
        self.wrench = load_at_point(np.array(force_N), at_m)


class MountedSensorTwin:
    """Implements `SensorTwin`: the true wrench in the rig's axes, with the added load, becomes that
    of the sensor as it is mounted.
    """

    def __init__(
        self,
        sensor: SensorTwin,
        axes: SensorAxes,
        panel: FaultPanel | None,
        load: SimulatedLoad,
    ) -> None:
        self._sensor = sensor
        self._axes = axes
        self._panel = panel
        self._load = load

    def take_requests(self) -> None:
        self._sensor.take_requests()

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in s of the sensor itself."""
        return self._sensor.due(to_s)

    def take_wrench(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6) in the rig's axes."""
        if len(wrench):
            wrench = wrench + self._load.wrench
            if self._panel is not None and self._panel.is_on(LOWER.name):
                wrench[:, 3] += LOWER_M * wrench[:, 1]
                wrench[:, 4] -= LOWER_M * wrench[:, 0]
            wrench = self._axes.to_device(wrench)
            if self._panel is not None and self._panel.any_on():
                wrench = self._with_faults(self._panel, wrench)
        self._sensor.take_wrench(wrench)

    def _with_faults(self, panel: FaultPanel, wrench: Floats) -> Floats:
        for name, matrix in _IN_THE_SENSOR.items():
            if panel.is_on(name):
                wrench = wrench @ matrix.T
        return wrench


def mount_twin(
    sensor: SensorTwin, axes: SensorAxes, panel: FaultPanel | None, load: SimulatedLoad
) -> SensorTwin:
    """The sensor's twin as it is mounted; the same object where nothing can change its load."""
    if axes.is_identity and panel is None:
        return sensor
    return MountedSensorTwin(sensor, axes, panel, load)
