"""Checks every limit at every tick, in the same loop that feeds the drive's watchdog."""

from rfca_rig.drivers.roles import ForceSamples, MotorStatus, SensorScale, ShaftSamples
from rfca_rig.engine.monitors.drive import check_drive
from rfca_rig.engine.monitors.force_sensor import SensorMonitor
from rfca_rig.engine.monitors.load import LoadMonitor
from rfca_rig.engine.monitors.shaft import ShaftMonitor, Tracking
from rfca_rig.errors import Tripped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Limits
from rfca_rig.trip_codes import Trip


class LimitMonitor:
    """Raises Tripped, with code, value and limit, as soon as a limit is passed.

    One loop checks and commands: where the checks stall, the commands stall too, and the drive's watchdog stops the motor.
    """

    def __init__(self, limits: Limits, scale: SensorScale, now_s: float) -> None:
        self._limits = limits
        self._load = LoadMonitor(limits, scale)
        self._sensor = SensorMonitor(limits, now_s)
        self._shaft = ShaftMonitor(limits, now_s)

    def expect(self, load: Load | None) -> None:
        """A stage begins with this predicted load; None where there is no prediction."""
        self._load.expect(load)

    @property
    def peak(self) -> Load:
        """Largest load since the last `expect`."""
        return self._load.peak

    def reports(self, now_s: float, shaft: ShaftSamples, force: ForceSamples) -> None:
        """Checks the samples of one tick; either block may be empty."""
        # The sensor's health comes first: forces of a saturated or frozen sensor say nothing about the load.
        self._sensor.check(now_s, force)
        if len(force.counts):
            self._load.check(force)
        self._shaft.check_reports(now_s, shaft)

    def motion(self, now_s: float, status: MotorStatus, tracking: Tracking) -> None:
        """Checks the drive's status, and how the shaft follows its target."""
        check_drive(status, self._limits)
        self._shaft.check_tracking(now_s, tracking)

    def gap(self, gap_s: float, planned_s: float) -> None:
        """Checks the length of a tick. A late loop neither feeds the watchdog nor sees the force."""
        late_s = gap_s - planned_s
        if late_s > self._limits.late_s:
            raise Tripped(
                Trip.LATE,
                f"the control loop came {1e3 * late_s:.0f} ms late, limit {1e3 * self._limits.late_s:g} ms; "
                "close what else runs on this computer",
            )
