"""Edits of a finished run: at random places of random files, and of whole files. Each must be
found, and check and recover must agree.
"""

import itertools
import shutil
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path

import numpy as np

from rfca_rig.cli.commands.check import recover
from rfca_rig.errors import BadInput
from rfca_rig.recording import run_folder
from rfca_rig.recording.backend import InProcessRecorder
from rfca_rig.recording.checking import REMADE, check_run, describe_damage
from rfca_rig.recording.run_text import Ending, write_ending
from tests.recording.growing import exhaust, hand_over, header, run_blocks

Change = Callable[[bytes, np.random.Generator], bytes]
# Bytes that an insertion, a deletion or a block of zeros has at most.
MOST_BYTES = 64
SUMS = "SHA256SUMS"


def finish_run(folder: Path, stages: Sequence[int], older: Path | None = None) -> None:
    """A finished run of these stages of `growing`, with a photo; `older` keeps its files as they
    were before the end.
    """
    run_folder.create(folder, header())
    keeper = InProcessRecorder(folder)
    for number in stages:
        exhaust(hand_over(keeper, number, run_blocks(number)[-1]))
    if older is not None:
        shutil.copytree(folder, older)
    keeper.finish("done")
    write_ending(folder, Ending({"ended": "done"}, run_folder.read_stages(folder).static))
    run_folder.build_recording(folder)


