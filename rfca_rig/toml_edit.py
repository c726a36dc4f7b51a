"""Sets keys of a TOML file that people wrote: comments, order and all other lines stay."""

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput
from rfca_rig.toml import format_value


@dataclass(frozen=True)
class _Statement:
    """`KEY = VALUE` on the lines `begin` to `end`, without `end`; `comment` stands behind it."""

    key: str
    begin: int
    end: int
    comment: str


def set_keys(text: str, table: str, values: Mapping[str, Any], path: Path) -> str:
    """The text of the file at `path` with these keys of [table] set: changed where they stand, else
    added behind the last key of the table.

    Raises BadInput, with what is to be written by hand, where [table] has no header of its own, or
    a key is written as a table.
    """
    lines = text.splitlines(keepends=True)
    by_hand = "; ".join(f"{key} = {format_value(value)}" for key, value in values.items())
    header = re.compile(rf"\s*\[\s*{re.escape(table)}\s*\]\s*(#.*)?$")
    begin = next((number for number, line in enumerate(lines) if header.match(line)), None)
    if begin is None:
        raise BadInput(
            f"{path}: [{table}] has no line of its own; write into it by hand: {by_hand}"
        )
    ending = "\n"
    if lines[begin].endswith("\r\n"):
        ending = "\r\n"
    statements = list(_statements(lines, begin + 1))
    after = max((statement.end for statement in statements), default=begin + 1)
    # From the end on, so that earlier line numbers stay right.
    new = [f"{key} = {format_value(values[key])}{ending}" for key in values]
    known = {statement.key: statement for statement in statements}
    if not lines[after - 1].endswith("\n"):
        lines[after - 1] += ending
    lines[after:after] = [line for key, line in zip(values, new, strict=True) if key not in known]
    for statement in reversed(statements):
        if statement.key in values:
            line = f"{statement.key} = {format_value(values[statement.key])}{statement.comment}"
            lines[statement.begin : statement.end] = [line + ending]
    edited = "".join(lines)
    if not _is_as_wanted(text, edited, table, values):
        raise BadInput(f"{path}: [{table}] is written in another way; change it by hand: {by_hand}")
    return edited


def _statements(lines: list[str], begin: int) -> Iterator[_Statement]:
    """The statements of a table whose first line is `begin`, up to the next header."""
    number = begin
    while number < len(lines):
        line = lines[number].strip()
        if line.startswith("["):
            return
        if not line or line.startswith("#"):
            number += 1
            continue
        end = number + 1
        # A list may go over several lines.
        while (key := _key_of("".join(lines[number:end]))) is None and end < len(lines):
            end += 1
        if key is None:
            return
        yield _Statement(key, number, end, _comment("".join(lines[number:end])))
        number = end


def _key_of(statement: str) -> str | None:
    try:
        return next(iter(tomllib.loads(statement)))
    except tomllib.TOMLDecodeError:
        return None


def _comment(statement: str) -> str:
    """The comment behind a statement, with the blanks before it; the sign may be in a text, too."""
    statement = statement.rstrip("\r\n")
    for number, character in enumerate(statement):
        if character == "#" and _key_of(statement[:number]) is not None:
            return statement[len(statement[:number].rstrip()) :]
    return ""


def _is_as_wanted(text: str, edited: str, table: str, values: Mapping[str, Any]) -> bool:
    """Whether the edited text differs from the first one in these keys only."""
    wanted = tomllib.loads(text)
    for key, value in values.items():
        # As it comes back from a file, with the digits that were written.
        wanted[table][key] = tomllib.loads(f"value = {format_value(value)}")["value"]
    try:
        return bool(tomllib.loads(edited) == wanted)
    except tomllib.TOMLDecodeError:
        return False
