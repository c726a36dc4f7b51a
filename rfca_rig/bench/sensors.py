"""Makes drivers and twins of the force sensors and cameras that a rig file may name: the one place that knows them all."""

import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rfca_rig.acquisition.acquired import AcquiredDatagrams
from rfca_rig.clock import Clock, WallClock
from rfca_rig.codecs.ati_calibration import TransducerCalibration, parse_calibration
from rfca_rig.codecs.ati_serial import MAX_COUNT
from rfca_rig.description.camera_file import CameraSection, OpenCvCameraSection, PhotoFolderSection, TwinCameraSection
from rfca_rig.description.rig_file import RigFile, TwinSection
from rfca_rig.devices.force_sensor import AtiDaqSection, AtiSerialSection, ForceSensorKeys, NetFtSection, OwnForceSensorSection
from rfca_rig.devices.own import twin_of
from rfca_rig.drivers.camera import ArrivingPhotos, CameraThread, OpenCvCamera
from rfca_rig.drivers.force_sensors.ati_serial import AtiSerialSensor
from rfca_rig.drivers.force_sensors.daq_ft import DaqFtSensor, DaqFtSettings, NidaqmxGages
from rfca_rig.drivers.force_sensors.netft import CommandBox, HttpBox, NetFtBox, NetFtSensor, NetFtSettings
from rfca_rig.drivers.ports import UdpDatagrams, advise_receive_buffer, open_port
from rfca_rig.drivers.roles import Camera, ForceSensor, Photo, Photographer
from rfca_rig.errors import BadInput
from rfca_rig.subprocesses import can_be_started
from rfca_rig.twins.ati_sensors import AtiSerialTwin, AtiSerialTwinSettings, DaqFtTwin, DaqFtTwinSettings
from rfca_rig.twins.camera import CameraTwin, StandingLeg
from rfca_rig.twins.netft import NetFtBoxTwin, NetFtTwin, NetFtTwinSettings
from rfca_rig.twins.wires import DatagramLink, SerialLine, datagram_link, serial_line
from rfca_rig.twins.world import SensorTwin
from rfca_rig.vision.leg_photo import PhotoSetup


def make_force_sensor(rig: RigFile, clock: WallClock, stack: ExitStack) -> ForceSensor:
    """The driver that [force_sensor] names, on the real device; what it opened is closed with the stack."""
    sensor = rig.force_sensor
    match sensor:
        case NetFtSection():
            # A process of its own empties the socket, so that a busy loop loses no records.
            datagrams = AcquiredDatagrams(sensor.host, clock, sensor.port) if can_be_started() else UdpDatagrams(sensor.host, sensor.port)
            stack.callback(datagrams.close)
            return NetFtSensor(
                datagrams, clock, netft_settings(sensor), netft_box(sensor), advise_receive_buffer(datagrams.receive_buffer_bytes)
            )
        case AtiSerialSection():
            port = open_port(sensor.port, sensor.bits_per_s)
            stack.callback(port.close)
            return AtiSerialSensor(port, clock, sensor.settings())
        case AtiDaqSection():
            calibration = _calibration(sensor)
            gages = NidaqmxGages(sensor.channels, sensor.rate_Hz, calibration.rails_V)
            stack.callback(gages.stop)
            return DaqFtSensor(gages, clock, calibration, DaqFtSettings(sensor.rate_Hz, sensor.unloaded_V))
        case OwnForceSensorSection():
            keys = _keys_of_loaded(sensor)
            way = keys.open()
            stack.callback(way.close)
            return keys.driver(way, clock)


def _keys_of_loaded(sensor: OwnForceSensorSection) -> ForceSensorKeys:
    if isinstance(sensor, ForceSensorKeys):
        return sensor
    # Own devices are loaded relative to the rig file; a section made without a file has no driver.
    raise BadInput(f"{sensor.file} was not loaded; read the rig file from where it stands")


@dataclass(frozen=True)
class SensorPair:
    """A sensor's twin, and a function that makes the driver at the other end of its wire."""

    twin: SensorTwin
    driver: Callable[[Clock], ForceSensor]


def make_sensor_pair(
    rig: RigFile, twin: TwinSection, random: np.random.Generator, on_link: Callable[[DatagramLink], DatagramLink]
) -> SensorPair:
    """The twin that [force_sensor] names, on a wire of its own in this process. `random` is the sensor's noise.

    `on_link` may put network faults between the twin and its link.
    """
    sensor = rig.force_sensor
    match sensor:
        case NetFtSection():
            here, there = datagram_link()
            twin_settings = _netft_twin(sensor, twin)
            streaming = NetFtTwin(on_link(there), twin_settings, random)
            box = None if sensor.configuration == "unchecked" else NetFtBoxTwin(streaming, twin_settings)
            return SensorPair(streaming, lambda clock: NetFtSensor(here, clock, netft_settings(sensor), box))
        case AtiSerialSection():
            host, device = serial_line()
            serial_twin = AtiSerialTwin(device, _serial_twin(sensor, twin), random)
            return SensorPair(serial_twin, lambda clock: AtiSerialSensor(host, clock, sensor.settings()))
        case AtiDaqSection():
            calibration = _calibration(sensor)
            gages = DaqFtTwin(calibration, DaqFtTwinSettings(sensor.rate_Hz, sensor.unloaded_V, _noise_std(twin)), random)
            settings = DaqFtSettings(sensor.rate_Hz, sensor.unloaded_V)
            return SensorPair(gages, lambda clock: DaqFtSensor(gages, clock, calibration, settings))
        case OwnForceSensorSection():
            keys, (host, device) = _keys_of_loaded(sensor), serial_line()
            return SensorPair(make_own_twin(keys, twin, random, device), lambda clock: keys.driver(host, clock))


