"""Driver for an ODrive (CANSimple protocol) on a CAN bus."""

from math import isfinite

import can

from rfca_rig.clock import Clock
from rfca_rig.codecs import cansimple
from rfca_rig.codecs.odrive import (
    WATCHDOG_EXPIRED,
    AxisState,
    ControlMode,
    Heartbeat,
    OdriveCommand,
    OdriveFirmware,
    OdrivePart,
    error_text,
    part_error_text,
    result_text,
    state_text,
)
from rfca_rig.drivers.can_frames import send, send_stop
from rfca_rig.drivers.device_time import PERIODS_PER_ATTEMPT, find_wrong_period
from rfca_rig.drivers.motors.odrive_reports import WATCHDOG_REMEDY, OdriveReports, OdriveSettings
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.errors import DeviceError

__all__ = ["OdriveMotor", "OdriveSettings"]

# Poll interval while waiting, and the time given to a drive to answer a request for part errors, in s.
POLL_S = 2e-3
PART_ERROR_S = 0.05


class OdriveMotor:
    """A `ShaftMotor` over any `can.BusABC`. Waits only through the clock, and only in `enable` and `prove_watchdog`.

    Any frame to the drive feeds its watchdog, so this class sends nothing on its own. Outside those two methods every frame results
    directly from a call; a caller that hangs therefore lets the drive stop the motor. Firmware 0.5 keeps separate errors for motor,
    encoder and controller; `read` requests such an error once a heartbeat announces it (the motor is off then).
    """

    def __init__(self, bus: can.BusABC, clock: Clock, settings: OdriveSettings) -> None:
        self._bus = bus
        self._clock = clock
        self._settings = settings
        self._reports = OdriveReports(bus, clock, settings)
        self._mode: ControlMode | None = None
        self._armed = False
        self._asked_parts: set[OdrivePart] = set()

    def enable(self) -> None:
        """Energises the motor and holds the shaft: the set-point is the measured angle before the loop closes.

        Raises DeviceError, and leaves the motor idle, if

        - no frame, no frame of this node, or none of its heartbeat, encoder or torque messages arrives;
        - the encoder messages come at another rate than configured;
        - the drive refuses with an error.
        """
        self.disable()
        # With a lost zero every angle is wrong, so the zero must be found again before a new start.
        if self._reports.zero_lost is not None:
            raise DeviceError(f"drive not enabled: {self._reports.zero_lost}, then start again")
        self._reports.part_errors.clear()
        self._asked_parts.clear()
        self._send(cansimple.clear_errors(self._settings.node_id, self._settings.dialect))
        self._send(cansimple.request(self._settings.node_id, OdriveCommand.VERSION), remote=True)
        self._await_reports()
        # Firmware 0.6 answers a version request, 0.5 does not. A heartbeat decoded in the wrong dialect would be wrong.
        if self._settings.dialect == OdriveFirmware.V0_5 and self._reports.firmware != "unknown":
            raise DeviceError(f'drive not enabled: its firmware is {self._reports.firmware}; set dialect = "0.6"')
        self._refuse_if(_is_faulty(self._beat()), "still reports")
        # Set-point first, then mode, then closed loop: an old set-point in the drive would make the shaft jump.
        hold = cansimple.set_input_pos(self._settings.node_id, self._reports.turns)
        self._send(hold)
        self._set_mode(ControlMode.POSITION)
        self._send(cansimple.set_axis_state(self._settings.node_id, AxisState.CLOSED_LOOP))
        self._await_closed_loop(hold)
        self._armed = True

    def _await_reports(self) -> None:
        """Waits for every required message, and for enough encoder frames to measure their rate."""
        self._reports.drain()
        # Frames that piled up during a pause may have gaps, so they are discarded.
        self._reports.samples()
        configured_s = self._settings.encoder_period_s
        measured_s = find_wrong_period(self._measure_period_s, configured_s)
        if measured_s is not None:
            raise DeviceError(
                f"drive not enabled: encoder estimates come every {1e3 * measured_s:.2g} ms, the settings say "
                f"{1e3 * configured_s:g} ms; set the drive's encoder_msg_rate_ms or encoder_period_s"
            )

    def _measure_period_s(self) -> float:
        """Measures the mean period of the encoder frames in s, and waits until all required messages have arrived."""
        self._reports.reset_counters()
        started_s, timeout_s = self._clock.now_s(), self._settings.enable_timeout_s
        look_s = PERIODS_PER_ATTEMPT * self._settings.encoder_period_s
        while self._reports.missing() is not None or self._clock.now_s() - started_s < look_s:
            if self._clock.now_s() - started_s > max(timeout_s, look_s):
                raise DeviceError(f"drive not enabled: within {timeout_s:g} s {self._reports.missing()}")
            self._wait_and_drain()
        return (self._clock.now_s() - started_s) / self._reports.encoder_frames

    def _ask_for_part_errors(self) -> None:
        failed = set() if self._reports.beat is None else set(self._reports.beat.failed)
        for part in sorted(failed - self._asked_parts):
            self._send(cansimple.request(self._settings.node_id, cansimple.PART_COMMANDS[part]))
            self._asked_parts.add(part)

    def _await_closed_loop(self, hold: cansimple.Frame) -> None:
        self._reports.reset_counters()
        deadline_s = self._clock.now_s() + self._settings.enable_timeout_s
        # A new heartbeat is required, as the last one was sent before the request.
        while self._reports.heartbeats == 0 or self._beat().state != AxisState.CLOSED_LOOP:
            self._refuse_if(self._reports.heartbeats > 0 and _is_faulty(self._beat()), "refuses closed loop with")
            self._refuse_if(self._clock.now_s() > deadline_s, f"not in closed loop after {self._settings.enable_timeout_s:g} s:")
            self._wait_and_drain()
            # The watchdog may already run in closed loop, so the same set-point is repeated.
            self._send(hold)
        self._refuse_if(_is_faulty(self._beat()), "refuses closed loop with")

    def _refuse_if(self, refused: bool, how: str) -> None:
        if refused:
            beat = self._beat()
            self.disable()
            # Waits briefly for the drive to report the error of each part.
            self._ask_for_part_errors()
            deadline_s = self._clock.now_s() + PART_ERROR_S
            while self._asked_parts - self._reports.part_errors.keys() and self._clock.now_s() < deadline_s:
                self._wait_and_drain()
            result = f", procedure result {result_text(beat.procedure_result)}" if self._settings.dialect == OdriveFirmware.V0_6 else ""
            raise DeviceError(
                f"drive not enabled: node {self._settings.node_id} {how} {self._errors(beat)}, state {state_text(beat.state)}{result}"
            )

    def _errors(self, beat: Heartbeat) -> str:
        """Text of the drive's error word and of its parts' error words, as far as they are known."""
        errors = self._reports.part_errors
        parts = [
            part_error_text(part, errors[part]) if part in errors else f"{part} error, which one is not reported" for part in beat.failed
        ]
        return "; ".join([error_text(beat.error, self._settings.dialect), *parts])

    def _beat(self) -> Heartbeat:
        if self._reports.beat is None:
            raise DeviceError(f"no heartbeat from node {self._settings.node_id} yet; enable the drive first")
        return self._reports.beat

    def command_speed(self, speed_rad_s: float) -> None:
        """Commands a shaft speed. Raises DeviceError if the frame cannot be sent."""
        self._send(cansimple.set_input_vel(self._settings.node_id, self._settings.turns_s(_finite(speed_rad_s, "speed"))))
        self._set_mode(ControlMode.VELOCITY)

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Commands a shaft angle. Raises DeviceError if the frame cannot be sent, or above 32.767 motor turns/s of feed-forward."""
        turns, turns_s = self._settings.turns(_finite(angle_rad, "angle")), self._settings.turns_s(_finite(speed_rad_s, "speed"))
        self._send(cansimple.set_input_pos(self._settings.node_id, turns, turns_s))
        self._set_mode(ControlMode.POSITION)

    def _set_mode(self, mode: ControlMode) -> None:
        """Switches the controller mode. Call it after the set-point is sent, so a new mode never acts on an old set-point."""
        if mode != self._mode:
            self._send(cansimple.set_controller_mode(self._settings.node_id, mode))
            self._mode = mode

    def disable(self) -> None:
        """Disables the motor within 20 ms. Raises DeviceError if the frame cannot be sent; its watchdog then stops the motor."""
        self._armed = False
        self._mode = None
        idle = _message(cansimple.set_axis_state(self._settings.node_id, AxisState.IDLE))
        send_stop(self._bus, self._clock, [idle], WATCHDOG_REMEDY)

    def prove_watchdog(self, limit_s: float) -> float:
        """Sends nothing until the heartbeat shows an expired watchdog and an idle motor; returns the time in s that this took.

        Call it with the shaft enabled and at rest; the motor is off afterwards. Raises DeviceError if nothing happened within
        `limit_s`. The heartbeat alone takes up to 0.1 s to show it.
        """
        started_s = self._clock.now_s()
        while not (self._beat().error & WATCHDOG_EXPIRED[self._settings.dialect] and self._beat().state == AxisState.IDLE):
            if self._clock.now_s() - started_s > limit_s:
                self.disable()
                raise DeviceError(f"drive's watchdog let it run through {limit_s:g} s of silence; set enable_watchdog and watchdog_timeout")
            self._wait_and_drain()
        self.disable()
        return self._clock.now_s() - started_s

    def read(self) -> ShaftSamples:
        """Samples (m,) since the last call. Raises DeviceError if the bus fails or a frame cannot be decoded."""
        self._reports.drain()
        self._ask_for_part_errors()
        return self._reports.samples()

    def status(self) -> MotorStatus:
        """State of the drive. A motor that left closed loop on its own is at fault, even if the error word is zero."""
        beat = self._reports.beat
        silent_s = self._reports.drained_s - self._reports.beat_s
        state, temperature_C = "unknown" if beat is None else state_text(beat.state), self._reports.temperature.warmest_C
        return MotorStatus(state, self._fault(silent_s), silent_s, temperature_C)

    def _fault(self, silent_s: float) -> str | None:
        beat, limit_s = self._reports.beat, self._settings.heartbeat_timeout_s
        if beat is not None and _is_faulty(beat):
            return self._errors(beat)
        # The firmware-reported error comes first, since it names the cause; doubts about the reports come second.
        if self._reports.doubts is not None:
            return self._reports.doubts
        # Firmware 0.5 can fall back to idle with an error word of zero, so the state is checked, not only the word.
        if beat is not None and self._armed and beat.state != AxisState.CLOSED_LOOP:
            return f"left closed loop for {state_text(beat.state)} without an error; was it stopped from elsewhere, or restarted?"
        if silent_s > limit_s:
            return f"no heartbeat for {silent_s:.2f} s, limit {limit_s:g} s; check the drive's power and the CAN wiring"
        return None

    def identity(self) -> dict[str, str]:
        """For the recording. The firmware version is known after `enable`."""
        return {
            "make": "ODrive, CANSimple",
            "bus": str(self._bus.channel_info),
            "node_id": str(self._settings.node_id),
            "dialect": self._settings.dialect.value,
            "firmware": self._reports.firmware,
            "gear_ratio": repr(self._settings.gear_ratio),
            "direction": str(self._settings.direction),
            "zero_turns": repr(self._settings.zero_turns),
            "encoder_period_s": repr(self._settings.encoder_period_s),
            "torque_from": self._reports.torque_source,
            "encoder_frames_lost": str(self._reports.lost_frames),
            **self._reports.health.facts(),
        }

    def _send(self, frame: cansimple.Frame, remote: bool = False) -> None:
        send(self._bus, _message(frame, remote), WATCHDOG_REMEDY)

    def _wait_and_drain(self) -> None:
        self._clock.wait_until(self._clock.now_s() + POLL_S)
        self._reports.drain()


def _message(frame: cansimple.Frame, remote: bool = False) -> can.Message:
    return can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False, is_remote_frame=remote)


def _is_faulty(beat: Heartbeat) -> bool:
    return beat.error != 0 or len(beat.failed) > 0


def _finite(value: float, name: str) -> float:
    if not isfinite(value):
        raise DeviceError(f"commanded {name} is {value}; nothing was sent to the drive")
    return value
