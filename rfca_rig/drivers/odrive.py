"""An ODrive on a CAN bus as the motor on the shaft."""

from math import isfinite

import can

from rfca_rig.clock import Clock
from rfca_rig.codecs import cansimple, odrive_meanings, odrive_older_meanings
from rfca_rig.codecs.odrive_meanings import result_text, state_text
from rfca_rig.codecs.odrive_messages import AxisState, ControlMode, Heartbeat, OdriveCommand, OdriveFirmware, OdrivePart
from rfca_rig.drivers.can_frames import send, send_stop
from rfca_rig.drivers.odrive_reports import GUARDED, OdriveReports
from rfca_rig.drivers.odrive_scale import OdriveSettings
from rfca_rig.drivers.report_period import LOOK_REPORTS, period_fault
from rfca_rig.drivers.roles import MotorStatus, ShaftSamples
from rfca_rig.errors import DeviceError

__all__ = ["OdriveMotor", "OdriveSettings"]

POLL_S = 2e-3
PART_ERROR_S = 0.05
WATCHDOG_EXPIRED = {OdriveFirmware.V0_5: odrive_older_meanings.WATCHDOG_EXPIRED, OdriveFirmware.V0_6: odrive_meanings.WATCHDOG_EXPIRED}
ERROR_TEXT = {OdriveFirmware.V0_5: odrive_older_meanings.error_text, OdriveFirmware.V0_6: odrive_meanings.error_text}