def _flip(content: bytes, rng: np.random.Generator) -> bytes:
    changed = bytearray(content)
    changed[rng.integers(len(content))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _insert(content: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(len(content) + 1))
    return content[:at] + rng.bytes(int(rng.integers(1, MOST_BYTES))) + content[at:]


def _delete(content: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(len(content)))
    return content[:at] + content[at + int(rng.integers(1, MOST_BYTES)) :]


def _truncate(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: int(rng.integers(len(content)))]


def _append(content: bytes, rng: np.random.Generator) -> bytes:
    return content + (
        b"\n" if rng.integers(4) == 0 else rng.bytes(int(rng.integers(1, MOST_BYTES)))
    )


def _zero(content: bytes, rng: np.random.Generator) -> bytes:
    at = int(rng.integers(len(content)))
    length = int(rng.integers(1, MOST_BYTES))
    return content[:at] + bytes(len(content[at : at + length])) + content[at + length :]


def _drop_line(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.splitlines(keepends=True)
    del lines[int(rng.integers(len(lines)))]
    return b"".join(lines)


CHANGES: tuple[Change, ...] = (_flip, _insert, _delete, _truncate, _append, _zero, _drop_line)


@dataclass(frozen=True)
class Edit:
    """`apply` changes the run in a folder."""

    name: str
    apply: Callable[[Path], object]


def random_edits(run: Path, count: int, seed: int) -> Iterator[Edit]:
    """Changes of one file each, which change it indeed."""
    rng = np.random.default_rng(seed)
    files = files_of(run)
    for number in range(count):
        file = files[number % len(files)]
        change = CHANGES[int(rng.integers(len(CHANGES)))]
        before = (run / file).read_bytes()
        while (after := change(before, rng)) == before:
            change = CHANGES[int(rng.integers(len(CHANGES)))]
        yield Edit(
            f"{number} {change.__name__} {file}",
            lambda folder, file=file, after=after: (folder / file).write_bytes(after),
        )


def files_of(run: Path) -> list[str]:
    return sorted(file.relative_to(run).as_posix() for file in run.rglob("*") if file.is_file())


def whole_file_edits(run: Path, other: Path, older: Path) -> Iterator[Edit]:
    """Files that are removed, emptied, renamed, of another run, of before the end; one or two at
    a time.
    """
    files = files_of(run)
    yield from _spoil_a_file(files)
    yield from _spoil_two_files(files)
    yield from _mix_with_another_run(_list_differing(files, run, other), other)
    yield from _mix_with_before_the_end(_list_differing(files, run, older), older)
    for place in ("stages", "photos"):
        yield Edit(f"remove {place}", lambda folder, place=place: shutil.rmtree(folder / place))


def _spoil_a_file(files: Sequence[str]) -> Iterator[Edit]:
    for name in files:
        yield Edit(f"remove {name}", remove(name))
        yield Edit(f"empty {name}", lambda folder, name=name: (folder / name).write_bytes(b""))
        yield Edit(
            f"rename {name}",
            lambda folder, name=name: (folder / name).rename(folder / f"{name}.bak"),
        )


def _spoil_two_files(files: Sequence[str]) -> Iterator[Edit]:
    for first, second in itertools.combinations(files, 2):
        yield Edit(f"remove {first} and {second}", remove(first, second))
        kept = f"{first}.kept"
        swap = apply_all(
            copy_within(first, kept), copy_within(second, first), move_within(kept, second)
        )
        yield Edit(f"swap {first} and {second}", swap)


def _mix_with_another_run(files: Sequence[str], other: Path) -> Iterator[Edit]:
    for name in files:
        yield Edit(f"{name} of another run", copy_from(other, name))
        without_hashes = copy_from(other, name)
        if name != SUMS:
            without_hashes = apply_all(without_hashes, remove(SUMS))
        yield Edit(f"{name} of another run, without hashes", without_hashes)
    for first, second in itertools.combinations(files, 2):
        yield Edit(f"{first} and {second} of another run", copy_from(other, first, second))


def _mix_with_before_the_end(files: Sequence[str], older: Path) -> Iterator[Edit]:
    for name in files:
        yield Edit(f"{name} of before the end", copy_from(older, name))
        yield Edit(
            f"{name} of before the end, without hashes",
            apply_all(copy_from(older, name), remove(SUMS)),
        )


def _list_differing(files: Sequence[str], run: Path, other: Path) -> list[str]:
    """The files that both runs have, with different content."""
    return [
        name
        for name in files
        if (other / name).is_file() and (other / name).read_bytes() != (run / name).read_bytes()
    ]


def remove(*names: str) -> Callable[[Path], object]:
    return lambda folder: [(folder / name).unlink() for name in names]


def copy_from(place: Path, *names: str) -> Callable[[Path], object]:
    return lambda folder: [shutil.copy(place / name, folder / name) for name in names]


def copy_within(name: str, to: str) -> Callable[[Path], object]:
    return lambda folder: shutil.copy(folder / name, folder / to)


def move_within(name: str, to: str) -> Callable[[Path], object]:
    return lambda folder: (folder / name).replace(folder / to)


def apply_all(*edits: Callable[[Path], object]) -> Callable[[Path], object]:
    return lambda folder: [edit(folder) for edit in edits]


def find_fault(run: Path, edit: Edit, place: Path) -> str:
    """What check or recover do wrong after the edit; "" where nothing."""
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(run, place)
    edit.apply(place)
    findings = list(check_run(place))
    damaged = {finding.file for finding in findings if not finding.is_sound}
    if not damaged:
        return "not found"
    words = describe_damage(place, findings)
    answer = _recover(place)
    if f"rfca-rig recover {place}" not in words:
        if answer == words:
            return ""
        return f"check says {words!r}, recover {answer!r}"
    if answer:
        return f"check names recover, which says {answer!r}"
    left = {finding.file for finding in check_run(place) if not finding.is_sound}
    if not left <= damaged - set(REMADE):
        return f"damaged after recover: {sorted(left)}"
    again = _recover(place)
    if left or again.endswith("is whole; there is nothing to recover"):
        return ""
    return f"recover, typed again, says {again!r}"


def _recover(folder: Path) -> str:
    """What it refuses; "" where it did it."""
    try:
        with redirect_stdout(StringIO()), redirect_stderr(StringIO()):
            recover(folder, as_json=True)
    except BadInput as error:
        return str(error)
    return ""
