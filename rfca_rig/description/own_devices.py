"""Motors and force sensors of a lab's own: a rig file names a Python file, which says what its section holds and makes the driver.

The section is checked by the class that the file defines, so that a wrong key is refused with its line, as of any other device.
"""

import hashlib
import linecache
import sys
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import TypeVar

from rfca_rig.description.force_sensor_sections import ForceSensorKeys, OwnForceSensorSection
from rfca_rig.description.motor_sections import MotorKeys, OwnMotorSection
from rfca_rig.description.toml import read_text, section_of
from rfca_rig.errors import BadInput

MOTOR_PAGE, SENSOR_PAGE = "add-a-motor.md", "add-a-force-sensor.md"

Keys = TypeVar("Keys", MotorKeys, ForceSensorKeys)


SOURCE = "__source__"


def named_in(path: Path, name: str, page: str) -> type:
    """The class that the file defines under `name`; `page` of docs says how. Raises BadInput where there is none.

    A class from elsewhere is refused: the recording keeps this file, and it should hold what ran.
    """
    module = _loaded(path, read_text(path))
    found = getattr(module, name, None)
    if not isinstance(found, type) or found.__module__ != module.__name__:
        raise BadInput(f"{path}: defines no class of its own as {name}; see docs/{page}")
    return found


def source_of(found: type) -> str:
    """The text of the file that a class of `named_in` stands in, as it was when it was loaded."""
    return str(getattr(sys.modules[found.__module__], SOURCE))


@cache
def _loaded(path: Path, text: str) -> ModuleType:
    """Once per text: a class stays the same class however often its rig file is read.

    The module is registered, for pydantic looks up annotations there; its folder is not searched for imports, so that all of a driver
    is in the file that the recording keeps.
    """
    module = ModuleType(f"rfca_rig_own_{path.stem}_{hashlib.sha256(f'{path}{text}'.encode()).hexdigest()[:12]}")
    module.__file__ = str(path)
    setattr(module, SOURCE, text)
    sys.modules[module.__name__] = module
    linecache.cache[str(path)] = (len(text), None, text.splitlines(keepends=True), str(path))
    try:
        exec(compile(text, str(path), "exec"), module.__dict__)
    except SyntaxError as error:
        raise BadInput(f"{path}:{error.lineno}: {error.msg}") from None
    except Exception as error:  # whatever a lab's file may raise
        raise BadInput(f"{path}{_line(error, path)}: {type(error).__name__}: {' '.join(str(error).split())}") from error
    return module


def _line(error: BaseException, path: Path) -> str:
    """Where in the file it happened."""
    lines, step = [], error.__traceback__
    while step is not None:
        if step.tb_frame.f_code.co_filename == str(path):
            lines.append(step.tb_lineno)
        step = step.tb_next
    return f":{lines[-1]}" if lines else ""


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
