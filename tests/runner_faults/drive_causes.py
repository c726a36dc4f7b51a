"""What goes wrong with the drive, the motor, and the shaft between motor and leg."""

import struct
from collections import deque
from math import inf, nan

import can

from rfca_rig.devices.odrive import codec as cansimple
from rfca_rig.devices.odrive.messages import ERROR_BITS, AxisState, OdriveCommand
from rfca_rig.twins.drive_parts import LoopGains, SpeedLoop
from rfca_rig.twins.wires import SampleGrid
from tests.runner_faults.cause import GOES_ON, Cause, catalogued
from tests.runner_faults.rig import FaultyRig

# Above the limit of the rig file, and what a thermistor can report.
HOT_degC = 120.0


def _error(bit: int) -> Cause:
    name, meaning = ERROR_BITS[bit]
    return Cause(
        f"drive-{name.lower().replace('_', '-')}",
        "drive",
        f"the drive stops: {meaning}",
        "D-01",
        lambda rig: rig.drive.set_error(1 << bit),
    )


def _say(rig: FaultyRig, frame: cansimple.Frame) -> None:
    rig.observer.send(can.Message(arbitration_id=frame[0], data=frame[1], is_extended_id=False))


def _order_idle(rig: FaultyRig) -> None:
    _say(rig, cansimple.set_axis_state(0, AxisState.IDLE))


def _press_e_stop(rig: FaultyRig) -> None:
    _say(rig, cansimple.estop(0))


def _silence_encoder(rig: FaultyRig) -> None:
    rig.drive._encoder_ticks = SampleGrid(1e6)


def _weaken(rig: FaultyRig) -> None:
    rig.drive._loop = SpeedLoop(LoopGains(torque_limit_Nm=0.3))


def _switch_watchdog_off(rig: FaultyRig) -> None:
    rig.drive._watchdog_s = None


def _fever(rig: FaultyRig) -> None:
    rig.drive.warmth._degC = HOT_degC


def _block(rig: FaultyRig) -> None:
    rig.truth.block()


def _loosen(rig: FaultyRig) -> None:
    rig.truth.loose = True


def _run_away(rig: FaultyRig) -> None:
    rig.runaway.away_Nm = 15.0


def _forget_address(rig: FaultyRig) -> None:
    """It no longer hears, and its watchdog takes the torque away."""
    rig.drive._node = 5


def _command_of(message: can.Message) -> int:
    return message.arbitration_id & 0x1F


def _replace_values(
    rig: FaultyRig, command: OdriveCommand, first: float, second: float, frames: float = inf
) -> None:
    """So many frames of that message carry these two numbers."""
    left = frames

    def alter(message: can.Message) -> can.Message:
        nonlocal left
        if _command_of(message) != command or left <= 0:
            return message
        left -= 1
        return can.Message(
            arbitration_id=message.arbitration_id,
            data=struct.pack("<ff", first, second),
            is_extended_id=False,
        )

    rig.bus.alter = alter


def _hold_back(rig: FaultyRig, late_s: float) -> None:
    """The encoder estimates come this much later from now on."""
    queue: deque[tuple[float, can.Message]] = deque()

    def alter(message: can.Message) -> can.Message | None:
        if _command_of(message) != OdriveCommand.ENCODER_ESTIMATES:
            return message
        queue.append((rig.clock.now_s(), message))
        if rig.clock.now_s() - queue[0][0] >= late_s:
            return queue.popleft()[1]
        return None

    rig.bus.alter = alter


def _silence_torque(rig: FaultyRig) -> None:
    rig.bus.alter = lambda message: (
        None if _command_of(message) == OdriveCommand.TORQUES else message
    )


