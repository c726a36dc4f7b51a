"""Device protocols: what the engine needs from any motor, force sensor, camera or rack. All
values are in SI units.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Protocol, TypeVar, runtime_checkable

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ShaftSamples:
    """Motor samples since the last `read`; every column has shape (m,).

    `host_s` is the host clock when the sample arrived, or was drained where the bus does not say.
    `device_s` is the drive's own time, 0 at its first sample. `angle_rad`, `speed_rad_s` and
    `torque_Nm` are those of the shaft, after gear, direction and zero.
    """

    host_s: Floats
    device_s: Floats
    angle_rad: Floats
    speed_rad_s: Floats
    torque_Nm: Floats


@dataclass(frozen=True)
class MotorStatus:
    """State of the drive.

    `state` is a text. `fault` is None, or the drive's own error code with its meaning. `silent_s`
    is the time since the last heartbeat. `temperature_C` is the higher of drive and motor
    temperature, None if the drive reports none. `torque_age_s` is the age of the torque for a drive
    that reports it in a message of its own; it is 0 where torque and angle come together.
    `uptime_s` is the time since the drive was powered up, None if it does not report it.
    `zero_lost` is why angles are wrong since the driver was made, or None.
    """

    state: str
    fault: str | None
    silent_s: float
    # Optional, as some drives have no temperature sensor.
    temperature_C: float | None = None
    torque_age_s: float = 0.0
    uptime_s: float | None = None
    zero_lost: str | None = None


class ShaftMotor(Protocol):
    """A motor that turns the shaft. Angles are continuous over many turns; 0 is horizontal,
    positive downwards.
    """

    def enable(self) -> None:
        """Energises the motor and holds the shaft at its present angle, without a jerk. Raises
        DeviceError if the drive refuses.
        """
        ...

    def prove_watchdog(self, limit_s: float) -> float:
        """Sends nothing to the enabled drive until its watchdog disables the motor; returns the
        time in seconds that this took.

        The motor is off afterwards. Raises DeviceError if the drive still runs after `limit_s`.
        """
        ...

    def command_speed(self, speed_rad_s: float) -> None:
        """Commands a shaft speed. Must be repeated every few milliseconds, or the drive's
        watchdog stops the motor.
        """
        ...

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Commands a shaft angle, with the speed of a moving target. Must be repeated like
        `command_speed`.
        """
        ...

    def disable(self) -> None:
        """Disables the motor (torque off). May be called at any time, any number of times."""
        ...

    def read(self) -> ShaftSamples:
        """Everything received since the last call; never waits."""
        ...

    def status(self) -> MotorStatus:
        """State of the drive at the last `read`."""
        ...

    def identity(self) -> dict[str, str]:
        """Make, address and scale, for the recording."""
        ...


@runtime_checkable
class AskedMotor(Protocol):
    """A motor whose drive reports only as an answer to a command, so that `read` alone brings
    nothing.
    """

    def ask(self) -> None:
        """Requests a report from a drive that is not commanded. What it sends never adds torque."""
        ...


@dataclass(frozen=True)
class SensorScale:
    """Scale from counts to N and N m: value = counts / counts_per_unit. `rate_Hz` is the record
    rate.
    """

    counts_per_N: float
    counts_per_Nm: float
    rate_Hz: float


@dataclass(frozen=True)
class ForceSamples:
    """Sensor records since the last `read`.

    `counts` (m, 6) holds fx fy fz tx ty tz in counts, see `SensorScale`. `host_s` (m,) is the host
    clock at the read. `device_s` (m,) is the time from the record counter, 0 at record 1, and
    `sequence` (m,) that counter without wrap. `status` (m,) is 0 if healthy. For every make, bit 31
    marks an error and bit 17 saturation.
    """

    host_s: Floats
    device_s: Floats
    sequence: NDArray[np.int64]
    status: NDArray[np.uint32]
    counts: NDArray[np.int32]


@dataclass
class StreamHealth:
    """Transmission and sensor errors since `start`, counted in records.

    `malformed` counts datagrams, or pieces of a stream, that were not records. `stalled` records
    repeat old values because the sensor stopped measuring. `saturated` is the part of
    `faulty_status` in which the sensor was beyond its range.
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
        """Starts the stream; the record counter restarts at 1."""
        ...

    def read(self) -> ForceSamples:
        """Everything received since the last call; never waits."""
        ...

    def stop(self) -> None:
        """Ends the stream. May be called at any time, any number of times."""
        ...

    def scale(self) -> SensorScale: ...

    def health(self) -> StreamHealth:
        """Counters since `start`."""
        ...

    def identity(self) -> dict[str, str]: ...


@runtime_checkable
class ConfiguredSensor(Protocol):
    """A force sensor whose own settings can be read before a run."""

    def check_configuration(self) -> list[str]:
        """Warnings of settings that change what is measured, in one line each.

        Raises BadInput where a setting contradicts the rig file, DeviceError where the sensor does
        not answer.
        """
        ...


@dataclass(frozen=True, eq=False)
class Photo:
    """One photo: `image` (rows, columns, 3) uint8 in BGR order, `host_s` when it was taken,
    `name` for messages and files.
    """

    image: NDArray[np.uint8]
    host_s: float
    name: str


class Camera(Protocol):
    """A camera that photographs the leg from the side. The image is the raw one: neither rotated
    nor undistorted.
    """

    def photo(self) -> Photo:
        """A photo (rows, columns, 3) whose exposure began after the call. Raises DeviceError if
        none arrives.
        """
        ...

    def close(self) -> None:
        """Releases the camera. May be called at any time, any number of times."""
        ...

    def identity(self) -> dict[str, str]: ...


class Photographer(Protocol):
    """Takes photos in the background, for use in the control loop. No method waits."""

    def begin(self) -> None:
        """Requests a photo. Raises DeviceError while an earlier one is pending; one that arrived
        too late is discarded.
        """
        ...

    def fetch_photo(self) -> Photo | None:
        """The photo, handed out once; None until it has arrived. Raises the camera's exception
        if it failed.
        """
        ...

    def close(self) -> None:
        """Releases the camera, or abandons one that does not answer. May be called at any time,
        any number of times.
        """
        ...

    def identity(self) -> dict[str, str]: ...


class Rack(Protocol):
    """Sets the height of the shaft above the ground: an operator at the lead screws, or a twin."""

    def set_height(self, height_m: float) -> None:
        """Returns once the rack is at `height_m`."""
        ...


# Any dataclass of columns.
Block = TypeVar("Block", bound="DataclassInstance")


def concatenate_blocks(blocks: Sequence[Block]) -> Block:
    """Concatenates blocks of columns (m, ...) along the first axis, column by column; a single
    block is returned as it is.
    """
    # One block per tick is the usual case.
    if len(blocks) == 1:
        return blocks[0]
    kind = type(blocks[0])
    columns = []
    for column in fields(kind):
        columns.append(np.concatenate([getattr(block, column.name) for block in blocks]))
    return kind(*columns)
