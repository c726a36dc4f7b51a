"""The catalogue of effects, and the simulation of a rig with its effects in it.

The catalogue holds every effect of a leg, and of every file of a lab's own folder; those of a
mechanism depend on its model, and `mechanism.effects.list_effects` makes them. A lab keeps its
effects as Python files in a folder that RFCA_RIG_EFFECTS names; each defines `EFFECT`. The package
needs no change for it.

The members of a family are the effects that declare it, of the catalogue and of mechanisms.
"""

import importlib
import importlib.util
import os
import pkgutil
from collections.abc import Collection, Iterable, Iterator
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from types import ModuleType

from rfca_rig.errors import BadInput
from rfca_rig.model import effects
from rfca_rig.model.bench_tests import BENCH_TESTS
from rfca_rig.model.declarations import LEG, MECHANISM
from rfca_rig.model.declarations.changes import CHANGES
from rfca_rig.model.effect import Declaration, Effect
from rfca_rig.model.families import FAMILIES, FAMILIES_OF_VALUES, Family
from rfca_rig.model.motion import ShaftMotion
from rfca_rig.model.parameters import PresentEffect, RigModel
from rfca_rig.model.setup import Setup
from rfca_rig.model.tabulated_law import TABULATED_LAW, effect_of_table
from rfca_rig.suggestions import suggestion

FOLDER_VARIABLE = "RFCA_RIG_EFFECTS"


def catalogue() -> dict[str, Effect]:
    """All effects of a leg by id; a lab's file may replace one of the package's by using its id."""
    return _catalogue(os.environ.get(FOLDER_VARIABLE))


@cache
def _catalogue(folder: str | None) -> dict[str, Effect]:
    modules = (
        importlib.import_module(f"{effects.__name__}.{module.name}")
        for module in pkgutil.iter_modules(effects.__path__)
    )
    packaged: dict[str, Effect] = {
        effect.id: effect for module in modules for effect in module.EFFECTS
    }
    # The lab's entries come last, so that they replace entries of the same id.
    return packaged | {name: effect for name, (effect, _) in _lab_effects(folder).items()}


def lab_texts(ids: Collection[str]) -> dict[str, str]:
    """Source texts, by id, of those of these effects that are a lab's own; a recording stores
    them.
    """
    return {
        name: text
        for name, (_, text) in _lab_effects(os.environ.get(FOLDER_VARIABLE)).items()
        if name in ids
    }


@cache
def _lab_effects(folder: str | None) -> dict[str, tuple[Effect, str]]:
    modules = _lab_modules(Path(folder)) if folder else iter(())
    return {
        (effect := _effect_of(module)).id: (
            effect,
            Path(str(module.__file__)).read_text(encoding="utf-8"),
        )
        for module in modules
    }


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
        # A lab's file may raise anything; the user gets its name in one line instead of a
        # traceback.
        except Exception as error:
            raise BadInput(f"{file}: {type(error).__name__}: {error}") from error
        yield module


def _effect_of(module: ModuleType) -> Effect:
    effect = getattr(module, "EFFECT", None)
    if not isinstance(effect, Effect):
        raise BadInput(
            f"{module.__file__}: defines no EFFECT; see docs/add-an-effect.md for the form"
        )
    if effect.family:
        effect = replace(effect, families=(*effect.families, effect.family))
    for family in effect.families:
        _check_known(module, "family", family, [family.id for family in FAMILIES])
    if effect.bench_test:
        _check_known(module, "bench test", effect.bench_test, [kind for kind, *_ in BENCH_TESTS])
    return effect


def _check_known(module: ModuleType, kind: str, name: str, known: list[str]) -> None:
    if name not in known:
        raise BadInput(
            f"{module.__file__}: {kind} {name!r} is none of the catalogue; "
            f"{suggestion(name, known)}"
        )


# Parts of a setup that move the leg, all but the changes of the sensor.
_OF_SENSOR = ("sensor_changes", "sensed_every_s")
_MOVING = tuple(part.name for part in fields(Setup) if part.name not in _OF_SENSOR)


