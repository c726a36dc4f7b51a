"""Parameters of a model as lines of a table, with units from their names: k0_Nm_per_rad is "k0" in N m/rad."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

from rfca_rig.model.parameters import LawTable, RigModel
from rfca_rig.model.tabulated_law import kind_of

# Ending of the name: unit shown, factor. The first match counts, so longer endings come before their parts ("_Nm_per_rad", "_rad").
UNITS = {
    "_Nm_s_per_rad": ("N m s/rad", 1.0),
    "_Nm_per_rad": ("N m/rad", 1.0),
    "_N_per_m1p5": ("N/m^1.5", 1.0),
    "_N_s_per_m": ("N s/m", 1.0),
    "_N_per_m": ("N/m", 1.0),
    "_s_per_m": ("s/m", 1.0),
    "_per_rad2": ("1/rad²", 1.0),
    "_rad": ("rad", 1.0),
    "_kg": ("g", 1e3),
    "_m": ("mm", 1e3),
    "_s": ("s", 1.0),
}


SECTIONS = ("leg", "ground", "sensor", "drive")


@dataclass(frozen=True)
class ParameterLine:
    """One line of a table of parameters."""

    section: str
    name: str
    value: str
    unit: str


def parameter_lines(rig: RigModel) -> list[ParameterLine]:
    """Every parameter of the model that has a value and is not switched off, section by section.

    It goes through the fields of the dataclasses, so that new parameters appear without a change here.
    """
    sections = [
        _quantity(section, parameter.name, value)
        for section in SECTIONS
        for parameter in fields(getattr(rig, section))
        if (value := getattr(getattr(rig, section), parameter.name)) is not None and value is not False and value != ()
    ]
    effects = [_quantity("effect", f"{present.id} {name}", value) for present in rig.effects for name, value in present.values]
    tables = [_of_table(present.table) for present in rig.effects if present.table is not None]
    return sections + effects + tables


def _of_table(table: LawTable) -> ParameterLine:
    values = f"{len(table.values)} values, {min(table.values):.4g} to {max(table.values):.4g}"
    return ParameterLine("effect", f"tabulated_law of {table.argument} at {table.place}", values, kind_of(table.place, table.argument).unit)


def _quantity(section: str, name: str, value: Any) -> ParameterLine:
    ending = next((ending for ending in UNITS if name.endswith(ending)), "")
    unit, factor = UNITS.get(ending, ("", 1.0))
    return ParameterLine(section, name.removesuffix(ending).replace("_", " "), _number(value, factor), unit)


def _number(value: Any, factor: float) -> str:
    if isinstance(value, Sequence) and not isinstance(value, str):
        return ", ".join(_number(each, factor) for each in value)
    return f"{factor * value:.6g}" if isinstance(value, int | float) and not isinstance(value, bool) else str(value)
