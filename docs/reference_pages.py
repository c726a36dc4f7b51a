"""Sphinx extension: fills the pages of the reference from the code.

A page has a mark such as `<!-- commands -->`, which is replaced by Markdown before the page is
read:

- `<!-- commands -->`: every command with usage, options and defaults, from the command line itself
- `<!-- file NAME -->`: the tables and keys of one file format, from its pydantic model; its JSON
  schema is written beside the page
- `<!-- effects -->`: the catalogue of effects

The glossary is written as tables; here each term becomes an entry of Sphinx's glossary, which the
search knows.
"""

import json
import re
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel
from sphinx.application import Sphinx
from sphinx.util.typing import ExtensionMetadata

from rfca_rig.campaign.layout import CampaignFile, ExperimentFile
from rfca_rig.campaign.pendulum import PendulumFile, PendulumModelFile
from rfca_rig.cli.main import app as command_line
from rfca_rig.description.camera_file import CameraFile
from rfca_rig.description.model_file import ModelFile
from rfca_rig.description.protocol_file import DynamicFile, FatigueFile, StaticFile
from rfca_rig.description.rig_draft import list_limits
from rfca_rig.description.rig_file import RigFile
from rfca_rig.description.tolerances_file import TolerancesFile
from rfca_rig.executors.slurm import ClusterFile
from rfca_rig.model.catalogue import catalogue, families_of
from rfca_rig.model.effect import Effect, Parameter
from rfca_rig.reports.text import words_and_unit
from rfca_rig.sweep.sweep_file import SweepFile

FILES: dict[str, type[BaseModel]] = {
    "rig-file": RigFile,
    "model-file": ModelFile,
    "protocol-dynamic": DynamicFile,
    "protocol-static": StaticFile,
    "protocol-fatigue": FatigueFile,
    "experiment": ExperimentFile,
    "campaign": CampaignFile,
    "pendulum": PendulumFile,
    "pendulum-model": PendulumModelFile,
    "sweep": SweepFile,
    "cluster": ClusterFile,
    "camera-file": CameraFile,
    "tolerances": TolerancesFile,
}
MARK = re.compile(r"<!-- (commands|effects|file ([a-z-]+)) -->")
# What Typer appends to a name, in words; the type of an argument says nothing.
TYPES = {
    "<int range>": "INTEGER",
    "<float range>": "NUMBER",
    "<list[Path]>": "",
    "<list[str]>": "",
    "<path>": "",
    "<str>": "",
}
Schema = Mapping[str, Any]


def setup(app: Sphinx) -> ExtensionMetadata:
    app.connect("source-read", fill_page)
    app.connect("build-finished", write_schemas)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def fill_page(_: Sphinx, page: str, source: list[str]) -> None:
    """Replaces the marks of a page, whose text is `source[0]`."""
    if page == "glossary":
        source[0] = list_terms(source[0])
    else:
        source[0] = MARK.sub(_fill_mark, source[0])


def _fill_mark(mark: re.Match[str]) -> str:
    if mark[1] == "commands":
        lines = describe_commands()
    elif mark[1] == "effects":
        lines = describe_effects()
    else:
        lines = describe_file(mark[2])
    return "\n".join(lines)


def list_terms(text: str) -> str:
    """The glossary with a `{glossary}` directive in the place of each table."""

    def list_rows(table: re.Match[str]) -> str:
        rows = [row.strip("| ").split(" | ") for row in table[1].splitlines()]
        entries = [
            line for term, meaning in rows for line in (*term.split(", "), f"  {meaning}", "")
        ]
        return "\n".join(("```{glossary}", *entries[:-1], "```", ""))

    return re.sub(r"\| term \| meaning \|\n\|[-|]+\|\n((?:\|.*\|\n)+)", list_rows, text)


# Commands


def describe_commands() -> Iterator[str]:
    """Markdown of all commands, in the order of `rfca-rig --help`."""
    root = typer.main.get_command(command_line)
    commands = list(_walk(root, root.context_class(root, info_name="rfca-rig")))
    yield from _table(
        ("command", "what it does"),
        [(f"[`{path}`](#{_anchor(path)})", summary) for path, summary, _ in commands],
    )
    for path, _, lines in commands:
        yield from (f"## {path}", "", *lines)


