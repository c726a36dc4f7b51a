"""Checks of all devices that a rig file names, in turn, and `scan` for devices without one.

Those of the motor stop at the first red finding. Plug-in devices are checked through their own
drivers: are they present, and can their messages be decoded. Of the camera one photo is taken: its
marks are looked for, and nothing moves.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from math import tau
from pathlib import Path
from typing import TypeVar

import can
import numpy as np

from rfca_rig.bench.factory import make_motor
from rfca_rig.bench.sensors import make_camera
from rfca_rig.bench.zero_check import (
    EncoderReading,
    find_doubt,
    find_stale_check,
    needs_check,
    read_check,
    setup_command,
    summarize_readings,
)
from rfca_rig.clock import Clock
from rfca_rig.description.camera_file import (
    OpenCvCameraSection,
    PhotoFolderSection,
    read_camera_file,
)
from rfca_rig.description.rig_file import RigFile
from rfca_rig.devices import FORCE_SENSORS, find_motor, find_sensor, load_object
from rfca_rig.devices.checks import (
    CanBusObservation,
    Colour,
    Finding,
    FoundSensor,
    Listener,
    green,
    judge_found_port,
    judge_serial_port,
    look_at_serial_port,
    look_for_serial_ports,
    red,
    shorten_error,
    yellow,
)
from rfca_rig.devices.sections import ForceSensorSection, MotorSection
from rfca_rig.doctor.computer import check_computer
from rfca_rig.doctor.ports import (
    CanInterfaceObservation,
    can_interfaces,
    judge_can_bus,
    judge_can_interface,
    look_at_can_interface,
    look_for_adapters,
    make_up_command,
)
from rfca_rig.doctor.sensor_setup import judge_last_check
from rfca_rig.drivers.can_frames import list_interfaces
from rfca_rig.drivers.photo_files import list_pictures
from rfca_rig.drivers.roles import ForceSensor, Photo, Photographer, ShaftMotor
from rfca_rig.errors import BadInput, DeviceError, RigError
from rfca_rig.vision.leg_photo import PhotoSetup, read_leg_photo

# Observation time and poll interval, and the silence that the driver treats as a fault, in s.
OWN_LISTEN_S = 1.5
POLL_S = 5e-3
SILENT_S = 0.5
DRIVE = "drive"
SENSOR = "force sensor"
NEXT = "try the driver without the device first:"
SHAFT = "shaft"
ZERO = "zero"
POLICY_FIX = (
    "state under [motor] what of the zero survives a power-down: all of it, all but whole turns of "
    "the motor, or nothing:",
    'zero_policy = "absolute"',
    'zero_policy = "behind-gear"',
    'zero_policy = "incremental"',
)
LISTEN_S = 0.3

Way = TypeVar("Way")

CAMERA = "camera"
CALIBRATION = "camera file"
# Reprojection error from which a new calibration is advised.
MAX_REPROJECTION_ERROR_PX = 1.0

LOOK_EVERY_S = 0.02

ADAPTERS = "CAN adapters"
PORTS = "serial port"
# Bit rate for the proposed command if the interface has none yet, in bit/s.
USUAL_BITRATE = 1_000_000


def check_own_motor(keys: MotorSection, clock: Clock) -> Iterator[Finding]:
    """Yields the findings on a plug-in motor. Only listens, or requests reports if the drive
    sends none by itself.
    """
    yield green("driver", f"{keys.title} is loaded, its keys in [motor] are right")
    bus = _open(keys.open, f"CAN bus {keys.interface} {keys.channel}", "[motor]")
    if isinstance(bus, Finding):
        yield bus
        return
    with bus:
        yield judge_own_motor(
            find_motor(keys.device).make_driver(keys, bus, clock, SILENT_S), clock
        )


def judge_own_motor(motor: ShaftMotor, clock: Clock) -> Finding:
    """Finding from 1.5 s of data, as decoded by the driver."""
    began_s = clock.now_s()
    reports = 0
    last_rad = 0.0
    try:
        for _ in _poll(clock):
            shaft = motor.read()
            reports += len(shaft.angle_rad)
            # Most reads return nothing; the last known angle is kept.
            if len(shaft.angle_rad):
                last_rad = float(shaft.angle_rad[-1])
    except RigError as error:
        return red(DRIVE, str(error), NEXT, "rfca-rig contract YOUR-RIG.toml")
    status = motor.status()
    # Silence is not an error: some drives report only when they are energised.
    if not reports:
        fix = (
            "check its power and the wiring; a drive that reports only on request is asked "
            "when the motor is enabled"
        )
        return yellow(DRIVE, f"no report of the shaft within {OWN_LISTEN_S:g} s", fix)
    summary = (
        f"{reports / (clock.now_s() - began_s):.0f} reports/s, shaft at "
        f"{np.degrees(last_rad):.1f} deg, {status.state}"
    )
    if status.fault is not None:
        return red(DRIVE, f"{summary}: {status.fault}", "see the drive's manual for this error")
    return green(DRIVE, summary)


def check_own_sensor(keys: ForceSensorSection, clock: Clock) -> Iterator[Finding]:
    """Yields the findings on a plug-in force sensor. Streams for 1.5 s, then ends the stream."""
    make = find_sensor(keys.device)
    yield green("driver", f"{keys.title} is loaded, its keys in [force_sensor] are right")
    address = getattr(keys, make.address[0], keys.title)
    way = _open(lambda: make.open_way(keys, clock), address, "[force_sensor]")
    if isinstance(way, Finding):
        yield way
        return
    try:
        yield judge_own_sensor(make.make_driver(keys, way, clock), clock)
    finally:
        way.close()


def judge_own_sensor(sensor: ForceSensor, clock: Clock) -> Finding:
    """Finding from 1.5 s of data, as decoded by the driver."""
    try:
        sensor.start()
        began_s = clock.now_s()
        # Also where reading fails: the sensor would go on streaming.
        try:
            for _ in _poll(clock):
                sensor.read()
        finally:
            sensor.stop()
    except RigError as error:
        return red(SENSOR, str(error), NEXT, "rfca-rig contract YOUR-RIG.toml")
    health = sensor.health()
    rate_Hz = health.received / (clock.now_s() - began_s)
    summary = (
        f"{rate_Hz:.0f} records/s, {health.lost} lost, {health.malformed} pieces of the "
        "stream no records"
    )
    if not health.received:
        return red(
            SENSOR,
            f"no record within {OWN_LISTEN_S:g} s",
            "check its power, the cable, and port and bits_per_s under [force_sensor]",
        )
    if health.notes:
        return yellow(
            SENSOR, f"{summary}: {health.notes[0]}", "look at the sensor and its cable before a run"
        )
    return green(SENSOR, summary)


def _open(opener: Callable[[], Way], name: str, table: str) -> Way | Finding:
    try:
        return opener()
    # The plug-in's `open` and the interfaces of python-can raise exceptions of many types.
    except Exception as error:
        return red(
            "wire",
            f"{name} cannot be opened: {type(error).__name__}: {shorten_error(error)}",
            f"check {table} in the rig file",
        )


def _poll(clock: Clock) -> Iterator[None]:
    until_s = clock.now_s() + OWN_LISTEN_S
    while clock.now_s() < until_s:
        clock.wait_until(clock.now_s() + POLL_S)
        yield


def check_motor(motor: MotorSection, clock: Clock) -> Iterator[Finding]:
    """Yields the findings on interface, bus and drive. Opens the bus of [motor] for about one
    second.
    """
    before = _before_the_bus(motor)
    if before is not None:
        yield before
        if before.colour is Colour.RED:
            return
    try:
        bus = motor.open()
    # Interfaces of python-can raise exceptions of many types, even NameError and ImportError if a
    # vendor library is missing.
    except Exception as error:
        yield _bus(motor, CanBusObservation(f"{type(error).__name__}: {shorten_error(error)}"))
        return
    with bus:
        yield from check_drive(motor, Listener(bus, clock))


def _before_the_bus(motor: MotorSection) -> Finding | None:
    """Finding on the kernel interface or serial port below the bus; None if there is none to
    check.
    """
    if motor.interface == "socketcan":
        return judge_can_interface(
            look_at_can_interface(motor.channel), motor.bitrate, motor.fd_bitrate
        )
    if motor.channel.startswith("/dev/"):
        return judge_serial_port(look_at_serial_port(motor.channel), "[motor]")
    return None


def check_drive(motor: MotorSection, listener: Listener) -> Iterator[Finding]:
    """Yields the findings on the bus and, unless it is red, on the drive."""
    # The drive is probed first: bus errors may show only once frames have passed.
    check = find_motor(motor.device).check
    findings: list[Finding] = []
    if check is not None:
        findings = load_object(check)(motor, listener)
    bus = _bus(motor, listener.observe())
    yield bus
    if bus.colour is not Colour.RED:
        yield from findings


def _bus(motor: MotorSection, seen: CanBusObservation) -> Finding:
    return judge_can_bus(seen, motor.interface, motor.channel, list_interfaces())


def check_camera(rig: RigFile, clock: Clock) -> Iterator[Finding]:
    """Yields the findings on the camera, none if the rig has none. An OpenCV camera takes one
    photo.
    """
    camera = rig.camera
    if camera is None:
        return
    try:
        eye = rig.eye()
        error_px = read_camera_file(Path(camera.calibration_file)).camera.reprojection_error_px
    except BadInput as error:
        yield judge_camera_file(camera.calibration_file, str(error), 0.0)
        return
    yield judge_camera_file(camera.calibration_file, None, error_px)
    if isinstance(camera, PhotoFolderSection):
        fault: str | None = None
        try:
            list_pictures(Path(camera.folder))
        except BadInput as error:
            fault = str(error)
        yield judge_photo_folder(camera.folder, fault)
    elif eye is not None:
        yield judge_camera(look_at_camera(camera, eye, clock))


def check_sensor(sensor: ForceSensorSection, clock: Clock) -> Iterator[Finding]:
    """Yields the findings on the force sensor. Streams from it for about one second."""
    check = find_sensor(sensor.device).check
    if check is None:
        yield from check_own_sensor(sensor, clock)
    else:
        yield from load_object(check)(sensor, clock)


def check_shaft(rig: RigFile, rig_path: Path | None, clock: Clock) -> Iterator[Finding]:
    """Yields the shaft angle, for a drive that was found, and whether its zero holds. It is read as
    in a run, but not enabled.

    Yields no angle if the drive does not report while it is off.
    """
    try:
        with rig.motor.open() as bus:
            motor = make_motor(rig, bus, clock)
            angles_rad = list[float]()
            until_s = clock.now_s() + LISTEN_S
            while clock.now_s() < until_s:
                clock.wait_until(clock.now_s() + POLL_S)
                angles_rad += motor.read().angle_rad.tolist()
            status = motor.status()
    # The bus was fine a moment ago; a failure now is reported, and the other checks go on.
    except (RigError, can.CanError, OSError, ValueError) as error:
        yield yellow(SHAFT, f"not read: {shorten_error(error)}", "mend what is red first")
        return
    if angles_rad:
        yield green(
            SHAFT,
            (
                f"at {np.degrees(angles_rad[-1]):.1f} deg{_encoder(rig, angles_rad[-1])}: is "
                "it? 0 is horizontal, 90 straight down"
            ),
        )
    zero = rig.motor.encoder_zero
    now = None
    if zero is not None and angles_rad:
        now = summarize_readings(zero, angles_rad, status, clock)
    yield from check_zero(rig, rig_path, now)


def check_zero(
    rig: RigFile, rig_path: Path | None, now: EncoderReading | None
) -> Iterator[Finding]:
    """Yields the finding on the zero of the drive: whether a run would be refused for it. `now` is
    what the drive tells, None where it was not read. Of a twin without a policy there is none.
    """
    policy = rig.motor.zero_policy
    if policy is None:
        if rig.is_real:
            yield yellow(ZERO, "zero_policy is not stated: a power-up is not noticed", *POLICY_FIX)
        return
    if not needs_check(policy):
        yield green(ZERO, f"{policy}: it survives a power-down")
        return
    zero = rig.motor.encoder_zero
    command = setup_command(rig_path)
    fix = "hold the leg at a known angle, then type:"
    try:
        check = None
        if rig_path is not None:
            check = read_check(rig_path)
        doubt = find_stale_check(rig, check)
    # Of a damaged record, or a section that does not know its zero.
    except BadInput as error:
        yield red(ZERO, str(error), fix, command)
        return
    if doubt is None and now is not None and check is not None and zero is not None:
        doubt = find_doubt(zero, policy, check, now)
    if doubt is not None:
        yield red(ZERO, f"{policy}: {doubt}", fix, command)
    elif check is not None:
        yield green(ZERO, f"{policy}: checked at {check.checked_at}")


def _encoder(rig: RigFile, angle_rad: float) -> str:
    """Encoder reading of the drive, if the rig file gives its zero in turns."""
    motor = rig.motor
    zero = getattr(motor, "zero_turns", None)
    gear = getattr(motor, "gear_ratio", None)
    if zero is None or gear is None:
        return ""
    return f", encoder at {zero + motor.direction * gear * angle_rad / tau:.3f} turns"


def check_rig(
    rig: RigFile, runs: Path, clock: Clock, rig_path: Path | None = None
) -> Iterator[Finding]:
    """Yields all findings as they come. Sends nothing that could move the shaft; takes over and
    ends a running sensor stream. Beside the rig file is the last check of its zero.
    """
    if not rig.is_real:
        yield green(
            "devices",
            (
                f"{rig.motor.title} and {rig.force_sensor.title} are twins in this process: "
                "nothing to be looked for"
            ),
        )
        yield from check_zero(rig, rig_path, None)
        yield from check_computer(runs, clock, None)
        return
    motor = rig.motor
    is_red = False
    if find_motor(motor.device).check is None:
        motor_findings = check_own_motor(motor, clock)
    else:
        motor_findings = check_motor(motor, clock)
    for finding in motor_findings:
        is_red |= finding.colour is Colour.RED
        yield finding
    # Reading the shaft makes no sense on a bus or drive that does not work.
    if not is_red:
        yield from check_shaft(rig, rig_path, clock)
    yield from check_sensor(rig.force_sensor, clock)
    yield judge_last_check(rig.sensor)
    yield from check_camera(rig, clock)
    yield from check_computer(runs, clock, rig.watchdog_s)


@dataclass(frozen=True)
class CameraObservation:
    """Observed photo. `fault` is why there was none, else None. It showed `stated` of `planned`
    marks, with these doubts.
    """

    fault: str | None
    stated: int = 0
    planned: int = 0
    doubts: tuple[str, ...] = ()


def judge_camera_file(path: str, fault: str | None, error_px: float) -> Finding:
    """Finding on the calibration. `fault` is why it cannot be used, None if it can; `error_px`
    is its reprojection error.
    """
    calibrate = "rfca-rig calibrate camera --help"
    if fault is not None:
        return red(
            CALIBRATION,
            fault,
            "calibrate the camera, and name the file in calibration_file; docs/camera.md says how:",
            calibrate,
        )
    if error_px > MAX_REPROJECTION_ERROR_PX:
        return yellow(
            CALIBRATION,
            f"{path}: reprojection error {error_px:.2f} px",
            "calibrate again with a flat board:",
            calibrate,
        )
    return green(CALIBRATION, f"{path}: reprojection error {error_px:.2f} px")


def judge_camera(seen: CameraObservation) -> Finding:
    if seen.fault is not None:
        return red(
            CAMERA,
            seen.fault,
            (
                "put the camera right before the next static run; without [camera] forces "
                "are measured all the same"
            ),
        )
    shown = f"{seen.stated} of {seen.planned} marks found"
    if seen.stated == seen.planned:
        return green(CAMERA, shown)
    message = f"{shown}: {'; '.join(seen.doubts)}"
    return yellow(
        CAMERA, message, "bring the leg into the picture, light it evenly, take red things away"
    )


def judge_photo_folder(folder: str, fault: str | None) -> Finding:
    """Finding on the photo folder. `fault` is why it cannot be read, None if it can."""
    if fault is not None:
        return red(
            CAMERA,
            fault,
            "make the folder, and tell the camera's program to put its photos there:",
            f"mkdir -p {folder}",
        )
    return green(CAMERA, f"photos are to come into {folder}")


def look_at_camera(
    section: OpenCvCameraSection, eye: PhotoSetup, clock: Clock
) -> CameraObservation:
    try:
        with ExitStack() as stack:
            photo = _take_photo(
                make_camera(section, eye, clock, stack), clock, section.photo_limit_s
            )
        identified = read_leg_photo(photo.image, eye).identified
    except RigError as error:
        return CameraObservation(shorten_error(error))
    count = sum(mark is not None for mark in identified.marks)
    return CameraObservation(
        None, count, len(identified.marks), tuple(doubt.words for doubt in identified.doubts)
    )


def _take_photo(camera: Photographer, clock: Clock, limit_s: float) -> Photo:
    camera.begin()
    until_s = clock.now_s() + limit_s
    while clock.now_s() < until_s:
        if photo := camera.fetch_photo():
            return photo
        clock.wait_until(clock.now_s() + LOOK_EVERY_S)
    raise DeviceError(f"the camera gave no photo within {limit_s:g} s; check its cable and power")


def judge_found_interfaces(seen: tuple[CanInterfaceObservation, ...]) -> list[Finding]:
    if not seen:
        fix = (
            "plug the adapter in; where it is not seen, load its driver, or make a serial "
            "adapter an interface:"
        )
        commands = ("sudo modprobe can_raw gs_usb", "sudo slcand -o -c -s8 /dev/ttyACM0 can0")
        return [yellow("CAN interface", "none in the kernel", fix, *commands)]
    return [_interface(interface) for interface in seen]


def _interface(seen: CanInterfaceObservation) -> Finding:
    rate = ""
    if seen.bitrate is not None:
        rate = f", {seen.bitrate} bit/s"
    if not seen.is_up:
        fix = "bring it up, with the bit rate of the drive:"
        return yellow(
            "CAN interface",
            f"{seen.channel} is down",
            fix,
            make_up_command(seen.channel, seen.bitrate or USUAL_BITRATE),
        )
    return green(
        "CAN interface",
        f'{seen.channel} is up{rate}: interface = "socketcan", channel = "{seen.channel}"',
    )


def judge_found_adapters(seen: tuple[tuple[str, str], ...]) -> list[Finding]:
    """Findings on adapters other than the kernel's, as (interface, channel) of python-can."""
    if not seen:
        return [green(ADAPTERS, "none beside the kernel's")]
    return [
        green(ADAPTERS, f'interface = "{interface}", channel = "{channel}"')
        for interface, channel in seen
    ]


def judge_no_ports() -> Finding:
    return green(PORTS, "none")


def find_sensors() -> dict[str, FoundSensor]:
    """Results of the search for each built-in force sensor that can be found without a rig file,
    by its kind.
    """
    places = {kind: find_sensor(kind).find for kind in FORCE_SENSORS}
    return {kind: load_object(search)() for kind, search in places.items() if search is not None}


def scan(runs: Path, clock: Clock) -> Iterator[Finding]:
    """Yields all findings as they come. Sends only what the search for each force sensor sends."""
    yield from judge_found_interfaces(
        tuple(look_at_can_interface(name) for name in can_interfaces())
    )
    yield from judge_found_adapters(look_for_adapters())
    ports = look_for_serial_ports()
    yield from [judge_found_port(port) for port in ports] or [judge_no_ports()]
    for sensor in find_sensors().values():
        yield from sensor.findings
    yield from check_computer(runs, clock, None)