class OdriveMotor:
    """A `ShaftMotor` over any `can.BusABC`. Waits only through the clock, and only in `enable` and `prove_watchdog`.

    Any frame to the drive feeds its watchdog; so nothing here sends on its own: outside those two methods every frame is the
    direct consequence of a call, and a caller that stands still lets the drive stop the motor. Firmware 0.5 keeps the errors of
    motor, encoder and controller apart; `read` asks for one once a heartbeat says that it is there (the motor is off then).
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
        """Energises, holding the shaft where it stands: the set-point is the measured angle before the loop closes.

        Raises DeviceError saying what is missing: any frame, this node's frames, its heartbeat, encoder or torque messages at
        the configured rate; or with what error the drive refuses. The motor is idle after a refusal.
        """
        self.disable()
        self._refuse_lost_zero()
        self._forget_part_errors()
        self._send(cansimple.clear_errors(self._settings.node_id, self._settings.dialect))
        self._send(cansimple.request(self._settings.node_id, OdriveCommand.VERSION), remote=True)
        self._await_reports()
        self._check_dialect()
        self._refuse_if(_is_faulty(self._beat()), "still reports")
        hold = cansimple.set_input_pos(self._settings.node_id, self._reports.turns)
        self._send(hold)
        self._set_mode(ControlMode.POSITION)
        self._send(cansimple.set_axis_state(self._settings.node_id, AxisState.CLOSED_LOOP))
        self._await_closed_loop(hold)
        self._armed = True

    def _refuse_lost_zero(self) -> None:
        if self._reports.zero_lost is not None:
            raise DeviceError(f"drive not enabled: {self._reports.zero_lost}, then start anew")

    def _await_reports(self) -> None:
        """Waits for every message the driver lives on, and for enough encoder frames to see their rate."""
        self._reports.drain()
        self._reports.samples()  # what has dammed up while nobody looked has holes, and is handed to nobody
        set_s = self._settings.encoder_period_s
        seen_s = period_fault(self._watched_period_s, set_s)
        if seen_s is not None:
            raise DeviceError(
                f"drive not enabled: encoder estimates come every {1e3 * seen_s:.2g} ms, the settings say "
                f"{1e3 * set_s:g} ms; set the drive's encoder_msg_rate_ms or encoder_period_s"
            )

    def _watched_period_s(self) -> float:
        """Of the encoder's frames, while all that is needed has come."""
        self._reports.recount()
        started_s, timeout_s = self._clock.now_s(), self._settings.enable_timeout_s
        look_s = LOOK_REPORTS * self._settings.encoder_period_s
        while self._reports.missing() is not None or self._clock.now_s() - started_s < look_s:
            if self._clock.now_s() - started_s > max(timeout_s, look_s):
                raise DeviceError(f"drive not enabled: within {timeout_s:g} s {self._reports.missing()}")
            self._wait_and_drain()
        return (self._clock.now_s() - started_s) / self._reports.encoder_frames

    def _check_dialect(self) -> None:
        """Firmware 0.6 tells its version when asked, 0.5 says nothing; a heartbeat read in the wrong dialect would lie."""
        if self._settings.dialect == OdriveFirmware.V0_5 and self._reports.firmware != "unknown":
            raise DeviceError(f'drive not enabled: its firmware is {self._reports.firmware}; set dialect = "0.6"')

    def _forget_part_errors(self) -> None:
        self._reports.part_errors.clear()
        self._asked_parts.clear()

    def _ask_for_part_errors(self) -> None:
        failed = set() if self._reports.beat is None else set(self._reports.beat.failed)
        for part in sorted(failed - self._asked_parts):
            self._send(cansimple.request(self._settings.node_id, cansimple.PART_COMMANDS[part]))
            self._asked_parts.add(part)

    def _await_closed_loop(self, hold: cansimple.Frame) -> None:
        self._reports.recount()
        deadline_s = self._clock.now_s() + self._settings.enable_timeout_s
        while self._reports.heartbeats == 0 or self._beat().state != AxisState.CLOSED_LOOP:
            self._refuse_if(self._reports.heartbeats > 0 and _is_faulty(self._beat()), "refuses closed loop with")
            self._refuse_if(self._clock.now_s() > deadline_s, f"not in closed loop after {self._settings.enable_timeout_s:g} s:")
            self._wait_and_drain()
            self._send(hold)
        self._refuse_if(_is_faulty(self._beat()), "refuses closed loop with")

    def _refuse_if(self, refused: bool, how: str) -> None:
        if refused:
            beat = self._beat()
            self.disable()
            self._learn_part_errors()
            result = f", procedure result {result_text(beat.procedure_result)}" if self._settings.dialect == OdriveFirmware.V0_6 else ""
            raise DeviceError(
                f"drive not enabled: node {self._settings.node_id} {how} {self._errors(beat)}, state {state_text(beat.state)}{result}"
            )

    def _learn_part_errors(self) -> None:
        """Gives the drive a moment to tell which error a part has."""
        self._ask_for_part_errors()
        deadline_s = self._clock.now_s() + PART_ERROR_S
        while self._asked_parts - self._reports.part_errors.keys() and self._clock.now_s() < deadline_s:
            self._wait_and_drain()

    def _errors(self, beat: Heartbeat) -> str:
        """The drive's error word, and those of its parts as far as known."""
        known = self._reports.part_errors
        parts = [
            odrive_older_meanings.part_error_text(part, known[part]) if part in known else f"{part} error, not told which"
            for part in beat.failed
        ]
        return "; ".join([ERROR_TEXT[self._settings.dialect](beat.error), *parts])

    def _beat(self) -> Heartbeat:
        if self._reports.beat is None:
            raise DeviceError(f"no heartbeat from node {self._settings.node_id} yet; enable the drive first")
        return self._reports.beat

    def command_speed(self, speed_rad_s: float) -> None:
        """Asks for a shaft speed. Raises DeviceError when the frame cannot be sent."""
        self._send(cansimple.set_input_vel(self._settings.node_id, self._settings.turns_s(_finite(speed_rad_s, "speed"))))
        self._set_mode(ControlMode.VELOCITY)

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        """Asks for a shaft angle. Raises DeviceError when the frame cannot be sent, or above 32.767 motor turns/s of feed-forward."""
        turns, turns_s = self._settings.turns(_finite(angle_rad, "angle")), self._settings.turns_s(_finite(speed_rad_s, "speed"))
        self._send(cansimple.set_input_pos(self._settings.node_id, turns, turns_s))
        self._set_mode(ControlMode.POSITION)

    def _set_mode(self, mode: ControlMode) -> None:
        """Called after the set-point went out: a mode never meets a set-point older than itself."""
        if mode != self._mode:
            self._send(cansimple.set_controller_mode(self._settings.node_id, mode))
            self._mode = mode

    def disable(self) -> None:
        """Takes the torque away, within 20 ms. Raises DeviceError when the frame cannot be sent; its watchdog stops the motor then."""
        self._armed = False
        self._mode = None
        idle = _message(cansimple.set_axis_state(self._settings.node_id, AxisState.IDLE))
        send_stop(self._bus, self._clock, [idle], GUARDED)

    def prove_watchdog(self, limit_s: float) -> float:
        """Lets the drive starve, and returns how long it took until its heartbeat showed the watchdog expired and the motor idle.

        To be called with the shaft enabled and still; the motor is off afterwards. Raises DeviceError where nothing happened
        within `limit_s`; the heartbeat alone takes up to 0.1 s to tell.
        """
        started_s = self._clock.now_s()
        while not self._watchdog_tripped():
            if self._clock.now_s() - started_s > limit_s:
                self.disable()
                raise DeviceError(f"drive's watchdog let it run through {limit_s:g} s of silence; set enable_watchdog and watchdog_timeout")
            self._wait_and_drain()
        self.disable()
        return self._clock.now_s() - started_s

    def _watchdog_tripped(self) -> bool:
        return bool(self._beat().error & WATCHDOG_EXPIRED[self._settings.dialect]) and self._beat().state == AxisState.IDLE

    def read(self) -> ShaftSamples:
        """Samples since the last call. Raises DeviceError on a failing bus or a frame that cannot be read."""
        self._reports.drain()
        self._ask_for_part_errors()
        return self._reports.samples()

    def status(self) -> MotorStatus:
        """A motor that left closed loop on its own is at fault, also where the drive's error word is zero."""
        beat = self._reports.beat
        silent_s = self._reports.drained_s - self._reports.beat_s
        state, temperature_C = "unknown" if beat is None else state_text(beat.state), self._reports.temperature.warmest_C
        return MotorStatus(state, self._fault(silent_s), silent_s, temperature_C)

    def _fault(self, silent_s: float) -> str | None:
        beat, limit_s = self._reports.beat, self._settings.heartbeat_timeout_s
        if beat is not None and _is_faulty(beat):
            return self._errors(beat)
        if self._reports.doubts is not None:
            return self._reports.doubts
        if beat is not None and self._armed and beat.state != AxisState.CLOSED_LOOP:
            return f"left closed loop for {state_text(beat.state)} without an error; was it stopped from elsewhere, or restarted?"
        if silent_s > limit_s:
            return f"no heartbeat for {silent_s:.2f} s, limit {limit_s:g} s; check the drive's power and the CAN wiring"
        return None

    def identity(self) -> dict[str, str]:
        """For the recording; the firmware is known after `enable`."""
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
        send(self._bus, _message(frame, remote), GUARDED)

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
