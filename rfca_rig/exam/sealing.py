"""Truths under seal: hashes first, contents where no diagnosis reads, opened only against the hash."""

import base64
import binascii
import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput

Truth = Mapping[str, Any]

SEALS, FOLDER, ENDING = "seals.txt", "sealed", ".sealed"


def seal_all(truths: Sequence[Truth], out: Path) -> None:
    """Writes the hash of every truth into `seals.txt`, then each truth, not readable at a glance, into a folder of its own.

    Done before the first campaign is written, so that nothing can be fitted to what a diagnosis said. A truth holds its case's name.
    """
    contents = {truth["case"]: json.dumps(truth, indent=1, sort_keys=True).encode() for truth in truths}
    lines = [f"{hashlib.sha256(content).hexdigest()}  {case}\n" for case, content in contents.items()]
    (out / FOLDER).mkdir(parents=True)
    (out / SEALS).write_text("".join(lines), encoding="utf-8")
    for case, content in contents.items():
        (out / FOLDER / f"{case}{ENDING}").write_bytes(base64.encodebytes(content))


def open_all(out: Path) -> list[dict[str, Any]]:
    """The truths of all cases under `out`, in the order of their seals. Raises BadInput where one is missing or was changed."""
    path = out / SEALS
    if not path.is_file():
        raise BadInput(f"{path}: not there; name the folder that the cases were written into")
    return [_opened(out, *line.split()) for line in path.read_text(encoding="utf-8").splitlines()]


def _opened(out: Path, seal: str, case: str) -> dict[str, Any]:
    path = out / FOLDER / f"{case}{ENDING}"
    if not path.is_file():
        raise BadInput(f"{path}: not there, though {SEALS} names it; write the cases anew")
    try:
        content = base64.decodebytes(path.read_bytes())
    except binascii.Error:
        content = b""
    if hashlib.sha256(content).hexdigest() != seal:
        raise BadInput(f"{path}: is not what was sealed; write the cases anew")
    opened: dict[str, Any] = json.loads(content)
    return opened
