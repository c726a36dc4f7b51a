"""Faults of an ODrive, in its frames and inside the drive."""

from collections.abc import Callable, Mapping

import can

from rfca_rig.codecs import cansimple, odrive_meanings, odrive_older_meanings
from rfca_rig.codecs.odrive_messages import EncoderEstimates, OdriveCommand, OdriveFirmware
from rfca_rig.twin_server.drive_faults import drive_events
from rfca_rig.twin_server.tampered_bus import replace_data
from rfca_rig.twins.odrive import WATCHDOG_EXPIRED, OdriveTwin

JUMP_TURNS = 1.0
OVER_TEMPERATURE = {
    OdriveFirmware.V0_5: odrive_older_meanings.OVER_TEMPERATURE,
    OdriveFirmware.V0_6: odrive_meanings.MOTOR_OVER_TEMPERATURE,
}


class OdriveDialect:
    """Interprets CANSimple frames for the bus faults."""

    def is_heartbeat(self, message: can.Message) -> bool:
        return message.arbitration_id & 0x1F == OdriveCommand.HEARTBEAT

    def jumped(self, message: can.Message) -> can.Message:
        """The frame with the encoder estimate shifted by one motor turn."""
        estimates = cansimple.decode(message.arbitration_id, message.data)
        if not isinstance(estimates, EncoderEstimates):
            return message
        node = cansimple.node_of(message.arbitration_id)
        _, data = cansimple.encoder_estimates(node, estimates.position_turns + JUMP_TURNS, estimates.speed_turns_s)
        return replace_data(message, data)


def odrive_events(motor: OdriveTwin) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""
    return {
        "watchdog-trip": lambda: motor.fail(WATCHDOG_EXPIRED[motor.dialect]),
        "over-temperature": lambda: motor.fail(OVER_TEMPERATURE[motor.dialect]),
        "idle-unasked": lambda: motor.fail(0),
        **drive_events(motor),
    }
