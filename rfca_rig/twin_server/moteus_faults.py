"""Faults of a moteus, in its frames and inside the drive."""

from collections.abc import Callable, Mapping
from dataclasses import replace

import can

from rfca_rig.codecs import moteus
from rfca_rig.codecs.moteus import Reply, Subframe
from rfca_rig.codecs.moteus_registers import Register
from rfca_rig.twin_server.drive_faults import drive_events
from rfca_rig.twin_server.faults import DRIVE_FAULTS, Fault
from rfca_rig.twin_server.tampered_bus import replace_data
from rfca_rig.twins.moteus import MoteusTwin

JUMP_TURNS = 1.0
# Fault code of the drive.
OVER_TEMPERATURE = 38
MOTEUS_FAULTS = (
    Fault("encoder-jump", "the drive's position reads one turn more"),
    Fault("watchdog-trip", "the drive times out, though commands reach it", once=True),
    Fault("over-temperature", "the drive stops with fault 38, over temperature", once=True),
    *DRIVE_FAULTS,
)


class MoteusDialect:
    """Interprets the frames of a moteus for the bus faults."""

    def is_heartbeat(self, message: can.Message) -> bool:  # noqa: ARG002 (a moteus has none)
        return False

    def jumped(self, message: can.Message) -> can.Message:
        """The frame with the reported position shifted by one turn."""
        return replace_data(message, moteus.encode([_shift_position(item) for item in moteus.decode(message.data)]))


def _shift_position(item: Subframe) -> Subframe:
    if not isinstance(item, Reply) or item.register != Register.POSITION:
        return item
    return replace(item, value=moteus.clip_to_register(item.register, item.width, item.value + JUMP_TURNS))


def moteus_events(motor: MoteusTwin) -> Mapping[str, Callable[[], None]]:
    """One-time events inside the drive, by the name of the fault."""
    return {
        "watchdog-trip": motor.time_out,
        "over-temperature": lambda: motor.fail(OVER_TEMPERATURE),
        **drive_events(motor),
    }
