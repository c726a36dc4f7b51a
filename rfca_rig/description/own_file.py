"""Loads a Python file that a rig file names: the driver or the twin of a device of a lab's own."""

import hashlib
import linecache
import sys
from functools import cache
from pathlib import Path
from types import ModuleType

from rfca_rig.description.toml import read_text
from rfca_rig.errors import BadInput

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
