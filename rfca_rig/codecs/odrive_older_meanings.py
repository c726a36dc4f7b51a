"""Meanings of the error words of an ODrive with firmware 0.5 (0.5.6 API reference: Axis, Motor, Encoder and Controller errors)."""

from rfca_rig.codecs.odrive_messages import OdrivePart

AXIS_BITS = {
    0: ("INVALID_STATE", "the state asked for cannot be entered; is the motor calibrated?"),
    6: ("MOTOR_FAILED", "see the motor's own error"),
    7: ("SENSORLESS_ESTIMATOR_FAILED", "see the estimator's own error"),
    8: ("ENCODER_FAILED", "see the encoder's own error"),
    9: ("CONTROLLER_FAILED", "see the controller's own error"),
    11: ("WATCHDOG_TIMER_EXPIRED", "no command reached the drive in time"),
    12: ("MIN_ENDSTOP_PRESSED", "the lower end stop was touched"),
    13: ("MAX_ENDSTOP_PRESSED", "the upper end stop was touched"),
    14: ("ESTOP_REQUESTED", "emergency stop pressed or sent"),
    17: ("HOMING_WITHOUT_ENDSTOP", "homing needs an end stop"),
    18: ("OVER_TEMP", "drive or motor too hot"),
    19: ("UNKNOWN_POSITION", "no valid position; run the calibration"),
}
WATCHDOG_EXPIRED = 1 << 11
ESTOP_REQUESTED = 1 << 14
OVER_TEMPERATURE = 1 << 18

# Bit of the motor's error word.
MODULATION_IS_NAN = 1 << 16

_PART_BITS = {
    OdrivePart.MOTOR: {
        0: ("PHASE_RESISTANCE_OUT_OF_RANGE", "check the motor's wires"),
        1: ("PHASE_INDUCTANCE_OUT_OF_RANGE", "check the motor's wires"),
        3: ("DRV_FAULT", "the gate driver chip reports a fault"),
        4: ("CONTROL_DEADLINE_MISSED", "the control loop missed its deadline; mostly follows another error"),
        7: ("MODULATION_MAGNITUDE", "supply voltage too low for this speed or current"),
        10: ("CURRENT_SENSE_SATURATION", "current beyond what can be measured"),
        12: ("CURRENT_LIMIT_VIOLATION", "motor current above its limit"),
        16: ("MODULATION_IS_NAN", "a set-point was not a number"),
        17: ("MOTOR_THERMISTOR_OVER_TEMP", "motor too hot"),
        18: ("FET_THERMISTOR_OVER_TEMP", "inverter too hot"),
        19: ("TIMER_UPDATE_MISSED", "firmware failure inside the drive"),
        20: ("CURRENT_MEASUREMENT_UNAVAILABLE", "firmware failure inside the drive"),
        21: ("CONTROLLER_FAILED", "see the controller's own error"),
        22: ("I_BUS_OUT_OF_RANGE", "supply current outside its limits"),
        23: ("BRAKE_RESISTOR_DISARMED", "the brake resistor is off"),
        24: ("SYSTEM_LEVEL", "see the drive's own error, mostly supply voltage or current"),
        25: ("BAD_TIMING", "the control loop missed its deadline"),
        26: ("UNKNOWN_PHASE_ESTIMATE", "no valid encoder position; run the calibration"),
        27: ("UNKNOWN_PHASE_VEL", "no valid encoder speed"),
        28: ("UNKNOWN_TORQUE", "the controller gave no torque"),
        29: ("UNKNOWN_CURRENT_COMMAND", "no current was asked for"),
        30: ("UNKNOWN_CURRENT_MEASUREMENT", "current not measured"),
        31: ("UNKNOWN_VBUS_VOLTAGE", "supply voltage not measured"),
        32: ("UNKNOWN_VOLTAGE_COMMAND", "no voltage was asked for"),
        33: ("UNKNOWN_GAINS", "run the motor calibration"),
        34: ("CONTROLLER_INITIALIZING", "the drive is still starting up"),
        35: ("UNBALANCED_PHASES", "check the motor's wires"),
    },
    OdrivePart.ENCODER: {
        0: ("UNSTABLE_GAIN", "the encoder's bandwidth is set too high"),
        1: ("CPR_POLEPAIRS_MISMATCH", "pole pairs and counts per turn do not match"),
        2: ("NO_RESPONSE", "no change seen while the motor turned; check the encoder's wires"),
        3: ("UNSUPPORTED_ENCODER_MODE", "set another encoder mode"),
        4: ("ILLEGAL_HALL_STATE", "check the Hall sensors' wires"),
        5: ("INDEX_NOT_FOUND_YET", "turn to the encoder's index first"),
        6: ("ABS_SPI_TIMEOUT", "the absolute encoder does not answer"),
        7: ("ABS_SPI_COM_FAIL", "the absolute encoder's answers are damaged"),
        8: ("ABS_SPI_NOT_READY", "the absolute encoder is not ready"),
        9: ("HALL_NOT_CALIBRATED_YET", "run the Hall calibration"),
    },
    OdrivePart.CONTROLLER: {
        0: ("OVERSPEED", "motor faster than its limit"),
        1: ("INVALID_INPUT_MODE", "set another input mode"),
        2: ("UNSTABLE_GAIN", "the gains are set too high"),
        3: ("INVALID_MIRROR_AXIS", "set another axis to mirror"),
        4: ("INVALID_LOAD_ENCODER", "set another load encoder"),
        5: ("INVALID_ESTIMATE", "no valid encoder position or speed"),
        6: ("INVALID_CIRCULAR_RANGE", "set another circular range"),
        7: ("SPINOUT_DETECTED", "electrical and mechanical power disagree; encoder slipping or miscalibrated"),
    },
}


def error_text(word: int) -> str:
    """The axis error word in hexadecimal with the name and meaning of every bit that is set."""
    return f"error 0x{word:08x} ({_describe_bits(word, AXIS_BITS)})"


def part_error_text(part: OdrivePart, word: int) -> str:
    """The same for the error word of one part, 64 bits for the motor's."""
    return f"{part} error 0x{word:08x} ({_describe_bits(word, _PART_BITS[part])})"


def _describe_bits(word: int, bits: dict[int, tuple[str, str]]) -> str:
    known = (bits.get(bit, (f"bit {bit}", "not documented")) for bit in range(64) if word >> bit & 1)
    return "; ".join(f"{name}: {meaning}" for name, meaning in known) or "none"
