"""Checks every limit at every tick, in the same loop that feeds the drive's watchdog."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rfca_rig.codecs.force_sensors import status_text
from rfca_rig.drivers.roles import ForceSamples, MotorStatus, SensorScale, ShaftSamples
from rfca_rig.errors import Trip, Tripped
from rfca_rig.protocol.check import Load
from rfca_rig.protocol.plan import Limits

# Status word of a force sensor, see `codecs.force_sensors`. All drivers set its bits 31 and 17. Bit
# 31: summary of all errors.
SENSOR_FAULT = 0x80000000
# Bit 17: transducer saturation or A/D error.
SATURATED = 0x00020000
# All but the summary bit and bit 16, a latched monitor condition, which leaves the values good.
ANY_ERROR = 0x7FFEFFFF

Floats = NDArray[np.float64]

# Share of the limit below which the ceiling never falls: a small excess over a small prediction is
# no danger.
MIN_CEILING_SHARE = 0.1

# A target slower than this may stand for a moment.
JAM_SPEED_RAD_S = 0.2
# Share of the target's speed below which the shaft counts as stuck.
JAM_SHARE = 0.1
# Longer than a soft drive sags into a load.
JAM_S = 0.3
# Allowed between two reports beyond what the speed limit explains: far above any encoder's noise.
JUMP_RAD = 0.2


def check_drive(status: MotorStatus, limits: Limits) -> None:
    """Checks the age of the last heartbeat, error and state, the age of the torque, and the
    temperature where the drive reports one.

    A driver with the same limit reports silence as a fault too.
    """
    # Comparisons with a limit are written so that a value that is no number passes it: an own
    # driver may report one. Silence first: everything else that is known of a silent drive is old.
    if not status.silent_s <= limits.drive_silent_s:
        raise Tripped(
            Trip.DRIVE_SILENT,
            (
                f"drive silent for {1e3 * status.silent_s:.0f} ms, limit "
                f"{1e3 * limits.drive_silent_s:.0f} ms; check bus and power"
            ),
        )
    if status.fault is not None:
        raise Tripped(Trip.DRIVE_ERROR, f"drive: {status.fault}")
    if not status.torque_age_s <= limits.reading_age_s:
        raise _too_old("torque", status.torque_age_s, limits)
    if status.temperature_C is not None and not status.temperature_C <= limits.temperature_C:
        raise Tripped(
            Trip.DRIVE_HOT,
            f"drive or motor at {status.temperature_C:.0f} degC, limit "
            f"{limits.temperature_C:g} degC; let it cool, then go slower "
            "or rest longer between strokes",
        )


def _too_old(reading: str, age_s: float, limits: Limits) -> Tripped:
    return Tripped(
        Trip.READING_OLD,
        f"the drive's last {reading} is {1e3 * age_s:.0f} ms old, limit "
        f"{1e3 * limits.reading_age_s:.0f} ms; check its power, "
        "its cyclic messages, and the bus",
    )


class SensorMonitor:
    """Remembers when the last record came, and when its counts last changed."""

    def __init__(self, limits: Limits, now_s: float) -> None:
        self._limits = limits
        self._received_s = now_s
        self._last: NDArray[np.int32] | None = None
        self._last_s = np.nan
        self._changed_s = np.nan

    def check(self, now_s: float, samples: ForceSamples) -> None:
        """Checks one tick's records; `samples.counts` (m, 6) may be empty."""
        if len(samples.counts):
            self._received_s = now_s
            self._check_status(samples)
            self._check_time(samples)
            self._check_alive(samples)
        else:
            self._check_silence(now_s - self._received_s)

    def _check_silence(self, silent_s: float) -> None:
        limit_s = self._limits.sensor_silent_s
        if not silent_s <= limit_s:
            raise Tripped(
                Trip.SENSOR_SILENT,
                (
                    f"force sensor silent for {1e3 * silent_s:.0f} ms, limit "
                    f"{1e3 * limit_s:.0f} ms; check its cable and power"
                ),
            )

    def _check_status(self, samples: ForceSamples) -> None:
        worst = int(np.bitwise_or.reduce(samples.status))
        if not worst:
            return
        # Before all other errors: the values of a saturated sensor can no longer guard the rig.
        if worst & SATURATED:
            raise Tripped(
                Trip.SENSOR_SATURATED,
                (
                    f"force sensor saturated (status 0x{worst:08x}); its values can no longer "
                    "guard the rig"
                ),
            )
        if worst & SENSOR_FAULT and worst & ANY_ERROR:
            raise Tripped(
                Trip.SENSOR_ERROR,
                f"force sensor reports an error: {status_text(worst)}; see its status page",
            )

    def _check_time(self, samples: ForceSamples) -> None:
        """Checks for gaps: records may come, and yet so many be lost in between that the force
        was not observed.
        """
        # By the sensor's own record counter, which shows lost records whenever they were received.
        times_s = samples.device_s
        blind_s = float(np.maximum.reduce(times_s[1:] - times_s[:-1], initial=0.0))
        if not math.isnan(self._last_s):
            blind_s = max(blind_s, float(times_s[0]) - self._last_s)
        self._last_s = float(times_s[-1])
        if not blind_s <= self._limits.sensor_silent_s:
            limit_ms = 1e3 * self._limits.sensor_silent_s
            raise Tripped(
                Trip.SENSOR_BLIND,
                f"records of {1e3 * blind_s:.0f} ms of the force are lost at once, limit "
                f"{limit_ms:.0f} ms; check the network and the "
                "machine's load",
            )

    def _check_alive(self, samples: ForceSamples) -> None:
        """Checks that the counts change: a sensor at rest has noise, a hanging box or a loose
        cable has not.
        """
        counts = samples.counts
        # The first record of all is compared with itself, which counts as no change.
        before = counts[:1] if self._last is None else self._last
        # The newest pair decides alone where it differs, which is the usual case.
        if len(counts) > 1 and counts[-1].tolist() != counts[-2].tolist():
            self._changed_s = float(samples.device_s[-1])
        elif len(
            changed := np.flatnonzero((np.concatenate([before, counts[:-1]]) != counts).any(axis=1))
        ):
            self._changed_s = float(samples.device_s[changed[-1]])
        elif math.isnan(self._changed_s):
            self._changed_s = float(samples.device_s[0])
        self._last = counts[-1:]
        frozen_s = float(samples.device_s[-1]) - self._changed_s
        limit_s = self._limits.sensor_frozen_s
        if not frozen_s <= limit_s:
            raise Tripped(
                Trip.SENSOR_FROZEN,
                f"force sensor sends the same six counts for {1e3 * frozen_s:.0f} ms, "
                f"limit {1e3 * limit_s:.0f} ms; "
                "restart its box, check the transducer's cable",
            )


