"""Settings of an ODrive that matter on a rig: their names in both firmwares, what a rig file needs
of them, and what a drive has as it leaves its maker.

Names: ODrive API reference of 0.6, and `odrive-interface.yaml` of 0.5.6. Factory values: the same
file of 0.5.6; those of 0.6 were read in configurations that users published, not on a drive.
"""

from dataclasses import dataclass
from math import inf, tau

from rfca_rig.devices.drive_setup import ON_OFF, DriveNeeds, Setting
from rfca_rig.devices.odrive.messages import OdriveFirmware
from rfca_rig.devices.odrive.section import OdriveSection

BAUD_RATE = "can.config.baud_rate"
NODE_ID = "axis0.config.can.node_id"
WATCHDOG_TIMEOUT = "axis0.config.watchdog_timeout"
ENABLE_WATCHDOG = "axis0.config.enable_watchdog"
VEL_LIMIT = "axis0.controller.config.vel_limit"
CLOSED_LOOP_AT_START = "axis0.config.startup_closed_loop_control"
VEL_SCALE = "axis0.config.can.input_vel_scale"
TORQUE_SCALE = "axis0.config.can.input_torque_scale"
SWITCHES = frozenset({ENABLE_WATCHDOG, CLOSED_LOOP_AT_START})

# The heartbeat shows an error, and that the drive is there; the driver waits for three of them.
HEARTBEAT_MS = 100.0
# Motors warm up within minutes. The driver misses temperatures after ten seconds.
TEMPERATURE_MS = 500.0
LONGEST_TEMPERATURE_MS = 1000.0
# What the driver takes for one unit of the feed-forwards, as the drive has it from its maker.
FEED_FORWARD_SCALE = 1000.0
# The longest watchdog that is taken. The longest silence of a guardian is the same.
LONGEST_WATCHDOG_S = 0.3
# The rig's own limits act first: the drive's are for the case that this computer fails. A drive
# that is limited to the rig's speed would also end a stroke that swings back freely.
MOST_SPEED_FACTOR = 1.5
# Beside the leg's load the motor accelerates its own rotor.
TORQUE_FACTOR = 1.5
MOST_TORQUE_FACTOR = 2.0


@dataclass(frozen=True)
class OdriveNames:
    """Names that differ between the firmwares; "" for a value that a firmware does not have."""

    heartbeat: str
    encoder: str
    torques: str
    iq: str
    temperature: str
    torque_max: str
    torque_min: str
    current_max: str
    torque_constant: str


NAMES = {
    OdriveFirmware.V0_6: OdriveNames(
        heartbeat="axis0.config.can.heartbeat_msg_rate_ms",
        encoder="axis0.config.can.encoder_msg_rate_ms",
        torques="axis0.config.can.torques_msg_rate_ms",
        iq="axis0.config.can.iq_msg_rate_ms",
        temperature="axis0.config.can.temperature_msg_rate_ms",
        torque_max="axis0.config.torque_soft_max",
        torque_min="axis0.config.torque_soft_min",
        current_max="axis0.config.motor.current_soft_max",
        torque_constant="axis0.config.motor.torque_constant",
    ),
    OdriveFirmware.V0_5: OdriveNames(
        heartbeat="axis0.config.can.heartbeat_rate_ms",
        encoder="axis0.config.can.encoder_rate_ms",
        torques="",
        iq="axis0.config.can.iq_rate_ms",
        temperature="",
        torque_max="axis0.motor.config.torque_lim",
        torque_min="",
        current_max="axis0.motor.config.current_lim",
        torque_constant="axis0.motor.config.torque_constant",
    ),
}


