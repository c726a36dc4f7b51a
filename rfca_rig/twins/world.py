"""The simulated rig: interfaces of plant, motor twin and sensor twin, and their co-simulation by
`TwinWorld`.

The plants, which are based on the model, are in other packages.
"""

from collections.abc import Iterator, Sequence
from math import ceil
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

LONGEST_STEP_S = 2e-3
# Steps are this many times longer while the shaft is slower than MAX_RESTING_SPEED_RAD_S.
RESTING_STEP_FACTOR = 5
MAX_RESTING_SPEED_RAD_S = 1e-3


class ShaftDrive(NamedTuple):
    """Linear torque law of a drive, in SI units at the shaft: feed + angle_gain (angle - q) +
    speed_gain (speed - dq/dt).
    """

    feed_Nm: float = 0.0
    angle_gain_Nm_per_rad: float = 0.0
    angle_rad: float = 0.0
    speed_gain_Nm_s_per_rad: float = 0.0
    speed_rad_s: float = 0.0

    def torque_Nm(self, angle_rad: float, speed_rad_s: float) -> float:
        """Torque in N m at a shaft angle and speed."""
        return (
            self.feed_Nm
            + self.angle_gain_Nm_per_rad * (self.angle_rad - angle_rad)
            + self.speed_gain_Nm_s_per_rad * (self.speed_rad_s - speed_rad_s)
        )

    def scale(self, factor: float) -> "ShaftDrive":
        """The law with `factor` times the torque, at any angle and speed."""
        return self._replace(
            feed_Nm=factor * self.feed_Nm,
            angle_gain_Nm_per_rad=factor * self.angle_gain_Nm_per_rad,
            speed_gain_Nm_s_per_rad=factor * self.speed_gain_Nm_s_per_rad,
        )


NO_TORQUE = ShaftDrive()


class ShaftState(NamedTuple):
    """Present state of the shaft, and the motor's torque on it."""

    angle_rad: float
    speed_rad_s: float
    torque_Nm: float


class TwinPlant(Protocol):
    """Mechanics of leg, rack and ground: driven by the motor twin, measured by the sensor twin."""

    def advance(self, to_s: float, drive: ShaftDrive, force_times_s: Floats) -> Floats:
        """Advances to `to_s` under `drive`; returns the true wrench (m, 6) [N, N m] at
        `force_times_s` (m,), ascending and <= to_s.
        """
        ...

    def shaft(self) -> ShaftState:
        """State of the shaft at the time of the last `advance`."""
        ...

    def set_height(self, height_m: float) -> None:
        """Sets the height of the rack in m, at once."""
        ...


class SensorTwin(Protocol):
    """The sensor's side of the wire, advanced in steps: `take_requests`, `due`, then, after the
    plant has moved, `take_wrench`.
    """

    def take_requests(self) -> None:
        """Executes requests received since the last step."""
        ...

    def due(self, to_s: float) -> Floats:
        """Sample times (m,) in s in the step that ends at `to_s`; none while none are requested."""
        ...

    def take_wrench(self, wrench: Floats) -> None:
        """Takes the true wrench (m, 6) [N, N m] at the times that were due, and sends the
        records that are due.
        """
        ...


class MotorTwin(Protocol):
    """The drive's side of the bus, advanced in steps: `take_frames`, `drive`, then, after the
    plant has moved, `advance`.
    """

    def take_frames(self, now_s: float) -> None:
        """Executes frames received since the last step."""
        ...

    def drive(self, shaft: ShaftState) -> ShaftDrive:
        """Torque law on the shaft until the next step; `shaft` is its present state."""
        ...

    def advance(
        self, elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState, law: ShaftDrive
    ) -> None:
        """Takes in a step of the plant under `law` that ended at `now_s`, and sends the reports
        that became due in it.
        """
        ...


# A hand gives way by a tenth of a degree under the leg's weight. It brings the leg there within a
# second, and without a jerk.
HAND_GAIN_Nm_per_rad = 500.0
HAND_DAMPING_Nm_s_per_rad = 100.0
HAND_LIMIT_Nm = 5.0