@dataclass
class ExceedanceTimer:
    """How long a value has been above its ceiling, by the device's own time."""

    below_s: float = np.nan

    def seconds(self, device_s: Floats, values: Floats, ceiling: float) -> float:
        """Adds a block of samples and returns for how many seconds the value has been above the
        ceiling without a break.

        Parameters
        ----------
        device_s : ndarray, shape (m,)
            Times in s by the device's clock, increasing; m is at least 1.
        values : ndarray, shape (m,)
            Any measure of force or moment.
        ceiling : float
            In the unit of `values`.

        Returns
        -------
        float
            0 where the last value is not above the ceiling.
        """
        # The last value below the ceiling is the usual case.
        if values[-1] <= ceiling:
            self.below_s = float(device_s[-1])
            return 0.0
        below = np.flatnonzero(values <= ceiling)
        if len(below):
            self.below_s = float(device_s[below[-1]])
        # A stage that begins above the ceiling counts from its first sample.
        elif math.isnan(self.below_s):
            self.below_s = float(device_s[0])
        return float(device_s[-1]) - self.below_s


class LoadMonitor:
    """Checks force and moment; `peak` is the largest load since the stage began."""

    def __init__(self, limits: Limits, scale: SensorScale) -> None:
        self._limits = limits
        self._scale = scale
        self.expect(None)

    def expect(self, expected: Load | None) -> None:
        """A stage begins in which the model predicts at most this load; None where there is no
        prediction.
        """
        # Without a prediction the ceiling is infinite: only the absolute limits hold then.
        limits = self._limits
        unknown = Load(np.inf, np.inf)
        load = expected or unknown
        self._ceiling = Load(
            max(limits.above_expected * load.force_N, MIN_CEILING_SHARE * limits.force_N),
            max(limits.above_expected * load.torque_Nm, MIN_CEILING_SHARE * limits.torque_Nm),
        )
        self._force = ExceedanceTimer()
        self._torque = ExceedanceTimer()
        self.peak = Load(0.0, 0.0)

    def check(self, samples: ForceSamples) -> None:
        """Checks one block, with at least one record."""
        counts = samples.counts.astype(np.float64)
        # Magnitudes of the whole vectors: a limit per axis would depend on how the sensor is
        # mounted.
        squares = np.multiply(counts, counts, out=counts)
        # Reductions of ufuncs, as this runs at every tick: the methods of arrays take twice as long
        # for so few records.
        forces = np.add.reduce(squares[:, :3], axis=1)
        torques = np.add.reduce(squares[:, 3:], axis=1)
        force_N = math.sqrt(np.maximum.reduce(forces)) / self._scale.counts_per_N
        torque_Nm = math.sqrt(np.maximum.reduce(torques)) / self._scale.counts_per_Nm
        if force_N > self.peak.force_N or torque_Nm > self.peak.torque_Nm:
            self.peak = self.peak.max_with(Load(force_N, torque_Nm))
        if not force_N <= self._limits.force_N:
            raise Tripped(
                Trip.FORCE,
                (
                    f"force {force_N:.1f} N, limit {self._limits.force_N:g} N; raise the rack "
                    "or go slower"
                ),
            )
        if not torque_Nm <= self._limits.torque_Nm:
            limit_Nm = self._limits.torque_Nm
            raise Tripped(
                Trip.MOMENT,
                f"moment {torque_Nm:.2f} N m, limit {limit_Nm:g} N m; raise the rack or go slower",
            )
        # Squares of counts are compared with the square of the ceiling: a root of every record
        # would be for nothing.
        per_N = self._scale.counts_per_N
        per_Nm = self._scale.counts_per_Nm
        lasts_s = self._force.seconds(
            samples.device_s, forces, (self._ceiling.force_N * per_N) ** 2
        )
        if not lasts_s <= self._limits.above_expected_s:
            raise self._trip(
                Trip.FORCE_LASTS,
                f"force {math.sqrt(forces[-1]) / per_N:.1f} N",
                lasts_s,
                f"{self._ceiling.force_N:.3g} N",
            )
        lasts_s = self._torque.seconds(
            samples.device_s, torques, (self._ceiling.torque_Nm * per_Nm) ** 2
        )
        if not lasts_s <= self._limits.above_expected_s:
            value = f"moment {math.sqrt(torques[-1]) / per_Nm:.2f} N m"
            raise self._trip(
                Trip.MOMENT_LASTS, value, lasts_s, f"{self._ceiling.torque_Nm:.3g} N m"
            )

    def _trip(self, code: Trip, value: str, lasts_s: float, ceiling: str) -> Tripped:
        return Tripped(
            code,
            f"{value} and more for {1e3 * lasts_s:.0f} ms, {ceiling} may be passed for "
            f"{1e3 * self._limits.above_expected_s:.0f} ms; is the rack as high as "
            "planned, and the leg whole?",
        )


