"""Makes drivers and twins of the force sensor and the camera that a rig file names. The make of
a sensor is asked of the registry.
"""

import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from rfca_rig.clock import Clock, WallClock
from rfca_rig.codecs.sensor_axes import SensorAxes
from rfca_rig.description.camera_file import (
    CameraSection,
    OpenCvCameraSection,
    PhotoFolderSection,
    TwinCameraSection,
)
from rfca_rig.description.rig_file import RigFile, TwinSection
from rfca_rig.devices import find_sensor
from rfca_rig.devices.sections import ForceSensorSection
from rfca_rig.drivers.camera import ArrivingPhotos, CameraThread, OpenCvCamera
from rfca_rig.drivers.roles import Camera, ForceSensor, Photo, Photographer
from rfca_rig.drivers.rotated_sensor import with_axes
from rfca_rig.twin_server.faults import FaultPanel
from rfca_rig.twin_server.open_ports import TwinMaker
from rfca_rig.twins.camera import CameraTwin, StandingLeg
from rfca_rig.twins.world import SensorTwin
from rfca_rig.vision.leg_photo import PhotoSetup


def make_force_sensor(
    keys: ForceSensorSection, axes: SensorAxes, clock: WallClock, stack: ExitStack
) -> ForceSensor:
    """The driver that [force_sensor] names, on the real device, in the rig's axes; what it opened
    is closed with the stack.
    """
    make = find_sensor(keys.device)
    way = make.open_way(keys, clock)
    stack.callback(way.close)
    return with_axes(make.make_driver(keys, way, clock), axes)


def sensor_twin_maker(rig: RigFile, twin: TwinSection, random: np.random.Generator) -> TwinMaker:
    """Makes the twin that [force_sensor] names, on its end of a wire. `random` is the sensor's
    noise.
    """
    keys = rig.force_sensor
    # One value for the three forces, one for the three moments.
    noise_std = (twin.noise_N,) * 3 + (twin.noise_Nm,) * 3
    return lambda end: find_sensor(keys.device).make_twin(end, keys, noise_std, random)


@dataclass(frozen=True)
class SensorPair:
    """A sensor's twin, the way to it, and a function that makes the driver at that end, in the
    rig's axes.
    """

    twin: SensorTwin
    way: Any
    driver: Callable[[Clock], ForceSensor]


def make_sensor_pair(rig: RigFile, make_twin: TwinMaker, panel: FaultPanel | None) -> SensorPair:
    """The twin that [force_sensor] names, on a wire of its own in this process; `panel` switches
    the faults of that wire.
    """
    keys = rig.force_sensor
    make = find_sensor(keys.device)
    wire = make.find_wire()
    if wire is None:
        twin = way = make_twin(None)
    else:
        twin, way = wire.connect(keys, make_twin, panel)
    axes = rig.sensor.mounting
    return SensorPair(twin, way, lambda clock: with_axes(make.make_driver(keys, way, clock), axes))


# Exposure and transfer to the host.
TWIN_PHOTO_S = 0.2


class TwinCamera:
    """Implements `Camera`: exposes at once, at the clock's present time."""

    def __init__(self, twin: CameraTwin, clock: Clock) -> None:
        self._twin = twin
        self._clock = clock
        self._count = 0

    def photo(self) -> Photo:
        self._count += 1
        return Photo(self._twin.expose(), self._clock.now_s(), f"photo-{self._count:03d}")

    def close(self) -> None:
        """Nothing is held open."""

    def identity(self) -> dict[str, str]:
        return {"camera": "twin"}


class DelayedCamera:
    """Implements `Photographer` with a camera that takes no time: exposes on request, and delivers
    the photo `takes_s` later.

    All on the caller's thread, so that a run on a twin's clock is the same every time.
    """

    def __init__(self, camera: Camera, clock: Clock, takes_s: float) -> None:
        self._camera = camera
        self._clock = clock
        self._takes_s = takes_s
        self._photo: Photo | None = None

    def begin(self) -> None:
        self._photo = self._camera.photo()

    def fetch_photo(self) -> Photo | None:
        if self._photo is None or self._clock.now_s() < self._photo.host_s + self._takes_s:
            return None
        photo = self._photo
        self._photo = None
        return photo

    def close(self) -> None:
        self._camera.close()

    def identity(self) -> dict[str, str]:
        return self._camera.identity()


class AnnouncingCamera:
    """Implements `Camera`: tells the person at the shutter when to take the photo."""

    def __init__(self, camera: Camera, tell: Callable[[str], None]) -> None:
        self._camera = camera
        self._tell = tell

    def photo(self) -> Photo:
        self._tell("REAL take the photo now")
        return self._camera.photo()

    def close(self) -> None:
        self._camera.close()

    def identity(self) -> dict[str, str]:
        return self._camera.identity()


def make_camera(
    section: CameraSection, eye: PhotoSetup, clock: Clock, stack: ExitStack
) -> Photographer:
    """The camera that [camera] names, closed with the stack. Raises DeviceError or BadInput
    where it cannot be opened.
    """
    camera: Camera
    match section:
        case OpenCvCameraSection():
            camera = OpenCvCamera(section.number, eye.camera.image_size_px, clock)
        case PhotoFolderSection():
            arriving = ArrivingPhotos(Path(section.folder), clock, section.photo_limit_s)
            camera = AnnouncingCamera(arriving, lambda line: print(line, file=sys.stderr))
    # A camera may block for seconds; on its own thread it cannot delay the control loop.
    threaded = CameraThread(camera)
    stack.callback(threaded.close)
    return threaded


def make_twin_camera(
    eye: PhotoSetup,
    leg: StandingLeg,
    twin: TwinCameraSection,
    random: np.random.Generator,
    clock: Clock,
) -> Photographer:
    """The twin of any camera: renders `leg` as it stands when a photo is requested."""
    rendered = CameraTwin(leg, eye.plan, eye.camera, twin.disturbance(), random)
    return DelayedCamera(TwinCamera(rendered, clock), clock, TWIN_PHOTO_S)
