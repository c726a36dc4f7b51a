"""Meanings of the numbers in an ODrive heartbeat; firmware 0.6 (ODrive API reference, ODrive.Error and ProcedureResult)."""

ERROR_BITS = {
    0: ("INITIALIZING", "the drive is still starting up"),
    1: ("SYSTEM_LEVEL", "firmware failure inside the drive"),
    2: ("TIMING_ERROR", "the drive's control loop missed its deadline"),
    3: ("MISSING_ESTIMATE", "no valid encoder position or calibration"),
    4: ("BAD_CONFIG", "the drive's configuration is incomplete or contradicts itself"),
    5: ("DRV_FAULT", "the gate driver chip reports a fault"),
    6: ("MISSING_INPUT", "no set-point was given"),
    8: ("DC_BUS_OVER_VOLTAGE", "supply voltage above its limit; check the brake resistor"),
    9: ("DC_BUS_UNDER_VOLTAGE", "supply voltage below its limit; check the power supply"),
    10: ("DC_BUS_OVER_CURRENT", "supply current above its limit"),
    11: ("DC_BUS_OVER_REGEN_CURRENT", "current fed back into the supply above its limit"),
    12: ("CURRENT_LIMIT_VIOLATION", "motor current above its limit"),
    13: ("MOTOR_OVER_TEMP", "motor too hot"),
    14: ("INVERTER_OVER_TEMP", "inverter too hot"),
    15: ("VELOCITY_LIMIT_VIOLATION", "motor faster than its limit"),
    16: ("POSITION_LIMIT_VIOLATION", "position outside its limits"),
    17: ("REQUESTED_CURRENT_TOO_HIGH", "the configured current is more than the drive can give"),
    24: ("WATCHDOG_TIMER_EXPIRED", "no command reached the drive in time"),
    25: ("ESTOP_REQUESTED", "emergency stop pressed or sent"),
    26: ("SPINOUT_DETECTED", "electrical and mechanical power disagree; encoder slipping or miscalibrated"),
    27: ("BRAKE_RESISTOR_DISARMED", "the brake resistor is off"),
    28: ("THERMISTOR_DISCONNECTED", "a thermistor is not connected"),
    30: ("CALIBRATION_ERROR", "the calibration failed"),
}

WATCHDOG_EXPIRED = 1 << 24
ESTOP_REQUESTED = 1 << 25
MISSING_INPUT = 1 << 6
MOTOR_OVER_TEMPERATURE = 1 << 13

STATES = {
    0: "undefined",
    1: "idle",
    2: "startup sequence",
    3: "full calibration",
    4: "motor calibration",
    5: "sensorless control",
    6: "encoder index search",
    7: "encoder offset calibration",
    8: "closed loop",
    9: "lock-in spin",
    10: "encoder direction search",
    11: "homing",
    12: "hall polarity calibration",
    13: "hall phase calibration",
    14: "anticogging calibration",
}

PROCEDURE_RESULTS = {
    0: "success",
    1: "busy",
    2: "cancelled",
    3: "disarmed",
    4: "no response",
    5: "pole pairs and counts per turn do not match",
    6: "phase resistance out of range",
    7: "phase inductance out of range",
    8: "unbalanced phases",
    9: "invalid motor type",
    10: "illegal hall state",
    11: "timeout",
    12: "homing without endstop",
    13: "invalid state",
    14: "not calibrated",
    15: "not converging",
    16: "requested current too high",
}


def error_text(word: int) -> str:
    """The error word in hexadecimal with the name and meaning of every bit that is set."""
    bits = [bit for bit in range(32) if word >> bit & 1]
    meanings = [f"{name}: {meaning}" for name, meaning in (ERROR_BITS.get(bit, (f"bit {bit}", "not documented")) for bit in bits)]
    return f"error 0x{word:08x} ({'; '.join(meanings) or 'none'})"


def state_text(state: int) -> str:
    return STATES.get(state, f"state {state}")


def result_text(result: int) -> str:
    return PROCEDURE_RESULTS.get(result, f"result {result}")
