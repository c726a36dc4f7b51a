"""The catalogue of effects: every file of the package's folder, and of a lab's own folder.

A lab keeps its effects as Python files in a folder that RFCA_RIG_EFFECTS names; each defines `EFFECT`. The package needs no change
for it.
"""

import importlib
import importlib.util
import os
import pkgutil
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path
from types import ModuleType

from rfca_rig.errors import BadInput
from rfca_rig.model import effects
from rfca_rig.model.effect import Effect

FOLDER_VARIABLE = "RFCA_RIG_EFFECTS"


def catalogue() -> dict[str, Effect]:
    """All effects by id; a lab's file may replace one of the package's by using its id."""
    return _catalogue(os.environ.get(FOLDER_VARIABLE))


@cache
def _catalogue(folder: str | None) -> dict[str, Effect]:
    modules = (importlib.import_module(f"{effects.__name__}.{module.name}") for module in pkgutil.iter_modules(effects.__path__))
    packaged = {effect.id: effect for effect in map(_effect_of, modules)}
    # The lab's entries come last, so that they replace entries of the same id.
    return packaged | {name: effect for name, (effect, _) in _lab_effects(folder).items()}


def lab_texts(ids: Collection[str]) -> dict[str, str]:
    """Source texts, by id, of those of these effects that are a lab's own; a recording stores them."""
    return {name: text for name, (_, text) in _lab_effects(os.environ.get(FOLDER_VARIABLE)).items() if name in ids}


@cache
def _lab_effects(folder: str | None) -> dict[str, tuple[Effect, str]]:
    modules = _lab_modules(Path(folder)) if folder else iter(())
    return {(effect := _effect_of(module)).id: (effect, Path(str(module.__file__)).read_text(encoding="utf-8")) for module in modules}


def _lab_modules(folder: Path) -> Iterator[ModuleType]:
    if not folder.is_dir():
        raise BadInput(f"{folder}: {FOLDER_VARIABLE} names a folder that is not there")
    for file in sorted(folder.glob("*.py")):
        spec = importlib.util.spec_from_file_location(f"lab_effect_{file.stem}", file)
        if spec is None or spec.loader is None:
            raise BadInput(f"{file}: cannot be loaded as a Python file")
        module = importlib.util.module_from_spec(spec)
        try:
            spec.loader.exec_module(module)
        # A lab's file may raise anything; the user gets its name in one line instead of a traceback.
        except Exception as error:
            raise BadInput(f"{file}: {type(error).__name__}: {error}") from error
        yield module


def _effect_of(module: ModuleType) -> Effect:
    effect = getattr(module, "EFFECT", None)
    if not isinstance(effect, Effect):
        raise BadInput(f"{module.__file__}: defines no EFFECT; see any file of the package's effects for the form")
    return effect
