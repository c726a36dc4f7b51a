"""Meanings of the values of a moteus' registers mode and fault (moteus reference, registers 0x000 and 0x00f)."""

MODES = {
    0: "stopped",
    1: "fault",
    2: "enabling",
    3: "calibrating",
    4: "calibration complete",
    5: "PWM",
    6: "voltage",
    7: "voltage FOC",
    8: "voltage DQ",
    9: "current",
    10: "position",
    11: "timeout",
    12: "zero velocity",
    13: "stay within",
    14: "measure inductance",
    15: "brake",
}

FAULTS = {
    32: ("calibration fault", "the encoder sensed no magnet during calibration"),
    33: ("motor driver fault", "mostly the supply sagged under the current drawn; see the drv8323 diagnostics"),
    34: ("over voltage", "supply above servo.max_voltage; check its setting, and where braking power goes"),
    35: ("encoder fault", "the encoder's readings do not fit a magnet in place"),
    36: ("motor not configured", "run moteus_tool --calibrate on this motor"),
    37: ("pwm cycle overrun", "an internal error of the firmware"),
    38: ("over temperature", "board or motor above its limit; let it cool"),
    39: ("outside limit", "started outside servopos.position_min .. position_max"),
    40: ("under voltage", "supply too low; check the power supply"),
    41: ("config changed", "a setting was changed that needs a stop first"),
    42: ("theta invalid", "no valid encoder for commutation"),
    43: ("position invalid", "no valid encoder of the output"),
    44: ("driver enable fault", "the gate driver could not be switched on"),
    45: ("stop position deprecated", "a stop position was given together with velocity or acceleration limits"),
    46: ("timing violation", "the firmware broke a time limit of its own"),
    47: ("bemf feedforward no accel", "servo.bemf_feedforward is set without an acceleration limit"),
    48: ("invalid limits", "servopos.position_min or position_max lie outside the range available"),
}

# Codes in the fault register that are no faults: a function that limits the output while the drive runs.
LIMITS = {
    96: "servo.max_velocity",
    97: "servo.max_power_W",
    98: "the supply's voltage",
    99: "servo.max_current_A",
    100: "servo.fault_temperature",
    101: "servo.motor_fault_temperature",
    102: "the commanded maximum torque",
    103: "servopos.position_min or position_max",
}

REGISTER_ERRORS = {1: "unknown register", 2: "not writeable", 3: "value not allowed"}


def mode_text(mode: int) -> str:
    return MODES.get(mode, f"mode {mode}")


def fault_text(code: int) -> str:
    """The code of register 0x00f with its name and meaning; codes of limiting functions are described as limits."""
    if code in LIMITS:
        return f"limit {code} (output limited by {LIMITS[code]})"
    name, meaning = FAULTS.get(code, ("not documented", "see the firmware's release notes"))
    return f"fault {code} ({name}: {meaning})"


def register_error_text(code: int) -> str:
    return REGISTER_ERRORS.get(code, f"error {code}")
