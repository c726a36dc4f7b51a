"""A rig whose devices are only listened to: motor, force sensor or both, with every frame on the
motor's bus.
"""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import NoReturn

import can
import numpy as np

from rfca_rig.bench.factory import HandRack, explain_closed_bus, open_bench
from rfca_rig.bench.recorder import SHAFT_FORM, Recorder, force_form, force_rows, shaft_rows
from rfca_rig.bench.sensors import make_force_sensor
from rfca_rig.clock import Clock, TwinClock, WallClock
from rfca_rig.codecs.sensor_axes import SensorAxes
from rfca_rig.description.rig_file import DevicesFile, RigFile
from rfca_rig.devices import find_motor
from rfca_rig.devices.sections import ForceSensorSection, MotorSection
from rfca_rig.drivers.frame_tap import FrameTap
from rfca_rig.drivers.roles import (
    ForceSamples,
    ForceSensor,
    MotorStatus,
    SensorScale,
    ShaftMotor,
    ShaftSamples,
    StreamHealth,
)
from rfca_rig.engine.interfaces import Bench
from rfca_rig.errors import DeviceError
from rfca_rig.protocol.plan import Rates
from rfca_rig.recording.can_frames import can_form, frame_row
from rfca_rig.recording.columns import Rows, StreamForm
from rfca_rig.recording.layout import LISTENING
from rfca_rig.recording.model import Source

# A file without [limits] states no time after which a drive counts as silent; nothing depends on it
# while the motor is off.
DRIVE_SILENT_S = 0.1

_NOTHING = np.empty(0)


class AbsentMotor:
    """Implements `ShaftMotor` for a rig without one: reports nothing, and takes no command."""

    def read(self) -> ShaftSamples:
        return ShaftSamples(_NOTHING, _NOTHING, _NOTHING, _NOTHING, _NOTHING)

    def status(self) -> MotorStatus:
        return MotorStatus("none", None, 0.0)

    def identity(self) -> dict[str, str]:
        return {}

    def disable(self) -> None:
        """There is nothing to disable."""

    def enable(self) -> None:
        self._refuse()

    def prove_watchdog(self, limit_s: float) -> float:
        del limit_s
        self._refuse()

    def command_speed(self, speed_rad_s: float) -> None:
        del speed_rad_s
        self._refuse()

    def command_angle(self, angle_rad: float, speed_rad_s: float = 0.0) -> None:
        del angle_rad, speed_rad_s
        self._refuse()

    def _refuse(self) -> NoReturn:
        raise DeviceError("the rig file names no motor")


class AbsentSensor:
    """Implements `ForceSensor` for a rig without one."""

    def start(self) -> None:
        """There is nothing to start."""

    def read(self) -> ForceSamples:
        return ForceSamples(
            _NOTHING,
            _NOTHING,
            np.empty(0, np.int64),
            np.empty(0, np.uint32),
            np.empty((0, 6), np.int32),
        )

    def stop(self) -> None:
        """There is nothing to stop."""

    def scale(self) -> SensorScale:
        return SensorScale(1.0, 1.0, 0.0)

    def health(self) -> StreamHealth:
        return StreamHealth()

    def identity(self) -> dict[str, str]:
        return {}


@dataclass(frozen=True)
class ListeningBench:
    """The devices, and the streams that are recorded of them. `tap` is None without a motor."""

    bench: Bench
    source: Source
    forms: tuple[StreamForm, ...]
    has_sensor: bool
    tap: FrameTap | None

    def make_rows(self, shaft: ShaftSamples, force: ForceSamples) -> list[Rows]:
        """Packed records of each stream, in the order of `forms`, of what was received."""
        rows = []
        if self.tap is not None:
            rows.append(shaft_rows(shaft))
        if self.has_sensor:
            rows.append(force_rows(force))
        if self.tap is not None:
            form = self.forms[-1]
            frames = self.tap.take()
            packed = b"".join(
                frame_row(form, frame.message, frame.host_s, frame.is_sent) for frame in frames
            )
            rows.append(np.frombuffer(packed, form.dtype))
        return rows

    def begin(self, recorder: Recorder) -> None:
        """Begins the stage of the recording, with frames that arrive from now on."""
        if self.tap is not None:
            self.tap.discard()
        recorder.begin_listening(LISTENING, self.forms)


@contextmanager
def open_listening_bench(
    rig: RigFile | DevicesFile, seed: int | None, twin_clock: TwinClock | None = None
) -> Iterator[ListeningBench]:
    """Opens the devices for the length of the block; no guardian, which would send frames.

    Parameters
    ----------
    rig : RigFile or DevicesFile
        The rig; a twin needs a whole rig file.
    seed : int or None
        Decides all randomness of a twin; None on a real rig.
    twin_clock : TwinClock, optional
        For a twin whose time must not pass as fast as it can.

    Raises
    ------
    BadInput
        A twin without a [twin] section or a seed.
    DeviceError
        A device cannot be opened.
    """
    if isinstance(rig, RigFile) and not rig.is_real:
        taps: list[FrameTap] = []

        def tap_bus(bus: can.BusABC, clock: Clock) -> can.BusABC:
            taps.append(FrameTap(bus, clock))
            return taps[-1]

        with open_bench(rig, seed, twin_clock=twin_clock, tap_bus=tap_bus) as bench:
            try:
                yield _with_streams(bench, rig.motor, rig.force_sensor, taps[0])
            finally:
                taps[0].shutdown()
        return
    with ExitStack() as stack:
        clock = WallClock()
        motor: ShaftMotor = AbsentMotor()
        sensor: ForceSensor = AbsentSensor()
        tap = None
        if rig.motor is not None:
            with explain_closed_bus(rig.motor):
                bus = rig.motor.open()
            tap = stack.enter_context(FrameTap(bus, clock))
            silent_s = DRIVE_SILENT_S
            if isinstance(rig, RigFile):
                silent_s = rig.limits.drive_silent_ms / 1e3
            motor = find_motor(rig.motor.device).make_driver(rig.motor, tap, clock, silent_s)
        if rig.force_sensor is not None:
            axes = SensorAxes()
            if isinstance(rig, RigFile):
                axes = rig.sensor.mounting
            sensor = make_force_sensor(rig.force_sensor, axes, clock, stack)
        bench = Bench(motor, sensor, HandRack(), clock, is_real=True)
        yield _with_streams(bench, rig.motor, rig.force_sensor, tap)


def _with_streams(
    bench: Bench,
    motor: MotorSection | None,
    sensor: ForceSensorSection | None,
    tap: FrameTap | None,
) -> ListeningBench:
    forms: list[StreamForm] = []
    if motor is not None:
        forms.append(SHAFT_FORM)
    if sensor is not None:
        forms.append(force_form(bench.sensor.scale()))
    if motor is not None:
        forms.append(can_form(is_fd=motor.fd_bitrate is not None))
    source: Source = "SIM"
    if bench.is_real:
        source = "REAL"
    return ListeningBench(bench, source, tuple(forms), sensor is not None, tap)


def rates_of(rig: RigFile | DevicesFile) -> Rates:
    """Records per second of the devices, for an estimate of the recording's size."""
    force_Hz = shaft_Hz = 0.0
    if rig.force_sensor is not None:
        force_Hz = rig.force_sensor.rate_Hz
    if rig.motor is not None:
        shaft_Hz = rig.motor.reports_Hz
    return Rates(force_Hz, shaft_Hz)
