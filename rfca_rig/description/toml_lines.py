"""Line numbers of keys in a TOML text. `tomllib` does not give them, and error messages need them."""

import re

Key = tuple[str | int, ...]

# A full parser is not needed: the text was read by tomllib before, and a wrong line only makes a message less precise.
_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\]]+?)\s*\]")
_ASSIGNMENT = re.compile(r"""^\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[\w-]+|"[^"]*"|'[^']*'))*)\s*=""")


def line_of(text: str, key: Key) -> int | None:
    """Line, from 1, of the key, or of the nearest enclosing table that has a line of its own; None for the whole file.

    `key` counts entries of `[[...]]` from 0: ("runs", 3, "height_mm").
    """
    lines = _lines_by_key(text)
    for length in range(len(key), 0, -1):
        if key[:length] in lines:
            return lines[key[:length]]
    return None


def _lines_by_key(text: str) -> dict[Key, int]:
    found: dict[Key, int] = {}
    entries: dict[Key, int] = {}
    table: Key = ()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = _table(_parts(header[2]), header[1] == "[[", entries)
            found.setdefault(table, number)
        elif assignment := _ASSIGNMENT.match(line):
            found.setdefault(table + _parts(assignment[1]), number)
    return found


def _parts(dotted: str) -> Key:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))


def _table(parts: Key, is_entry: bool, entries: dict[Key, int]) -> Key:
    """The header's key with the index of each `[[...]]` that contains it; `entries` holds the latest index of each and is updated."""
    table: Key = ()
    for place, part in enumerate(parts):
        table += (part,)
        if is_entry and place == len(parts) - 1:
            entries[table] = entries.get(table, -1) + 1
        if table in entries:
            table += (entries[table],)
    return table