class Tracking(NamedTuple):
    """Angle and speed of target and shaft at one tick."""

    target_rad: float
    angle_rad: float
    target_speed_rad_s: float
    speed_rad_s: float


class ShaftMonitor:
    """Remembers the last report, and since when the shaft has not followed its target at all."""

    def __init__(self, limits: Limits, now_s: float) -> None:
        self._limits = limits
        self._measured_s = self._moved_s = now_s
        self._last: tuple[float, float] | None = None
        self._torque_Nm = np.nan

    def check_reports(self, now_s: float, shaft: ShaftSamples) -> None:
        """Checks one tick's reports; the block may be empty."""
        if len(shaft.angle_rad):
            # A drive that answers requests gives the time of the request: an answer that comes late
            # is old.
            self._measured_s = float(shaft.host_s[-1])
        age_s = now_s - self._measured_s
        if not age_s <= self._limits.reading_age_s:
            raise _too_old("angle", age_s, self._limits)
        if not len(shaft.angle_rad):
            return
        self._torque_Nm = float(shaft.torque_Nm[-1])
        # Plain numbers: a tick brings a few reports, for which numpy takes longer. The last report
        # of the tick before belongs to the block, because a jump may lie between two ticks.
        last = self._last
        worst_rad = -1.0
        for time_s, angle_rad in zip(
            shaft.device_s.tolist(), shaft.angle_rad.tolist(), strict=True
        ):
            if last is not None:
                step_rad = abs(angle_rad - last[1])
                if not step_rad <= self._limits.speed_rad_s * (time_s - last[0]) + JUMP_RAD:
                    worst_rad = max(step_rad, worst_rad)
            last = time_s, angle_rad
        if not worst_rad < 0.0:
            raise Tripped(
                Trip.JUMP,
                f"the shaft's angle jumped by {np.degrees(worst_rad):.1f} deg from one "
                "report to the next; was the drive "
                "restarted, or does the encoder slip? Check the zero before anything moves",
            )
        self._last = float(shaft.device_s[-1]), float(shaft.angle_rad[-1])

    def check_tracking(self, now_s: float, now: Tracking) -> None:
        """Checks the speed, and the following error, whose limit grows with the target's speed."""
        if not abs(now.speed_rad_s) <= self._limits.speed_rad_s:
            raise Tripped(
                Trip.OVERSPEED,
                f"shaft at {now.speed_rad_s:.2f} rad/s, limit "
                f"{self._limits.speed_rad_s:g} rad/s; does the drive obey, and are gear "
                "and encoder as the rig file says?",
            )
        self._check_behind(now)
        self._check_jam(now_s, now)

    def _check_behind(self, now: Tracking) -> None:
        behind_rad = abs(now.target_rad - now.angle_rad)
        # A drive lags in proportion to its speed; a constant limit would be too tight in strokes or
        # too wide at rest.
        limit_rad = self._limits.following_error_rad + self._limits.following_error_s * abs(
            now.target_speed_rad_s
        )
        if not behind_rad <= limit_rad:
            raise Tripped(
                Trip.FOLLOWING,
                f"following error: shaft {np.degrees(behind_rad):.1f} deg from where it "
                f"should be, limit {np.degrees(limit_rad):.1f} deg "
                f"at {now.target_speed_rad_s:.2f} rad/s; look for a jam, or a drive too "
                "weak for this load",
            )

    def _check_jam(self, now_s: float, now: Tracking) -> None:
        # At a low speed the following error reaches its limit late; this check finds a stuck shaft
        # within JAM_S.
        wanted_rad_s = abs(now.target_speed_rad_s)
        if wanted_rad_s < JAM_SPEED_RAD_S or abs(now.speed_rad_s) > JAM_SHARE * wanted_rad_s:
            self._moved_s = now_s
        elif now_s - self._moved_s > JAM_S:
            raise Tripped(
                Trip.JAM,
                f"the shaft has stood for {1e3 * (now_s - self._moved_s):.0f} ms where it "
                "should turn at "
                f"{now.target_speed_rad_s:.2f} rad/s, with {self._torque_Nm:.1f} N m from "
                "the motor; look for what holds it, or for a drive too weak for this load",
            )


class LimitMonitor:
    """Raises Tripped, with code, value and limit, as soon as a limit is passed.

    One loop checks and commands: where the checks stall, the commands stall too, and the drive's
    watchdog stops the motor.
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
        # The sensor's health comes first: forces of a saturated or frozen sensor say nothing about
        # the load.
        self._sensor.check(now_s, force)
        if len(force.counts):
            self._load.check(force)
        self._shaft.check_reports(now_s, shaft)

    def motion(self, now_s: float, status: MotorStatus, tracking: Tracking) -> None:
        """Checks the drive's status, and how the shaft follows its target."""
        check_drive(status, self._limits)
        self._shaft.check_tracking(now_s, tracking)

    def gap(self, gap_s: float, planned_s: float) -> None:
        """Checks the length of a tick. A late loop neither feeds the watchdog nor sees the
        force.
        """
        late_s = gap_s - planned_s
        if not late_s <= self._limits.late_s:
            raise Tripped(
                Trip.LATE,
                f"the control loop came {1e3 * late_s:.0f} ms late, limit "
                f"{1e3 * self._limits.late_s:g} ms; "
                "close what else runs on this computer",
            )
