"""Reads a TOML file into a pydantic model, and turns any fault into a message of one line.
`Section` is the base class of its tables.

Also writes TOML that people can read: tables of plain values. `escaping` writes its comments.
"""

import difflib
import math
import re
import tomllib
import typing
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import fields
from pathlib import Path
from stat import S_ISDIR, S_ISREG
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetJsonSchemaHandler,
    ValidationError,
    field_validator,
    model_validator,
)
from pydantic.fields import FieldInfo
from pydantic_core import CoreSchema, ErrorDetails

from rfca_rig.errors import BadInput
from rfca_rig.escaping import toml_key, toml_string

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

Key = tuple[str | int, ...]

# A full parser is not needed: the text was read by tomllib before, and a wrong line only makes a
# message less precise.
_HEADER = re.compile(r"^\s*(\[\[?)\s*([^\]]+?)\s*\]")
_ASSIGNMENT = re.compile(
    r"""^\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[\w-]+|"[^"]*"|'[^']*'))*)\s*="""
)

Model = TypeVar("Model", bound=BaseModel)
Dataclass = TypeVar("Dataclass", bound="DataclassInstance")

# Of a file that people write. The largest one in use, a laboratory's own effect with tables, has
# some 100 kB.
MOST_BYTES = 4_000_000
# The deepest of our files has four. For each level of a dotted key, tomllib keeps the whole way to
# it.
MOST_LEVELS = 32
_KEY_PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_DEEP_KEY = re.compile(
    rf"(?:^|[{{,\[])\s*+(?:{_KEY_PART}[ \t]*+\.[ \t]*+){{{MOST_LEVELS}}}", re.MULTILINE
)
# Of faults in one file that are put into words; only the first is reported.
MOST_FAULTS = 200

# Stands in a draft for a value that only its user knows.
OPEN = "?"
TO_FILL_IN = "is still a question mark; put the value in its place"

# Digits after the point; the error of any fitted value is far larger.
DECIMALS = 7

# In the unit of the key. The largest of a rig is a contact stiffness, 1e5 to 1e10 N/m^1.5. The
# smallest that must be above 0 is an inertia, 1e-9 kg m^2 of a needle. Squares, products and
# quotients of a few such numbers stay finite.
SMALLEST = 1e-30
LARGEST = 1e15


def _check_size(value: float) -> float:
    if value < SMALLEST:
        raise ValueError(f"should be {SMALLEST:g} or more")
    return value


Positive = Annotated[float, Field(gt=0), AfterValidator(_check_size)]
NotNegative = Annotated[float, Field(ge=0)]


def line_of(text: str, key: Key) -> int | None:
    """Line, from 1, of the key, or of the nearest enclosing table that has a line of its own; None
    for the whole file.

    `key` counts entries of `[[...]]` from 0: ("runs", 3, "height_mm").
    """
    lines = _lines_by_key(text)
    for length in range(len(key), 0, -1):
        if key[:length] in lines:
            return lines[key[:length]]
    return None


def _lines_by_key(text: str) -> dict[Key, int]:
    lines: dict[Key, int] = {}
    entries: dict[Key, int] = {}
    table: Key = ()
    for number, line in enumerate(text.splitlines(), start=1):
        if header := _HEADER.match(line):
            table = _table(_parts(header[2]), header[1] == "[[", entries)
            lines.setdefault(table, number)
        elif assignment := _ASSIGNMENT.match(line):
            lines.setdefault(table + _parts(assignment[1]), number)
    return lines


def _parts(dotted: str) -> Key:
    return tuple(part.strip().strip("\"'") for part in dotted.split("."))


def _table(parts: Key, is_entry: bool, entries: dict[Key, int]) -> Key:
    """The header's key with the index of each `[[...]]` that contains it; `entries` holds the
    latest index of each and is updated.
    """
    table: Key = ()
    for index, part in enumerate(parts):
        table += (part,)
        if is_entry and index == len(parts) - 1:
            entries[table] = entries.get(table, -1) + 1
        if table in entries:
            table += (entries[table],)
    return table