def list_wanted(keys: OdriveSection, needs: DriveNeeds) -> tuple[Setting, ...]:
    """What a rig file needs, in the order in which it is written: the watchdog's time before the
    watchdog.
    """
    firmware = OdriveFirmware(keys.dialect)
    names = NAMES[firmware]
    torque_message = names.iq
    if keys.torque_constant_Nm_per_A is None:
        torque_message = names.torques
    is_newer = firmware == OdriveFirmware.V0_6
    turns_s = needs.speed_rad_s * keys.gear_ratio / tau
    torque_Nm = needs.torque_Nm / keys.gear_ratio
    settings = [
        Setting(BAUD_RATE, "bits/s of the bus", float(keys.bitrate), None, "bit/s", False),
        Setting(NODE_ID, "its number on the bus", float(keys.node_id), None),
        Setting(
            names.heartbeat,
            "shows errors, and that it is there",
            HEARTBEAT_MS,
            None,
            "ms",
            least=1.0,
            most=HEARTBEAT_MS,
        ),
        Setting(
            names.encoder,
            "reports angle and speed: encoder_period_ms",
            keys.encoder_period_ms,
            None,
            "ms",
        ),
        Setting(
            torque_message,
            "reports the torque, as often as the angle",
            keys.encoder_period_ms,
            None,
            "ms",
            least=1.0,
            most=keys.encoder_period_ms,
        ),
    ]
    if is_newer:
        settings += [
            Setting(
                names.temperature,
                "for limits.temperature_degC",
                TEMPERATURE_MS,
                None,
                "ms",
                least=1.0,
                most=LONGEST_TEMPERATURE_MS,
            ),
            Setting(VEL_SCALE, "counts of a feed-forward of 1 turn/s", FEED_FORWARD_SCALE, None),
            Setting(TORQUE_SCALE, "counts of a feed-forward of 1 N m", FEED_FORWARD_SCALE, None),
        ]
    settings += [
        Setting(
            VEL_LIMIT,
            "limits.speed_rad_s at the motor",
            round(turns_s, 3),
            None,
            "turn/s",
            least=round(turns_s, 3),
            most=MOST_SPEED_FACTOR * turns_s,
        ),
        Setting(
            names.torque_max,
            "1.5 times limits.torque_Nm at the motor",
            round(TORQUE_FACTOR * torque_Nm, 3),
            None,
            "N m",
            least=torque_Nm,
            most=MOST_TORQUE_FACTOR * torque_Nm,
        ),
    ]
    if is_newer:
        settings.append(
            Setting(
                names.torque_min,
                "the same in the other direction",
                -round(TORQUE_FACTOR * torque_Nm, 3),
                None,
                "N m",
                least=-MOST_TORQUE_FACTOR * torque_Nm,
                most=-torque_Nm,
            )
        )
    settings += [
        Setting(names.current_max, "by the motor's data sheet", None, None, "A", False),
        Setting(names.torque_constant, _constant_purpose(keys), None, None, "N m/A", False),
        Setting(CLOSED_LOOP_AT_START, "the motor is off after power-up", 0.0, None, ON_OFF),
        Setting(
            WATCHDOG_TIMEOUT,
            "twice limits.late_ms without a command",
            needs.watchdog_s,
            None,
            "s",
            least=1.2 * needs.late_s,
            most=max(LONGEST_WATCHDOG_S, needs.watchdog_s),
        ),
        Setting(ENABLE_WATCHDOG, "ends the torque then; proven in each run", 1.0, None, ON_OFF),
    ]
    return tuple(settings)


def _constant_purpose(keys: OdriveSection) -> str:
    if keys.torque_constant_Nm_per_A is None:
        return "8.27 / KV of the motor"
    return f"8.27 / KV of the motor; the rig file has {keys.torque_constant_Nm_per_A:g}"


def factory_values(firmware: OdriveFirmware) -> dict[str, float]:
    """What a drive has as it leaves its maker, by the names of its firmware."""
    names = NAMES[firmware]
    values = {
        BAUD_RATE: 250_000.0,
        NODE_ID: 0.0,
        names.heartbeat: 100.0,
        names.encoder: 10.0,
        names.iq: 0.0,
        VEL_LIMIT: 2.0,
        names.torque_max: inf,
        names.current_max: 10.0,
        names.torque_constant: 0.04,
        CLOSED_LOOP_AT_START: 0.0,
        WATCHDOG_TIMEOUT: 0.0,
        ENABLE_WATCHDOG: 0.0,
    }
    if firmware == OdriveFirmware.V0_6:
        values |= {
            names.torques: 0.0,
            names.temperature: 0.0,
            names.torque_min: -inf,
            VEL_SCALE: FEED_FORWARD_SCALE,
            TORQUE_SCALE: FEED_FORWARD_SCALE,
        }
    return values