def set_up(
    rig: RigModel, height_m: float, motion: ShaftMotion, strokes_before: tuple[int, ...] = ()
) -> Setup:
    """The setup of a rig with all its effects in it; `strokes_before` as in `Setup`.

    Raises BadInput for an effect that is not in the catalogue, and for one whose law needs k2 where
    the hinges follow a measured curve.
    """
    setup = Setup(rig, height_m, motion, strokes_before=strokes_before)
    for present in rig.effects:
        effect, values = resolve_effect(present)
        if effect.needs_k2 and rig.leg.torque_splines:
            raise BadInput(
                f"effect {effect.id}: its law is written in k0 and k2, and the hinges of "
                "this leg follow a measured curve "
                "(leg.torque_rotation); leave out one of them"
            )
        changed = effect.apply(setup, values)
        # By identity, since a motion holds arrays. The function stands for a lab's own effect,
        # which may change under the same id.
        kept = all(getattr(changed, name) is getattr(setup, name) for name in _MOVING)
        if kept:
            setup = changed
        else:
            setup = replace(changed, moved_by=(*setup.moved_by, (effect.apply, present)))
    return setup


def resolve_effect(present: PresentEffect) -> tuple[Effect, dict[str, float]]:
    """The catalogue's entry, and the values by parameter name, with neutral values for optional
    parameters that are not given.

    Raises BadInput where either does not fit.
    """
    if present.id == TABULATED_LAW:
        return effect_of_table(present.table), {}
    effects = catalogue()
    if present.id not in effects:
        raise BadInput(
            f"effect {present.id}: not in the catalogue; there are {', '.join(sorted(effects))}"
        )
    effect = effects[present.id]
    values = dict(present.values)
    required = {parameter.name for parameter in effect.parameters}
    neutral = {parameter.name: parameter.neutral for parameter in (*effect.shape, *effect.begins)}
    # Shape parameters and initial states are optional in a file; all others are required.
    if set(values) - set(neutral) != required:
        raise BadInput(
            f"effect {present.id}: takes {', '.join(sorted(required))}, was given "
            f"{', '.join(sorted(values)) or 'nothing'}"
        )
    return effect, neutral | values


def declarations() -> tuple[Declaration, ...]:
    """Declarations of all effects: of legs, of mechanisms, changed values, and the lab's own.

    Two have the same id where two simulators have the effect, or where a lab's effect replaces one
    of the package's. What one of them states of the id holds.
    """
    return _declarations(os.environ.get(FOLDER_VARIABLE))


@cache
def _declarations(folder: str | None) -> tuple[Declaration, ...]:
    of_lab = (effect for effect, _ in _lab_effects(folder).values())
    return (*LEG, *MECHANISM, *CHANGES.values(), *of_lab)


def list_effects_like(values: Iterable[str]) -> frozenset[str]:
    """Effects that act much as errors of these nominal values do, for example of
    "link1.mass_relative".
    """
    names = [value.rpartition(".")[2] for value in values]
    return frozenset().union(
        *(members_of(family) for name in names for family in FAMILIES_OF_VALUES.get(name, ()))
    )


def families_of(effect_id: str) -> tuple[Family, ...]:
    """The families that an effect belongs to, in the order of `FAMILIES`; an effect that names none
    is a family of its own.
    """
    ids = {
        family
        for declaration in declarations()
        if declaration.id == effect_id
        for family in declaration.families
    }
    matches = tuple(family for family in FAMILIES if family.id in ids)
    return matches or (Family(effect_id, effect_id.replace("_", " "), ""),)


def members_of(family_id: str) -> frozenset[str]:
    """The effects of a family; an effect that names none is the only one of its own."""
    members = frozenset(
        declaration.id for declaration in declarations() if family_id in declaration.families
    )
    return members or frozenset((family_id,))


def list_related(ids: Iterable[str]) -> frozenset[str]:
    """All members of the families of these effects, themselves among them."""
    families = {family.id for effect_id in ids for family in families_of(effect_id)}
    return frozenset().union(*map(members_of, families))
