"""Files that a model file names: parts that it includes, meshes, textures, height fields. MuJoCo
would read them from anywhere.

Also numbers in these texts that are none: MuJoCo takes a mass of "nan" for one that was not given,
and computes another.

MuJoCo's own reader of XML is more lenient than others, so the text is searched instead of parsed:
every attribute that may name a file counts, wherever it stands.
"""

import os
import re
from collections.abc import Iterable
from html import unescape
from math import inf, isfinite
from pathlib import Path

from rfca_rig.errors import BadInput
from rfca_rig.recording.outside import refuse_outside

# file, filename of URDF, fileright and its like of a texture; and the folders that such names begin
# in.
_NAMES_A_FILE = re.compile(rb"""\bfile\w*\s*=\s*(?:"([^"]*)"|'([^']*)')""")
_NAMES_A_FOLDER = re.compile(rb"""\b(?:mesh|texture|asset)dir\s*=\s*(?:"([^"]*)"|'([^']*)')""")
# Of URDF; MuJoCo takes what follows it as a path.
_SCHEME = re.compile(r"^(?:package|file)://")
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)
_ELEMENT = re.compile(rb"<\s*([A-Za-z_][\w.:-]*)([^<>]*)>")
_ATTRIBUTE = re.compile(rb"""([A-Za-z_][\w.:-]*)\s*=\s*(?:"([^"]*)"|'([^']*)')""")
# As C reads them, which knows more than Python does. The first is a quick look at a whole file.
_MAY_BE_NOT_FINITE = re.compile(rb"nan|inf|e\+?\d{3}|&#", re.IGNORECASE)
_NOT_FINITE = re.compile(r"[+-]?(?:nan(?:\(\w*\))?|inf(?:inity)?)", re.IGNORECASE)

# A humanoid has 200 meshes in two folders, and its parts include each other three deep.
MOST_PLACES = 100_000
MOST_LEVELS = 20


def find_named_files(model: Path, folders: tuple[Path, ...] | None) -> set[Path]:
    """The model, and all files that it and the files that it includes may name.

    Raises BadInput where one is outside all of the folders; with None they may be anywhere.
    """
    names: set[str] = set()
    bases = {model.parent}
    files = {model}
    to_search = [model]
    for _ in range(MOST_LEVELS):
        for path in to_search:
            content = path.read_bytes()
            names |= _values(_NAMES_A_FILE, content)
            # A part may name its own parts from its own folder, and the folders of all meshes.
            bases.add(path.parent)
            for folder in _values(_NAMES_A_FOLDER, content):
                bases |= {file.parent for file in _shorten(model.parent / folder / "file")}
        if len(names) * len(bases) > MOST_PLACES:
            raise BadInput(
                f"{model}: names {len(names)} files in {len(bases)} folders; more than "
                f"{MOST_PLACES} places are not searched"
            )
        to_search = sorted(_existing(model, bases, names) - files)
        if folders is not None:
            refuse_outside(to_search, folders)
        if not to_search:
            return files
        files.update(to_search)
    raise BadInput(f"{model}: files that it includes include others, more than {MOST_LEVELS} deep")


def refuse_non_finite(files: Iterable[Path]) -> None:
    """Raises BadInput where an attribute in one of the files, of whatever element, holds a
    number that is not finite.
    """
    for path in sorted(files):
        content = path.read_bytes()
        # Meshes and textures are no XML.
        if content.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<") and _MAY_BE_NOT_FINITE.search(
            content
        ):
            _refuse_non_finite_attributes(path, content)


def _refuse_non_finite_attributes(path: Path, content: bytes) -> None:
    # A comment leaves its line breaks behind, so that the lines keep their numbers.
    content = _COMMENT.sub(lambda comment: b"\n" * comment[0].count(b"\n"), content)
    for element in _ELEMENT.finditer(content):
        for attribute in _ATTRIBUTE.finditer(element[2]):
            text = unescape(
                (attribute[2] or attribute[3] or b"").decode("utf-8", "surrogateescape")
            )
            if not _holds_non_finite(text):
                continue
            line = content.count(b"\n", 0, element.start(2) + attribute.start()) + 1
            name = attribute[1].decode()
            if name in ("name", "class"):
                remedy = "rename it"
            else:
                remedy = "give a finite number, or remove the attribute"
            raise BadInput(
                f"{path}:{line}: {element[1].decode()}: {name} is {text!r}, which is no "
                f"finite number; {remedy}"
            )


def _holds_non_finite(text: str) -> bool:
    """Whether the text is a list of numbers, one of which is not finite."""
    try:
        numbers = [inf if _NOT_FINITE.fullmatch(word) else float(word) for word in text.split()]
    except ValueError:
        return False
    return not all(map(isfinite, numbers))


def _values(pattern: re.Pattern[bytes], content: bytes) -> set[str]:
    """The values of these attributes, as they stand and with their entities replaced; MuJoCo
    takes / and \\ alike.
    """
    texts = {
        (double_quoted or other).decode("utf-8", "surrogateescape")
        for double_quoted, other in pattern.findall(content)
    }
    plain = {_SCHEME.sub("", text).replace("\\", "/") for text in texts | set(map(unescape, texts))}
    return {text for text in plain if text and "\0" not in text}


def _existing(model: Path, bases: set[Path], names: set[str]) -> set[Path]:
    """Every file that one of these names can mean. With `strippath`, the default of URDF, only
    the last part of a name counts.
    """
    parts = names | {Path(name).name for name in names}
    places = {base / part for base in bases for part in parts if part}
    shortened = set().union(*map(_shorten, places))
    for path in shortened:
        # Reading one may wait for ever. As for files below, no error for any path, however long.
        if os.path.exists(path) and not os.path.isfile(path) and not os.path.isdir(path):  # noqa: PTH110, PTH112, PTH113
            raise BadInput(f"{model}: names {path}, a device or a pipe; name a file")
    return {path for path in shortened if os.path.isfile(path)}  # noqa: PTH113 - False for any path, however long


def _shorten(path: Path) -> set[Path]:
    """The path without "..": as the text of the path says, and as the system follows the links
    in it; libraries differ in this.
    """
    if ".." not in path.parts:
        return {path}
    return {Path(os.path.normpath(path)), Path(os.path.realpath(path.parent)) / path.name}
