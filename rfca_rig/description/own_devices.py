"""Motors and force sensors of a lab's own: a rig file names a Python file, which says what its section holds and makes the driver.

The section is checked by the class that the file defines, so that a wrong key is refused with its line, as of any other device.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TypeVar

from rfca_rig.description.force_sensor_sections import ForceSensorKeys, OwnForceSensorSection
from rfca_rig.description.motor_sections import MotorKeys, OwnMotorSection
from rfca_rig.description.own_file import named_in, source_of
from rfca_rig.description.toml import section_of
from rfca_rig.errors import BadInput

MOTOR_PAGE, SENSOR_PAGE = "add-a-motor.md", "add-a-force-sensor.md"

Keys = TypeVar("Keys", MotorKeys, ForceSensorKeys)


def own_motor(section: OwnMotorSection, rig_text: str, rig_path: Path) -> MotorKeys:
    """The section as its own class has it, with the paths in it counted from the rig file. Raises BadInput FILE:LINE: key: what."""
    return _checked(section.file, "MOTOR", MotorKeys, MOTOR_PAGE, ("motor", rig_text, rig_path))


def own_force_sensor(section: OwnForceSensorSection, rig_text: str, rig_path: Path) -> ForceSensorKeys:
    """The same of [force_sensor]."""
    return _checked(section.file, "FORCE_SENSOR", ForceSensorKeys, SENSOR_PAGE, ("force_sensor", rig_text, rig_path))


def _checked(file: str, name: str, base: type[Keys], page: str, where: tuple[str, str, Path]) -> Keys:
    table, rig_text, rig_path = where
    path = _beside(rig_path, file)
    found = named_in(path, name, page)
    if not issubclass(found, base):
        raise BadInput(f"{path}: {name} does not inherit {base.__name__}; see docs/{page}")
    keys = section_of(rig_text, table, found, rig_path)
    return keys.model_copy(update={"file": str(path), **({"twin_file": str(_beside(rig_path, keys.twin_file))} if keys.twin_file else {})})


def _beside(rig_path: Path, file: str) -> Path:
    return (rig_path.parent / file).resolve()


def twin_of(keys: OwnMotorSection | OwnForceSensorSection) -> type:
    """What the lab's twin file defines as TWIN. Raises BadInput where the rig file names none."""
    motor = isinstance(keys, OwnMotorSection)
    table, page = ("motor", MOTOR_PAGE) if motor else ("force_sensor", SENSOR_PAGE)
    if keys.twin_file is None:
        raise BadInput(
            f"[{table}] {Path(keys.file).name} has no twin: name one in twin_file (docs/{page}), or take another device for runs without "
            "the rig"
        )
    return named_in(Path(keys.twin_file), "TWIN", page)


def texts_of(motor: object, force_sensor: object) -> Mapping[str, str]:
    """For the recording: the files of own devices, by name, as they were loaded."""
    texts = {}
    for table, keys in (("motor", motor), ("force_sensor", force_sensor)):
        if isinstance(keys, MotorKeys | ForceSensorKeys):
            texts[f"{table}_driver_file"] = source_of(type(keys))
            texts |= {f"{table}_twin_file": source_of(twin_of(keys))} if keys.twin_file else {}
    return texts