def make_netft_twins(
    sensor: NetFtSection, twin: TwinSection, random: np.random.Generator, link: DatagramLink
) -> tuple[NetFtTwin, NetFtBoxTwin]:
    """The twin of a Net F/T on a link from elsewhere, and what else its box answers."""
    settings = _netft_twin(sensor, twin)
    streaming = NetFtTwin(link, settings, random)
    return streaming, NetFtBoxTwin(streaming, settings)


def make_serial_twin(sensor: AtiSerialSection, twin: TwinSection, random: np.random.Generator, line: SerialLine) -> AtiSerialTwin:
    """The twin of an F/T controller on a serial line from elsewhere."""
    return AtiSerialTwin(line, _serial_twin(sensor, twin), random)


def make_own_twin(sensor: ForceSensorKeys, twin: TwinSection, random: np.random.Generator, line: SerialLine) -> SensorTwin:
    """The twin of a sensor of a lab's own on a serial line from elsewhere."""
    made: SensorTwin = twin_of(sensor)(line, sensor, _noise_std(twin), random)
    return made


def netft_settings(sensor: NetFtSection) -> NetFtSettings:
    """The settings for the driver."""
    return NetFtSettings(
        counts_per_N=sensor.counts_per_N,
        counts_per_Nm=sensor.counts_per_Nm,
        rate_Hz=sensor.rate_Hz,
        address=f"{sensor.host}:{sensor.port}",
        buffered=sensor.buffered,
    )


def netft_box(sensor: NetFtSection) -> NetFtBox | None:
    """Where the settings of the box are read."""
    if sensor.configuration == "http":
        return HttpBox(sensor.host, sensor.http_port)
    return CommandBox(sensor.host, sensor.command_port) if sensor.configuration == "commands" else None


def _netft_twin(sensor: NetFtSection, twin: TwinSection) -> NetFtTwinSettings:
    return NetFtTwinSettings(
        counts_per_N=sensor.counts_per_N,
        counts_per_Nm=sensor.counts_per_Nm,
        decimation=netft_settings(sensor).decimation,
        noise_std=_noise_std(twin),
    )


def _serial_twin(sensor: AtiSerialSection, twin: TwinSection) -> AtiSerialTwinSettings:
    """Settings of a transducer whose full scale is the largest count of 16 bits."""
    return AtiSerialTwinSettings(
        counts_per_N=sensor.counts_per_N,
        counts_per_Nm=sensor.counts_per_Nm,
        sampling_Hz=sensor.rate_Hz,
        bits_per_s=sensor.bits_per_s,
        noise_std=_noise_std(twin),
        full_scale=(MAX_COUNT / sensor.counts_per_N,) * 3 + (MAX_COUNT / sensor.counts_per_Nm,) * 3,
    )


def _noise_std(twin: TwinSection) -> tuple[float, ...]:
    # One value for the three forces, one for the three moments.
    return (twin.noise_N,) * 3 + (twin.noise_Nm,) * 3


def _calibration(sensor: AtiDaqSection) -> TransducerCalibration:
    """Raises BadInput where the file cannot be read, or is no calibration file."""
    try:
        content = Path(sensor.calibration_file).read_bytes()
    except OSError as error:
        raise BadInput(f"{sensor.calibration_file}: cannot be read: {error.strerror}; see calibration_file in the rig file") from None
    return parse_calibration(content, sensor.calibration_file)


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
    """Implements `Photographer` with a camera that takes no time: exposes on request, and delivers the photo `takes_s` later.

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
        photo, self._photo = self._photo, None
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


def make_camera(section: CameraSection, eye: PhotoSetup, clock: Clock, stack: ExitStack) -> Photographer:
    """The camera that [camera] names, closed with the stack. Raises DeviceError or BadInput where it cannot be opened."""
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


def make_twin_camera(eye: PhotoSetup, leg: StandingLeg, twin: TwinCameraSection, random: np.random.Generator, clock: Clock) -> Photographer:
    """The twin of any camera: renders `leg` as it stands when a photo is requested."""
    rendered = CameraTwin(leg, eye.plan, eye.camera, twin.disturbance(), random)
    return DelayedCamera(TwinCamera(rendered, clock), clock, TWIN_PHOTO_S)
