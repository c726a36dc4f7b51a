"""Takes one photo of the hanging leg and identifies its marks. Nothing moves."""

from contextlib import ExitStack

from rfca_rig.bench.cameras import make_camera
from rfca_rig.clock import Clock
from rfca_rig.description.camera_sections import OpenCvCameraSection
from rfca_rig.doctor.judging.camera import CameraObservation
from rfca_rig.doctor.looking.can_bus import shorten_error
from rfca_rig.drivers.roles import Photo, Photographer
from rfca_rig.errors import DeviceError, RigError
from rfca_rig.vision.leg_photo import PhotoSetup, read_leg_photo

LOOK_EVERY_S = 0.02


def look_at_camera(section: OpenCvCameraSection, eye: PhotoSetup, clock: Clock) -> CameraObservation:
    try:
        with ExitStack() as stack:
            photo = _one_photo(make_camera(section, eye, clock, stack), clock, section.photo_limit_s)
        identified = read_leg_photo(photo.image, eye).identified
    except RigError as error:
        return CameraObservation(shorten_error(error))
    count = sum(mark is not None for mark in identified.marks)
    return CameraObservation(None, count, len(identified.marks), tuple(doubt.words for doubt in identified.doubts))


def _one_photo(camera: Photographer, clock: Clock, limit_s: float) -> Photo:
    camera.begin()
    until_s = clock.now_s() + limit_s
    while clock.now_s() < until_s:
        if photo := camera.taken():
            return photo
        clock.wait_until(clock.now_s() + LOOK_EVERY_S)
    raise DeviceError(f"the camera gave no photo within {limit_s:g} s; check its cable and power")
