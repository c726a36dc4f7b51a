"""Loads the templates and style sheets of the pages, which are in this package."""

from collections.abc import Iterable
from functools import cache
from importlib import resources

from jinja2 import Environment, FunctionLoader, StrictUndefined, Template

from rfca_rig import __version__
from rfca_rig.report.style import colours
from rfca_rig.report.table_cells import cells_as_text
from rfca_rig.report.text import MARK_MEANINGS


def template(name: str) -> Template:
    """A template that escapes the values it is given, and fails on a missing one."""
    return _environment().get_template(name)


@cache
def _environment() -> Environment:
    """Environment of all templates, with colours, meanings of the marks, version and the filters `words` and `by_stem`."""
    # StrictUndefined: a misspelt name fails in tests instead of leaving a gap in a page.
    environment = Environment(
        loader=FunctionLoader(beside), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["words"] = lambda id_: id_.replace("_", " ")
    environment.filters["by_stem"] = by_stem
    environment.globals |= {
        "beside": beside,
        "colours": colours(),
        "mark_meanings": MARK_MEANINGS,
        "shown_cells": cells_as_text,
        "version": __version__,
    }
    return environment


def by_stem(files: Iterable[str]) -> list[str]:
    """File names joined by stem, as in "values.csv/.tex", "static.json"."""
    stems: dict[str, list[str]] = {}
    for file in files:
        stem, dot, ending = file.rpartition(".")
        stems.setdefault(stem, []).append(dot + ending)
    return [stem + "/".join(endings) for stem, endings in stems.items()]


def beside(name: str) -> str:
    """Text of a template or style sheet of this package."""
    return resources.files("rfca_rig.report").joinpath(name).read_text("utf-8")