def hold(shaft: ShaftState, at_rad: float) -> ShaftDrive:
    """The law of a hand that holds the shaft at an angle."""
    law = ShaftDrive(0.0, HAND_GAIN_Nm_per_rad, at_rad, HAND_DAMPING_Nm_s_per_rad, 0.0)
    torque_Nm = abs(law.torque_Nm(shaft.angle_rad, shaft.speed_rad_s))
    return law.scale(min(1.0, HAND_LIMIT_Nm / max(torque_Nm, HAND_LIMIT_Nm)))


def interpolate_motion(
    due_s: Sequence[float], elapsed_s: float, now_s: float, before: ShaftState, after: ShaftState
) -> Iterator[tuple[float, float]]:
    """Yields angle and speed at the times `due_s` within a step that ended at `now_s`.

    Cubic Hermite interpolation through angle and speed at both ends of the step.
    """
    turned_rad = after.angle_rad - before.angle_rad
    left_rad = before.speed_rad_s * elapsed_s
    right_rad = after.speed_rad_s * elapsed_s
    # Coefficients in x = 0..1 over the step; speeds are scaled by its length.
    square = 3.0 * turned_rad - 2.0 * left_rad - right_rad
    cube = left_rad + right_rad - 2.0 * turned_rad
    for moment_s in due_s:
        x = 1.0 + (moment_s - now_s) / elapsed_s
        yield (
            before.angle_rad + x * (left_rad + x * (square + x * cube)),
            before.speed_rad_s + x * (2.0 * square + 3.0 * x * cube) / elapsed_s,
        )


class TwinWorld:
    """Advances all twins together; `process(to_s)` is registered with a twin clock. The same calls
    give the same bytes.

    Steps are at most `longest_step_s` long, or five times that while the shaft is at rest.
    Integrator, torque limit and watchdog of the drive are updated once per step. Encoder reports
    within a step lie on a cubic between its ends; force samples come from the plant.

    `held_rad` is the angle at which a hand holds the shaft while the motor has no torque; None: it
    is let go.
    """

    def __init__(
        self,
        plant: TwinPlant,
        motor: MotorTwin,
        sensor: SensorTwin,
        longest_step_s: float = LONGEST_STEP_S,
    ) -> None:
        self._plant = plant
        self._motor = motor
        self._sensor = sensor
        self._longest_step_s = longest_step_s
        self._now_s = 0.0
        self._is_held = False
        self.held_rad: float | None = None

    def process(self, to_s: float) -> None:
        """Advances everything to `to_s`."""
        began_s = self._now_s
        resting = abs(self._plant.shaft().speed_rad_s) < MAX_RESTING_SPEED_RAD_S
        if resting:
            longest_s = RESTING_STEP_FACTOR * self._longest_step_s
        else:
            longest_s = self._longest_step_s
        # The tolerance keeps rounding from adding a step of almost zero length.
        steps = ceil((to_s - began_s) / longest_s - 1e-6)
        for step in range(1, steps + 1):
            self._step(to_s if step == steps else began_s + (to_s - began_s) * step / steps)

    def _step(self, to_s: float) -> None:
        # Commands first, then the torque law from the state before the step, then the plant, then
        # the reports.
        self._motor.take_frames(self._now_s)
        self._sensor.take_requests()
        before = self._motor_s_share(self._plant.shaft())
        law = self._motor.drive(before)
        on_shaft = law
        self._is_held = self.held_rad is not None and law == NO_TORQUE
        if self.held_rad is not None and self._is_held:
            on_shaft = hold(before, self.held_rad)
        self._sensor.take_wrench(self._plant.advance(to_s, on_shaft, self._sensor.due(to_s)))
        after = self._motor_s_share(self._plant.shaft())
        self._motor.advance(to_s - self._now_s, to_s, before, after, law)
        self._now_s = to_s

    def _motor_s_share(self, shaft: ShaftState) -> ShaftState:
        """The state with the motor's torque: that of a hand passes beside it, is not reported, and
        warms nothing.
        """
        if self._is_held:
            return shaft._replace(torque_Nm=0.0)
        return shaft
