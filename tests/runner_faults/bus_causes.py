"""What goes wrong with the CAN bus and its adapter."""

import can

from tests.runner_faults.cause import GOES_ON, Cause, catalogued
from tests.runner_faults.rig import FaultyRig

UNPLUGGED = OSError(19, "No such device")


def _error_frame(rig: FaultyRig, classes: int, data: list[int]) -> None:
    rig.observer.send(
        can.Message(arbitration_id=classes, data=data, is_error_frame=True, is_extended_id=False)
    )


def _go_off(rig: FaultyRig) -> None:
    _error_frame(rig, 0x040, [0] * 8)


def _count_errors(rig: FaultyRig) -> None:
    _error_frame(rig, 0x204, [0, 0x20, 0, 0, 0, 0, 136, 0])


def _refuse(rig: FaultyRig) -> None:
    rig.bus.send_error = can.CanOperationError(
        "Failed to transmit: No buffer space available [Error Code 105]"
    )


def _refuse_for_a_moment(rig: FaultyRig) -> None:
    rig.bus.refuses_until_s = rig.clock.now_s() + 0.01


def _unplug(rig: FaultyRig) -> None:
    rig.bus.send_error = rig.bus.receive_error = UNPLUGGED


def _deafen(rig: FaultyRig) -> None:
    rig.bus.receive_error = can.CanOperationError("Failed to receive: Network is down")


def _babble(rig: FaultyRig) -> None:
    for number in range(500):
        rig.observer.send(
            can.Message(
                arbitration_id=5 << 5 | 9, data=number.to_bytes(8, "little"), is_extended_id=False
            )
        )


BUS_CAUSES = (
    Cause(
        "frames-refused",
        "bus",
        "the adapter takes no frame any more",
        "B-01",
        _refuse,
        within_ms=115,
    ),
    Cause(
        "queue-full", "bus", "the transmit queue is full for 10 ms", "B-01", _refuse_for_a_moment
    ),
    Cause(
        "adapter-unplugged",
        "bus",
        "the adapter is pulled: sending and receiving raise",
        "B-01",
        _unplug,
        within_ms=115,
    ),
    Cause("receiving-fails", "bus", "receiving raises, sending works", "B-01", _deafen),
    Cause("bus-off-frame", "bus", "the controller says that it is bus-off", "B-01", _go_off),
    Cause(
        "error-passive",
        "bus",
        "the controller says that it is error-passive",
        "D-01",
        _count_errors,
    ),
    catalogued(
        "can-silent", "bus", "the drive hears, but nothing comes from it", "D-03", within_ms=120
    ),
    Cause(
        "can-silent-held",
        "bus",
        "the same while the shaft is held",
        "D-03",
        lambda rig: rig.event("can-silent"),
        in_hold=True,
        within_ms=130,
        hold_s=0.8,
    ),
    catalogued(
        "bus-off",
        "bus",
        "the bus is cut: the drive neither hears nor is heard",
        "D-03",
        within_ms=115,
    ),
    catalogued("can-short", "bus", "every frame of the drive lacks its last byte", "B-01"),
    catalogued("can-twice", "bus", "every frame of the drive comes twice", "D-01", within_ms=1200),
    catalogued("own-frame-echo", "bus", "what is sent to the drive comes back", GOES_ON),
    Cause("babble", "bus", "500 frames of another node at once", GOES_ON, _babble),
)