def degrees_key(key: str) -> str | None:
    """The key in which the same angle may be written in degrees: start_angle_deg for
    start_angle_rad. None for other keys.
    """
    stem = key.removesuffix("_rad")
    # N m/rad and the like are no angles.
    if stem == key or stem.endswith("_per"):
        return None
    return f"{stem}_deg"


def degrees_keys(model: type[BaseModel]) -> dict[str, str]:
    """Each key of `model` that holds an angle in radians, with its key in degrees, unless that
    has a meaning of its own.
    """
    pairs = {
        key: degrees_key(key)
        for key, field in model.model_fields.items()
        if _is_number(field.annotation)
    }
    return {
        key: twin
        for key, twin in pairs.items()
        if twin is not None and twin not in model.model_fields
    }


def _is_number(annotation: Any) -> bool:
    """Whether a field holds one number, which may be absent; the name of a column, as
    angle1_rad, is none.
    """
    if typing.get_origin(annotation) is tuple:
        return False
    return annotation is float or any(
        _is_number(argument) for argument in typing.get_args(annotation)
    )


class Section(BaseModel):
    """A table in a file: no unknown keys, no text where a number is expected, no NaN.

    An angle whose key ends in `_rad` may be written in degrees, under the same key with `_deg`;
    recordings hold radians.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _convert_degrees(cls, data: Any) -> Any:
        if not isinstance(data, Mapping):
            return data
        converted = dict(data)
        for key, in_degrees in degrees_keys(cls).items():
            if in_degrees not in data:
                continue
            if key in data:
                raise ValueError(
                    f"{key} and {in_degrees} both state one angle; leave one of them out"
                )
            value = converted.pop(in_degrees)
            # Anything else is refused under its own key as no number.
            if isinstance(value, int | float) and not isinstance(value, bool):
                value = math.radians(value)
            converted[key] = value
        return converted

    def to_dataclass(self, kind: type[Dataclass], **others: Any) -> Dataclass:
        """An object of `kind`: `others`, and the values of the fields that the table has under
        the same names.
        """
        same = {
            field.name: getattr(self, field.name)
            for field in fields(kind)
            if field.name in type(self).model_fields
        }
        return kind(**(same | others))

    @classmethod
    def __get_pydantic_json_schema__(
        cls, core_schema: CoreSchema, handler: GetJsonSchemaHandler
    ) -> dict[str, Any]:
        """The schema for editors, with the keys in degrees beside those in radians."""
        schema = handler(core_schema)
        table = handler.resolve_ref_schema(schema)
        for key, in_degrees in degrees_keys(cls).items():
            either = [{"required": [key]}, {"required": [in_degrees]}]
            is_required = key in table.get("required", ())
            rule: dict[str, Any] = {"not": {"required": [key, in_degrees]}}
            if is_required:
                rule = {"oneOf": either}
            table["allOf"] = [*table.get("allOf", ()), rule]
            table["properties"][in_degrees] = {"type": "number", "description": f"{key} in degrees"}
            if is_required:
                table["required"] = [other for other in table["required"] if other != key]
        return schema

    @field_validator("*")
    @classmethod
    def _has_sane_numbers(cls, value: Any) -> Any:
        for number in _floats_in(value):
            if abs(number) > LARGEST:
                raise ValueError(f"should be {LARGEST:g} or less in size, not {number:g}")
        return value


def _floats_in(value: Any) -> Iterator[float]:
    if isinstance(value, float):
        yield value
    elif isinstance(value, tuple | list):
        for item in value:
            yield from _floats_in(item)
    elif isinstance(value, Mapping):
        yield from _floats_in(tuple(value.values()))


def read_toml(path: Path, model: type[Model]) -> Model:
    """Read the file as `model`.

    Raises BadInput `FILE:LINE: key: what is wrong` for a file that is missing, not UTF-8, not TOML,
    or not valid for `model`.
    """
    return model_of(read_text(path), model, path)


def read_data(path: Path) -> dict[str, Any]:
    """Read the file as plain TOML data of any form. Raises BadInput where it is not TOML."""
    return _parse(read_text(path), path)


def model_of(text: str, model: type[Model], path: Path) -> Model:
    """Validate a text that was, or might have been, at `path`. Raises BadInput as `read_toml`
    does.
    """
    data = _parse(text, path)
    try:
        return model.model_validate(data)
    except ValidationError as error:
        fault, more = _first_fault(error, model, data)
        raise BadInput(f"{_place(path, line_of(text, fault.key))}: {fault.text}{more}") from None


def section_of(text: str, name: str, model: type[Model], path: Path) -> Model:
    """Validate the table `name` of a text from `path`, which was read before, as a `model` of
    its own, with the same messages.
    """
    data = _parse(text, path)[name]
    try:
        return model.model_validate(data)
    except ValidationError as error:
        fault, more = _first_fault(error, model, data)
        if fault.key:
            shown = f"{name}.{fault.text}"
        else:
            shown = f"{name}: {fault.text}"
        raise BadInput(
            f"{_place(path, line_of(text, (name, *fault.key)))}: {shown}{more}"
        ) from None


def validate(data: Mapping[str, Any], model: type[Model], where: str) -> Model:
    """Validate `data` as `model`; raises BadInput `WHERE: key: what is wrong`."""
    try:
        return model.model_validate(dict(data))
    except ValidationError as error:
        fault, more = _first_fault(error, model, dict(data))
        raise BadInput(f"{where}: {fault.text}{more}") from None


def place_of(path: Path, key: Key) -> str:
    """FILE:LINE of a key in a file that was read before; for faults that only show in comparison
    with other files.
    """
    return _place(path, line_of(read_text(path), key))


def read_text(path: Path) -> str:
    """Read the file as UTF-8 text without a byte-order mark.

    Raises BadInput as `read_bytes` does, and where it is no such text.
    """
    return decode_text(path, read_bytes(path))


def read_bytes(
    path: Path, most_bytes: int = MOST_BYTES, way_out: str = "give a smaller file"
) -> bytes:
    """Read the file.

    Raises BadInput where there is none, for devices and pipes, which may never end, and for more
    than `most_bytes`.
    """
    try:
        status = path.stat()
        if not (S_ISREG(status.st_mode) or S_ISDIR(status.st_mode)):
            raise BadInput(f"{path}: is a device or a pipe; give a file")
        if status.st_size > most_bytes:
            raise BadInput(
                f"{path}: has {status.st_size / 1e6:.0f} MB, where {most_bytes / 1e6:.0f} "
                f"MB are the most; {way_out}"
            )
        return path.read_bytes()
    except OSError as error:
        raise BadInput(f"{path}: cannot be read: {error.strerror}") from None


def decode_text(path: Path, content: bytes) -> str:
    """The content of a file as UTF-8 text without a byte-order mark. Raises BadInput."""
    try:
        # Editors on Windows write a byte-order mark, which TOML and CSV do not know.
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = content[: error.start].count(b"\n") + 1
        raise BadInput(
            f"{path}:{line}: byte 0x{content[error.start]:02x} is not UTF-8 text; save "
            "the file as UTF-8"
        ) from None


def _parse(text: str, path: Path) -> dict[str, Any]:
    if deep := _DEEP_KEY.search(text):
        line = text.count("\n", 0, deep.end()) + 1
        raise BadInput(
            f"{path}:{line}: a key has more than {MOST_LEVELS} parts; no key of these "
            "files needs more than a few levels"
        )
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise BadInput(
            f"{path}: is nested too deeply; no key of these files needs more than a few levels"
        ) from None
    except tomllib.TOMLDecodeError as error:
        located = re.match(r"(.*) \(at line (\d+), column (\d+)\)$", str(error))
        if located:
            raise BadInput(
                f"{path}:{located[2]}: not TOML at column {located[3]}: {_lower(located[1])}"
            ) from None
        # Without a position in its message, the fault is at the end of the text.
        raise BadInput(f"{path}:{len(text.splitlines())}: not TOML: {_lower(str(error))}") from None
    # Python's own limit, of the digits of a whole number.
    except ValueError as error:
        raise BadInput(
            f"{path}: holds a number that cannot be read: {_lower(str(error).partition(';')[0])}"
        ) from None


def _place(path: Path, line: int | None) -> str:
    if line:
        return f"{path}:{line}"
    return str(path)


class _Fault:
    """One error of pydantic: `key` as in the file, and the text for the user."""

    def __init__(self, error: ErrorDetails, model: type[BaseModel], data: Any) -> None:
        self.kind = error["type"]
        self.key = _key_in_file(error, data)
        self.likely: str | None = None
        in_degrees = bool(self.key) and self.key[-1] == degrees_key(str(error["loc"][-1]))
        if in_degrees:
            error = _to_degrees(error)
        message = _plain(error)
        if self.kind == "extra_forbidden":
            known = _keys_at(self.key[:-1], model, {str(part) for part in error["loc"]}, data)
            close = difflib.get_close_matches(str(self.key[-1]), known, n=1, cutoff=0.7)
            self.likely = next(iter(close), None)
            if self.likely:
                message = f"unknown key; did you mean {self.likely}?"
            else:
                message = f"unknown key; known are {', '.join(known) or 'none'}"
        if self.key:
            self.text = f"{_format_key(self.key)}: {message}"
        else:
            self.text = message


# Pydantic's messages in the words of somebody who edits a file, by pydantic's type of the error.
_IN_WORDS = {
    "missing": "missing",
    "union_tag_not_found": "{discriminator} is missing",
    "union_tag_invalid": "{discriminator} should be one of {expected_tags}, not '{tag}'",
    "tuple_type": "should be a list",
    "list_type": "should be a list",
    "model_type": "should be a table",
    "too_short": "should have {min_length} or more entries, not {actual_length}",
    "float_type": "should be a number",
    "int_type": "should be a whole number",
    "string_type": "should be text",
}


def _first_fault(error: ValidationError, model: type[BaseModel], data: Any) -> tuple[_Fault, str]:
    """The fault to report, and the number of others. An unknown key comes before all others,
    because it often explains them.

    A key that is missing only because it was misspelt counts as one fault, not two.
    """
    details = error.errors(include_url=False)
    # Unknown keys first, as below: to put each of 100,000 faults into words takes minutes.
    details.sort(key=lambda detail: detail["type"] != "extra_forbidden")
    unseen = max(len(details) - MOST_FAULTS, 0)
    faults = [_Fault(detail, model, data) for detail in details[:MOST_FAULTS]]
    explained = {(*fault.key[:-1], fault.likely) for fault in faults if fault.likely}
    faults = [fault for fault in faults if not (fault.kind == "missing" and fault.key in explained)]
    faults.sort(key=lambda fault: fault.kind != "extra_forbidden")
    more = len(faults) - 1 + unseen
    if more:
        return faults[0], f" (and {more} more)"
    return faults[0], ""


def _key_in_file(error: ErrorDetails, data: Any) -> Key:
    """Pydantic's location without the names of union members, which do not appear in the file."""
    key: Key = ()
    for index, name in enumerate(error["loc"]):
        part = name
        last = index == len(error["loc"]) - 1
        if isinstance(data, dict) and part not in data and degrees_key(str(part)) in data:
            part = str(degrees_key(str(part)))
        if isinstance(data, dict) and part in data:
            data = data[str(part)]
        elif isinstance(data, list | tuple) and isinstance(part, int) and part < len(data):
            data = data[part]
        elif not (last and error["type"] == "missing"):
            continue
        key += (part,)
    return key