DRIVE_CAUSES = (
    *(_error(bit) for bit in ERROR_BITS),
    Cause(
        "watchdog-off",
        "drive",
        "the drive has no watchdog: found out at arming, nothing moves",
        "DeviceError",
        _switch_watchdog_off,
        at_arming=True,
    ),
    catalogued("idle-unasked", "drive", "the drive goes idle, without any error", "D-01"),
    Cause(
        "idle-from-elsewhere",
        "drive",
        "another master on the bus orders the drive to go idle",
        "D-01",
        _order_idle,
    ),
    Cause("e-stop-frame", "drive", "an emergency stop frame on the bus", "D-01", _press_e_stop),
    catalogued(
        "heartbeat-silent",
        "drive",
        "no heartbeat any more, all else goes on",
        "D-02",
        within_ms=610,
    ),
    Cause(
        "encoder-silent",
        "drive",
        "no encoder estimates any more, heartbeats go on",
        "D-03",
        _silence_encoder,
        within_ms=120,
    ),
    Cause(
        "encoder-silent-held",
        "drive",
        "the same while the shaft is held",
        "D-03",
        _silence_encoder,
        in_hold=True,
        within_ms=130,
        hold_s=0.8,
    ),
    Cause(
        "encoder-late",
        "drive",
        "the encoder estimates come 0.2 s late",
        "D-03",
        lambda rig: _hold_back(rig, 0.2),
        within_ms=120,
    ),
    Cause(
        "torque-silent",
        "drive",
        "no torque is reported any more, all else goes on",
        "D-03",
        _silence_torque,
        within_ms=120,
    ),
    Cause(
        "encoder-nan",
        "drive",
        "every encoder estimate is NaN",
        "D-05",
        lambda rig: _replace_values(rig, OdriveCommand.ENCODER_ESTIMATES, nan, nan),
        within_ms=24,
    ),
    Cause(
        "encoder-nan-held",
        "drive",
        "the same while the shaft is held",
        "D-05",
        lambda rig: _replace_values(rig, OdriveCommand.ENCODER_ESTIMATES, nan, nan),
        in_hold=True,
        within_ms=34,
        hold_s=0.8,
    ),
    Cause(
        "encoder-absurd",
        "drive",
        "every encoder estimate is 1e30 turns",
        "D-05",
        lambda rig: _replace_values(rig, OdriveCommand.ENCODER_ESTIMATES, 1e30, 0.0),
        within_ms=24,
    ),
    Cause(
        "encoder-nan-twice",
        "drive",
        "two encoder estimates in a row are NaN",
        GOES_ON,
        lambda rig: _replace_values(rig, OdriveCommand.ENCODER_ESTIMATES, nan, nan, frames=2),
    ),
    Cause(
        "torque-nan",
        "drive",
        "every torque is NaN",
        "D-05",
        lambda rig: _replace_values(rig, OdriveCommand.TORQUES, nan, nan),
        within_ms=24,
    ),
    Cause(
        "temperature-nan",
        "drive",
        "the temperatures are NaN, which were numbers before",
        "D-05",
        lambda rig: _replace_values(rig, OdriveCommand.TEMPERATURES, nan, nan),
        within_ms=1600,
    ),
    catalogued(
        "encoder-frozen",
        "drive",
        "every encoder report repeats the one before",
        "F-02",
        within_ms=200,
    ),
    catalogued("encoder-jump", "drive", "the encoder slips by a turn of the motor", "F-04"),
    catalogued(
        "drive-restart",
        "drive",
        "the drive restarts: idle, its position counts from elsewhere",
        "F-04",
    ),
    Cause(
        "drive-hot",
        "drive",
        "motor above the limit of temperature, no error of the drive",
        "D-04",
        _fever,
        within_ms=600,
    ),
    Cause("weak-drive", "drive", "the drive gives 0.3 N m at most", "F-02", _weaken, within_ms=250),
    Cause(
        "runaway", "drive", "the drive pushes with 15 N m, whatever the command", "F-01", _run_away
    ),
    Cause(
        "coupling-slips",
        "drive",
        "the motor's torque no longer gets to the shaft",
        "F-02",
        _loosen,
        within_ms=250,
    ),
    Cause("jam", "drive", "the shaft is held fast", "F-02", _block, within_ms=200),
    Cause(
        "jam-slow",
        "drive",
        "the shaft is held fast in a stroke at 1 rad/s",
        "F-03",
        _block,
        within_ms=320,
        speed_rad_s=1.0,
    ),
    Cause(
        "drive-forgets-address",
        "drive",
        "the drive takes another address: hears nothing, says nothing as itself",
        "D-03",
        _forget_address,
        within_ms=115,
    ),
)
