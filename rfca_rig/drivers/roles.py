"""What the engine asks of a device, whatever its make. Values are the shaft's and the sensor's, in SI units."""

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ShaftSamples:
    """What the motor reported since it was last read; all (m,). `device_s` counts the drive's own periods from its first sample."""

    host_s: Floats
    device_s: Floats
    angle_rad: Floats
    speed_rad_s: Floats
    torque_Nm: Floats


@dataclass(frozen=True)
class MotorStatus:
    """`state` in words; `fault` is None or the drive's own error code with its meaning; `silent_s` since its last heartbeat.

    `temperature_C` is that of drive or motor, whichever is warmer; None where the drive does not tell.
    """

    state: str
    fault: str | None
    silent_s: float
    temperature_C: float | None = None


class ShaftMotor(Protocol):
    """A motor that turns the shaft. Angles are continuous over many turns; 0 is horizontal, positive downwards."""

    def enable(self) -> None:
        """Energises without a jerk, holding where the shaft stands. Raises DeviceError when the drive refuses."""
        ...

    def prove_watchdog(self, limit_s: float) -> float:
        """Says nothing to the enabled drive until its watchdog stops the motor, which is off then; returns how long that took.

        Raises DeviceError where the drive still runs after `limit_s`.
        """
        ...

    def command_speed(self, speed_rad_s: float) -> None:
        """Asks for a speed; to be repeated every few milliseconds, or the drive's watchdog stops the motor."""
        ...

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Asks for an angle, with the speed of a moving target; to be repeated like `command_speed`."""
        ...

    def disable(self) -> None:
        """Takes the torque away. May be called at any time, any number of times."""
        ...

    def read(self) -> ShaftSamples:
        """Everything that came in since the last call; never waits."""
        ...

    def status(self) -> MotorStatus:
        """How the drive is, as of the last `read`."""
        ...

    def identity(self) -> dict[str, str]:
        """Make, address and scale, for the recording."""
        ...


@dataclass(frozen=True)
class SensorScale:
    """Counts to newtons and newton metres: value = counts / counts_per_unit. `rate_Hz` of the records."""

    counts_per_N: float
    counts_per_Nm: float
    rate_Hz: float


@dataclass(frozen=True)
class ForceSamples:
    """Records since the sensor was last read. `counts` (m, 6) = fx fy fz tx ty tz; `device_s` from the record counter.

    `status` 0 is healthy; bit 31 says that something is wrong and bit 17 that the sensor is saturated, whatever its make.
    """

    host_s: Floats
    device_s: Floats
    sequence: NDArray[np.int64]
    status: NDArray[np.uint32]
    counts: NDArray[np.int32]


@dataclass
class StreamHealth:
    """What went wrong on the way, in records.

    `malformed` counts datagrams, or pieces of a stream, that were no records. `stalled` records hold nothing new, because the
    sensor stood still; `saturated` ones are those of the `faulty_status` in which it was beyond its range.
    """

    received: int = 0
    lost: int = 0
    duplicate: int = 0
    out_of_order: int = 0
    malformed: int = 0
    faulty_status: int = 0
    stalled: int = 0
    saturated: int = 0
    notes: list[str] = field(default_factory=list)


class ForceSensor(Protocol):
    """A six-axis force sensor that streams."""

    def start(self) -> None:
        """Starts the stream; the record counter begins anew."""
        ...

    def read(self) -> ForceSamples:
        """Everything that came in since the last call; never waits."""
        ...

    def stop(self) -> None:
        """Ends the stream. May be called at any time, any number of times."""
        ...

    def scale(self) -> SensorScale: ...

    def health(self) -> StreamHealth:
        """Counters since `start`."""
        ...

    def identity(self) -> dict[str, str]: ...


@dataclass(frozen=True, eq=False)
class Photo:
    """One picture: `image` (rows, columns, 3) uint8, blue green red; `host_s` when it was taken; `name` for messages and files."""

    image: NDArray[np.uint8]
    host_s: float
    name: str


class Camera(Protocol):
    """What takes a picture of the leg from the side. The picture is the sensor's own, neither turned nor undistorted."""

    def photo(self) -> Photo:
        """A picture whose exposure began after the call. Raises DeviceError where none comes."""
        ...

    def close(self) -> None:
        """Lets go of the camera. May be called at any time, any number of times."""
        ...

    def identity(self) -> dict[str, str]: ...


class Photographer(Protocol):
    """Has photos taken while its caller goes on: what the control loop needs of a camera. Nothing here waits."""

    def begin(self) -> None:
        """Asks for a photo. Raises DeviceError while an earlier one has not come; one that came too late is forgotten."""
        ...

    def taken(self) -> Photo | None:
        """The photo, once, as soon as it is there. Raises what the camera raised instead."""
        ...

    def close(self) -> None:
        """Lets go of the camera, or leaves one behind that does not answer. May be called at any time, any number of times."""
        ...

    def identity(self) -> dict[str, str]: ...


class Rack(Protocol):
    """What sets the height of the shaft above the ground: a hand on the lead screws, or a twin."""

    def set_height(self, height_m: float) -> None:
        """Returns when the rack stands at that height."""
        ...
