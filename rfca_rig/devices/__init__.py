"""Devices, each kind with all that belongs to it in a folder, and the registry of their kinds.

A rig file names the kind of a motor by `device` in [motor]. `find_motor` maps that word to a `MotorMake`. Built-in makes are in a table,
those of installed packages are entry points of the group `rfca_rig.devices`. A make names its parts, which are imported when they are first
used. So reading a rig file imports no driver, and no installed package that the file does not name.

1. `motor` and `force_sensor` are the sections of a rig file; `own` loads a lab's own device from the file that a section names.
2. A folder has the `codec`, `driver` and `twin` (with its faults) of one make, its `section`, and the doctor's `checks`.
3. `checks` is what the checks of all makes use: findings, and a listener on the bus.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import TYPE_CHECKING, Any

from rfca_rig.errors import BadInput

if TYPE_CHECKING:
    import can

    from rfca_rig.clock import Clock
    from rfca_rig.drivers.roles import ShaftMotor
    from rfca_rig.twins.drive_parts import LoopGains
    from rfca_rig.twins.world import MotorTwin

GROUP = "rfca_rig.devices"
OWN = "own"
# The kind in a rig file, and its make as "module:name", as in an entry point.
MOTORS = {
    "odrive": "rfca_rig.devices.odrive:DEVICE",
    "cubemars-mit": "rfca_rig.devices.cubemars:MIT",
    "cubemars-servo": "rfca_rig.devices.cubemars:SERVO",
    "moteus": "rfca_rig.devices.moteus:DEVICE",
    OWN: "rfca_rig.devices.own:DEVICE",
}
# Watchdog of a drive whose rig file does not state it.
USUAL_WATCHDOG_S = 0.1


@dataclass(frozen=True)
class MotorMake:
    """One kind of motor: where its parts are. Each part is "module:name", which is imported when it is first used.

    Parameters
    ----------
    section
        The keys of [motor], a subclass of `motor.MotorSection`.
    twin
        Makes the simulated drive: (bus, keys, gains, watchdog_s) -> MotorTwin.
    driver
        Makes the driver: (keys, bus, clock, silent_s) -> ShaftMotor. Without it, the section's own method `driver` does.
    check
        The doctor's check: (keys, listener) -> findings. Without it, the doctor reads the drive by its driver.
    faults
        A `DriveFaults`: the faults that can be injected into the twin. Without it there are none.
    torque_off
        For a drive without a watchdog: (keys, silent_s) -> TorqueOffFrames, which the guardian sends.
    watchdog_key
        The key in milliseconds that states the drive's watchdog, where the rig file has one.
    number
        For `rfca-rig init`: the key of the drive's number on the bus, and the number of a new drive.
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
    watchdog_key: str | None = None
    number: tuple[str, int] = ("drive_id", 1)
    usual: Mapping[str, Any] = field(default_factory=dict)
    example: Mapping[str, Any] = field(default_factory=dict)

    def make_driver(self, keys: Any, bus: "can.BusABC", clock: "Clock", silent_s: float) -> "ShaftMotor":
        """The driver on that bus; no report for `silent_s` is a fault."""
        driver: ShaftMotor
        driver = keys.driver(bus, clock, silent_s) if self.driver is None else load_object(self.driver)(keys, bus, clock, silent_s)
        return driver

    def make_twin(self, keys: Any, bus: "can.BusABC", gains: "LoopGains", watchdog_s: float | None) -> "MotorTwin":
        """The simulated drive on its end of the bus; `watchdog_s` None: without a watchdog."""
        twin: MotorTwin = load_object(self.twin)(bus, keys, gains, watchdog_s)
        return twin


def load_object(place: str) -> Any:
    """The object at "module:name". Raises BadInput where it cannot be loaded."""
    module, _, name = place.partition(":")
    try:
        return getattr(import_module(module), name)
    # Another package's code may raise anything.
    except Exception as error:
        raise BadInput(f"{place} cannot be loaded: {' '.join(f'{type(error).__name__}: {error}'.split())}") from error


def list_motors() -> tuple[str, ...]:
    """The kinds that a rig file may name, without importing any: the built-in ones, then those of installed packages."""
    return (*MOTORS, *sorted({point.name for point in entry_points(group=GROUP)} - {*MOTORS}))


def find_motor(kind: str) -> MotorMake:
    """The make of a kind of motor.

    Raises
    ------
    KeyError
        No such kind.
    BadInput
        The installed package that offers it cannot be used; names the package.
    """
    if kind in MOTORS:
        make: MotorMake = load_object(MOTORS[kind])
        return make
    points = tuple(entry_points(group=GROUP, name=kind))
    if not points:
        raise KeyError(kind)
    if len(points) > 1:
        raise BadInput(f"device {kind!r} is offered by several installed packages: {package_of(kind)}; remove all but one")
    return _load(points[0])


def package_of(kind: str) -> str | None:
    """The installed package that offers the kind, with its version; None for a built-in kind."""
    points = () if kind in MOTORS else entry_points(group=GROUP, name=kind)
    return ", ".join(sorted(f"{point.dist.name} {point.dist.version}" for point in points if point.dist is not None)) or None


def _load(point: EntryPoint) -> MotorMake:
    """The make of an entry point, with its section. Raises BadInput where the package does not provide one."""
    what = f"device {point.name!r} of the installed package {package_of(point.name)}"
    try:
        make = load_object(point.value)
        if isinstance(make, MotorMake):
            load_object(make.section)
            return make
    except BadInput as error:
        raise BadInput(f"{what}: {error}") from error
    raise BadInput(f"{what}: {point.value} is no MotorMake")
