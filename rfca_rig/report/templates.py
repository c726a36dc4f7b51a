"""The pages' templates and style sheets, which lie beside this file."""

from importlib import resources

from jinja2 import Environment, StrictUndefined, Template


def template(name: str) -> Template:
    """A template that escapes what it is given and fails on what it is not; `words` turns an id into words."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["words"] = lambda id_: id_.replace("_", " ")
    return environment.from_string(beside(name))


def beside(name: str) -> str:
    """The text of a file."""
    return resources.files("rfca_rig.report").joinpath(name).read_text("utf-8")
