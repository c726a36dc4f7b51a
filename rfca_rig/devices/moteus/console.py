"""The text commands of a moteus on its diagnostic stream, and the names of its settings; pure.

Sources: moteus reference, "Diagnostic Protocol" and "Configuration"; mjlib,
micro/persistent_config.cc (answers). A command is one line. `conf get NAME` is answered by the
value alone, all other commands by `OK`, after any text; what is refused by `ERR` and the reason.
"""

from math import nan

from rfca_rig.errors import MalformedFrame

# Channel of the stream on which the drive takes commands.
CHANNEL = 1
LINE_END = b"\n"

ID = "id.id"
CAN_PREFIX = "can.prefix"
POSITION_MIN = "servopos.position_min"
POSITION_MAX = "servopos.position_max"
DEFAULT_TIMEOUT = "servo.default_timeout_s"
TIMEOUT_MODE = "servo.timeout_mode"
TIMEOUT_TORQUE = "servo.timeout_max_torque_Nm"
MAX_CURRENT = "servo.max_current_A"
MAX_VELOCITY = "servo.max_velocity"
VELOCITY_LIMIT = "servo.default_velocity_limit"
ACCELERATION_LIMIT = "servo.default_accel_limit"
OUTPUT_RATIO = "motor_position.rotor_to_output_ratio"
POLES = "motor.poles"

# Settings as they leave the factory (firmware, bldc_servo_structs.h and motor_position.h), of a
# moteus r4 that was not calibrated yet.
FACTORY_SETTINGS: dict[str, float] = {
    ID: 1,
    CAN_PREFIX: 0,
    POSITION_MIN: -0.01,
    POSITION_MAX: 0.01,
    DEFAULT_TIMEOUT: 0.1,
    TIMEOUT_MODE: 12,
    TIMEOUT_TORQUE: 5.0,
    MAX_CURRENT: 100.0,
    MAX_VELOCITY: 500.0,
    VELOCITY_LIMIT: nan,
    ACCELERATION_LIMIT: 50.0,
    OUTPUT_RATIO: 1.0,
    POLES: 0,
}
INTEGER_SETTINGS = frozenset({ID, CAN_PREFIX, TIMEOUT_MODE, POLES})


def format_setting(value: float) -> str:
    """The value as a command carries it; "nan" for no limit."""
    return f"{value:.9g}"


def parse_setting(text: str) -> float:
    """The value in an answer. Raises MalformedFrame for anything but a number."""
    try:
        return float(text)
    except ValueError as error:
        raise MalformedFrame(f"{text[:40]!r} is no number") from error


def split_lines(received: bytes) -> tuple[list[str], bytes]:
    """Complete lines without their ends, none empty, and the remaining bytes."""
    *lines, rest = received.replace(b"\r", LINE_END).split(LINE_END)
    return [line.decode("latin1").strip() for line in lines if line.strip()], rest
