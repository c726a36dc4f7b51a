"""The pages' templates and style sheets, which lie beside this file."""

from collections.abc import Iterable
from functools import cache
from importlib import resources

from jinja2 import Environment, FunctionLoader, StrictUndefined, Template

from rfca_rig import __version__
from rfca_rig.report.style import colours
from rfca_rig.report.table_cells import shown_cells
from rfca_rig.report.text import MARK_MEANINGS


def template(name: str) -> Template:
    """A template that escapes what it is given and fails on what it is not."""
    return _environment().get_template(name)


@cache
def _environment() -> Environment:
    """`words` turns an id into words; every template knows the colours, the meaning of the marks and the version."""
    environment = Environment(
        loader=FunctionLoader(beside), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["words"] = lambda id_: id_.replace("_", " ")
    environment.filters["by_stem"] = by_stem
    environment.globals |= {
        "beside": beside,
        "colours": colours(),
        "mark_meanings": MARK_MEANINGS,
        "shown_cells": shown_cells,
        "version": __version__,
    }
    return environment


def by_stem(files: Iterable[str]) -> list[str]:
    """As in "values.csv/.tex", "static.json": files that differ in their ending only are named once."""
    stems: dict[str, list[str]] = {}
    for file in files:
        stem, dot, ending = file.rpartition(".")
        stems.setdefault(stem, []).append(dot + ending)
    return [stem + "/".join(endings) for stem, endings in stems.items()]


def beside(name: str) -> str:
    """The text of a file."""
    return resources.files("rfca_rig.report").joinpath(name).read_text("utf-8")
