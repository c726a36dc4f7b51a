"""A lab's own motors and force sensors: a rig file names a Python file, which defines the keys of
its section and makes the driver.

The section is validated by the class in that file, so that a wrong key is refused with its line, as
for any other device.
"""

import hashlib
import linecache
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import ModuleType

import can
import numpy as np

from rfca_rig.devices import MotorMake, SensorMake, package_of
from rfca_rig.devices.sections import (
    ForceSensorKeys,
    ForceSensorSection,
    MotorKeys,
    MotorSection,
    OwnForceSensorSection,
    OwnMotorSection,
)
from rfca_rig.errors import BadInput
from rfca_rig.toml import read_text, section_of
from rfca_rig.twins.drive_parts import LoopGains
from rfca_rig.twins.wires import SerialLine
from rfca_rig.twins.world import MotorTwin, SensorTwin

MOTOR = MotorMake(
    section="rfca_rig.devices.sections:OwnMotorSection", twin=f"{__name__}:make_motor_twin"
)
FORCE_SENSOR = SensorMake(
    section="rfca_rig.devices.sections:OwnForceSensorSection", twin=f"{__name__}:make_sensor_twin"
)

# By table: the name of the class in a lab's file, its base class, and the page that explains it.
OWN_CLASSES: dict[str, tuple[str, type[MotorKeys] | type[ForceSensorKeys], str]] = {
    "motor": ("MOTOR", MotorKeys, "add-a-motor.md"),
    "force_sensor": ("FORCE_SENSOR", ForceSensorKeys, "add-a-force-sensor.md"),
}

SOURCE_ATTRIBUTE = "__source__"


def find_class(path: Path, name: str, page: str) -> type:
    """The class that the file defines under `name`; `page` of docs explains how. Raises BadInput
    where there is none.

    A class from another file is refused, because the recording keeps this file, and it must contain
    the code that ran.
    """
    module = _load(path, read_text(path))
    own_class = getattr(module, name, None)
    if not isinstance(own_class, type) or own_class.__module__ != module.__name__:
        raise BadInput(f"{path}: defines no class of its own as {name}; see docs/{page}")
    return own_class


def source_of(found: type) -> str:
    """Text of the file that defines a class from `find_class`, as it was when it was loaded."""
    return str(getattr(sys.modules[found.__module__], SOURCE_ATTRIBUTE))


@cache
def _load(path: Path, text: str) -> ModuleType:
    """Loads the module once per text, so that a class stays the same object however often its rig
    file is read.

    The module is registered because pydantic looks up annotations there. Its folder is not searched
    for imports, so that the whole driver is in the file that the recording keeps.
    """
    # The hash keeps two files of the same name, or two versions of one file, apart.
    module = ModuleType(
        f"rfca_rig_own_{path.stem}_{hashlib.sha256(f'{path}{text}'.encode()).hexdigest()[:12]}"
    )
    module.__file__ = str(path)
    setattr(module, SOURCE_ATTRIBUTE, text)
    sys.modules[module.__name__] = module
    # Tracebacks then show the lines that were loaded, even if the file has changed since.
    linecache.cache[str(path)] = (len(text), None, text.splitlines(keepends=True), str(path))
    try:
        exec(compile(text, str(path), "exec"), module.__dict__)
    except SyntaxError as error:
        raise BadInput(f"{path}:{error.lineno}: {error.msg}") from None
    # A lab's file may raise anything.
    except Exception as error:
        raise BadInput(
            f"{path}{_line(error, path)}: {type(error).__name__}: {' '.join(str(error).split())}"
        ) from error
    return module


def _line(error: BaseException, path: Path) -> str:
    """`:LINE` of the last step of the traceback in the file, "" without one."""
    lines = []
    step = error.__traceback__
    while step is not None:
        if step.tb_frame.f_code.co_filename == str(path):
            lines.append(step.tb_lineno)
        step = step.tb_next
    if lines:
        return f":{lines[-1]}"
    return ""


def load_own(
    table: str, section: OwnMotorSection | OwnForceSensorSection, rig_text: str, rig_path: Path
) -> MotorKeys | ForceSensorKeys:
    """The section of that table, validated by its own class, with paths relative to the rig file
    resolved.

    Raises BadInput FILE:LINE: key: what is wrong.
    """
    name, base, page = OWN_CLASSES[table]
    path = (rig_path.parent / section.file).resolve()
    own_class = find_class(path, name, page)
    if not issubclass(own_class, base):
        raise BadInput(f"{path}: {name} does not inherit {base.__name__}; see docs/{page}")
    keys = section_of(rig_text, table, own_class, rig_path)
    if keys.twin_file:
        twin = {"twin_file": str((rig_path.parent / keys.twin_file).resolve())}
    else:
        twin = {}
    return keys.model_copy(update={"file": str(path), **twin})


def twin_of(keys: OwnMotorSection | OwnForceSensorSection) -> type:
    """The class TWIN in the lab's twin file. Raises BadInput where the rig file names none."""
    if isinstance(keys, OwnMotorSection):
        table = "motor"
    else:
        table = "force_sensor"
    *_, page = OWN_CLASSES[table]
    if keys.twin_file is None:
        raise BadInput(
            f"[{table}] {Path(keys.file).name} has no twin: name one in twin_file "
            f"(docs/{page}), or take another device for runs without "
            "the rig"
        )
    return find_class(Path(keys.twin_file), "TWIN", page)


def make_motor_twin(
    bus: can.BusABC, keys: OwnMotorSection, gains: LoopGains, watchdog_s: float | None
) -> MotorTwin:
    """The twin of a lab's own motor, of the class TWIN in its file."""
    twin: MotorTwin = twin_of(keys)(bus, keys, gains, watchdog_s)
    return twin


def make_sensor_twin(
    line: SerialLine,
    keys: OwnForceSensorSection,
    noise_std: tuple[float, ...],
    random: np.random.Generator,
) -> SensorTwin:
    """The twin of a lab's own sensor, of the class TWIN in its file."""
    twin: SensorTwin = twin_of(keys)(line, keys, noise_std, random)
    return twin


def texts_of(motor: object, force_sensor: object) -> Mapping[str, str]:
    """Source texts of own devices by name, as they were loaded, for the recording."""
    texts = {}
    for table, keys in (("motor", motor), ("force_sensor", force_sensor)):
        if isinstance(keys, MotorKeys | ForceSensorKeys):
            texts[f"{table}_driver_file"] = source_of(type(keys))
            if keys.twin_file:
                texts[f"{table}_twin_file"] = source_of(twin_of(keys))
    return texts


def packages_of(
    motor: MotorSection | None, force_sensor: ForceSensorSection | None
) -> Mapping[str, str]:
    """Installed packages that offer the devices, with their versions, by name, for the
    recording.
    """
    packages = {}
    for table, keys in (("motor", motor), ("force_sensor", force_sensor)):
        if keys is not None and (package := package_of(keys.device)) is not None:
            packages[f"{table}_package"] = package
    return packages
