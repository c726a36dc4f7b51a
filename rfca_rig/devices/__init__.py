"""Devices, each kind with all that belongs to it in a folder, and the registry of their kinds.

A rig file names the kind of a device by `device` in [motor] and [force_sensor]. `find_motor` and
`find_sensor` map that word to a `MotorMake` or `SensorMake`. Built-in makes are in two tables,
those of installed packages are entry points of the group `rfca_rig.devices`. A make names its
parts, which are imported when they are first used. So reading a rig file imports no driver, and no
installed package that the file does not name.

1. `sections` has the base classes of the sections; `own` loads a lab's own device from the file
   that a section names.
2. A folder has the `codec`, `driver` and `twin` (with its faults) of one make, its `section`, and
   the doctor's `checks`.
3. `checks` is what the checks of all makes use: findings, a listener on the bus, ports.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any, TypeVar

from rfca_rig.errors import BadInput

if TYPE_CHECKING:
    import can
    import numpy as np

    from rfca_rig.clock import Clock
    from rfca_rig.devices.drive_setup import DriveNeeds, DriveSetup
    from rfca_rig.drivers.roles import ForceSensor, ShaftMotor
    from rfca_rig.twin_server.open_ports import SensorWire
    from rfca_rig.twins.drive_parts import LoopGains
    from rfca_rig.twins.world import MotorTwin, SensorTwin

GROUP = "rfca_rig.devices"
OWN = "own"
# The kind in a rig file, and its make as "module:name", as in an entry point.
MOTORS = {
    "odrive": "rfca_rig.devices.odrive:DEVICE",
    "cubemars-mit": "rfca_rig.devices.cubemars:MIT",
    "cubemars-servo": "rfca_rig.devices.cubemars:SERVO",
    "moteus": "rfca_rig.devices.moteus:DEVICE",
    OWN: "rfca_rig.devices.own:MOTOR",
}
FORCE_SENSORS = {
    "ati-net-ft": "rfca_rig.devices.netft:DEVICE",
    "ati-serial": "rfca_rig.devices.ati_serial:DEVICE",
    "ati-daq": "rfca_rig.devices.ati_daq:DEVICE",
    OWN: "rfca_rig.devices.own:FORCE_SENSOR",
}
# Watchdog of a drive whose rig file does not state it.
USUAL_WATCHDOG_S = 0.1


@dataclass(frozen=True)
class MotorMake:
    """One kind of motor: where its parts are. Each part is "module:name", which is imported when it
    is first used.

    Parameters
    ----------
    section
        The keys of [motor], a subclass of `motor.MotorSection`.
    twin
        Makes the simulated drive: (bus, keys, gains, watchdog_s) -> MotorTwin.
    driver
        Makes the driver: (keys, bus, clock, silent_s) -> ShaftMotor. Without it, the section's own
        method `driver` does.
    check
        The doctor's check: (keys, listener) -> findings. Without it, the doctor reads the drive by
        its driver.
    faults
        A `DriveFaults`: the faults that can be injected into the twin. Without it there are none.
    torque_off
        For a drive without a watchdog: (keys, silent_s) -> TorqueOffFrames, which the guardian
        sends.
    setup
        Reads and writes the settings of the drive: (keys, bus, clock, needs) ->
        `drive_setup.DriveSetup`. Without it, `rfca-rig setup motor` refuses the make.
    new_twin
        Makes the simulated drive as it leaves its maker: (bus, keys, gains) -> MotorTwin. Without
        it, a new drive begins with what the rig file needs.
    watchdog_key
        The key in milliseconds that states the drive's watchdog, where the rig file has one.
    number
        For `rfca-rig init`: the key of the drive's number on the bus, and the number of a new
        drive.
    usual
        For `rfca-rig init`: usual values of the other keys that have no default.
    example
        For the conformance tests: keys of a drive with a gear, a zero and the other direction.
    """

    section: str
    twin: str
    driver: str | None = None
    check: str | None = None
    faults: str | None = None
    torque_off: str | None = None
    setup: str | None = None
    new_twin: str | None = None
    watchdog_key: str | None = None
    number: tuple[str, int] = ("drive_id", 1)
    usual: Mapping[str, Any] = field(default_factory=dict)
    example: Mapping[str, Any] = field(default_factory=dict)

    def make_driver(
        self, keys: Any, bus: "can.BusABC", clock: "Clock", silent_s: float
    ) -> "ShaftMotor":
        """The driver on that bus; no report for `silent_s` is a fault."""
        driver: ShaftMotor
        if self.driver is None:
            driver = keys.driver(bus, clock, silent_s)
        else:
            driver = load_object(self.driver)(keys, bus, clock, silent_s)
        return driver

    def make_twin(
        self, keys: Any, bus: "can.BusABC", gains: "LoopGains", watchdog_s: float | None
    ) -> "MotorTwin":
        """The simulated drive on its end of the bus; `watchdog_s` None: without a watchdog."""
        twin: MotorTwin = load_object(self.twin)(bus, keys, gains, watchdog_s)
        return twin

    def make_new_twin(self, keys: Any, bus: "can.BusABC", gains: "LoopGains") -> "MotorTwin | None":
        """The simulated drive as it leaves its maker; None where the make has none."""
        if self.new_twin is None:
            return None
        twin: MotorTwin = load_object(self.new_twin)(bus, keys, gains)
        return twin

    def make_setup(
        self, keys: Any, bus: "can.BusABC", clock: "Clock", needs: "DriveNeeds"
    ) -> "DriveSetup | None":
        """Reads and writes the settings of the drive on that bus; None where the make has none."""
        if self.setup is None:
            return None
        setup: DriveSetup = load_object(self.setup)(keys, bus, clock, needs)
        return setup


@dataclass(frozen=True)
class SensorMake:
    """One kind of force sensor: where its parts are, as in `MotorMake`.

    The way to a sensor is what its driver reads and writes: a serial port, a socket, a card. It has
    a method `close`.

    Parameters
    ----------
    section
        The keys of [force_sensor], a subclass of `sections.ForceSensorSection`.
    twin
        Makes the simulated sensor on its end of the wire: (end, keys, noise_std, random) ->
        SensorTwin.
    driver
        Makes the driver: (keys, way, clock) -> ForceSensor. Without it, the section's own method
        `driver` does.
    open
        Opens the way to the real sensor: (keys, clock) -> way. Without it, the section's own method
        `open` does.
    wire
        A `SensorWire`: what is between driver and twin, with its faults. A serial line where
        nothing else is stated. With None the driver reads the twin itself, by calls, so that no
        other program can.
    check
        The doctor's check: (keys, clock) -> iterator of findings. Without it, the doctor reads the
        sensor by its driver.
    check_way
        Findings on the settings that an open sensor states: (keys, way) -> list of findings, before
        any stream. Without it there are none.
    find
        Searches for the sensor without a rig file: () -> FoundSensor.
    address
        For `rfca-rig init`: the key of the sensor's address, the question, and the usual answer.
    usual
        For `rfca-rig init`: usual values of the other keys that have no default.
    example
        For tests: keys of a sensor.
    """

    section: str
    twin: str
    driver: str | None = None
    open: str | None = None
    wire: str | None = "rfca_rig.twin_server.open_ports:SERIAL"
    check: str | None = None
    check_way: str | None = None
    find: str | None = None
    address: tuple[str, str, str] = ("port", "its serial port", "/dev/ttyUSB0")
    usual: Mapping[str, Any] = field(default_factory=dict)
    example: Mapping[str, Any] = field(default_factory=dict)

    def open_way(self, keys: Any, clock: "Clock") -> Any:
        """The way to the real sensor, to be closed by the caller. Raises DeviceError."""
        if self.open is None:
            return keys.open()
        return load_object(self.open)(keys, clock)

    def make_driver(self, keys: Any, way: Any, clock: "Clock") -> "ForceSensor":
        """The driver on that way."""
        driver: ForceSensor
        if self.driver is None:
            driver = keys.driver(way, clock)
        else:
            driver = load_object(self.driver)(keys, way, clock)
        return driver

    def make_twin(
        self, end: Any, keys: Any, noise_std: tuple[float, ...], random: "np.random.Generator"
    ) -> "SensorTwin":
        """The simulated sensor on its end of the wire."""
        twin: SensorTwin = load_object(self.twin)(end, keys, noise_std, random)
        return twin

    def find_wire(self) -> "SensorWire | None":
        """What is between driver and twin."""
        if self.wire is None:
            return None
        wire: SensorWire = load_object(self.wire)
        return wire


Make = TypeVar("Make", MotorMake, SensorMake)


def load_object(place: str) -> Any:
    """The object at "module:name". Raises BadInput where it cannot be loaded."""
    module, _, name = place.partition(":")
    try:
        return getattr(import_module(module), name)
    # Another package's code may raise anything.
    except Exception as error:
        raise BadInput(
            f"{place} cannot be loaded: {' '.join(f'{type(error).__name__}: {error}'.split())}"
        ) from error


def list_motors() -> tuple[str, ...]:
    """The words that [motor] may name, without importing any: the built-in kinds, then those of
    installed packages.
    """
    return (*MOTORS, *_list_packaged())


def list_sensors() -> tuple[str, ...]:
    """The same for [force_sensor]. Which kind of device a package offers shows only when it is
    loaded, so both lists have all.
    """
    return (*FORCE_SENSORS, *_list_packaged())


def _list_packaged() -> list[str]:
    return sorted({point.name for point in entry_points(group=GROUP)} - {*MOTORS, *FORCE_SENSORS})


def find_motor(kind: str) -> MotorMake:
    """The make of a kind of motor.

    Raises
    ------
    KeyError
        No such kind.
    BadInput
        The installed package that offers it cannot be used; names the package.
    """
    return _find(kind, MOTORS, MotorMake)


def find_sensor(kind: str) -> SensorMake:
    """The make of a kind of force sensor. Raises as `find_motor`."""
    return _find(kind, FORCE_SENSORS, SensorMake)


def _find(kind: str, built_in: Mapping[str, str], make_class: type[Make]) -> Make:
    if kind in built_in:
        make: Make = load_object(built_in[kind])
        return make
    points = _points_of(kind)
    if not points:
        raise KeyError(kind)
    if len(points) > 1:
        raise BadInput(
            f"device {kind!r} is offered by several installed packages: "
            f"{package_of(kind)}; remove all but one"
        )
    what = f"device {kind!r} of the installed package {package_of(kind)}"
    try:
        offered = load_object(points[0].value)
        if isinstance(offered, make_class):
            # A make without its section is of no use to a rig file.
            load_object(offered.section)
            return offered
    except BadInput as error:
        raise BadInput(f"{what}: {error}") from error
    raise BadInput(f"{what}: {points[0].value} is no {make_class.__name__}")


def package_of(kind: str) -> str | None:
    """The installed package that offers the kind, with its version; None for a built-in kind."""
    return (
        ", ".join(
            sorted(
                f"{point.dist.name} {point.dist.version}"
                for point in _points_of(kind)
                if point.dist is not None
            )
        )
        or None
    )


def _points_of(kind: str) -> tuple[EntryPoint, ...]:
    # The word of a built-in kind is taken in both tables.
    if kind in MOTORS or kind in FORCE_SENSORS:
        return ()
    return tuple(entry_points(group=GROUP, name=kind))