def _walk(command: Any, context: Any) -> Iterator[tuple[str, str, list[str]]]:
    """Path, summary and description of each command below this one."""
    if hasattr(command, "commands"):
        for name, inner in command.commands.items():
            if not inner.hidden:
                yield from _walk(inner, inner.context_class(inner, info_name=name, parent=context))
        return
    summary, *paragraphs = (command.help or "").split("\n\n")
    lines = [
        _prose(summary),
        "",
        "```text",
        command.get_usage(context).removeprefix("Usage: "),
        "```",
        "",
    ]
    for paragraph in paragraphs:
        example = paragraph.partition("Example: ")[2]
        lines += ["```sh", example, "```", ""] if example else [_prose(paragraph), ""]
    rows = []
    for parameter in command.get_params(context):
        if (record := parameter.get_help_record(context)) is not None:
            text, _, notes = record[1].partition("  [")
            names, _, value = record[0].partition(" ")
            # Typer appends type and requirement to arguments, and range and default to options.
            rows.append(
                (
                    _code(f"{names} {TYPES.get(value, value)}"),
                    _prose(text),
                    _prose(notes.rstrip("]")),
                )
            )
    yield (
        context.command_path,
        _prose(summary),
        [*lines, *_table(("argument or option", "what it does", "default, range"), rows)],
    )


# Files


def describe_file(name: str) -> Iterator[str]:
    """Markdown of one format: a link to its JSON schema, its own keys, and those of each table
    in it.
    """
    schema = FILES[name].model_json_schema()
    yield f'JSON schema: <a href="schemas/{name}.json">{name}.json</a>'
    yield ""
    yield from _describe_object("", schema, schema.get("$defs", {}))


def _describe_object(header: str, schema: Schema, known: Mapping[str, Schema]) -> Iterator[str]:
    inner: list[tuple[str, Schema]] = []
    rows = []
    path = header.strip("[]")
    for key, value in schema["properties"].items():
        tables = _tables_in(value, known)
        if tables:
            full = f"{path}.{key}" if path else key
            inner += [
                (f"[[{full}]]" if is_list else f"[{full}]", table) for table, is_list in tables
            ]
        else:
            required = key in schema.get("required", ())
            rows.append(
                (
                    f"`{key}`",
                    _type_of(value),
                    words_and_unit(key)[1],
                    _limits(value),
                    _default(value, required),
                    _prose(value.get("description", "")),
                )
            )
    if header:
        variant = next(
            (value["const"] for value in schema["properties"].values() if "const" in value), None
        )
        yield f"### {_prose(header)}" + (f", {variant}" if variant else "")
        yield ""
    if "description" in schema:
        # The heading names the table already.
        text = re.sub(r"^\[[^:]*\]+: ", "", schema["description"])
        yield _prose(text[0].upper() + text[1:])
        yield ""
    if rows:
        yield from _table(("key", "type", "unit", "limits", "default", "meaning"), rows)
    for each, table in inner:
        yield from _describe_object(each, table, known)


def _tables_in(
    value: Schema, known: Mapping[str, Schema], is_list: bool = False
) -> list[tuple[Schema, bool]]:
    """The TOML tables that a key may hold, each with whether it is an array of tables."""
    if "$ref" in value:
        return [(known[value["$ref"].rpartition("/")[2]], is_list)]
    choices = [*value.get("anyOf", ()), *value.get("oneOf", ())]
    found = [table for choice in choices for table in _tables_in(choice, known, is_list)]
    return found + (_tables_in(value["items"], known, True) if "items" in value else [])


def _choices(value: Schema) -> list[Schema]:
    return [choice for choice in value.get("anyOf", [value]) if choice.get("type") != "null"]


def _type_of(value: Schema) -> str:
    words = {
        "string": "text",
        "boolean": "true or false",
        "object": "table",
        "number": "number",
        "integer": "integer",
    }
    types = []
    for choice in _choices(value):
        if "const" in choice or "enum" in choice:
            types.append("one of")
        elif choice.get("type") == "array":
            inner = choice.get("items") or {"anyOf": [{"type": "number"}]}
            types.append(f"list of {_type_of(inner)}")
        else:
            types.append(words[choice["type"]])
    return " or ".join(dict.fromkeys(types))


