"""Writes TOML that people can read: tables of plain values, and comments."""

from collections.abc import Mapping
from typing import Any

import numpy as np

# Digits after the point; the error of any fitted value is far larger.
DECIMALS = 7


def comment(line: str) -> str:
    """A comment line. Line breaks in a title would end the comment, so they become blanks."""
    return f"# {''.join(sign if sign.isprintable() else ' ' for sign in line)}".rstrip() + "\n"


def table(name: str, keys: Mapping[str, Any]) -> str:
    """[name] with its keys; keys with the value None are omitted."""
    return f"[{name}]\n" + "".join(f"{key} = {format_value(value)}\n" for key, value in keys.items() if value is not None)


def format_value(value: Any) -> str:
    """A value in TOML syntax; mappings become inline tables."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key} = {format_value(inner)}" for key, inner in value.items() if inner is not None) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(format_value(inner) for inner in value) + "]"
    # Before int: a bool is an int in Python.
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return '"' + value.translate(_ESCAPES) + '"'
    return str(value) if isinstance(value, int) else _number(float(value))


_ESCAPES = {ord('"'): '\\"', ord("\\"): "\\\\", **{code: f"\\u{code:04x}" for code in (*range(32), 127)}}


def _number(value: float) -> str:
    """Enough digits for any fit; TOML wants a point or an exponent in a float, which numpy gives."""
    is_scientific = value != 0.0 and not 1e-3 <= abs(value) < 1e5
    return str(np.format_float_scientific(value, DECIMALS, trim="0") if is_scientific else round(value, DECIMALS))
