"""What goes wrong with the computer: time, disk, recorder, camera."""

from datetime import timedelta

from rfca_rig.errors import DeviceError, DiskFull, RigError, Trip, Tripped
from tests.runner_faults.cause import GOES_ON, Cause
from tests.runner_faults.rig import FaultyRig


def _be_late(rig: FaultyRig) -> None:
    rig.engine_clock.late_s = 0.08


def _stand(rig: FaultyRig) -> None:
    rig.engine_clock.late_s = 0.5


def _recorder_says(rig: FaultyRig, error: Exception) -> None:
    rig.keeper.error = error


def _freeze_camera(rig: FaultyRig) -> None:
    rig.camera.frozen = True


def _lose_camera(rig: FaultyRig) -> None:
    rig.camera.error = DeviceError("camera 0 gives no picture; check its cable")


def _step_wall_clock(rig: FaultyRig) -> None:
    rig.engine_clock.wall_step = timedelta(hours=1)


COMPUTER_CAUSES = (
    Cause(
        "late", "computer", "the control loop sleeps 80 ms too long", "C-01", _be_late, within_ms=90
    ),
    Cause(
        "stopped-for-a-while",
        "computer",
        "the process stands for half a second (SIGSTOP, a suspended machine)",
        "C-01",
        _stand,
        within_ms=115,
    ),
    Cause(
        "recorder-died",
        "computer",
        "the recorder's process has ended",
        "RigError",
        lambda rig: _recorder_says(rig, RigError("the recorder has ended by itself")),
    ),
    Cause(
        "recorder-behind",
        "computer",
        "the recorder's queue is full",
        "C-02",
        lambda rig: _recorder_says(rig, Tripped(Trip.RECORDER_BEHIND, "its queue is full")),
    ),
    Cause(
        "disk-full",
        "computer",
        "the disk takes no more",
        "DiskFull",
        lambda rig: _recorder_says(rig, DiskFull("stopped: disk full")),
    ),
    Cause(
        "camera-frozen",
        "computer",
        "the camera never gives the photo it was asked for",
        GOES_ON,
        _freeze_camera,
        in_hold=True,
    ),
    Cause(
        "camera-gone",
        "computer",
        "the camera raises when asked",
        GOES_ON,
        _lose_camera,
        in_hold=True,
    ),
    Cause(
        "wall-clock-set",
        "computer",
        "the computer's clock is set an hour on",
        GOES_ON,
        _step_wall_clock,
    ),
)
