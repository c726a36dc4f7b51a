"""Sealed truths: hashes are written first, contents where no diagnosis reads them, and opening
checks the hash.

Seed and case numbers of an exam, kept in its folder, so that only the same exam can be continued
there.
"""

import base64
import binascii
import hashlib
import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rfca_rig.errors import BadInput, RigError
from rfca_rig.exam.cases import KINDS
from rfca_rig.recording.atomic import write_atomically

Truth = Mapping[str, Any]

SEALS = "seals.txt"
FOLDER = "sealed"
ENDING = ".sealed"

FILE = "plan.json"
FORMAT = "rfca-exam-plan/1"


def seal_all(truths: Sequence[Truth], out: Path) -> None:
    """Write the hash of every truth into `seals.txt`, then each truth, not readable at a glance,
    into a separate folder.

    Do this before the first campaign is written, so that no truth can be adapted to a diagnosis. A
    truth holds its case's name.
    """
    contents = {truth["case"]: _content(truth) for truth in truths}
    lines = [
        f"{hashlib.sha256(content).hexdigest()}  {case}\n" for case, content in contents.items()
    ]
    (out / FOLDER).mkdir(parents=True, exist_ok=True)
    # The folder exists before the hashes: `is_sealed` then means that an interrupted sealing can be
    # completed.
    write_atomically(out / SEALS, "".join(lines).encode())
    for case, content in contents.items():
        write_atomically(_path(out, case), base64.encodebytes(content))


def is_sealed(out: Path) -> bool:
    """Whether the hashes exist; they are never written again."""
    return (out / SEALS).is_file()


def list_unwritten(out: Path) -> list[str]:
    """Cases with a hash whose truths were not written when the sealing was interrupted."""
    return [case for _, case in _seals(out) if not _path(out, case).is_file()]


def write_missing(truths: Sequence[Truth], out: Path) -> None:
    """Write missing truths. They are checked against their hashes when they are opened."""
    for truth in truths:
        write_atomically(_path(out, truth["case"]), base64.encodebytes(_content(truth)))


def open_all(out: Path, only: Collection[str] | None = None) -> list[dict[str, Any]]:
    """Open the truths of all cases under `out`, or `only` of these, in the order of their seals.

    Raises BadInput where one is missing or was changed.
    """
    return [_open(out, seal, case) for seal, case in _seals(out) if only is None or case in only]


def _content(truth: Truth) -> bytes:
    # Sorted keys: the same truth always has the same bytes, and so the same hash.
    return json.dumps(truth, indent=1, sort_keys=True).encode()


def _path(out: Path, case: str) -> Path:
    return out / FOLDER / f"{case}{ENDING}"


def _seals(out: Path) -> list[tuple[str, str]]:
    """(hash, case) of each line."""
    path = out / SEALS
    if not path.is_file():
        raise BadInput(f"{path}: not there; name the folder that the cases were written into")
    lines = [line.split() for line in path.read_text(encoding="utf-8").splitlines()]
    return [(seal, case) for seal, case in lines]


def _open(out: Path, seal: str, case: str) -> dict[str, Any]:
    path = _path(out, case)
    if not path.is_file():
        raise BadInput(f"{path}: not there, though {SEALS} names it; write the cases again")
    try:
        content = base64.decodebytes(path.read_bytes())
    # Empty content fails the comparison of hashes below, whose message also fits a damaged file.
    except binascii.Error:
        content = b""
    if hashlib.sha256(content).hexdigest() != seal:
        raise BadInput(f"{path}: is not what was sealed; write the cases again")
    opened: dict[str, Any] = json.loads(content)
    return opened


@dataclass(frozen=True)
class ExamPlan:
    """Seed and number of cases of each kind. Raises BadInput for an unknown kind."""

    seed: int
    numbers: Mapping[str, int]

    def __post_init__(self) -> None:
        unknown = set(self.numbers) - set(KINDS)
        if unknown:
            raise BadInput(f"kind {sorted(unknown)[0]!r} is unknown; there are {', '.join(KINDS)}")

    @property
    def words(self) -> str:
        """As in "seed 1, 500 cases"."""
        kinds = [kind for kind, number in self.numbers.items() if number]
        text = f"seed {self.seed}, {sum(self.numbers.values())} cases"
        if len(kinds) == 1:
            text += f" of the kind {kinds[0]!r}"
        return text


def _drop_zeros(numbers: Mapping[str, int]) -> dict[str, int]:
    """A kind with zero cases is the same as a kind that is not listed."""
    return {kind: number for kind, number in numbers.items() if number}


def begin(folder: Path, plan: ExamPlan) -> None:
    """Create the folder with the plan, or check that it holds the same plan. Raises BadInput
    where `folder` holds anything else.
    """
    path = folder / FILE
    if path.is_file():
        begun = read_plan(folder)
        if plan.seed != begun.seed or _drop_zeros(plan.numbers) != _drop_zeros(begun.numbers):
            raise BadInput(
                f"{folder}: holds an exam with {begun.words}, not {plan.words}; ask for "
                "the same again, or name a new folder"
            )
        return
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise BadInput(
            f"{folder}: is not empty, and holds no exam that could be continued; name a new folder"
        )
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RigError(f"{folder}: cannot be made: {error.strerror}; name another folder") from None
    content = {"format": FORMAT, "seed": plan.seed, "numbers": dict(plan.numbers)}
    write_atomically(path, (json.dumps(content, indent=1) + "\n").encode())


def read_plan(folder: Path) -> ExamPlan:
    """The plan of an exam's folder. Raises BadInput where there is none that can be read."""
    path = folder / FILE
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if content["format"] != FORMAT:
            raise BadInput(
                f"{path}: format {content['format']!r} should be {FORMAT!r}; name a new folder"
            )
        return ExamPlan(
            int(content["seed"]), {kind: int(number) for kind, number in content["numbers"].items()}
        )
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise BadInput(
            f"{path}: is not the plan of an exam ({type(error).__name__}: {error}); name "
            "a new folder"
        ) from None