def _format_key(key: Key) -> str:
    """leg.link_lengths_mm[3] for the third length, because users count from one."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            text += f".{part}"
    return text.lstrip(".")


def _plain(error: ErrorDetails) -> str:
    if error["input"] == OPEN:
        return TO_FILL_IN
    if error["type"] in _IN_WORDS:
        message = _IN_WORDS[error["type"]].format(**error.get("ctx", {}))
    else:
        message = _lower(
            error["msg"].removeprefix("Value error, ").replace("Input should be", "should be")
        )
    if isinstance(error["input"], str | int | float):
        return f"{message}, not {error['input']!r}"
    return message


def _to_degrees(error: ErrorDetails) -> ErrorDetails:
    """The error of an angle that was written in degrees and checked in radians, with its limits
    and the value as in the file.
    """
    limits = {
        name: f"{math.degrees(limit):.4g}"
        for name, limit in error.get("ctx", {}).items()
        if isinstance(limit, int | float)
    }
    if not limits:
        return error
    message = error["msg"]
    for name, in_degrees in limits.items():
        message = message.replace(f"{error['ctx'][name]:g}", in_degrees)
    return {**error, "msg": message, "input": float(f"{math.degrees(error['input']):.12g}")}


def _lower(text: str) -> str:
    return text[:1].lower() + text[1:]


class SelectedByData:
    """Base class of an annotation of a table whose section its own content selects, without
    being a union.
    """

    def section_of(self, data: Mapping[str, Any]) -> type[BaseModel] | None:
        """The class of the section that `data` selects, None where it selects none."""
        raise NotImplementedError


def _keys_at(table: Key, model: type[BaseModel], tags: set[str], data: Any) -> list[str]:
    """Keys that `model` has in that table of `data`, in the order of declaration; for a union
    those of the member that `tags` select.
    """
    members = [model]
    for part in table:
        data = data[part]
        if isinstance(part, str):
            fields = [outer.model_fields[part] for outer in members if part in outer.model_fields]
            selected = [
                mark.section_of(data)
                for field in fields
                for mark in _marks_of(field)
                if isinstance(mark, SelectedByData)
            ]
            inner = [section for section in selected if section] or [
                member for field in fields for member in _models_in(field.annotation)
            ]
            # Of a union such as [force_sensor], only the keys of the chosen device are suggested.
            members = [member for member in inner if tags & _tags_of(member)] or inner
    keys = (
        field.alias or name for member in members for name, field in member.model_fields.items()
    )
    return list(
        dict.fromkeys(
            (*keys, *(key for member in members for key in degrees_keys(member).values()))
        )
    )


def _marks_of(field: FieldInfo) -> list[Any]:
    """What the annotation of a field is marked with, also where the table is optional."""
    marks = list(field.metadata)
    for member in typing.get_args(field.annotation):
        marks += getattr(member, "__metadata__", ())
    return marks


def _tags_of(model: type[BaseModel]) -> set[str]:
    """The words by which a union may select the model."""
    return {
        str(word)
        for field in model.model_fields.values()
        for word in typing.get_args(field.annotation)
        if isinstance(word, str)
    }


def _models_in(annotation: Any) -> Iterable[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for argument in typing.get_args(annotation):
        yield from _models_in(argument)


def table(name: str, keys: Mapping[str, Any], is_exact: bool = False) -> str:
    """[name] with its keys; keys with the value None are omitted."""
    return f"[{name}]\n" + "".join(
        f"{toml_key(key)} = {format_value(value, is_exact)}\n"
        for key, value in keys.items()
        if value is not None
    )


def format_value(value: Any, is_exact: bool = False) -> str:
    """A value in TOML syntax; mappings become inline tables. Numbers have the digits that matter,
    or all of them if `is_exact`.
    """
    if isinstance(value, Mapping):
        return (
            "{ "
            + ", ".join(
                f"{toml_key(key)} = {format_value(inner, is_exact)}"
                for key, inner in value.items()
                if inner is not None
            )
            + " }"
        )
    if isinstance(value, list | tuple):
        return "[" + ", ".join(format_value(inner, is_exact) for inner in value) + "]"
    # Before int: a bool is an int in Python.
    if isinstance(value, bool):
        if value:
            return "true"
        return "false"
    if isinstance(value, str):
        return toml_string(value)
    if isinstance(value, int):
        return str(value)
    if is_exact:
        # The shortest text that reads back as the same 64-bit float.
        return repr(float(value))
    return _number(float(value))


def _number(value: float) -> str:
    """Enough digits for any fit; TOML wants a point or an exponent in a float, which numpy
    gives.
    """
    if value != 0.0 and not 1e-3 <= abs(value) < 1e5:
        return str(np.format_float_scientific(value, DECIMALS, trim="0"))
    return str(round(value, DECIMALS))