def _limits(value: Schema) -> str:
    return ", ".join(f"`{limit}`" for limit in list_limits(value))


def _default(value: Schema, required: bool) -> str:
    if required:
        return "required"
    default = value.get("default")
    if default == sys.executable:
        return "the Python that runs rfca-rig"
    if default is None:
        return "optional"
    return f"`{json.dumps(default)}`"


def write_schemas(app: Sphinx, failure: Exception | None) -> None:
    """Writes the JSON schemas beside the page of file formats."""
    if failure is None and app.builder.format == "html":
        folder = Path(app.outdir) / "reference" / "schemas"
        folder.mkdir(parents=True, exist_ok=True)
        for name, model in FILES.items():
            text = json.dumps(model.model_json_schema(), indent=1)
            # The default of a cluster's `python` is the program that builds this site.
            text = text.replace(json.dumps(sys.executable), '"python3"')
            (folder / f"{name}.json").write_text(text + "\n", encoding="utf-8")


# Effects


def describe_effects() -> Iterator[str]:
    """Markdown of the catalogue: a table of all effects by their place, then each effect."""
    effects = sorted(catalogue().values(), key=lambda effect: (effect.where, effect.id))
    yield f"{len(effects)} effects:"
    yield ""
    rows = [
        (f"[`{effect.id}`](#{_anchor(effect.id)})", effect.where, _prose(effect.left_out))
        for effect in effects
    ]
    yield from _table(("effect", "place", "what the model lacks"), rows)
    for effect in effects:
        yield from _describe_effect(effect)


def _describe_effect(effect: Effect) -> Iterator[str]:
    yield f"## {effect.id}"
    yield ""
    yield f"Missing: {_prose(effect.left_out)}. Place: {effect.where}."
    yield ""
    yield from ("```text", effect.law, "```", "")
    if families := families_of(effect.id):
        yield (
            "- Family: "
            f"{'; '.join(f'`{family.id}`, {_prose(family.words)}' for family in families)}."
        )
    if effect.variant_of:
        yield f"- Special case of [`{effect.variant_of}`](#{_anchor(effect.variant_of)})."
    if effect.same_as:
        yield f"- Acts like an error of the nominal value `{effect.same_as}`."
    for limit in effect.equal_limits:
        yield f"- Cannot be distinguished from `{limit.other}` in a limit: {_prose(limit.words)}."
    yield f"- Source: {_prose(effect.source)}."
    yield ""
    rows = [
        _describe_parameter(parameter, role)
        for parameters, role in (
            (effect.parameters, "size"),
            (effect.shape, "shape"),
            (effect.begins, "initial state"),
        )
        for parameter in parameters
    ]
    yield from _table(("parameter", "unit", "plausible range", "role"), rows)


def _describe_parameter(parameter: Parameter, role: str) -> tuple[str, ...]:
    if role != "size":
        neutral = f", {parameter.neutral:.3g} if not given"
    else:
        neutral = ""
    return (
        f"`{parameter.name}`",
        words_and_unit(parameter.name)[1],
        f"{parameter.low:g} to {parameter.high:g}",
        role + neutral,
    )


# Markdown


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> Iterator[str]:
    yield f"| {' | '.join(heads)} |"
    yield "|" + "---|" * len(heads)
    yield from (f"| {' | '.join(row)} |" for row in rows)
    yield ""


def _prose(text: str) -> str:
    """Text of the code as Markdown: without emphasis by chance, and with references to pages as
    links.
    """
    pieces = text.split("`")
    # Every second piece stands in backticks and stays as it is.
    pieces[::2] = [re.sub(r"([*\[\]<>|_])", r"\\\1", piece) for piece in pieces[::2]]
    # Lines are joined and paragraphs stay, except in tables, which have none.
    paragraphs = (" ".join(paragraph.split()) for paragraph in "`".join(pieces).split("\n\n"))
    return re.sub(r"`?docs/([\w-]+)\.md`?", r"[\1](../\1.md)", "\n\n".join(paragraphs))


def _code(text: str) -> str:
    """Code in a table."""
    return f"`{text.strip()}`".replace("|", "\\|")


def _anchor(heading: str) -> str:
    """The target of a heading, as MyST makes it."""
    return heading.replace(" ", "-")
