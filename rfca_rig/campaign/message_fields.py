"""Fields of decoded messages by name: `wrench.force.z`, `data[2]`, and `position[shoulder]` where a list `name` accompanies `position`.

A message has the form that its decoder gives it: a JSON object, or a dataclass of a ROS message.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

import numpy as np

from rfca_rig.suggestions import suggestion

NS_PER_S = 1_000_000_000
# Longer arrays are pictures or point clouds, and not listed.
MOST_ENTRIES = 64

_PART = r"[^.\[\]]+(?:\[[^\[\]]+\])*"
_FIELD = re.compile(rf"{_PART}(?:\.{_PART})*")
# Field of sensor_msgs/JointState with the names of its arrays' entries.
_NAMES = "name"
# In ROS 2, and in JSON as Foxglove writes it.
_NANOSECONDS = ("nanosec", "nsec")


class JointNotNamed(LookupError):
    """A message names other joints than the requested one. Its argument is their names."""


@dataclass(frozen=True)
class MessageField:
    """Location of a field in a message: names from the outside inwards, each with the keys in brackets after it."""

    text: str
    parts: tuple[tuple[str, tuple[str, ...]], ...]


def parse_field(text: str) -> MessageField:
    """Parse the name of a field. Raises ValueError where the text is no such name."""
    if not _FIELD.fullmatch(text):
        raise ValueError(f"{text!r} is no field; write it as position[0], position[shoulder] or wrench.force.z")
    parts = []
    for part in re.findall(_PART, text):
        name, *keys = re.split(r"[\[\]]+", part.rstrip("]"))
        parts.append((name, tuple(keys)))
    return MessageField(text, tuple(parts))


def read_number(message: Any, field: MessageField) -> float:
    """The finite number in a field.

    Raises
    ------
    ValueError
        Where the message has no such field, or it is no finite number; the text says which.
    NotNamed
        Where the message has no joint of that name.
    """
    value = _value(message, field)
    if not _is_number(value):
        raise ValueError(f"{field.text} {_describe(value, field.text)}")
    if not math.isfinite(value):
        raise ValueError(f"{field.text} is {value:g}; every message needs a finite number")
    return float(value)


def read_time_ns(message: Any, field: MessageField, unit_ns: int) -> int:
    """The time in a field in ns: a stamp of seconds and nanoseconds, or a number in a unit of `unit_ns`.

    Raises ValueError as `read_number` does, and for a stamp whose unit is not stated as s.
    """
    value = _value(message, field)
    stamp = _stamp_ns(value)
    if stamp is not None:
        if unit_ns != NS_PER_S:
            raise ValueError(f'{field.text} is read in s; write unit = "s" in [time]')
        return stamp
    # Integers are multiplied exactly: as a float, ns since 1970 would lose the last digits.
    if isinstance(value, int | np.integer) and not isinstance(value, bool):
        return int(value) * unit_ns
    return round(read_number(message, field) * unit_ns)


def list_numbers(message: Any, before: str = "") -> Iterator[tuple[str, float]]:
    """Name and value of each number in a message, without stamps and without the content of long arrays."""
    for name in _field_names(message):
        value = _child(message, name)
        yield from _numbers_in(f"{before}{name}", value, _names_beside(message, value))


def has_stamp(message: Any, field: MessageField) -> bool:
    """Whether that field is a stamp."""
    try:
        return _stamp_ns(_value(message, field)) is not None
    except ValueError:
        return False


def _value(message: Any, field: MessageField) -> Any:
    # `holder` is one level behind `at`: the names of an array's entries are its neighbours.
    at, place = message, "the message"
    for name, keys in field.parts:
        if not _has(at, name):
            known = _field_names(at)
            raise ValueError(f"{place} has no field {name}; {suggestion(name, known) if known else 'it has no fields at all'}")
        holder, at, place = at, _child(at, name), name
        for key in keys:
            at = _entry(holder, at, place, key)
            place = f"{place}[{key}]"
    return at


def _entry(holder: Any, array: Any, place: str, key: str) -> Any:
    if not _is_array(array):
        raise ValueError(f"{place} is no array; leave [{key}] out")
    if key.isdecimal():
        index = int(key)
    else:
        names = _names_beside(holder, array)
        if names is None:
            raise ValueError(f"{place} has {len(array)} entries without names; write {place}[0] for the first")
        if key not in names:
            raise JointNotNamed(*names)
        index = names.index(key)
    if index >= len(array):
        raise ValueError(f"{place}[{key}] is out of range: {place} has {len(array)} entries, the first is {place}[0]")
    return array[index]


def _names_beside(holder: Any, array: Any) -> list[str] | None:
    """The names of an array's entries, where the enclosing message has them. An array may be empty if it was not measured."""
    names = _child(holder, _NAMES) if _has(holder, _NAMES) else None
    # An array next to `name` belongs to it only if both have the same length.
    if array is names or not _is_array(array) or not isinstance(names, list) or len(array) not in (0, len(names)):
        return None
    return names if all(isinstance(name, str) for name in names) else None


def _numbers_in(name: str, value: Any, names: Sequence[str] | None) -> Iterator[tuple[str, float]]:
    if _is_number(value):
        yield name, float(value)
    elif _is_array(value):
        if len(value) <= MOST_ENTRIES:
            for index, entry in enumerate(value):
                yield from _numbers_in(f"{name}[{names[index] if names else index}]", entry, None)
    elif _stamp_ns(value) is None:
        yield from list_numbers(value, f"{name}.")


def _stamp_ns(value: Any) -> int | None:
    if not _has(value, "sec"):
        return None
    for nanoseconds in _NANOSECONDS:
        if _has(value, nanoseconds):
            return int(_child(value, "sec")) * NS_PER_S + int(_child(value, nanoseconds))
    return None


def _field_names(value: Any) -> list[str]:
    """The fields of a message, none for anything else. A ROS message also has its type as a field, in double underscores, which is
    skipped.
    """
    if isinstance(value, dict):
        return list(value)
    return [field.name for field in fields(value) if not field.name.startswith("__")] if is_dataclass(value) else []


def _has(value: Any, name: str) -> bool:
    return name in (value if isinstance(value, dict) else getattr(value, "__dataclass_fields__", ()))


def _child(holder: Any, name: str) -> Any:
    return holder[name] if isinstance(holder, dict) else getattr(holder, name)


# A bool is an int in Python, but no measured number.
def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.number) and not isinstance(value, bool)


def _is_array(value: Any) -> bool:
    return isinstance(value, list | np.ndarray)


def _describe(value: Any, name: str) -> str:
    """Description of a value that should be a number."""
    if _is_array(value):
        return f"is an array of {len(value)}; write {name}[0] for its first entry"
    if known := _field_names(value):
        return f"has the fields {', '.join(known)}; name one of them"
    return "is text, no number" if isinstance(value, str) else f"is {value}, no number"
