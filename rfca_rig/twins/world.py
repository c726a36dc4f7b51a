"""Co-simulation of motor twin, sensor twin and plant."""

from math import ceil

from rfca_rig.twins.motor import MotorTwin
from rfca_rig.twins.plant import TwinPlant
from rfca_rig.twins.sensor import SensorTwin

LONGEST_STEP_S = 2e-3
# Steps are this many times longer while the shaft is slower than MAX_RESTING_SPEED_RAD_S.
RESTING_STEP_FACTOR = 5
MAX_RESTING_SPEED_RAD_S = 1e-3


class TwinWorld:
    """Advances all twins together; `process(to_s)` is registered with a twin clock. The same calls give the same bytes.

    Steps are at most `longest_step_s` long, or five times that while the shaft is at rest. Integrator, torque limit and watchdog of
    the drive are updated once per step. Encoder reports within a step lie on a cubic between its ends; force samples come from the
    plant.
    """

    def __init__(self, plant: TwinPlant, motor: MotorTwin, sensor: SensorTwin, longest_step_s: float = LONGEST_STEP_S) -> None:
        self._plant = plant
        self._motor = motor
        self._sensor = sensor
        self._longest_step_s = longest_step_s
        self._now_s = 0.0

    def process(self, to_s: float) -> None:
        """Advances everything to `to_s`."""
        began_s = self._now_s
        resting = abs(self._plant.shaft().speed_rad_s) < MAX_RESTING_SPEED_RAD_S
        longest_s = RESTING_STEP_FACTOR * self._longest_step_s if resting else self._longest_step_s
        # The tolerance keeps rounding from adding a step of almost zero length.
        steps = ceil((to_s - began_s) / longest_s - 1e-6)
        for step in range(1, steps + 1):
            self._step(to_s if step == steps else began_s + (to_s - began_s) * step / steps)

    def _step(self, to_s: float) -> None:
        # Commands first, then the torque law from the state before the step, then the plant, then the reports.
        self._motor.take_frames(self._now_s)
        self._sensor.take_requests()
        before = self._plant.shaft()
        law = self._motor.drive(before)
        self._sensor.measured(self._plant.advance(to_s, law, self._sensor.due(to_s)))
        self._motor.passed(to_s - self._now_s, to_s, before, self._plant.shaft(), law)
        self._now_s = to_s
